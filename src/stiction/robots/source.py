"""Compiled model of a robot's MuJoCo or URDF file, with notes on corrections.

Files are checked before they are compiled: size, meshes, mass. The root link of a URDF keeps its mass, which MuJoCo
drops without a message, and a mesh is found wherever its package lies.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from stiction.core.errors import RobotError
from stiction.core.files import read_bounded
from stiction.robots.meshes import drop_broken_meshes, resolve_meshes
from stiction.robots.model import LARGEST
from stiction.robots.motors import unread
from stiction.robots.physics import budget_objection
from stiction.robots.survey import MOST_BYTES, place_of, survey

WIDTH = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}
"""Numbers in a joint's position; hinges and slides have one."""


@dataclass(frozen=True)
class Source:
    """Robot's model as in its file, with notes on corrections."""

    name: str
    """Name of the file, or of the model."""
    model: mujoco.MjModel
    origin: str
    """File name, `robot.xml`, for messages and provenance."""
    notes: tuple[str, ...] = ()
    """Omissions and corrections, a sentence each."""


def read_source(path: Path) -> Source:
    """Return the model of a MuJoCo (.xml) or URDF (.urdf) file.

    Raises `RobotError` where it cannot be read, a required mesh is missing or cannot be decoded, or the model's weight
    differs from the file's.
    """
    spec, notes = read_spec(path)
    source = compile_source(spec, path.name, notes, path)
    # MuJoCo drops the mass of a root that is part of the world, and fuses links, without a word.
    expected, weight = _link_mass(path), float(source.model.body_subtreemass[_root(source.model)])
    if expected is not None and not abs(weight - expected) <= 1e-6 * expected:
        raise RobotError(
            f"{path}: its links weigh {expected:.6g} kg and the compiled robot {weight:.6g} kg; a link without mass "
            "that moves got one, or one is lost, as where no joint carries it: give each moving link its mass and joint"
        )
    return replace(source, name=path.stem)


def read_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Return the `MjSpec` of a MuJoCo (.xml) or URDF (.urdf) file, and notes on corrections. Errors: `read_source`."""
    content, urdf = _read_text(path)
    try:
        # By its path MuJoCo reads what a file includes, and nothing that is not called .xml.
        named = path.suffix == ".xml" and not urdf
        spec = mujoco.MjSpec.from_file(str(path)) if named else mujoco.MjSpec.from_string(content)
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot read it: {one_line(error)}{place_of(path, str(error))}") from error
    if urdf:
        # A link without inertia has none; MuJoCo would weigh its shapes. And feet behind fixed joints keep their names.
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        spec.compiler.fusestatic = False
    # Pictures, which are only seen, and the memory that a file asks for: neither is bounded.
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    spec.memory = -1
    return spec, resolve_meshes(spec, path, urdf)


def compile_source(spec: mujoco.MjSpec, name: str, notes: tuple[str, ...] = (), path: Path | None = None) -> Source:
    """Return the model of an `MjSpec`, its base free; `name`: its file's, `notes`: on corrections; `path`: of the
    file.
    """
    try:
        _check_structure(spec, name)
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
        place = "" if path is None else place_of(path, str(error))
        raise RobotError(f"{name}: MuJoCo cannot compile it: {one_line(error)}{place}") from error
    _check_numbers(model, name)
    notes += tuple(_not_taken(model, _root(model)))
    return Source(spec.modelname, model, name, notes)


def _root(model: mujoco.MjModel) -> int:
    """Return the number of the body that carries all joints."""
    hinges = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_HINGE))
    return int(model.body_rootid[model.jnt_bodyid[hinges[0]]])


def _read_text(path: Path) -> tuple[str, bool]:
    """Return a file's XML, and whether it is URDF, whatever its suffix.

    Rejects one that is enormous, or could grow while it is parsed.
    """
    content = read_bounded(path, "a robot's XML", RobotError, MOST_BYTES)
    survey(path, content)
    try:
        root = ElementTree.fromstring(content)
        return (_without_floating_root(root), True) if root.tag == "robot" else (content.decode(), False)
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: is no XML: {error}") from error


def _without_floating_root(root: ElementTree.Element) -> str:
    """Return a URDF without an empty root link on which the robot floats; every base floats here."""
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
    """Return MuJoCo's message in one line, without an unknown place."""
    text = " ".join(str(error).removeprefix("Error: ").split())
    return re.sub(r" Element (name '', id \d+|name '[^']*', id \d+|'[^']*'), line 0$", "", text)


