"""Loads a robot from its files, or from a function that makes its model. The way to MuJoCo from a robot's name."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco

from stiction.core.errors import RobotError
from stiction.core.files import near_file
from stiction.robots.derive import Derived, derive
from stiction.robots.description import Description, read_description
from stiction.robots.fixed import load_mechanism
from stiction.robots.model import Robot
from stiction.robots.record import read_robot
from stiction.robots.source import Source, compile_source, read_source

__all__ = ["as_robot", "described_source", "load_mechanism", "load_robot"]


def load_robot(path: Path) -> Derived:
    """Return the robot of a `robot.yaml`, a MuJoCo or a URDF file, and where each of its values came from.

    Raises `RobotError` where the file is none, or does not say enough.
    """
    if path.is_dir():
        raise RobotError(f"robot {str(path)!r} is a folder; name the robot.yaml, .xml or .urdf in it")
    if not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such file{near_file(path)}")
    if path.suffix.lower() == ".json":
        return Derived(read_robot(path), (), ())
    if path.suffix.lower() in (".xml", ".urdf"):
        return derive(read_source(path), Description(source="a robot.yaml"))
    return derive(*_described(path))


def described_source(path: Path) -> tuple[Source, str | None]:
    """Return the model that a `robot.yaml` names, and the body that it says is the base. Errors: `load_robot`."""
    source, said = _described(path)
    return source, said.base


def _described(path: Path) -> tuple[Source, Description]:
    """Return the model that a `robot.yaml` names, and what it says of it."""
    said = read_description(path)
    if said.model is None:
        raise RobotError(f"{path}: says no model; expected model: ROBOT.xml or ROBOT.urdf, beside it")
    if re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", said.model):
        raise RobotError(
            f"{path}: model {said.model!r} names code; a file runs none: name {said.model} itself as the robot, or "
            "have it write its model to a file"
        )
    model = path.parent / said.model
    if model.suffix.lower() not in (".xml", ".urdf") or not model.is_file():
        raise RobotError(f"{path}: model {said.model!r}: there is no such .xml or .urdf file in {path.parent}")
    return read_source(model), said


def as_robot(found: object, name: str) -> Derived:
    """Return the robot that a function of a module returns or describes; `name`: of both, for messages.

    Raises `RobotError` where it is no such function, or fails.
    """
    if isinstance(found, Robot):
        return Derived(found, (), ())
    if callable(found) and not isinstance(found, type):
        try:
            spec = found()
        # The function is the user's: whatever it raises is told in one line.
        except Exception as error:
            raise RobotError(f"robot {name!r}: its function fails: {type(error).__name__}: {error}") from error
        if isinstance(spec, Robot):
            return Derived(spec, (), ())
        if isinstance(spec, mujoco.MjSpec):
            return derive(compile_source(spec, name), Description(source="a robot.yaml"))
    raise RobotError(f"robot {name!r}: expected a Robot, or a function that returns a mujoco.MjSpec; it is neither")
