"""The policy bundles that come with the package, `src/stiction/policies/<robot>-<terrain>-<method>-<level>/`."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from stiction.formats.bundle import CONTRACT


def shipped_bundles() -> dict[str, Path]:
    """Return name -> directory of every shipped bundle, in alphabetical order; empty where none came along."""
    folder = Path(str(resources.files("stiction").joinpath("policies")))
    if not folder.is_dir():
        return {}
    return {entry.name: entry for entry in sorted(folder.iterdir()) if (entry / CONTRACT).is_file()}


def find_bundle(name: Path) -> Path:
    """Return the directory that `name` means: a path, or the name of a shipped bundle where no such path exists."""
    return name if name.exists() else shipped_bundles().get(str(name), name)
