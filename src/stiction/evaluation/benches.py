"""Friction identified on benches as input of walks: a robot's own, or a virtual one's, fed forward or observed.

On the robot of the data sheet both are the level of the walk itself; on a virtual robot, they are identified from the
log of its own bench, in the same engine and at the same level. The true friction is used only for `true`. For a joint
that a bench did not identify, the mean of its kind is fed forward, or nothing, and a policy observes the nominal
friction of its training; the summary notes it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.core.cache import has_entry
from stiction.core.errors import ConfigurationError, FileError, PolicyError, unknown_name
from stiction.core.lock import output_folder
from stiction.core.parallel import spread
from stiction.evaluation.grid import GridCfg, Walk, plan_forward
from stiction.evaluation.policies import known_to, nominal_known, parse_source
from stiction.evaluation.rollout import friction_at
from stiction.files.bam import load_all_joints, load_joints
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.joints import JointsFile
from stiction.files.known_friction import BenchFriction, bench_friction, kind_average
from stiction.joints.compensation import LOAD_LAW, parse_compensation
from stiction.robots.model import Robot
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw

if TYPE_CHECKING:
    # It imports all of identification, which takes a second; a walk without a bench does not need it.
    from stiction.virtual.bench import Bench

BENCH_WORK = "benches"
"""Name of this work in calls of `progress`."""


def as_identified(cfg: GridCfg, bundles: Sequence[Bundle], paths: Sequence[Path]) -> tuple[GridCfg, tuple[str, ...]]:
    """Return the grid at the friction in `joints.json` files, one level, the joints' mean f/τ_max, and notes.

    A joint without a valid record has the mean of its kind. Raises `StictionError`: a kind without any, policies of
    several robots, a virtual robot, or a mean that is no level.
    """
    robots = {(c.joint_names, c.torque_limit): c for c in (bundle.contract for bundle in bundles)}
    if len(robots) > 1 or any(each.cell for each in cfg.simulators):
        raise ConfigurationError("--joints: got several robots, or a virtual one, expected the data sheet's robot of "
                                 "one identification; evaluate others without it")  # fmt: skip
    (contract,) = robots.values()
    unknown, limits = np.full(len(set(contract.kinds)), np.nan), contract.array("torque_limit")
    bench = bench_friction(load_all_joints(paths), contract.joint_names, contract.kinds, limits, unknown)
    if lacking := [kind for kind, share in bench.share.items() if np.isnan(share)]:
        raise FileError(f"--joints: got no valid dry friction of {', '.join(lacking)}, expected that of each kind of "
                        "joint; identify them, and name all files")  # fmt: skip
    shares = np.array([bench.joints[name] for name in contract.joint_names])
    level = float(f"{shares.mean():g}")
    shape = tuple((shares / level).tolist()) if level else ()
    return replace(cfg, base=replace(cfg.base, friction_levels=(level,), friction_shape=shape)), bench.notes


def case_of(walk: Walk) -> Case | None:
    """Return the virtual robot of a walk; None for the robot of the data sheet."""
    if walk.robot is None or walk.simulator.cell is None:
        return None
    return Case(walk.robot, walk.simulator.cell, parse_level(walk.level))


def bench_of(walk: Walk, spec: Robot) -> Bench | None:
    """Return the bench of the robot of a walk; None for the robot of the data sheet."""
    case = case_of(walk)
    if case is None:
        return None
    from stiction.virtual.bench import Bench

    return Bench(walk.simulator.spec.name, case, spec)


def all_identified(benches: Iterable[Bench], out: Path) -> bool:
    """Return True if every robot was on its bench; out: as of `identify_on_benches`."""
    return all(has_entry(out / bench.label, bench.key) for bench in benches)


def identify_on_benches(
    benches: Iterable[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> None:
    """Identify the robots that were not on their bench yet, each in a folder of `out`.

    jobs: processes at once; they do not change the result. Raises `StictionError` where a file cannot be written.
    """
    missing = {bench.label: bench for bench in benches if not all_identified([bench], out)}
    if not missing:
        return
    from stiction.virtual.bench import identify_on_bench

    # Spare processes help with the joints of the benches.
    workers = max(1, jobs // len(missing))
    tasks = [(bench, out / label, workers) for label, bench in missing.items()]
    with output_folder(out):
        for count, _ in enumerate(spread(identify_on_bench, tasks, jobs), 1):
            progress(BENCH_WORK, count / len(missing))


def with_known_friction(
    walks: Sequence[Walk],
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> list[Walk]:
    """Return the walks, with the friction that policies observing their joints' friction receive.

    Robots are put on their benches first; arguments as of `identify_on_benches`. Raises `StictionError`.
    """
    identify_on_benches(benches_of(walks, bundles, cfg, robot), out, jobs, progress)
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    specs = {name: robot_of(contract, robot) for name, contract in contracts.items()}
    known: dict[tuple[Any, ...], tuple[float, ...] | None] = {}
    updated = []
    for walk in walks:
        same = walk.policy, walk.simulator, walk.level, walk.robot
        if same not in known:
            known[same] = _known(walk, contracts[walk.policy], specs[walk.policy], cfg, out)
        updated.append(replace(walk, known=known[same]))
    return updated


def _known(walk: Walk, contract: Contract, spec: Robot, cfg: GridCfg, out: Path) -> tuple[float, ...] | None:
    """Return the friction observed by the policy of a walk; None: that of its contract, or none."""
    source, case, bench, law = parse_source(cfg.base.known_friction), case_of(walk), bench_of(walk, spec), cfg.base.law
    if not contract.observes_friction or source.source == "contract":
        return None
    if case is None or bench is None:
        known = known_to(contract, spec, source, law, friction_at(contract, np.array([float(walk.level)]), law))
        assert known is not None
        share = known[0]
    elif source.source == "true":
        share = source.factor * true_friction(case, spec)
    elif source.source == "bench":
        share = source.factor * _identified(bench, contract, out).array
    else:
        share = np.full(len(spec.joint_kinds), source.source)
    return tuple(share.tolist())


def true_friction(case: Case, spec: Robot) -> np.ndarray:
    """Return the mean f/τ_max over the joints of each kind of a virtual robot without load, shape (kinds,)."""
    friction = case.coulomb(draw(spec, case.seed), spec) / spec.joint_values("torque_limit")
    return friction @ kind_average([joint.kind for joint in spec.joints])


def _bench_file(bench: Bench, out: Path) -> JointsFile:
    """Return the joints.json of a bench. Raises `StictionError` where the file cannot be read."""
    from stiction.virtual.bench import JOINTS

    return load_joints(out / bench.label / JOINTS)


def _identified(bench: Bench, contract: Contract, out: Path) -> BenchFriction:
    """Return the identified friction of each kind of joint on a bench."""
    file, spec = _bench_file(bench, out), bench.spec
    return bench_friction(
        file, spec.joint_names, contract.kinds, spec.joint_values("torque_limit"), nominal_known(contract, spec)
    )


def benches_of(walks: Iterable[Walk], bundles: Sequence[Bundle], cfg: GridCfg, robot: str | None = None) -> list[Bench]:
    """Return the benches needed by `with_known_friction`, each once."""
    if parse_source(cfg.base.known_friction).source != "bench":
        return []
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.contract.observes_friction}
    benches = [bench_of(walk, specs[walk.policy]) for walk in walks if walk.policy in specs]
    return list({bench.label: bench for bench in benches if bench is not None}.values())


def unidentified_notes(
    walks: Collection[Walk], bundles: Sequence[Bundle], cfg: GridCfg, out: Path, robot: str | None = None
) -> list[str]:
    """Return a note for every friction that a finished bench did not identify, with the value used instead."""
    notes = [
        f"friction of {bench.label} for {bundle.name}: {note}"
        for bundle in bundles
        for bench in benches_of([walk for walk in walks if walk.policy == bundle.name], bundles, cfg, robot)
        if all_identified([bench], out)
        for note in _identified(bench, bundle.contract, out).notes
    ]
    return list(dict.fromkeys(notes))


def forward_walks(
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> list[Walk]:
    """Return the walks of `cfg.forward` with their friction, without those where the bench identified no joint.

    Arguments as of `with_known_friction`. Raises `StictionError` for unknown names and for policies with compensation.
    """
    by_name = {bundle.name: bundle for bundle in bundles}
    for name in cfg.forward:
        if name not in by_name:
            raise ConfigurationError(f"friction fed forward: {unknown_name('policy', name, by_name)}")
        if by_name[name].contract.compensation is not None:
            raise PolicyError(f"{name} already compensates friction in its targets; remove it from --forward")
    benches = _forward_benches(bundles, cfg, robot)
    identify_on_benches([bench for bench in benches.values() if bench is not None], out, jobs, progress)
    identified = {bench.label: fed_friction(bench, out) for bench in benches.values() if bench is not None}
    walks = []
    for walk, bench in benches.items():
        if bench is None:
            limit = robot_of(by_name[walk.policy].contract, robot).joint_values("torque_limit")
            fed_arrays = fed_at_level(cfg.base.law.name, float(walk.level), limit)
            friction, load = (None if part is None else tuple(part.tolist()) for part in fed_arrays)
            walks.append(replace(walk, forward=friction, forward_load=load))
        elif not (fed := identified[bench.label]).nothing:
            loaded = fed.load is not None and parse_compensation(walk.forward_by).feeds_load
            forward = {"forward": fed.unloaded, "forward_load": fed.load} if loaded else {"forward": fed.friction}
            walks.append(replace(walk, **forward))
    return walks


def fed_at_level(law: str, level: Any, torque_limit: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return f [N m] and c [1] of every joint to feed forward where its friction is a level of a law."""
    if law == LOAD_LAW:
        load = level * np.ones_like(torque_limit)
        return np.zeros_like(load), load
    return level * torque_limit, None


