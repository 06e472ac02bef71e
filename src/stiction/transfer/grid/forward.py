"""Friction fed forward in the joint controllers, what a user of a conventional policy would try first.

At every reading the controllers get f sat((a − θ)/width) beside target and gains (`Pilot`). On the robot of the data
sheet f is the law's own level: the best that anybody could know. On a virtual robot it is what identification found in
the log of that robot's own bench, in the same engine, at the same level; never its hidden truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.formats.joints import JointsError, load_joints
from stiction.robots.spec import RobotSpec
from stiction.transfer.grid.benches import all_made, bench_of, make_benches
from stiction.transfer.grid.config import GridCfg
from stiction.transfer.grid.plan import Walk, plan_forward
from stiction.transfer.robot.identification import JOINTS, Bench, identified_friction
from stiction.transfer.rollout import robot_of


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
            raise StictionError(f"friction fed forward to {name!r}: expected some of {', '.join(by_name)}")
        if by_name[name].contract.compensation is not None:
            raise StictionError(f"{name} compensates friction in its targets; it cannot be fed forward once more")
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
    except JointsError as error:
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
