"""Reads a mechanism from a MuJoCo or URDF file: its links and hinges, the base held as the file places it.

Unlike `load`, which wants a legged robot whose base floats, this takes an arm as it is: bolted to the world, with a
pedestal or without. A base that floats in the file is held upright. What is no hinge (the slides of a gripper) is rigid
at its reference, and said so.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from stiction.core.errors import RobotError
from stiction.robots.actuators import torque_limit
from stiction.robots.anatomy import as_vector, centred, hinges
from stiction.robots.description import Description, read_description
from stiction.robots.hold import merge
from stiction.robots.mechanism import Mechanism
from stiction.robots.model import Body, Link
from stiction.robots.source import one_line, read_spec

LOOPS = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
"""Constraints that make more of a tree."""


def load_mechanism(path: Path) -> Mechanism:
    """Return the mechanism of a MuJoCo (.xml) or URDF (.urdf) file, or of a `robot.yaml` that names one.

    Raises `RobotError` where it cannot be read, has no hinge, closes loops, or a link that moves has no mass at all.
    """
    said = Description(source="a robot.yaml")
    if path.suffix.lower() in (".yaml", ".yml"):
        said = read_description(path)
        if said.model is None:
            raise RobotError(f"{path}: says no model; expected model: ROBOT.xml or ROBOT.urdf, beside it")
        path = path.parent / said.model
    if path.suffix not in (".xml", ".urdf") or not path.is_file():
        raise RobotError(f"robot {str(path)!r}: there is no such .xml or .urdf file")
    spec, notes = read_spec(path)
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot compile it: {one_line(error)}") from error
    return mechanism_of(model, path.stem, said, notes)


def mechanism_of(
    model: mujoco.MjModel, name: str, said: Description | None = None, notes: tuple[str, ...] = ()
) -> Mechanism:
    """Return the mechanism of a compiled model; `said`: what a `robot.yaml` says of its joints and its pose."""
    said = said or Description()
    driven = hinges(model)
    if not driven:
        raise RobotError(f"{name}: has no hinge; expected a robot with joints that turn")
    for number in np.flatnonzero(np.isin(model.eq_type, LOOPS)):
        raise RobotError(
            f"{name}: the equality constraint {model.eq(int(number)).name!r} closes a loop; only trees are known: "
            "remove it from a copy of the file, or identify the joints one at a time, without --robot"
        )
    data = _at_reference(model)
    owner = _owners(model, driven)
    _check_base(model, driven, owner, name)
    links = tuple(_link(model, data, driven, owner, number) for number in range(len(driven)))
    names = tuple(model.joint(joint).name for joint in driven)
    weightless = [number for number, link in enumerate(links) if _carried_mass(links, number) <= 0]
    if weightless:
        raise RobotError(f"{name}: nothing behind the joint {names[weightless[0]]!r} has a mass; give it an inertia")
    limits = [
        said.of_joint(text, "torque_limit") or torque_limit(model, joint)[0] for text, joint in zip(names, driven)
    ]
    armature = [said.of_joint(text, "armature") for text in names]
    return Mechanism(
        name=said.name or name,
        links=links,
        joint_names=names,
        armature=tuple(
            float(model.dof_armature[model.jnt_dofadr[joint]]) if given is None else float(given)
            for joint, given in zip(driven, armature)
        ),
        torque_limit=tuple(float(limit) if limit and np.isfinite(limit) else None for limit in limits),
        rest=tuple(said.angle(text) or 0.0 for text in names),
        gravity=as_vector(model.opt.gravity),
        rigid=_others(model),
        notes=notes,
    )


def _at_reference(model: mujoco.MjModel) -> mujoco.MjData:
    """Return where everything is with all hinges at zero, the rest at its reference, and a floating base upright."""
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        address = int(model.jnt_qposadr[joint])
        if model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_HINGE):
            data.qpos[address] = 0.0
        elif model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_FREE):
            data.qpos[address : address + 7] = (0, 0, 0, 1, 0, 0, 0)
    mujoco.mj_kinematics(model, data)
    return data


def _owners(model: mujoco.MjModel, driven: list[int]) -> list[int]:
    """Return the link that each body belongs to: the number of the last hinge that moves it, −1 for the base's."""
    last = {int(model.jnt_bodyid[joint]): number for number, joint in enumerate(driven)}
    owner = [-1]
    for body in range(1, model.nbody):
        owner.append(last.get(body, owner[int(model.body_parentid[body])]))
    return owner


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


def _link(model: mujoco.MjModel, data: mujoco.MjData, driven: list[int], owner: list[int], number: int) -> Link:
    """Return one link in its frame, parallel to the world's at angles of zero."""
    joint = driven[number]
    body = int(model.jnt_bodyid[joint])
    # A body with several hinges is a chain of links, of which only the last has its mass.
    before = number - 1 if number and int(model.jnt_bodyid[driven[number - 1]]) == body else -1
    parent = before if before >= 0 else owner[int(model.body_parentid[body])]
    anchor = data.xanchor[joint]
    bodies = [one for one in range(1, model.nbody) if owner[one] == number]
    whole = merge([centred(model, data, one, (anchor, np.eye(3))) for one in bodies])
    whole = whole if bodies else Body(0.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    return Link(
        mass=float(whole.mass),
        com=as_vector(whole.com),
        inertia=whole.inertia,
        name=model.body(body).name,
        parent=parent,
        origin=as_vector(anchor if parent < 0 else anchor - data.xanchor[driven[parent]]),
        axis=as_vector(data.xaxis[joint]),
    )


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