def _forward_benches(bundles: Sequence[Bundle], cfg: GridCfg, robot: str | None) -> dict[Walk, Bench | None]:
    """Return the walks planned with friction fed forward, still without it, and the bench of the robot of each."""
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.name in cfg.forward}
    return {walk: bench_of(walk, specs[walk.policy]) for walk in plan_forward(cfg)}


@dataclass(frozen=True)
class Fed:
    """Friction fed forward on one robot, and the joints that its bench did not identify."""

    friction: tuple[float, ...]
    """Friction of every joint for a way without `load` [N m]; it includes the load's share on the bench."""
    unloaded: tuple[float, ...]
    """Friction of every joint for a way that also feeds `load` [N m]."""
    load: tuple[float, ...] | None
    """Friction per motor torque of every joint [1], 0 where unknown; None: unknown for all joints."""
    borrowed: tuple[str, ...]
    """Joints with the mean of the other joints of their kind."""
    without: tuple[str, ...]
    """Joints of kinds without any identified joint; nothing is fed there."""
    why: str
    """First reason of an unidentified joint; empty without any."""

    @property
    def nothing(self) -> bool:
        """True if the bench identified no joint."""
        return len(self.without) == len(self.friction)


def fed_friction(bench: Bench, out: Path) -> Fed:
    """Return the friction of every joint identified on a bench. Raises `StictionError` for an unreadable file."""
    file, why = _bench_file(bench, out), {}
    identified: dict[str, tuple[float, float, float]] = {}
    for joint in bench.spec.joints:
        try:
            identified[joint.name] = file.fed_forward(joint.name)
        except FileError as error:
            why[joint.name] = str(error)
    kinds = {joint.name: joint.kind for joint in bench.spec.joints}
    of_kind = {kind: [value for name, value in identified.items() if kinds[name] == kind] for kind in kinds.values()}
    borrowed = tuple(name for name in why if of_kind[kinds[name]])
    means = {kind: np.mean(values or [(0.0, 0.0, 0.0)], axis=0) for kind, values in of_kind.items()}
    fed = np.array([identified.get(name, means[kind]) for name, kind in kinds.items()])
    friction, unloaded, load = (tuple(column.tolist()) for column in fed.T)
    return Fed(
        friction,
        unloaded,
        load if any(load) else None,
        borrowed,
        tuple(name for name in why if name not in borrowed),
        next(iter(why.values()), ""),
    )


def forward_notes(bundles: Sequence[Bundle], cfg: GridCfg, out: Path, robot: str | None = None) -> list[str]:
    """Return a note for every robot whose finished bench did not identify the friction of all joints."""
    benches = {bench.label: bench for bench in _forward_benches(bundles, cfg, robot).values() if bench is not None}
    notes = []
    for label, bench in benches.items():
        if not all_identified([bench], out):
            continue
        fed = fed_friction(bench, out)
        if fed.nothing:
            notes.append(f"feed-forward skipped on {label}, no joint was identified: {fed.why}")
        elif fed.why:
            parts = {"mean of its kind": fed.borrowed, "none": fed.without}
            fallback = "; ".join(f"{', '.join(names)} ({value})" for value, names in parts.items() if names)
            notes.append(f"feed-forward on {label} is as identified, except {fallback}: {fed.why}")
    return notes
