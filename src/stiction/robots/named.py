"""Comparison of a robot with the shipped robot of its name, and with the order of a policy's joints. NumPy alone."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

from stiction.core.errors import RobotError
from stiction.robots.catalog import find_robot, is_shipped
from stiction.robots.model import Robot, with_standing_height

UNCOMPARED = ("color",)
"""Fields in which robots of one name may differ: visual only."""

AT_MOST = ("kp", "kd", "torque_limit")
"""Fields of a joint that a policy trained elsewhere may lower, and never raise."""

OF_POLICY = ("default_position", "action_scale")
"""Fields of a joint that a policy trained elsewhere sets: its pose and its scale of the action."""


IMPORTED_ROBOT = "_imported"
"""Suffix of the name of a shipped robot whose gains or limits an imported policy raises."""


def check_named(robot: Robot, elsewhere: bool = False) -> None:
    """Reject a robot with the name of a shipped one and different numbers; robots with other names pass.

    elsewhere: the robot is that of a policy trained elsewhere, with its order of joints, pose, and gains that are at
    most those of the shipped robot. Raises `RobotError` naming the first field that differs.
    """
    if not is_shipped(robot.name):
        return
    shipped = find_robot(robot.name)
    if elsewhere and sorted(robot.joint_names) == sorted(shipped.joint_names):
        shipped = reordered(shipped, robot.joint_names)
        shipped = replace(shipped, standing_height=with_standing_height(robot).standing_height)
    for field, value, expected in _differences(robot, shipped, "", (*AT_MOST, *OF_POLICY) if elsewhere else ()):
        _reject(robot, field, value, expected)
    for field, value, most in raised(robot, shipped):
        _reject(robot, field, value, f"at most {most:g}")


def raised(robot: Robot, shipped: Robot) -> Iterator[tuple[str, float, float]]:
    """Yield the fields in which joints of a robot exceed those of another: field, value, and the other's value."""
    for number, (joint, other) in enumerate(zip(robot.joints, shipped.joints, strict=True)):
        for name in AT_MOST:
            if getattr(joint, name) > getattr(other, name) * (1 + 1e-6):
                yield f"joints[{number}].{name}", getattr(joint, name), getattr(other, name)


def _reject(robot: Robot, field: str, value: Any, expected: Any) -> None:
    """Raise `RobotError` that names a field."""
    value, expected = (f"{each:g}" if isinstance(each, float) else each for each in (value, expected))
    raise RobotError(
        f"robot {robot.name!r}: got {field} {str(value)[:80]}, the shipped {robot.name} has {str(expected)[:80]}; give "
        "the robot another name (`name` in its robot.yaml)"
    )


def _differences(value: Any, expected: Any, where: str, free: Collection[str]) -> Iterator[tuple[str, Any, Any]]:
    """Yield field, value and expected value of every difference of two parts of robots."""
    if is_dataclass(value) and type(value) is type(expected):
        for part in fields(value):
            if part.name not in UNCOMPARED and part.name not in free:
                name = f"{where}.{part.name}".lstrip(".")
                yield from _differences(getattr(value, part.name), getattr(expected, part.name), name, free)
    elif isinstance(value, tuple) and isinstance(expected, tuple) and len(value) == len(expected):
        for number, (item, other) in enumerate(zip(value, expected, strict=True)):
            yield from _differences(item, other, f"{where}[{number}]", free)
    elif isinstance(value, float) and isinstance(expected, int | float):
        if not math.isclose(value, expected, rel_tol=1e-6, abs_tol=1e-12):
            yield where, value, expected
    elif value != expected:
        yield where, value, expected


def reordered(robot: Robot, names: Sequence[str]) -> Robot:
    """Return a robot whose driven joints have the order of `names`.

    Raises `RobotError` where these are not its driven joints, each once, or a joint comes before the one that carries
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
