"""Reads a robot's MuJoCo or URDF file into a compiled model, and says what it had to mend on the way.

What others wrote is checked before it is compiled: its size, its meshes, its mass. A URDF comes as it is: its root link
keeps its mass, which MuJoCo drops without a word, and a mesh is found wherever its package lies.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from stiction.core.errors import RobotError
from stiction.core.files import read_bounded
from stiction.robots.meshes import drop_broken_meshes, mend_meshes
from stiction.robots.structure import check_keyframes, check_numbers, check_structure, not_taken, num_positions
from stiction.robots.survey import MOST_BYTES, survey


@dataclass(frozen=True)
class Source:
    """A robot's model as its file has it, and what had to be mended."""

    name: str
    """The file's, or the model's."""
    model: mujoco.MjModel
    origin: str
    """`robot.xml`, for messages and provenance."""
    notes: tuple[str, ...] = ()
    """What was left out or mended, a sentence each."""


def read_source(path: Path) -> Source:
    """Return the model of a MuJoCo (.xml) or URDF (.urdf) file.

    Raises `RobotError` where it cannot be read, a mesh that is needed is missing or cannot be decoded, or the model
    does not weigh what the file says.
    """
    spec, notes = read_spec(path)
    source = compile_source(spec, path.name, notes)
    # MuJoCo drops the mass of a root that is part of the world, and fuses links, without a word.
    if (expected := _link_mass(path)) is not None:
        _check_mass(source.model, path, expected)
    return replace(source, name=path.stem)


def read_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Return what a MuJoCo (.xml) or URDF (.urdf) file describes, and what had to be mended. Errors: `read_source`."""
    content, urdf = _read_text(path)
    try:
        # By its path MuJoCo reads what a file includes, and nothing that is not called .xml.
        named = path.suffix == ".xml" and not urdf
        spec = mujoco.MjSpec.from_file(str(path)) if named else mujoco.MjSpec.from_string(content)
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot read it: {one_line(error)}") from error
    if urdf:
        # A link without inertia has none; MuJoCo would weigh its shapes. And feet behind fixed joints keep their names.
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        spec.compiler.fusestatic = False
    _drop_looks(spec)
    return spec, mend_meshes(spec, path, urdf)


def _drop_looks(spec: mujoco.MjSpec) -> None:
    """Leave out pictures, which are only seen, and the memory that a file asks for: neither is bounded."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    spec.memory = -1


def compile_source(spec: mujoco.MjSpec, name: str, notes: tuple[str, ...] = ()) -> Source:
    """Return the model of an `MjSpec`, its base free; `name`: its file's, `notes`: what was mended in it."""
    try:
        check_structure(spec, name)
        notes += _free_base(spec, name)
        try:
            model = spec.compile()
        except (ValueError, RuntimeError):
            # One mesh that MuJoCo finds wrong is no reason to refuse a robot of which it is only seen.
            if not (lost := drop_broken_meshes(spec, name)):
                raise
            notes += lost
            model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{name}: MuJoCo cannot compile it: {one_line(error)}") from error
    check_numbers(model, name)
    notes += tuple(not_taken(model, _root(model)))
    return Source(spec.modelname, model, name, notes)


def _root(model: mujoco.MjModel) -> int:
    """Return the number of the body that carries all joints."""
    hinges = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE))
    return int(model.body_rootid[model.jnt_bodyid[hinges[0]]])


def _read_text(path: Path) -> tuple[str, bool]:
    """Return a file's XML, and whether it is URDF, whatever it is called.

    Refuses one that is enormous, or could grow while it is parsed.
    """
    content = read_bounded(path, "a robot's XML", RobotError, MOST_BYTES)
    survey(path, content)
    try:
        root = ElementTree.fromstring(content)
        return (_without_floating_root(root), True) if root.tag == "robot" else (content.decode(), False)
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: is no XML: {error}") from error


def _without_floating_root(root: ElementTree.Element) -> str:
    """Return a URDF without an empty root link on which the robot floats: here it floats anyway."""
    for joint in root.findall("joint"):
        parent, children = joint.find("parent"), {child.get("link") for child in root.iterfind("joint/child")}
        if joint.get("type") != "floating" or parent is None or parent.get("link") in children:
            continue
        for link in root.findall("link"):
            if link.get("name") == parent.get("link") and link.find("inertial") is None:
                root.remove(link)
                root.remove(joint)
    return ElementTree.tostring(root, encoding="unicode")


def one_line(error: Exception) -> str:
    """Return what MuJoCo said, in one line."""
    return " ".join(str(error).removeprefix("Error: ").split())


def _roots(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    """Return the bodies of the world that carry hinges, themselves or further out."""

    def carries(body: mujoco.MjsBody) -> bool:
        return any(joint.type == mujoco.mjtJoint.mjJNT_HINGE for joint in body.joints) or any(
            carries(child) for child in body.bodies
        )

    return [body for body in spec.worldbody.bodies if carries(body)]


def _free_base(spec: mujoco.MjSpec, name: str) -> tuple[str, ...]:
    """Let the base float where the file has it fixed: as a part of the world, a URDF's root would lose its mass."""
    roots = _roots(spec)
    if len(roots) != 1:
        found = f"{len(roots)} of them do ({', '.join(repr(body.name) for body in roots)})" if roots else "none does"
        raise RobotError(f"{name}: exactly one body of the world must carry joints; {found}")
    (root,) = roots
    free = [joint for joint in root.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if free:
        check_keyframes(spec, name)
        return ()
    if root.joints:
        raise RobotError(
            f"{name}: the root body {root.name!r} hangs on the world by the joint {root.joints[0].name!r}; a legged "
            "robot's base floats: remove the joint, or put a body without joints before it"
        )
    check_keyframes(spec, name)
    before = num_positions(spec)
    poses = {key.name: list(key.qpos) for key in spec.keys if len(key.qpos) == before}
    root.add_freejoint()
    for key in spec.keys:
        if key.name in poses and before:
            # MuJoCo would fill up the end, and every joint would stand at another one's angle.
            key.qpos = [*root.pos, 1.0, 0.0, 0.0, 0.0, *poses[key.name]]
    return (f"the root body {root.name!r} is fixed to the world in the file; it floats here, with its mass",)


def _link_mass(path: Path) -> float | None:
    """Return what the links of a URDF weigh together [kg]; None: the file is MuJoCo's."""
    root = ElementTree.parse(path).getroot()
    if root.tag != "robot":
        return None
    try:
        return sum(float(mass.get("value", "nan")) for mass in root.iterfind("link/inertial/mass"))
    except ValueError as error:
        raise RobotError(f"{path}: its masses cannot be read: {error}") from error


def _check_mass(model: mujoco.MjModel, path: Path, expected: float) -> None:
    """Refuse a robot that does not weigh what the links of its URDF do, `expected` [kg]."""
    weight = float(model.body_subtreemass[_root(model)])
    if not abs(weight - expected) <= 1e-6 * expected:
        raise RobotError(
            f"{path}: its links weigh {expected:.6g} kg and the compiled robot {weight:.6g} kg; a link without mass "
            "that moves got one, or one is lost, as where no joint carries it: give each moving link its mass and joint"
        )
