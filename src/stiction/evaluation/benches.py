"""What virtual robots' benches identify, as input of a walk: friction fed forward, and friction that a policy observes.

On the robot of the data sheet both are the level of the walk itself. On a virtual robot they are what identification
found in the log of that robot's own bench, in the same engine and at the same level: what its user could know. Its
hidden truth is never read, unless `true` is asked for. Where a bench does not identify the friction of a joint, a
summary says so: the mean of the joints of its kind is fed forward there, or nothing, and a policy is given the nominal
friction of its training. A load coefficient that a bench identified is fed too, by every way but `error`.
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
from stiction.evaluation.known_friction import known_to, nominal_known, parse_source
from stiction.evaluation.rollout import friction_at
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.joints import JointsFile, load_joints
from stiction.files.known_friction import BenchFriction, bench_friction, kind_average
from stiction.joints.compensation import LOAD_LAW, parse_compensation
from stiction.robots.model import Robot
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw

if TYPE_CHECKING:
    # With it comes all of identification, a second of imports that a walk without a bench does not need.
    from stiction.virtual.bench import Bench

BENCH_WORK = "benches"
"""Name of the benches for progress."""


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
    """Identify the robots that were not on their bench yet.

    Args:
        benches: of the robots, some perhaps more than once.
        out: folder of what is identified, one folder a robot.
        jobs: processes at once; they do not change the result.
        progress: called with `BENCH_WORK` and the share that is done.

    Raises:
        StictionError: a file cannot be written, or another process writes the folder.

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

    Robots that were not on their benches yet are put there first. walks: of the grid; bundles: its policies; cfg: the
    grid, whose base says which friction is given; robot: see `robot_of`; others as of `identify_on_benches`. Raises
    `StictionError` where a file cannot be read or written.
    """
    identify_on_benches(benches_of(walks, bundles, cfg, robot), out, jobs, progress)
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    specs = {name: robot_of(contract, robot) for name, contract in contracts.items()}
    known: dict[tuple[Any, ...], tuple[float, ...] | None] = {}
    for walk in walks:
        if _same_robot(walk) not in known:
            known[_same_robot(walk)] = _known(walk, contracts[walk.policy], specs[walk.policy], cfg, out)
    return [replace(walk, known=known[_same_robot(walk)]) for walk in walks]


def _same_robot(walk: Walk) -> tuple[Any, ...]:
    """Return what walks share in which one policy is given the same friction."""
    return walk.policy, walk.simulator, walk.level, walk.robot


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
    """Return a sentence for every friction that a bench did not identify, and what a policy was given instead.

    Robots that were not on their bench yet are left out. Arguments and errors as of `with_known_friction`.
    """
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
    """Return the walks of `cfg.forward`, each with the friction that is fed forward.

    Left out are those on a robot whose bench does not identify the friction of some joint: `forward_notes` names them.
    Robots that were not on their benches yet are put there first. Arguments as of `with_known_friction`.

    Raises:
        StictionError: no bundle has such a name, one compensates friction itself, or a file cannot be read or written.

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
            walks.append(_fed_its_level(walk, cfg.base.law.name, robot_of(by_name[walk.policy].contract, robot)))
        elif not (fed := identified[bench.label]).nothing:
            walks.append(_fed_from_bench(walk, fed))
    return walks


def _fed_its_level(walk: Walk, law: str, spec: Robot) -> Walk:
    """Return a walk of the data sheet's robot with the friction of its level fed forward."""
    friction, load = fed_at_level(law, float(walk.level), spec.joint_values("torque_limit"))
    forward_load = None if load is None else tuple(load.tolist())
    return replace(walk, forward=tuple(friction.tolist()), forward_load=forward_load)


def fed_at_level(law: str, level: Any, torque_limit: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return f [N m] and c [1] of every joint that are fed forward where its friction is a level of a law.

    Of `LOAD_LAW` the level is c, and there is no friction without the motor's torque; else it is a fraction of the
    torque limit, and there is no c. level: a number, or of shape (..., 1); torque_limit: [N m], shape (J,).
    """
    if law == LOAD_LAW:
        load = level * np.ones_like(torque_limit)
        return np.zeros_like(load), load
    return level * torque_limit, None


def _fed_from_bench(walk: Walk, fed: Fed) -> Walk:
    """Return a walk of a virtual robot with what its bench found fed forward."""
    if fed.load is None or not parse_compensation(walk.forward_by).feeds_load:
        return replace(walk, forward=fed.friction)
    return replace(walk, forward=fed.unloaded, forward_load=fed.load)


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
    """Why the first of both was not identified."""

    @property
    def nothing(self) -> bool:
        """Whether the bench identified no joint at all."""
        return len(self.without) == len(self.friction)


def fed_friction(bench: Bench, out: Path) -> Fed:
    """Return the friction of every joint as a bench identified it.

    A load coefficient is that of the torque of gravity, which at rest is the motor's; where a joint has none, its
    friction is the same for all ways. out: as of `identify_on_benches`. Raises `StictionError` where the file cannot be
    read.
    """
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
    """Return a sentence for every robot whose bench did not identify the friction of every joint.

    Robots that were not on their bench yet are left out. Arguments and errors as of `forward_walks`.
    """
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
