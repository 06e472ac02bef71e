"""Lookup of robots: a shipped one by its name, a file by its path, one in Python as `package.module:ROBOT`."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

from stiction.core.errors import RobotError, unknown_name
from stiction.core.plugins import find_named
from stiction.robots.mechanism import Mechanism, on_a_stand
from stiction.robots.model import Robot
from stiction.robots.record import Derived, read_robot

SHIPPED = Path(__file__).with_name("shipped")
"""Folder of the records of the shipped robots."""

VARIATIONS = ("kp", "torque", "action")
"""Quantities that `NAME@...` can multiply: gains, torque limits, the angle per unit of action."""

FILES = (".yaml", ".yml", ".xml", ".urdf", ".json")
"""Suffixes of files that describe a robot."""


@cache
def robot_names() -> tuple[str, ...]:
    """Return the names of the shipped robots."""
    return tuple(sorted(path.stem for path in SHIPPED.glob("*.json")))


@cache
def _shipped(name: str) -> Robot:
    """Return the shipped robot of that name."""
    return read_robot(SHIPPED / f"{name}.json")


def find_robot(name: str) -> Robot:
    """Return the robot called `name`.

    name: a shipped robot; the path of a `robot.yaml`, a MuJoCo or URDF file, or a `robot.json`; or
    `package.module[:VARIABLE]`, a `Robot` (or a function without arguments that returns a `mujoco.MjSpec`) anywhere on
    the Python path.

    `NAME@kp=0.5,torque=2` is that robot with its gains kp halved (kd by the root of it, which keeps the damping ratio)
    and its torque limits doubled; `action=2` doubles the angle per unit of action. A variation is thus one word in
    every file.

    Raises `StictionError` for an unknown robot or an invalid variation.
    """
    return find_derived(name).robot


def find_derived(name: str) -> Derived:
    """Return the robot called `name` as `find_robot`, with the origins of its values; a shipped one has none."""
    plain, variation = _split_variation(name)
    derived = _find(plain)
    return derived if variation is None else Derived(vary(derived.robot, name, variation))


def _split_variation(name: str) -> tuple[str, str | None]:
    """Return a robot's name and its variation; None without one, though its path may have an @, for example of a
    user.
    """
    plain, at, variation = name.rpartition("@")
    return (plain, variation) if at and not is_file_name(name) else (name, None)


def is_file_name(name: str) -> bool:
    """Return whether a robot's name is the name of a file that describes one."""
    return name.lower().endswith(FILES)


def find_mechanism(name: str) -> Mechanism:
    """Return the robot called `name` with its base held: an arm on its table, or a legged robot on a stand.

    name: as of `find_robot`; a MuJoCo or URDF file, or a `robot.yaml`, need not be of a legged robot. Raises
    `StictionError` as that does.
    """
    if is_file_name(name) and not name.lower().endswith(".json"):
        from stiction.robots.load import load_mechanism

        return load_mechanism(Path(name))
    return on_a_stand(find_robot(name))


def is_shipped(name: str) -> bool:
    """Return whether a robot, varied or not, is shipped, so that its name suffices anywhere."""
    return _split_variation(name)[0] in robot_names()


def robot_in_file(name: str, where: str, how: str) -> str:
    """Return the name of a robot in a file: of a shipped one, or the path of a file that describes one.

    where: the file, for messages; how: remedy, such as `give it with --robot`. Raises `RobotError` for
    `package.module:ROBOT`: finding such a robot runs that module, so it is typed and never read from a file.
    """
    if not isinstance(name, str) or (not is_shipped(name) and not is_file_name(_split_variation(name)[0])):
        raise RobotError(f"{where}: the robot {name!r} is neither shipped nor a file; a file runs no module: {how}")
    return name


def vary(robot: Robot, name: str, variation: str) -> Robot:
    """Return a robot called `name` with its joints varied as in `kp=0.5,torque=2`."""
    factors: dict[str, float] = {}
    for part in variation.split(","):
        key, _, value = part.partition("=")
        number = re.fullmatch(r"[0-9]*\.?[0-9]+", value) is not None and 0.01 <= float(value) <= 100
        if key not in VARIATIONS or key in factors or not number:
            raise RobotError(
                f"robot {name!r}: {part!r} is not a variation; expected {', '.join(VARIATIONS[:-1])} or "
                f"{VARIATIONS[-1]}, each at most once, factor 0.01 to 100, as in saturn_lite@kp=0.5,torque=2"
            )
        factors[key] = float(value)
    gain, torque, action = (factors.get(key, 1.0) for key in VARIATIONS)
    return robot.with_joints(name, kp=gain, kd=gain**0.5, torque_limit=torque, action_scale=action)


def _exists(name: str, kind: Callable[[Path], bool]) -> bool:
    """Return whether a folder or file of that name exists; False for a name that is too long."""
    try:
        return kind(Path(name))
    except OSError:
        return False


def _find(name: str) -> Derived:
    """Return the robot called `name`, without variations.

    Raises `StictionError` for an unknown robot.
    """
    if name.lower().endswith(".json"):
        return Derived(read_robot(Path(name)))
    if is_file_name(name):
        from stiction.robots.load import load_robot

        return load_robot(Path(name))
    if name not in robot_names() and name and _exists(name, Path.is_dir):
        raise RobotError(f"robot {name!r} is a folder; name the robot.yaml, .xml or .urdf in it")
    module_name, _, variable = name.partition(":")
    if not variable and "." in name and _exists(name, Path.is_file):
        raise RobotError(f"robot {name!r}: expected a robot.yaml, a MuJoCo (.xml) or URDF (.urdf) file")
    if not variable and "." not in name:
        if name not in robot_names():
            message = unknown_name("robot", name, robot_names())
            raise RobotError(
                f"{message}; for another robot give the path of its robot.yaml, .xml or .urdf, or package.module:ROBOT"
            )
        return Derived(_shipped(name))
    target = find_named("robot", f"{module_name}:{variable or 'ROBOT'}")
    if isinstance(target, Robot):
        return Derived(target)
    from stiction.robots.load import as_robot

    return as_robot(target, name)
