"""Reads a robot's MuJoCo or URDF file into a compiled model, and says what it had to mend on the way.

What others wrote is checked before it is compiled: its size, its meshes, its mass. A URDF comes as it is: its root link
keeps its mass, which MuJoCo drops without a word, and a mesh is found wherever its package lies.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import mujoco

from stiction.core.errors import RobotError
from stiction.core.files import read_bounded
from stiction.robots.survey import MOST_BYTES, survey

MOST_MESH_BYTES = 1024 * 2**20
"""Size of all meshes together."""

MESHES = (".stl", ".obj", ".msh")
"""What MuJoCo decodes."""

MOST_FILES = 20_000
"""Files of a package among which a mesh is looked for by its name."""


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
    return compile_source(spec, path.name, path, notes)


def read_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Return what a MuJoCo (.xml) or URDF (.urdf) file describes, and what had to be mended. Errors: `read_source`."""
    content = _read_text(path)
    try:
        spec = mujoco.MjSpec.from_string(content) if path.suffix == ".urdf" else mujoco.MjSpec.from_file(str(path))
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{path}: MuJoCo cannot read it: {one_line(error)}") from error
    if path.suffix == ".urdf":
        # A link without inertia has none; MuJoCo would weigh its shapes.
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    _drop_looks(spec)
    return spec, _mend_meshes(spec, path)


def _drop_looks(spec: mujoco.MjSpec) -> None:
    """Leave out pictures, which are only seen, and the memory that a file asks for: neither is bounded."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    spec.memory = -1


def compile_source(spec: mujoco.MjSpec, name: str, path: Path | None = None, notes: tuple[str, ...] = ()) -> Source:
    """Return the model of an `MjSpec`, its base free; `path`: its file, `notes`: what was mended in it."""
    _check_structure(spec, name)
    notes += _free_base(spec, name)
    try:
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"{name}: MuJoCo cannot compile it: {one_line(error)}") from error
    if path is not None and path.suffix == ".urdf":
        _check_mass(model, path)
    return Source(path.stem if path is not None else spec.modelname, model, name, notes)


def _read_text(path: Path) -> str:
    """Return a file's XML; refuse one that is enormous, or could grow while it is parsed."""
    content = read_bounded(path, "a robot's XML", RobotError, MOST_BYTES)
    survey(path, content)
    try:
        return _without_floating_root(content) if path.suffix == ".urdf" else content.decode()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise RobotError(f"{path}: is no XML: {error}") from error


def _without_floating_root(content: bytes) -> str:
    """Return a URDF without an empty root link on which the robot floats: here it floats anyway."""
    root = ElementTree.fromstring(content)
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


def _check_structure(spec: mujoco.MjSpec, name: str) -> None:
    """Refuse what is more than a tree of rigid bodies with hinges."""
    for equality in spec.equalities:
        raise RobotError(
            f"{name}: the equality constraint {equality.name or equality.name1!r} closes a loop or couples joints; "
            "only trees of free hinges are simulated: remove it, or replace the coupled joints by one"
        )
    for joint in spec.joints:
        if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE):
            kind = "slide" if joint.type == mujoco.mjtJoint.mjJNT_SLIDE else "ball"
            raise RobotError(f"{name}: the joint {joint.name!r} is a {kind} joint; only hinges are simulated")


