"""What policies that observe their joints' friction are told on each robot of a grid.

On the robot of the data sheet the truth is the level of the walk. On a virtual robot the bench's number is what
identification found in the log of that robot's own bench, as for friction fed forward; where it does not tell the
friction of a kind of joint, the policy is told the nominal one of its training, and the summary says so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.formats.contract import Contract
from stiction.formats.joints import load_joints
from stiction.formats.known_friction import BenchFriction, bench_friction, joint_kinds, kind_average
from stiction.robots.spec import RobotSpec
from stiction.transfer.grid.benches import all_made, bench_of, case_of, make_benches
from stiction.transfer.grid.config import GridCfg
from stiction.transfer.grid.plan import Walk
from stiction.transfer.known_friction import Told, nominal_known, parse_told, told_at
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.factorial import Case
from stiction.transfer.robot.identification import JOINTS, Bench
from stiction.transfer.rollout import friction_at, robot_of


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
    return walk.policy, walk.place, walk.level, walk.robot


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
