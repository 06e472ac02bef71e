"""Digests of the inputs of results: an edited file, or another one of the same name, is another input.

A file is identified by its SHA-256, read piece by piece; a bundle by that of its SHA256SUMS, and by its name, which
results have; the log of a run by all of its files. Anything else, such as a folder of runs, is identified by its path.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from stiction.core.errors import StictionError
from stiction.core.files import digest_of
from stiction.files.log import sidecar_of

Inputs = Mapping[str, str | Path | Sequence[Path] | None]
"""Option -> its paths, a shipped bundle by its name; or, as text, a robot by its file or name."""

Digests = dict[str, dict[str, str]]
"""Option -> path as typed -> digest, empty if only the path counts."""


def with_sidecars(logs: Iterable[Path]) -> list[Path]:
    """Return logs and their sidecars, whose content counts too."""
    paths = [*logs]
    sidecars = [sidecar_of(path) for path in paths if path.is_file()]
    return paths + [sidecar for sidecar in sidecars if sidecar.is_file()]


def digests_of(inputs: Inputs) -> Digests:
    """Return the digests of all inputs; without unreadable ones, which their readers report better."""
    known: Digests = {}
    for option, paths in inputs.items():
        try:
            digests = {str(path): _digest(path) for path in _paths(paths)}
        except (OSError, StictionError):
            continue
        if any(digests.values()):
            known[option] = digests
    return known


def changes(before: Any, now: Digests) -> dict[str, str]:
    """Return option -> its changed inputs, in words, or empty; for options in both digests.

    before: `Digests` from a file, not yet validated.
    """
    both = now.keys() & before.keys() if isinstance(before, dict) else set()
    return {option: _change(before[option], now[option]) for option in both if _are_digests(before[option])}


def _paths(value: str | Path | Sequence[Path] | None) -> Sequence[Path]:
    """Return the files and folders of an option; empty for a robot that is not a file."""
    if isinstance(value, str):
        from stiction.robots.description import files_of

        return files_of(Path(value)) if Path(value).is_file() else ()
    # An option of somebody's own study may be anything.
    several = value if isinstance(value, Sequence) else (value,)
    return [path for path in several if isinstance(path, Path)]


def _digest(path: Path) -> str:
    """Return the digest of a file, bundle or log of a run; raise `OSError` or `StictionError` for others."""
    if path.is_file():
        return digest_of(path)
    # Bundles and logs of runs are read where there is one: a table of text needs neither.
    from stiction.files.bundle import SUMS, find_bundle
    from stiction.files.run_log import find_run_log

    folder = path if path.exists() else find_bundle(path)
    folder = folder / "bundle" if (folder / "bundle" / SUMS).is_file() else folder  # of a run
    if not folder.is_dir():
        return digest_of(folder)
    if (folder / SUMS).is_file():
        return f"{digest_of(folder / SUMS)}  {folder.resolve().name}"
    log = find_run_log(folder)
    if log is None:
        return ""
    lines = [f"{digest_of(file)}  {file.name}\n" for file in sorted(log.iterdir()) if file.is_file()]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _are_digests(before: Any) -> bool:
    """Return whether an option's entry in a file is path -> digest."""
    return isinstance(before, dict) and all(isinstance(digest, str) for digest in before.values())


def _change(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return the difference between two digests of an option, in words; empty without one."""
    old, new = ([digest or path for path, digest in digests.items()] for digests in (before, now))
    if old == new:
        return ""
    if edited := [path for path in now if path in before and before[path] != now[path]]:
        return f"{' '.join(edited)} had another content"
    gone = [path for path, known in zip(before, old, strict=True) if known not in new]
    come = [path for path, known in zip(now, new, strict=True) if known not in old]
    if gone and come:
        return f"{' '.join(gone)}, now {' '.join(come)}"
    if gone or come:
        return f"{' '.join(gone or come)} {'left out' if gone else 'added'}"
    return f"{' '.join(before)}, now in another order"