def _roots(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    """Return the bodies of the world that carry hinges, themselves or further out."""

    def carries(body: mujoco.MjsBody) -> bool:
        return any(joint.type == mujoco.mjtJoint.mjJNT_HINGE for joint in body.joints) or any(
            carries(child) for child in body.bodies
        )

    return [body for body in spec.worldbody.bodies if carries(body)]


def _free_base(spec: mujoco.MjSpec, name: str) -> tuple[str, ...]:
    """Let the base float where the file has it fixed: a URDF's root would be part of the world, without its mass."""
    roots = _roots(spec)
    if len(roots) != 1:
        found = f"{len(roots)} of them do ({', '.join(repr(body.name) for body in roots)})" if roots else "none does"
        raise RobotError(f"{name}: exactly one body of the world must carry joints; {found}")
    (root,) = roots
    free = [joint for joint in root.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if free:
        return ()
    if root.joints:
        raise RobotError(
            f"{name}: the root body {root.name!r} hangs on the world by the joint {root.joints[0].name!r}; a legged "
            "robot's base floats: remove the joint, or put a body without joints before it"
        )
    root.add_freejoint()
    return (f"the root body {root.name!r} is fixed to the world in the file; it floats here, with its mass",)


def _check_mass(model: mujoco.MjModel, path: Path) -> None:
    """Refuse a model that does not weigh what the links of its URDF do."""
    try:
        masses = [float(mass.get("value", "nan")) for mass in ElementTree.parse(path).iterfind("link/inertial/mass")]
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotError(f"{path}: its masses cannot be read: {error}") from error
    if abs(model.body_mass.sum() - sum(masses)) > 1e-6 * sum(masses):
        raise RobotError(
            f"{path}: its links weigh {sum(masses):.6g} kg and the compiled model {model.body_mass.sum():.6g} kg; "
            "links without mass that move get one, or one is lost: give each moving link its mass"
        )


def _mend_meshes(spec: mujoco.MjSpec, path: Path) -> tuple[str, ...]:
    """Find the files of all meshes; leave out those that are only seen and cannot be had.

    Raises `RobotError` naming a mesh that is needed and is missing or cannot be decoded.
    """
    notes, total = [], 0
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        found = _find_mesh(mesh.file, path.parent, spec.meshdir)
        if found is not None and found.suffix.lower() in MESHES:
            total += found.stat().st_size
            mesh.file = str(found.resolve())
            continue
        why = "is not there" if found is None else f"cannot be decoded (expected one of {', '.join(MESHES)})"
        users = [geom for geom in spec.geoms if geom.meshname == mesh.name]
        needed = next((geom for geom in users if _is_needed(geom, path.suffix)), None)
        if needed is not None:
            raise RobotError(
                f"{path}: the mesh {mesh.file!r} {why}, and the body {needed.parent.name!r} has its mass from it; "
                "supply the mesh, or give the body its inertia"
            )
        for geom in users:
            spec.delete(geom)
        notes.append(f"the mesh {PurePosixPath(mesh.file).name!r} {why}; it is left out")
        spec.delete(mesh)
    spec.meshdir = ""
    if total > MOST_MESH_BYTES:
        raise RobotError(f"{path}: its meshes have {total} bytes; at most {MOST_MESH_BYTES} are read")
    return tuple(notes)


def _is_needed(geom: mujoco.MjsGeom, suffix: str) -> bool:
    """Return whether a body's mass comes from a geometry."""
    return suffix != ".urdf" and not geom.parent.explicitinertial and geom.mass != 0 and geom.density != 0


def _find_mesh(name: str, folder: Path, meshdir: str) -> Path | None:
    """Return where a mesh lies: as the file says, in the package that it names, or by its own name nearby."""
    for candidate in _candidates(name, folder, meshdir):
        if candidate.is_file():
            return candidate
    roots = [folder, *[parent for parent in (folder.parent, folder.parent.parent) if (parent / "meshes").is_dir()]]
    for root in roots:
        for number, file in enumerate(root.rglob("*")):
            if number > MOST_FILES:
                break
            if file.name.lower() == PurePosixPath(name).name.lower() and file.is_file():
                return file
    return None


def _candidates(name: str, folder: Path, meshdir: str) -> Iterator[Path]:
    """Yield where a mesh should be by its name."""
    if "://" in name:
        package, _, inside = name.split("://", 1)[1].partition("/")
        for parent in (folder, *folder.parents[:4]):
            yield parent / inside
            yield parent / package / inside
        return
    yield folder / meshdir / name
    yield folder / name
