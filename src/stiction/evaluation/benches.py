"""What virtual robots' benches identify, as input of a walk: friction fed forward, and friction that a policy observes.

On the robot of the data sheet both are the level of the walk itself; on a virtual robot, what identification made of
the log of its own bench, in the same engine and at the same level. Its truth is read where `true` is asked for. Where a
bench does not identify a joint, the mean of its kind is fed forward there, or nothing, and a policy is given the
nominal friction of its training; a summary says so.
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
from stiction.files.bam import load_joints
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.joints import JointsFile
from stiction.files.known_friction import BenchFriction, bench_friction, kind_average
from stiction.joints.compensation import LOAD_LAW, parse_compensation
from stiction.robots.model import Robot
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw

if TYPE_CHECKING:
    # With it comes all of identification, a second of imports that a walk without a bench does not need.
    from stiction.virtual.bench import Bench

BENCH_WORK = "benches"


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
    """Return whether every robot was on its bench; `out` as of `identify_on_benches`."""
    return all(has_entry(out / bench.label, bench.key) for bench in benches)


def identify_on_benches(
    benches: Iterable[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> None:
    """Identify the robots that were not on their bench yet, in folders of `out`.

    jobs: processes at once; they do not change the result. Raises `StictionError` where a file cannot be written.
    """
    missing = {bench.label: bench for bench in benches if not all_identified([bench], out)}
    if not missing:
        return
    from stiction.virtual.bench import identify_on_bench

    # Processes that have no bench of their own help with the joints of the others.
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
    """Return walks, those of policies that observe their joints' friction with the friction that they are given.

    Robots are put on their benches first; arguments as of `identify_on_benches`. Raises `StictionError`.
    """
    identify_on_benches(benches_of(walks, bundles, cfg, robot), out, jobs, progress)
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    specs = {name: robot_of(contract, robot) for name, contract in contracts.items()}
    known: dict[tuple[Any, ...], tuple[float, ...] | None] = {}
    told = []
    for walk in walks:
        same = walk.policy, walk.simulator, walk.level, walk.robot
        if same not in known:
            known[same] = _known(walk, contracts[walk.policy], specs[walk.policy], cfg, out)
        told.append(replace(walk, known=known[same]))
    return told


def _known(walk: Walk, contract: Contract, spec: Robot, cfg: GridCfg, out: Path) -> tuple[float, ...] | None:
    """Return the friction that the policy of a walk is given; None: what its contract says, or none."""
    given, case, bench, law = parse_source(cfg.base.known_friction), case_of(walk), bench_of(walk, spec), cfg.base.law
    if not contract.observes_friction or given.source == "contract":
        return None
    if case is None or bench is None:
        known = known_to(contract, spec, given, law, friction_at(contract, np.array([float(walk.level)]), law))
        assert known is not None
        share = known[0]
    elif given.source == "true":
        share = given.factor * true_friction(case, spec)
    elif given.source == "bench":
        share = given.factor * _identified(bench, contract, out).array
    else:
        share = np.full(len(spec.joint_kinds), given.source)
    return tuple(share.tolist())


def true_friction(case: Case, spec: Robot) -> np.ndarray:
    """Return the mean f/τ_max over the joints of each kind that a virtual robot has without load, shape (kinds,)."""
    friction = case.coulomb(draw(spec, case.seed), spec) / spec.joint_values("torque_limit")
    return friction @ kind_average([joint.kind for joint in spec.joints])


def _found(bench: Bench, out: Path) -> JointsFile:
    """Return what a bench identified. Raises `StictionError` where the file cannot be read."""
    from stiction.virtual.bench import JOINTS

    return load_joints(out / bench.label / JOINTS)


def _identified(bench: Bench, contract: Contract, out: Path) -> BenchFriction:
    """Return the friction of each kind of joint that a bench identified."""
    file, spec = _found(bench, out), bench.spec
    return bench_friction(
        file, spec.joint_names, contract.kinds, spec.joint_values("torque_limit"), nominal_known(contract, spec)
    )


def benches_of(walks: Iterable[Walk], bundles: Sequence[Bundle], cfg: GridCfg, robot: str | None = None) -> list[Bench]:
    """Return the benches on which robots must be before `with_known_friction` knows what to give, each once."""
    if parse_source(cfg.base.known_friction).source != "bench":
        return []
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.contract.observes_friction}
    found = [bench_of(walk, specs[walk.policy]) for walk in walks if walk.policy in specs]
    return list({bench.label: bench for bench in found if bench is not None}.values())


def unidentified_notes(
    walks: Collection[Walk], bundles: Sequence[Bundle], cfg: GridCfg, out: Path, robot: str | None = None
) -> list[str]:
    """Return a sentence for every friction that a bench, of those done, did not identify, and what is in its place."""
    notes = [
        f"On {bench.label}, as {bundle.name} is told it: {note}"
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
    """Return the walks of `cfg.forward`, each with the friction that is fed forward, but where a bench identified none.

    Arguments as of `with_known_friction`. Raises `StictionError` for unknown names and policies that compensate.
    """
    by_name = {bundle.name: bundle for bundle in bundles}
    for name in cfg.forward:
        if name not in by_name:
            raise ConfigurationError(f"friction fed forward: {unknown_name('policy', name, by_name)}")
        if by_name[name].contract.compensation is not None:
            raise PolicyError(f"{name} compensates friction in its targets; it cannot be fed forward once more")
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
    """Return f [N m] and c [1] of every joint that are fed forward where its friction is a level of a law."""
    if law == LOAD_LAW:
        load = level * np.ones_like(torque_limit)
        return np.zeros_like(load), load
    return level * torque_limit, None


def _forward_benches(bundles: Sequence[Bundle], cfg: GridCfg, robot: str | None) -> dict[Walk, Bench | None]:
    """Return the walks with friction fed forward, without it, and the bench of the robot of each."""
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.name in cfg.forward}
    return {walk: bench_of(walk, specs[walk.policy]) for walk in plan_forward(cfg)}


@dataclass(frozen=True)
class Fed:
    """What is fed forward on one robot, and where its bench left something open."""

    friction: tuple[float, ...]
    """Of every joint, by a way that knows no load [N m]: it has in it what the load on the bench made."""
    unloaded: tuple[float, ...]
    """Of every joint, by a way that feeds `load` beside it [N m]."""
    load: tuple[float, ...] | None
    """Friction per torque of the motor of every joint [1], 0 where none was found; None: nowhere."""
    borrowed: tuple[str, ...]
    """Joints that have the mean of those of their kind."""
    without: tuple[str, ...]
    """Joints of kinds of which the bench identified none; nothing is fed there."""
    why: str

    @property
    def nothing(self) -> bool:
        """Whether the bench identified no joint at all."""
        return len(self.without) == len(self.friction)


def fed_friction(bench: Bench, out: Path) -> Fed:
    """Return the friction of every joint as a bench identified it. Raises `StictionError` for an unreadable file."""
    file, why = _found(bench, out), {}
    found: dict[str, tuple[float, float, float]] = {}
    for joint in bench.spec.joints:
        try:
            found[joint.name] = file.fed_forward(joint.name)
        except FileError as error:
            why[joint.name] = str(error)
    kinds = {joint.name: joint.kind for joint in bench.spec.joints}
    of_kind = {kind: [value for name, value in found.items() if kinds[name] == kind] for kind in kinds.values()}
    borrowed = tuple(name for name in why if of_kind[kinds[name]])
    means = {kind: np.mean(values or [(0.0, 0.0, 0.0)], axis=0) for kind, values in of_kind.items()}
    fed = np.array([found.get(name, means[kind]) for name, kind in kinds.items()])
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
    """Return a sentence for every robot whose bench, where it is done, did not identify the friction of all joints."""
    benches = {bench.label: bench for bench in _forward_benches(bundles, cfg, robot).values() if bench is not None}
    notes = []
    for label, bench in benches.items():
        if not all_identified([bench], out):
            continue
        fed = fed_friction(bench, out)
        if fed.nothing:
            notes.append(f"Friction is not fed forward on {label}, its walks are left out: {fed.why}")
        elif fed.why:
            parts = {"the mean of its kind": fed.borrowed, "nothing": fed.without}
            said = "; ".join(f"{what} to {', '.join(names)}" for what, names in parts.items() if names)
            notes.append(f"On {label} friction is fed forward as identified, but for {said}: {fed.why}")
    return notes
