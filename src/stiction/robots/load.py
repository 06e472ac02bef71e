"""Robots loaded from their files, or from a function that makes their model.

A mechanism may be an arm: bolted to the world, with a pedestal or without. A floating base is held upright; joints
other than hinges (the slides of a gripper) are rigid at their reference, with a note.
"""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np

from stiction.core.errors import RobotError
from stiction.core.files import near_file
from stiction.robots.anatomy import as_vector, at_zero, hinges, owners, tree
from stiction.robots.derive import derive
from stiction.robots.description import Description, read_description
from stiction.robots.mechanism import Mechanism
from stiction.robots.model import Link, Robot
from stiction.robots.motors import armature, torque_limit
from stiction.robots.record import Derived
from stiction.robots.source import compile_source, one_line, read_source, read_spec
from stiction.robots.survey import place_of

LOOPS = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
"""Types of constraints that close loops or couple joints."""

RIGID = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_BALL))
"""Types of joints that count as rigid."""


def load_robot(path: Path) -> Derived:
    """Return the robot of a `robot.yaml`, a MuJoCo or a URDF file, and the origin of each of its values.

    Raises `RobotError` for an invalid file, or a missing value.
    """
    if path.is_dir():
        raise RobotError(f"robot {str(path)!r} is a folder; name the robot.yaml, .xml or .urdf in it")
    if not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such file{near_file(path)}")
    if path.suffix.lower() in (".xml", ".urdf"):
        return derive(read_source(path), Description(source="a robot.yaml"))
    model, description = described_model(path)
    return derive(read_source(model), description)


def load_mechanism(path: Path) -> Mechanism:
    """Return the mechanism of a MuJoCo (.xml) or URDF (.urdf) file, or of a `robot.yaml` that names one.

    Raises `RobotError` where it cannot be read, or as `mechanism_of`.
    """
    description = Description(source="a robot.yaml")
    if path.suffix.lower() in (".yaml", ".yml"):
        path, description = described_model(path)
    if path.suffix not in (".xml", ".urdf") or not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such .xml or .urdf file")
    spec, notes = read_spec(path)
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {one_line(error)}{place_of(path, str(error))}") from error
    return mechanism_of(model, path.stem, description, notes)


def mechanism_of(model: mujoco.MjModel, name: str, description: Description, notes: tuple[str, ...]) -> Mechanism:
    """Return the mechanism of a compiled model; `description`: its joints and its pose in a `robot.yaml`.

    Raises `RobotError` where it has no hinge, closes loops, or a moving link has no mass.
    """
    driven = hinges(model)
    if not driven:
        raise RobotError(f"{name}: has no hinge; expected a robot with joints that turn")
    for number in np.flatnonzero(np.isin(model.eq_type, LOOPS)):
        raise RobotError(
            f"{name}: the equality constraint {model.eq(int(number)).name!r} closes a loop; only trees are known: "
            "remove it from a copy of the file, or identify the joints one at a time, without --robot"
        )
    owner = owners(model, driven)
    _check_base(model, driven, owner, name)
    links = tuple(tree(model, at_zero(model), driven, owner, (np.zeros(3), np.eye(3))))
    names = tuple(model.joint(joint).name for joint in driven)
    weightless = [number for number, link in enumerate(links) if _carried_mass(links, number) <= 0]
    if weightless:
        raise RobotError(f"{name}: nothing behind the joint {names[weightless[0]]!r} has a mass; give it an inertia")
    limits = [
        description.of_joint(text, "torque_limit") or torque_limit(model, joint)[0]
        for text, joint in zip(names, driven)
    ]
    rotors = [description.of_joint(text, "armature") for text in names]
    return Mechanism(
        name=description.name or name,
        links=links,
        joint_names=names,
        armature=tuple(
            armature(model, joint) if value is None else float(value) for joint, value in zip(driven, rotors)
        ),
        torque_limit=tuple(float(limit) if limit and np.isfinite(limit) else None for limit in limits),
        rest=tuple(description.angle(text) or 0.0 for text in names),
        gravity=as_vector(model.opt.gravity),
        rigid=tuple(model.joint(joint).name for joint in range(model.njnt) if int(model.jnt_type[joint]) in RIGID),
        notes=notes,
    )


def _check_base(model: mujoco.MjModel, driven: list[int], owner: list[int], name: str) -> None:
    """Reject hinges on more than one floating body: the relative pose of their bases is not in the file."""
    floating = set()
    for joint in driven:
        body = int(model.jnt_bodyid[joint])
        while body:
            first = int(model.body_jntadr[body])
            if first >= 0 and model.jnt_type[first] == int(mujoco.mjtJoint.mjJNT_FREE):
                if owner[body] >= 0:
                    raise RobotError(f"{name}: the body {model.body(body).name!r} floats and has hinges before it")
                floating.add(body)
            body = int(model.body_parentid[body])
    if len(floating) > 1:
        raise RobotError(f"{name}: {len(floating)} bodies that float carry hinges; expected one robot in the file")


def _carried_mass(links: tuple[Link, ...], number: int) -> float:
    """Return the mass of a link and of all links that it carries [kg]."""
    carried = {number}
    for index in range(number + 1, len(links)):
        if links[index].parent in carried:
            carried.add(index)
    return sum(links[index].mass for index in carried)


def described_model(path: Path) -> tuple[Path, Description]:
    """Return the file of the model that a `robot.yaml` names, and its description. Errors: `load_robot`."""
    description = read_description(path)
    if description.model is None:
        raise RobotError(f"{path}: has no model; expected model: ROBOT.xml or ROBOT.urdf, in the same folder")
    if re.fullmatch(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", description.model):
        raise RobotError(
            f"{path}: model {description.model!r} is code, which no file may run; give {description.model} as the "
            "robot, or write its model to a file"
        )
    model = path.parent / description.model
    if model.suffix.lower() not in (".xml", ".urdf") or not model.is_file():
        raise RobotError(f"{path}: model {description.model!r}: there is no such .xml or .urdf file in {path.parent}")
    return model, description


def as_robot(candidate: object, name: str) -> Derived:
    """Return the robot that a function of a module returns or describes; `name`: for messages.

    Raises `RobotError` where it is not such a function, or fails.
    """
    if callable(candidate) and not isinstance(candidate, type):
        try:
            spec = candidate()
        # The function is the user's: whatever it raises is told in one line.
        except Exception as error:
            raise RobotError(f"robot {name!r}: its function fails: {type(error).__name__}: {error}") from error
        if isinstance(spec, Robot):
            return Derived(spec)
        if isinstance(spec, mujoco.MjSpec):
            return derive(compile_source(spec, name), Description(source="a robot.yaml"))
    raise RobotError(f"robot {name!r}: expected a Robot, or a function that returns a mujoco.MjSpec; it is neither")
