"""Files of a robot's meshes; visual meshes that are missing or cannot be decoded are left out.

Nothing that affects mass or contact is left out: a body with its mass from a missing mesh is refused here, a foot
without a shape where feet are derived.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path, PurePosixPath

import mujoco

from stiction.core.errors import RobotError

MOST_BYTES = 1024 * 2**20
"""Maximum size of all meshes together [B]."""

MESHES = (".stl", ".obj", ".msh")
"""Formats that MuJoCo decodes."""

MOST_FILES = 20_000
"""Maximum number of files of a package in which a mesh is searched by name."""


def resolve_meshes(spec: mujoco.MjSpec, path: Path, urdf: bool) -> tuple[str, ...]:
    """Find the files of all meshes; leave out missing ones that are only drawn.

    Returns notes on meshes left out, or found elsewhere. Raises `RobotError` naming a mesh that a body's mass comes
    from, and that is missing or cannot be decoded.
    """
    notes, total, nearby = [], 0, _Nearby(path.parent)
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        file = next(filter(_is_file, _candidates(mesh.file, path.parent, spec.meshdir)), None)
        if file is None and (file := nearby.find(mesh.file)) is not None:
            notes.append(f"the mesh {mesh.file!r} is missing; using {str(file)!r}, which has its name")
        if file is not None and file.suffix.lower() in MESHES:
            total += file.stat().st_size
            mesh.file = str(file.resolve())
            continue
        why = "is not there" if file is None else f"cannot be decoded (expected one of {', '.join(MESHES)})"
        notes.append(_leave_out(spec, mesh, why, str(path), urdf))
    spec.meshdir = ""
    if total > MOST_BYTES:
        raise RobotError(f"{path}: its meshes have {total} bytes; at most {MOST_BYTES} are read")
    return tuple(notes)


def drop_broken_meshes(spec: mujoco.MjSpec, where: str) -> tuple[str, ...]:
    """Leave out the meshes that MuJoCo cannot compile by themselves, with a note each; `where`: the robot's file.

    Raises `RobotError` naming one that a body's mass comes from.
    """
    # `read_spec` gives this setting to a URDF, whose masses never come from shapes.
    urdf = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    notes = []
    for mesh in list(spec.meshes):
        alone = mujoco.MjSpec()
        alone.add_mesh(
            name="alone",
            file=mesh.file,
            scale=mesh.scale,
            inertia=mesh.inertia,
            uservert=mesh.uservert,
            userface=mesh.userface,
        )
        alone.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="alone")
        try:
            alone.compile()
        except (ValueError, RuntimeError) as error:
            message = " ".join(str(error).removeprefix("Error: ").split("Element name")[0].split())
            notes.append(_leave_out(spec, mesh, f"cannot be decoded ({message})", where, urdf))
    return tuple(notes)


def _leave_out(spec: mujoco.MjSpec, mesh: mujoco.MjsMesh, why: str, where: str, urdf: bool) -> str:
    """Remove a mesh and its geometries from a robot; return the note on it."""
    name = PurePosixPath(mesh.file).name or mesh.name
    users = [geom for geom in spec.geoms if geom.meshname == mesh.name]
    heavy = (
        geom for geom in users if not geom.parent.explicitinertial and geom.mass != 0 and geom.density != 0 and not urdf
    )
    needed = next(heavy, None)
    if needed is not None:
        raise RobotError(
            f"{where}: the mesh {mesh.file or mesh.name!r} {why}, and the body {needed.parent.name!r} has its mass "
            "from it; supply the mesh, or give the body its inertia"
        )
    for geom in users:
        spec.delete(geom)
    spec.delete(mesh)
    return f"the mesh {name!r} {why}; it is left out"


def _is_file(path: Path) -> bool:
    """Return whether a path named in a model file leads to a file."""
    try:
        return path.is_file()
    except OSError:  # A name that is too long, a loop of links.
        return False


class _Nearby:
    """Files in a robot's folder, and in the package around it, by their names."""

    def __init__(self, folder: Path) -> None:
        around = [parent for parent in (folder.parent, folder.parent.parent) if (parent / "meshes").is_dir()]
        self._roots = [folder, *around]

    @cached_property
    def _files(self) -> dict[str, list[Path]]:
        """Files by their names in small letters, nearest root first; listed once."""
        files: dict[str, list[Path]] = defaultdict(list)
        for root in self._roots:
            for number, file in enumerate(root.rglob("*")):
                if number > MOST_FILES:
                    break
                if file.suffix and file not in files[file.name.lower()]:
                    files[file.name.lower()].append(file)
        return files

    def find(self, name: str) -> Path | None:
        """Return the file of the same name with the most folders in common, or None.

        `package://dog/meshes/foot.stl` is rather `dog/meshes/foot.stl` than `cat/meshes/foot.stl`.
        """
        wanted = [part.lower() for part in PurePosixPath(name.replace("\\", "/")).parts]

        def alike(file: Path) -> int:
            pairs = zip(reversed(wanted), (part.lower() for part in reversed(file.absolute().parts)), strict=False)
            return next((number for number, (word, other) in enumerate(pairs) if word != other), len(wanted))

        files = [file for file in self._files.get(wanted[-1], []) if _is_file(file)] if wanted else []
        return max(files, key=alike, default=None)


def _candidates(name: str, folder: Path, meshdir: str) -> Iterator[Path]:
    """Yield the places of a mesh by its name."""
    if "://" in name:
        package, _, inside = name.split("://", 1)[1].partition("/")
        for parent in (folder, *folder.parents[:4]):
            yield parent / inside
            yield parent / package / inside
        return
    yield folder / meshdir / name
    yield folder / name
