"""Which code a command ran: taken before its work, and held against the code on disk when the work is done.

A command of hours imports modules, and starts processes that import them again, while somebody may commit. What it
finds is labelled with the revision that it began with, and says so where the code did not stay that.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stiction.formats.reproducibility import PACKAGE, git_revision, provenance

SOURCE = ("*.py", "*.c", "*.html")
"""The files that are code."""


@dataclass(frozen=True)
class Origin:
    """Code and machine of a command, as they were when it began."""

    provenance: dict[str, Any]
    """`revision` and `machine`, for its summary."""
    code: str
    """SHA-256 of the package's code."""

    @classmethod
    def now(cls) -> Origin:
        """Return the code on disk and the machine: call it before the work."""
        return cls(provenance(), code_digest(PACKAGE))

    def warnings(self) -> list[str]:
        """Return a sentence where the code on disk is no longer that of the beginning: call it after the work."""
        if code_digest(PACKAGE) == self.code:
            return []
        return [
            f"The code of stiction changed while this command ran: it began with revision {self.provenance['revision']}"
            f", and {git_revision()} was there at its end. What came from which is not known: let the same command run "
            "again."
        ]


def code_digest(package: Path) -> str:
    """Return the SHA-256 of the code in a folder as it is now, names of files included."""
    found = hashlib.sha256()
    for file in sorted(file for pattern in SOURCE for file in package.rglob(pattern)):
        found.update(f"{file.relative_to(package)}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()
