"""Finds a robot by name. One of your own touches no file here: `package.module` or `package.module:NAME`."""

from __future__ import annotations

import importlib
import pkgutil

import stiction.robots as shipped
from stiction.formats.errors import StictionError
from stiction.robots.spec import RobotSpec


def robot_names() -> list[str]:
    """Return the names of the shipped robots: the modules beside this one that define `ROBOT`."""
    names = (module.name for module in pkgutil.iter_modules(shipped.__path__))
    return [name for name in names if name not in ("spec", "catalog", "build")]


def find_robot(name: str) -> RobotSpec:
    """Return the robot called `name`: a shipped one, or `package.module[:VARIABLE]` anywhere on the Python path.

    Raises `StictionError` where there is no such module, or it holds no `RobotSpec`.
    """
    module_name, _, variable = name.partition(":")
    if not variable and "." not in name:
        if name not in robot_names():
            raise StictionError(
                f"robot {name!r} is unknown; shipped are {', '.join(robot_names())}; "
                "name one of your own as package.module:VARIABLE"
            )
        module_name = f"stiction.robots.{name}"
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError, TypeError) as error:
        raise StictionError(
            f"robot {name!r}: the module {module_name!r} cannot be imported: {error}; "
            "install it, or name its folder in PYTHONPATH"
        ) from error
    robot = getattr(module, variable or "ROBOT", None)
    if not isinstance(robot, RobotSpec):
        raise StictionError(f"robot {name!r}: {module_name}.{variable or 'ROBOT'} is not a RobotSpec")
    return robot
