"""What results were made from, by content: an edited file, or another one of the same name, is another input.

A file is known by its SHA-256, read piece by piece; a bundle by that of its SHA256SUMS, and by its name, which results
have; the log of a run by all of its files. What is none of these, such as a folder of runs, is known by its path.
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
"""Option -> what was given: paths, a shipped bundle by its name among them; or, as text, a robot by its file or name.
"""

Digests = dict[str, dict[str, str]]
"""Option -> path as it was given -> digest, empty where only the path counts."""


def with_sidecars(logs: Iterable[Path]) -> list[Path]:
    """Return logs and the sidecars that lie beside them: who edits one of these has another input too."""
    given = [*logs]
    beside = [sidecar_of(path) for path in given if path.is_file()]
    return given + [sidecar for sidecar in beside if sidecar.is_file()]


def digests_of(inputs: Inputs) -> Digests:
    """Return the digests of all inputs; none of what cannot be read, for whoever reads it says so better."""
    found: Digests = {}
    for option, given in inputs.items():
        try:
            digests = {str(path): _digest(path) for path in _paths(given)}
        except (OSError, StictionError):
            continue
        if any(digests.values()):
            found[option] = digests
    return found


def changes(before: Any, now: Digests) -> dict[str, str]:
    """Return option -> what of its inputs is another, in words, or empty; of options that both have digests of.

    before: `Digests` as a file has them, which may be anything.
    """
    both = now.keys() & before.keys() if isinstance(before, dict) else set()
    return {option: _change(before[option], now[option]) for option in both if _are_digests(before[option])}


def _paths(given: str | Path | Sequence[Path] | None) -> Sequence[Path]:
    """Return the files and folders that an option names; of a robot that is no file, none."""
    if isinstance(given, str):
        from stiction.robots.description import files_of

        return files_of(Path(given)) if Path(given).is_file() else ()
    # An option of somebody's own study may be anything.
    several = given if isinstance(given, Sequence) else (given,)
    return [path for path in several if isinstance(path, Path)]


def _digest(path: Path) -> str:
    """Return what a file, bundle or log of a run is known by; raise `OSError` or `StictionError` for what is none."""
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
    """Say whether what a file has of an option is path -> digest."""
    return isinstance(before, dict) and all(isinstance(digest, str) for digest in before.values())


def _change(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Return what differs between two times of an option, in words; empty where nothing does."""
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
