"""Finds a robot by name. One of your own touches no file here: `package.module` or `package.module:NAME`."""

from __future__ import annotations

import pkgutil
import re
from dataclasses import replace

import stiction.robots as shipped
from stiction.core.errors import RobotError, unknown_name
from stiction.core.plugins import find_named
from stiction.robots.model import JointSpec, RobotSpec

VARIATIONS = ("kp", "torque")
"""What `NAME@...` can multiply: gains, torque limits."""


def robot_names() -> list[str]:
    """Return the names of the shipped robots: the modules beside this one that define `ROBOT`."""
    others = ("box_legs", "catalog", "mirror", "model", "physics", "terrain", "tree")
    names = (module.name for module in pkgutil.iter_modules(shipped.__path__))
    return [name for name in names if name not in others]


def find_robot(name: str) -> RobotSpec:
    """Return the robot called `name`: a shipped one, or `package.module[:VARIABLE]` anywhere on the Python path.

    `NAME@kp=0.5,torque=2` is that robot with its gains kp halved (kd by the root of it, which keeps the damping ratio)
    or its torque limits doubled: what an experiment varies, and still one word in every file.

    Raises `StictionError` where there is no such module, it holds no `RobotSpec`, or the variation is none.
    """
    plain, _, variation = name.partition("@")
    return vary(_find(plain), name, variation) if "@" in name else _find(name)


def vary(robot: RobotSpec, name: str, variation: str) -> RobotSpec:
    """Return a robot called `name` with its joints varied as `kp=0.5,torque=2` says."""
    factors: dict[str, float] = {}
    for part in variation.split(","):
        key, _, value = part.partition("=")
        number = re.fullmatch(r"[0-9]*\.?[0-9]+", value) is not None and 0.01 <= float(value) <= 100
        if key not in VARIATIONS or key in factors or not number:
            raise RobotError(
                f"robot {name!r}: {part!r} is no variation; expected {' or '.join(VARIATIONS)}, each at most once, "
                "with a factor from 0.01 to 100, as in saturn_lite@kp=0.5,torque=2"
            )
        factors[key] = float(value)

    gain, strength = (factors.get(name, 1.0) for name in VARIATIONS)

    def varied(joint: JointSpec) -> JointSpec:
        return replace(
            joint,
            stiffness=joint.stiffness * gain,
            derivative=joint.derivative * gain**0.5,
            torque_limit=joint.torque_limit * strength,
        )

    return replace(robot, name=name, hip=varied(robot.hip), thigh=varied(robot.thigh), shank=varied(robot.shank))


def _find(name: str) -> RobotSpec:
    """Return the robot called `name`, without variations.

    Raises `StictionError` where there is no such module, or it holds no `RobotSpec`.
    """
    module_name, _, variable = name.partition(":")
    if not variable and "." not in name:
        if name not in robot_names():
            message = unknown_name("robot", name, robot_names())
            raise RobotError(f"{message}; name one of your own as package.module:VARIABLE")
        module_name = f"stiction.robots.{name}"
    robot = find_named("robot", f"{module_name}:{variable or 'ROBOT'}")
    if not isinstance(robot, RobotSpec):
        raise RobotError(f"robot {name!r}: {module_name}:{variable or 'ROBOT'} is not a RobotSpec")
    return robot
