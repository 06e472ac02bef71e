"""Puts the joints of a robot into another order: a policy that was trained elsewhere has its own. NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stiction.core.errors import RobotError
from stiction.robots.model import Robot


def reordered(robot: Robot, names: Sequence[str]) -> Robot:
    """Return a robot whose driven joints have the order of `names`.

    Raises `RobotError` where these are not its driven joints, each once, or a joint stands before the one that carries
    it, which no engine builds.
    """
    if missing := [name for name in names if name not in robot.joint_names]:
        held = [name for name in missing if name in {joint.name for joint in robot.held}]
        why = f"{held[0]!r} is held in it (action: false)" if held else f"it has {', '.join(robot.joint_names[:40])}"
        raise RobotError(f"the policy moves {missing[0]!r}, which robot {robot.name!r} does not drive: {why}")
    if extra := [name for name in robot.joint_names if name not in names]:
        raise RobotError(
            f"robot {robot.name!r} drives {', '.join(extra[:12])}, which the policy does not move; say in robot.yaml "
            "that they are held (action: false)"
        )
    if len(set(names)) != len(names):
        raise RobotError(f"the policy names a joint twice: {', '.join(names)}")
    old = [robot.joint_names.index(name) for name in names]
    new = {before: after for after, before in enumerate(old)} | {-1: -1}
    for number in old:
        if new[robot.links[number].parent] > new[number]:
            raise RobotError(
                f"the policy's joint {robot.joints[number].name!r} stands before "
                f"{robot.joints[robot.links[number].parent].name!r}, which carries it; expected joints from the base on"
            )
    mirrored = robot.mirror_names
    return replace(
        robot,
        joints=tuple(robot.joints[number] for number in old),
        links=tuple(replace(robot.links[number], parent=new[robot.links[number].parent]) for number in old),
        feet=tuple(replace(foot, link=new[foot.link]) for foot in robot.feet),
        mirror_names=tuple(mirrored[number] for number in old) if mirrored else mirrored,
    )
