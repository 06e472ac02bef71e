"""Comparison of a robot with another model of it, joint by joint: names, axes, places, limits, masses, torque limits.

A joint with a wrong sign in one of the two turns a leg the other way on the machine, which no network can detect.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stiction.core.errors import RobotError, unknown_name
from stiction.robots.anatomy import hinges
from stiction.robots.derive import derive
from stiction.robots.description import Description, describe
from stiction.robots.hold import hold
from stiction.robots.load import described_model
from stiction.robots.model import Robot, link_poses
from stiction.robots.motors import torque_limit
from stiction.robots.source import Source, read_source

PLACE, AXIS, LIMIT, MASS, TORQUE = 5e-3, 1e-2, 0.05, 0.05, 0.02
"""Tolerances of two models: places [m], axes [-], limits [rad], masses and torque limits as shares [-]."""


def check_against(robot: Robot, path: Path) -> int:
    """Return the number of joints of a robot that agree with a model of it: all.

    path: a MuJoCo or URDF file; or a `robot.yaml`, whose `base` is then the frame in which they are compared. Joints
    that the robot holds are held in the model too. Raises `RobotError` naming the first joint that differs, in what,
    and by how much; or a model that cannot be read.
    """
    described = path.suffix.lower() in (".yaml", ".yml")
    file, description = described_model(path) if described else (path, Description())
    source, base = read_source(file), description.base
    other = _model(robot, source, base)
    missing = [name for name in robot.joint_names if name not in other.joint_names]
    if missing:
        raise RobotError(f"{path}: {unknown_name('joint', missing[0], other.joint_names)}")
    extra = [name for name in other.joint_names if name not in robot.joint_names]
    if extra:
        raise RobotError(
            f"{path}: the model moves {', '.join(extra)}, which the policy's robot neither moves nor holds"
        )
    for difference in _differences(robot, other, source):
        raise RobotError(f"{path}: {difference}")
    order = [name for name in other.joint_names if name in robot.joint_names]
    if order != list(robot.joint_names):
        # Another order is no fault of either; who wires them together by number has to know.
        number = next(n for n, pair in enumerate(zip(order, robot.joint_names, strict=True)) if len(set(pair)) > 1)
        if robot.vendor is None:
            raise RobotError(
                f"{path}: its joint {number + 1} is {order[number]!r}, the policy's {robot.joint_names[number]!r}; "
                "give the robot's vendor order in robot.yaml, or wire them by name"
            )
    return robot.num_joints


def _model(robot: Robot, source: Source, base: str | None) -> Robot:
    """Return the robot of a model, in the pose and with the held joints of the other one; `base`: its body."""
    names = [source.model.joint(number).name for number in hinges(source.model)]
    pose = dict(zip(robot.joint_names, robot.joint_values("default_position").tolist(), strict=True))
    pose |= {joint.name: joint.position for joint in robot.held}
    settings: dict[str, object] = {
        "joints": {".*": {"armature": 1.0, "torque_limit": 1.0, "kp": 1.0, "lower": -7.0, "upper": 7.0}},
        "pose": {re.escape(name): angle for name, angle in pose.items() if name in names},
    }
    derived = derive(source, describe(settings | ({"base": base} if base else {}), source.origin)).robot
    return hold(derived, {joint.name: joint.position for joint in robot.held if joint.name in derived.joint_names})


def _differences(robot: Robot, other: Robot, source: Source) -> Iterator[str]:
    """Yield a sentence for every difference of two robots with the same joints."""
    places = [link_poses(each, np.zeros(each.num_joints))[0] for each in (robot, other)]
    numbers = {source.model.joint(number).name: number for number in hinges(source.model)}
    for index, joint in enumerate(robot.joints):
        name, position = joint.name, other.joint_names.index(joint.name)
        axis, model_axis = np.array(robot.links[index].axis), np.array(other.links[position].axis)
        if np.abs(axis + model_axis).max() < AXIS:
            yield f"joint {name!r} turns the other way: its axis is {_text(model_axis)}, the policy's {_text(axis)}"
        if np.abs(axis - model_axis).max() > AXIS:
            yield f"joint {name!r} has the axis {_text(model_axis)}, the policy's {_text(axis)}"
        deviation = places[0][index] - places[1][position]
        if np.abs(deviation).max() > PLACE:
            got, wanted = _text(places[1][position]), _text(places[0][index])
            yield f"joint {name!r} is at {got} m at angles of zero, the policy's at {wanted} m"
        number = numbers[name]
        if source.model.jnt_limited[number]:
            low, high = source.model.jnt_range[number]
            if max(abs(low - joint.lower), abs(high - joint.upper)) > LIMIT:
                yield (
                    f"joint {name!r} has the limits {low:.4g} to {high:.4g} rad, the policy's {joint.lower:.4g} to "
                    f"{joint.upper:.4g} rad"
                )
        limit = torque_limit(source.model, number)[0]
        if limit and abs(limit / joint.torque_limit - 1.0) > TORQUE:
            yield f"joint {name!r} has a torque limit of {limit:.4g} N m, the policy's {joint.torque_limit:.4g} N m"
        mass, model_mass = robot.links[index].mass, other.links[position].mass
        if abs(model_mass - mass) > MASS * mass:
            yield f"the link behind joint {name!r} weighs {model_mass:.4g} kg, the policy's {mass:.4g} kg"
    if abs(other.mass - robot.mass) > MASS * robot.mass:
        yield f"the robot weighs {other.mass:.4g} kg, the policy's {robot.mass:.4g} kg"


def _text(values: np.ndarray) -> str:
    """Return three numbers, rounded for readers."""
    return "(" + ", ".join(f"{value:.3g}" for value in values.round(4) + 0.0) + ")"
