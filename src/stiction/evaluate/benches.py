"""What policies that observe their joints' friction are told on each robot of a grid.

On the robot of the data sheet the truth is the level of the walk. On a virtual robot the bench's number is what
identification found in the log of that robot's own bench, as for friction fed forward; where it does not tell the
friction of a kind of joint, the policy is told the nominal one of its training, and the summary says so.

What identification finds in the log of a robot's own bench, in the same engine and at the same level, is what its user
could know; its hidden truth is never read for it.

At every reading the controllers get f sat((a − θ)/width) beside target and gains (`Pilot`). On the robot of the data
sheet f is the law's own level: the best that anybody could know. On a virtual robot it is what identification found in
the log of that robot's own bench, in the same engine, at the same level; never its hidden truth.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import has_entry
from stiction.core.errors import ConfigurationError, FileError, PolicyError, unknown_name
from stiction.core.parallel import spread
from stiction.deploy.check import robot_of
from stiction.evaluate.grid import GridCfg, Walk, plan_forward
from stiction.evaluate.known_friction import Told, nominal_known, parse_told, told_at
from stiction.evaluate.rollout import friction_at
from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract
from stiction.formats.joints import load_joints
from stiction.formats.known_friction import BenchFriction, bench_friction, joint_kinds, kind_average
from stiction.robots.model import RobotSpec
from stiction.virtual.bench import JOINTS, Bench, identified_friction, make_bench
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw

BENCH_WORK = "benches"
"""What progress calls the benches."""


def bench_of(walk: Walk, spec: RobotSpec) -> Bench | None:
    """Return the bench of the robot of a walk; None for the robot of the data sheet."""
    case = case_of(walk)
    return None if case is None else Bench(walk.simulator.spec.name, case, spec)


def case_of(walk: Walk) -> Case | None:
    """Return the virtual robot of a walk; None for the robot of the data sheet."""
    if walk.robot is None or walk.simulator.cell is None:
        return None
    return Case(walk.robot, walk.simulator.cell, parse_level(walk.level))


def all_made(benches: Iterable[Bench], out: Path) -> bool:
    """Say whether every robot was on its bench; `out` as of `make_benches`."""
    return all(has_entry(out / bench.label, bench.key) for bench in benches)


def make_benches(
    benches: Iterable[Bench],
    out: Path,
    jobs: int = 1,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> None:
    """Put the robots on their benches that have not been there yet.

    Args:
        benches: of the robots, some perhaps more than once.
        out: folder of what is identified, one folder a robot.
        jobs: processes at once; they do not change the result.
        progress: called with `BENCH_WORK` and the share that is done.

    Raises:
        StictionError: a file cannot be written.

    """
    missing = {bench.label: bench for bench in benches if not has_entry(out / bench.label, bench.key)}
    workers = max(1, jobs // max(1, len(missing)))
    tasks = [(bench, out / label, workers) for label, bench in missing.items()]
    for count, _ in enumerate(spread(make_bench, tasks, jobs), 1):
        progress(BENCH_WORK, count / len(missing))


def informed(
    walks: Sequence[Walk],
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> list[Walk]:
    """Return walks, those of policies that observe their joints' friction with what they are told.

    Args:
        walks: of the grid.
        bundles: its policies.
        cfg: the grid; its base says what is told.
        out: folder of what is identified, one folder a robot. Robots that are not there yet are put on their benches.
        jobs: processes at once for that; they do not change the result.
        robot: a robot of one's own, see `robot_of`.
        progress: as of `make_benches`.

    Raises:
        StictionError: a file cannot be read or written.

    """
    told = parse_told(cfg.base.known_friction)
    make_benches(benches_of(walks, bundles, cfg, robot), out, jobs, progress)
    contracts = {bundle.name: bundle.contract for bundle in bundles}
    specs = {name: robot_of(contract, robot) for name, contract in contracts.items()}
    found: dict[tuple[Any, ...], tuple[float, ...] | None] = {}
    for walk in walks:
        if (robot_in := _robot_in(walk)) not in found:
            found[robot_in] = _known(walk, contracts[walk.policy], specs[walk.policy], told, cfg, out)
    return [replace(walk, known=found[_robot_in(walk)]) for walk in walks]


def _robot_in(walk: Walk) -> tuple[Any, ...]:
    """Return what the walks share in which one policy is told the same."""
    return walk.policy, walk.simulator, walk.level, walk.robot


def benches_of(walks: Iterable[Walk], bundles: Sequence[Bundle], cfg: GridCfg, robot: str | None = None) -> list[Bench]:
    """Return the benches on which robots must be before `informed` knows what to tell, each once."""
    if parse_told(cfg.base.known_friction).source != "bench":
        return []
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.contract.knows_friction}
    found = [bench_of(walk, specs[walk.policy]) for walk in walks if walk.policy in specs]
    return list({bench.label: bench for bench in found if bench is not None}.values())


def not_identified(
    walks: Collection[Walk], bundles: Sequence[Bundle], cfg: GridCfg, out: Path, robot: str | None = None
) -> list[str]:
    """Return a sentence for everything that a robot's bench did not tell, and what the policies were told instead.

    Robots that were not on their bench yet are left out. Arguments and errors as of `informed`.
    """
    notes: dict[str, None] = {}
    for bundle in bundles:
        for bench in benches_of([walk for walk in walks if walk.policy == bundle.name], bundles, cfg, robot):
            if all_made([bench], out):
                found = _identified(bench, bundle.contract, out)
                notes |= dict.fromkeys(f"On {bench.label}, as {bundle.name} is told it: {note}" for note in found.notes)
    return list(notes)


def _known(
    walk: Walk, contract: Contract, spec: RobotSpec, told: Told, cfg: GridCfg, out: Path
) -> tuple[float, ...] | None:
    """Return what the policy of a walk is told; None: what its contract says, or nothing."""
    case, bench, law = case_of(walk), bench_of(walk, spec), cfg.base.law
    if not contract.knows_friction or told.source == "contract":
        return None
    if case is None or bench is None:
        friction = friction_at(contract, np.array([float(walk.level)]), law)
        share = told_at(contract, spec, told, law, friction)[0]
    elif told.source == "true":
        share = told.factor * true_friction(case, spec)
    elif told.source == "bench":
        share = told.factor * _identified(bench, contract, out).array
    else:
        share = np.full(len(joint_kinds(spec.joint_names)), told.source)
    return tuple(share.tolist())


def true_friction(case: Case, spec: RobotSpec) -> np.ndarray:
    """Return the mean f/τ_max over the joints of each kind that a virtual robot has without load, shape (kinds,)."""
    share = case.robot(draw(spec, case.seed)).friction.share
    friction = case.level.coulomb(spec) * share / spec.joint_values("torque_limit")
    return friction @ kind_average(spec.joint_names)


def _identified(bench: Bench, contract: Contract, out: Path) -> BenchFriction:
    """Return what a bench found."""
    file, spec = load_joints(out / bench.label / JOINTS), bench.spec
    return bench_friction(file, spec.joint_names, spec.joint_values("torque_limit"), nominal_known(contract, spec))


def forwarded(
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Callable[[str, float], None] = lambda name, share: None,
) -> list[Walk]:
    """Return the walks of `cfg.forward`, each with its friction; those in the batch are left out.

    So are those on a robot whose friction its bench does not tell, in some joint: `not_told` says why.

    Virtual robots that have not been on their bench yet are put there first; `out` is the folder of what is identified,
    one folder a robot. Other arguments as of `walk_grid`.

    Raises:
        StictionError: no bundle has such a name, one compensates friction itself, or a file cannot be read or written.

    """
    by_name = {bundle.name: bundle for bundle in bundles}
    for name in cfg.forward:
        if name not in by_name:
            raise ConfigurationError(f"friction fed forward: {unknown_name('policy', name, by_name)}")
        if by_name[name].contract.compensation is not None:
            raise PolicyError(f"{name} compensates friction in its targets; it cannot be fed forward once more")
    specs = {name: robot_of(by_name[name].contract, robot) for name in cfg.forward}
    benches = {walk: bench_of(walk, specs[walk.policy]) for walk in plan_forward(cfg)}
    make_benches([bench for bench in benches.values() if bench is not None], out, jobs, progress)
    found = {bench.label: told(bench, out) for bench in benches.values() if bench is not None}
    friction = {
        walk: law_friction(walk, specs[walk.policy]) if bench is None else found[bench.label]
        for walk, bench in benches.items()
    }
    return [replace(walk, forward=known) for walk, known in friction.items() if not isinstance(known, str)]


def told(bench: Bench, out: Path) -> tuple[float, ...] | str:
    """Return the friction of every joint as a bench found it [N m]; or why not, where it does not tell one.

    out: as of `forwarded`. Raises `StictionError` where the file cannot be read.
    """
    joints = load_joints(out / bench.label / JOINTS)
    try:
        return tuple(identified_friction(joints, bench.spec.joint_names).tolist())
    except FileError as error:
        return str(error)


def not_told(bundles: Sequence[Bundle], cfg: GridCfg, out: Path, robot: str | None = None) -> list[str]:
    """Return a sentence for every robot on which no friction is fed forward, because its bench does not tell it.

    Robots that were not on their bench yet are left out. Arguments and errors as of `forwarded`.
    """
    specs = {bundle.name: robot_of(bundle.contract, robot) for bundle in bundles if bundle.name in cfg.forward}
    benches = [bench for walk in plan_forward(cfg) if (bench := bench_of(walk, specs[walk.policy])) is not None]
    made = {bench.label: bench for bench in benches if all_made([bench], out)}
    return [
        f"Friction is not fed forward on {label}, its walks are left out: {why}"
        for label, bench in made.items()
        if isinstance(why := told(bench, out), str)
    ]


def law_friction(walk: Walk, spec: RobotSpec) -> tuple[float, ...]:
    """Return the friction of a walk on the data sheet's robot, its level of each joint's torque limit [N m]."""
    return tuple((float(walk.level) * spec.joint_values("torque_limit")).tolist())
