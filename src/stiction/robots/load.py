"""Loads a robot from its files, or from a function that makes its model. The way to MuJoCo from a robot's name."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco

from stiction.core.errors import RobotError
from stiction.robots.derive import Derived, derive
from stiction.robots.description import Description, read_description
from stiction.robots.fixed import load_mechanism
from stiction.robots.model import Robot
from stiction.robots.record import read_robot
from stiction.robots.source import compile_source, read_source

__all__ = ["as_robot", "load_mechanism", "load_robot"]


def load_robot(path: Path) -> Derived:
    """Return the robot of a `robot.yaml`, a MuJoCo or a URDF file, and where each of its values came from.

    Raises `RobotError` where the file is none, or does not say enough.
    """
    if not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such file")
    if path.suffix == ".json":
        return Derived(read_robot(path), (), ())
    if path.suffix in (".xml", ".urdf"):
        return derive(read_source(path), Description(source="a robot.yaml"))
    said = read_description(path)
    if said.model is None:
        raise RobotError(f"{path}: says no model; expected model: ROBOT.xml or ROBOT.urdf, beside it")
    if re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", said.model):
        raise RobotError(
            f"{path}: model {said.model!r} names code; a file runs none: name {said.model} itself as the robot, or "
            "have it write its model to a file"
        )
    model = path.parent / said.model
    if model.suffix not in (".xml", ".urdf") or not model.is_file():
        raise RobotError(f"{path}: model {said.model!r}: there is no such .xml or .urdf file in {path.parent}")
    return derive(read_source(model), said)


def as_robot(found: object, name: str) -> Robot:
    """Return the robot that a function of a module returns or describes; `name`: of both, for messages.

    Raises `RobotError` where it is no such function.
    """
    if callable(found) and not isinstance(found, type):
        spec = found()
        if isinstance(spec, Robot):
            return spec
        if isinstance(spec, mujoco.MjSpec):
            return derive(compile_source(spec, name), Description(source="a robot.yaml")).robot
    raise RobotError(f"robot {name!r}: expected a Robot, or a function that returns a mujoco.MjSpec; it is neither")
