"""Loads a robot from its files, or from a function that makes its model. The way to MuJoCo from a robot's name.

A mechanism may be an arm as it is: bolted to the world, with a pedestal or without. A base that floats in the file is
held upright; what is no hinge (the slides of a gripper) is rigid at its reference, and said so.
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
"""Constraints that make more of a tree."""


def load_robot(path: Path) -> Derived:
    """Return the robot of a `robot.yaml`, a MuJoCo or a URDF file, and where each of its values came from.

    Raises `RobotError` where the file is none, or does not say enough.
    """
    if path.is_dir():
        raise RobotError(f"robot {str(path)!r} is a folder; name the robot.yaml, .xml or .urdf in it")
    if not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such file{near_file(path)}")
    if path.suffix.lower() in (".xml", ".urdf"):
        return derive(read_source(path), Description(source="a robot.yaml"))
    model, said = described_model(path)
    return derive(read_source(model), said)


def load_mechanism(path: Path) -> Mechanism:
    """Return the mechanism of a MuJoCo (.xml) or URDF (.urdf) file, or of a `robot.yaml` that names one.

    Raises `RobotError` where it cannot be read, or as `mechanism_of`.
    """
    said = Description(source="a robot.yaml")
    if path.suffix.lower() in (".yaml", ".yml"):
        path, said = described_model(path)
    if path.suffix not in (".xml", ".urdf") or not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such .xml or .urdf file")
    spec, notes = read_spec(path)
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {one_line(error)}{place_of(path, str(error))}") from error
    return mechanism_of(model, path.stem, said, notes)


def mechanism_of(model: mujoco.MjModel, name: str, said: Description, notes: tuple[str, ...]) -> Mechanism:
    """Return the mechanism of a compiled model; `said`: what a `robot.yaml` says of its joints and its pose.

    Raises `RobotError` where it has no hinge, closes loops, or a link that moves has no mass at all.
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
        said.of_joint(text, "torque_limit") or torque_limit(model, joint)[0] for text, joint in zip(names, driven)
    ]
    rotors = [said.of_joint(text, "armature") for text in names]
    return Mechanism(
        name=said.name or name,
        links=links,
        joint_names=names,
        armature=tuple(
            armature(model, joint) if given is None else float(given) for joint, given in zip(driven, rotors)
        ),
        torque_limit=tuple(float(limit) if limit and np.isfinite(limit) else None for limit in limits),
        rest=tuple(said.angle(text) or 0.0 for text in names),
        gravity=as_vector(model.opt.gravity),
        rigid=_others(model),
        notes=notes,
    )


def _check_base(model: mujoco.MjModel, driven: list[int], owner: list[int], name: str) -> None:
    """Refuse hinges on more than one floating body: how their bases stand to each other is not in the file."""
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
    """Return the mass of a link and of all that it carries [kg]."""
    carried = {number}
    for index in range(number + 1, len(links)):
        if links[index].parent in carried:
            carried.add(index)
    return sum(links[index].mass for index in carried)


def _others(model: mujoco.MjModel) -> tuple[str, ...]:
    """Return the names of joints that are taken to be rigid."""
    kinds = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_BALL))
    return tuple(model.joint(joint).name for joint in range(model.njnt) if int(model.jnt_type[joint]) in kinds)


def described_model(path: Path) -> tuple[Path, Description]:
    """Return the file of the model that a `robot.yaml` names, and what it says of it. Errors: `load_robot`."""
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
    return model, said


def as_robot(found: object, name: str) -> Derived:
    """Return the robot that a function of a module returns or describes; `name`: of it, for messages.

    Raises `RobotError` where it is no such function, or fails.
    """
    if callable(found) and not isinstance(found, type):
        try:
            spec = found()
        # The function is the user's: whatever it raises is told in one line.
        except Exception as error:
            raise RobotError(f"robot {name!r}: its function fails: {type(error).__name__}: {error}") from error
        if isinstance(spec, Robot):
            return Derived(spec)
        if isinstance(spec, mujoco.MjSpec):
            return derive(compile_source(spec, name), Description(source="a robot.yaml"))
    raise RobotError(f"robot {name!r}: expected a Robot, or a function that returns a mujoco.MjSpec; it is neither")