def _roots(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    """Return the bodies of the world that carry hinges, directly or further out."""

    def carries(body: mujoco.MjsBody) -> bool:
        return any(joint.type == mujoco.mjtJoint.mjJNT_HINGE for joint in body.joints) or any(
            carries(child) for child in body.bodies
        )

    return [body for body in spec.worldbody.bodies if carries(body)]


def _free_base(spec: mujoco.MjSpec, name: str) -> tuple[str, ...]:
    """Let a base that is fixed in the file float: as a part of the world, a URDF's root would lose its mass."""
    roots = _roots(spec)
    if len(roots) != 1:
        count = f"{len(roots)} of them do ({', '.join(repr(body.name) for body in roots)})" if roots else "none does"
        raise RobotError(f"{name}: exactly one body of the world must carry joints; {count}")
    (root,) = roots
    free = [joint for joint in root.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if free:
        _check_keyframes(spec, name)
        return ()
    if root.joints:
        raise RobotError(
            f"{name}: the root body {root.name!r} hangs on the world by the joint {root.joints[0].name!r}; a legged "
            "robot's base floats: remove the joint, or put a body without joints before it"
        )
    _check_keyframes(spec, name)
    before = _num_positions(spec)
    poses = {key.name: list(key.qpos) for key in spec.keys if len(key.qpos) == before}
    root.add_freejoint()
    for key in spec.keys:
        if key.name in poses and before:
            # MuJoCo would fill up the end, and every joint would stand at another one's angle.
            key.qpos = [*root.pos, 1.0, 0.0, 0.0, 0.0, *poses[key.name]]
    return (f"the root body {root.name!r} is fixed to the world in the file; it floats here, with its mass",)


def _link_mass(path: Path) -> float | None:
    """Return the total mass of the links of a URDF [kg]; None for a MuJoCo file."""
    root = ElementTree.parse(path).getroot()
    if root.tag != "robot":
        return None
    try:
        return sum(float(mass.get("value", "nan")) for mass in root.iterfind("link/inertial/mass"))
    except ValueError as error:
        raise RobotError(f"{path}: its masses cannot be read: {error}") from error


def _check_structure(spec: mujoco.MjSpec, name: str) -> None:
    """Reject everything except a tree of rigid bodies with hinges that have unique names.

    Raises `RobotError`, and MuJoCo's `ValueError` where two things have one name.
    """
    for equality in spec.equalities:
        raise RobotError(
            f"{name}: the equality constraint {equality.name or equality.name1!r} closes a loop or couples joints; "
            "only trees of free hinges are simulated: remove it, or replace the coupled joints by one"
        )
    for joint in spec.joints:
        if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE):
            kind = "slide" if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else "ball"
            called = repr(joint.name) if joint.name else f"of the body {joint.parent.name!r}"
            raise RobotError(f"{name}: the joint {called} is a {kind} joint; only hinges are simulated")
        if joint.type == mujoco.mjtJoint.mjJNT_HINGE and not joint.name:
            raise RobotError(
                f"{name}: a joint of the body {joint.parent.name!r} has no name, or another joint's; give every joint "
                "one in the file: what a policy moves is told by name"
            )
        if not np.isfinite([*joint.range, joint.armature]).all():
            raise RobotError(f"{name}: joint {joint.name!r} has a number that is none in range or armature")


def _num_positions(spec: mujoco.MjSpec) -> int:
    """Return the number of generalised positions of a robot (MuJoCo's nq)."""
    return sum(WIDTH.get(joint.type, 1) for joint in spec.joints)


def _check_keyframes(spec: mujoco.MjSpec, name: str) -> None:
    """Reject a keyframe of another length, which MuJoCo pads, so that every joint would have its neighbour's angle."""
    for key in spec.keys:
        if len(key.qpos) not in (0, _num_positions(spec)):
            raise RobotError(
                f"{name}: the keyframe {key.name!r} has {len(key.qpos)} positions, the model {_num_positions(spec)}; "
                "remove it, or correct its qpos"
            )


def _check_numbers(model: mujoco.MjModel, name: str) -> None:
    """Reject a model with a number that is not finite, or that overflows: its effect would be hard to trace.

    Raises `RobotError` naming the body, joint or actuator.
    """
    for kind, fields in (
        ("body", (model.body_pos, model.body_quat, model.body_ipos, model.body_mass, model.body_inertia)),
        ("jnt", (model.jnt_axis, model.jnt_pos, model.jnt_range)),
        ("geom", (model.geom_pos, model.geom_size)),
        ("key", (model.key_qpos,)),
    ):
        for values in fields:
            # In this form a NaN is found too.
            number = next((row for row, numbers in enumerate(values) if not (np.abs(numbers) < LARGEST).all()), None)
            if number is not None:
                word = {"jnt": "joint", "geom": "geometry", "key": "keyframe"}.get(kind, kind)
                called = getattr(model, {"jnt": "joint"}.get(kind, kind))(number).name
                listed = ", ".join(f"{value:.4g}" for value in np.ravel(values[number])[:8])
                raise RobotError(
                    f"{name}: the {word} {called!r} has numbers that no robot has ({listed}); correct them in the file"
                )


def _not_taken(model: mujoco.MjModel, root: int) -> Iterator[str]:
    """Yield a sentence for everything in a file that is not simulated; `root`: number of the base's body."""
    stiffness = np.column_stack((model.jnt_stiffness, model.jnt_stiffnesspoly))
    springs = [model.joint(joint).name for joint in np.flatnonzero(np.any(stiffness, axis=1))]
    if springs:
        yield f"the file has springs at {', '.join(springs)}; they are not simulated"
    if model.ntendon:
        names = ", ".join(model.tendon(tendon).name or str(tendon) for tendon in range(model.ntendon))
        yield f"the file has tendons ({names}); they are not simulated, and what they couple moves freely"
    yield from unread(model)
    if objection := budget_objection(model.opt.iterations, model.opt.ls_iterations):
        yield f"{objection} in the file's <option>; simulations here have 100 and 50, others of this file do not"
    floated = [model.body(body).name for body in np.flatnonzero(model.body_gravcomp)]
    if floated:
        yield f"the file takes the weight of {', '.join(floated)} away (gravcomp); here it has it"
    roots = [body for body in range(1, model.nbody) if model.body_rootid[body] == body and body != root]
    loose = [model.body(body).name for body in roots if model.body_dofnum[body]]
    if loose:
        yield f"beside the robot the file has {', '.join(map(repr, loose))}, which is left out"
    for number in range(model.nkey):
        address = int(model.jnt_qposadr[model.body_jntadr[root]])
        yield from _turned(
            model.key_qpos[number, address + 3 : address + 7], f"the keyframe {model.key(number).name!r}"
        )
    yield from _turned(model.body_quat[root], "the file")


def _turned(quaternion: np.ndarray, what: str) -> Iterator[str]:
    """Yield a sentence for a base that stands turned by more than 5°."""
    # A quaternion and its negative are one rotation.
    angle = 2 * np.arccos(np.clip(abs(quaternion[0]) / max(float(np.linalg.norm(quaternion)), 1e-9), 0, 1))
    if angle > np.radians(5.0):
        yield (
            f"{what} has the base turned by {np.degrees(angle):.0f}°; here it stands along its own axes, x forward, y "
            "left, z up: where they are not, say base: NAME of a body rigid with it that has such axes"
        )
