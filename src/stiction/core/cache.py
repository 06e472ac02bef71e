"""Cache for results that take minutes or hours; an entry is a file, a folder, or a line of a ledger.

The key of an entry is the SHA-256 of everything it depends on: settings, digests of its inputs, code and versions of
packages. An entry is written under a temporary name, synced and renamed, so that a partial one is never read.
"""

from __future__ import annotations

import hashlib
import json
import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stiction.core.errors import FileError
from stiction.core.files import digest_of, open_text, publish, read_bounded, unwritten
from stiction.core.provenance import fingerprint

ENTRY = "entry.json"
"""File that makes a folder an entry: its key, a readable label, and the digest of every other file."""


def key_of(inputs: Any, *code: str) -> str:
    """Return the key of an entry.

    `inputs`: everything it depends on apart from code and packages, plain data or frozen dataclasses; `code`: patterns
    of `fingerprint`; without any, code and packages do not count.
    """
    contents = [inputs, fingerprint(*code) if code else None]
    # The text of a frozen dataclass names every field: a field that is new, or has another value, makes another key.
    return hashlib.sha256(json.dumps(contents, sort_keys=True, default=repr).encode()).hexdigest()


def read_entry(file: Path, key: str) -> dict[str, Any] | None:
    """Return the `sealed` JSON object in a file; None where its `key` differs, it was altered, or no file exists."""
    entry = read_sealed(file)
    return entry if entry is not None and entry.get("key") == key else None


def read_sealed(file: Path) -> dict[str, Any] | None:
    """Return the `sealed` JSON object in a file; None where no file exists or it was altered."""
    try:
        return opened(json.loads(read_bounded(file, "an entry", FileError, LARGEST)))
    # Brackets within brackets without end are a RecursionError, from the reader of JSON itself.
    except (FileError, ValueError, RecursionError):
        return None


def has_entry(folder: Path, key: str) -> bool:
    """Return whether a folder is the entry of a key and every file in it is unaltered."""
    entry = read_entry(folder / ENTRY, key)
    files = None if entry is None else entry.get("files")
    try:
        return isinstance(files, dict) and digests(folder, files) == files
    except OSError:
        return False


def digests(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the SHA-256 of files of a folder. Raises `OSError` where one cannot be read."""
    return {name: digest_of(folder / name) for name in names}


@contextmanager
def publish_entry(folder: Path, key: str, label: str) -> Iterator[Path]:
    """Yield an empty folder to fill; it then replaces `folder`, as the entry of `key` with a readable `label`.

    Raises `FileError` as `publish`.
    """
    with publish(folder) as partial:
        partial.mkdir()
        yield partial
        files = sorted(path.relative_to(partial).as_posix() for path in partial.rglob("*") if path.is_file())
        entry = sealed({"label": label, "key": key, "files": digests(partial, files)})
        (partial / ENTRY).write_text(json.dumps(entry) + "\n", encoding="utf-8")


DIGEST = "entry_sha256"


def sealed(entry: dict[str, Any]) -> dict[str, Any]:
    """Return an entry with the digest of all its other values, which shows later changes."""
    # As it will be read: keys are text by then, and sorted as such.
    plain = json.loads(json.dumps(entry, allow_nan=False))
    return plain | {DIGEST: hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()}


def opened(entry: Any) -> dict[str, Any] | None:
    """Return an entry without its digest; None where the digest is missing or wrong."""
    if not isinstance(entry, dict) or DIGEST not in entry:
        return None
    bare = {name: value for name, value in entry.items() if name != DIGEST}
    try:
        return bare if sealed(bare)[DIGEST] == entry[DIGEST] else None
    except (ValueError, RecursionError):
        return None


class Ledger:
    """Many small entries in one growing file: one line of JSON each, with its digest.

    A line cut off by a kill is dropped. Altered lines, and lines that contradict another one of the same key, are
    ignored with a warning.
    """

    def __init__(self, path: Path) -> None:
        """Read every complete line of the file, if it exists. Raises `FileError` where it cannot be read."""
        self._path = path
        self._entries: dict[str, dict[str, Any]] = {}
        try:
            text = ""
            if path.exists():
                with open_text(path) as file:
                    text = file.read()
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(f"{path} cannot be read: {error}; move it away, or give another --out") from error
        whole = text[: text.rfind("\n") + 1]
        self._end = len(whole.encode())
        twice, wrong = set(), []
        # Not `splitlines`, which splits at characters that JSON has within a line.
        for number, line in enumerate(whole.split("\n")[:-1], start=1):
            try:
                entry = opened(json.loads(line))
            except (ValueError, RecursionError):
                entry = None
            if entry is None or not isinstance(entry.get("key"), str):
                wrong.append(number)
            elif self._entries.setdefault(entry["key"], entry) != entry:
                twice.add(entry["key"])
                wrong.append(number)
        # Neither of two contradicting entries can be trusted.
        for key in twice:
            del self._entries[key]
        if wrong:
            more = f" and {len(wrong) - MOST_LINES} more" if len(wrong) > MOST_LINES else ""
            lines = f"line{'s' * (len(wrong) > 1)} {', '.join(map(str, wrong[:MOST_LINES]))}{more}"
            warnings.warn(
                f"{path}: {lines} damaged, altered, contradicted, or without a digest (older version); their results "
                "are computed again",
                stacklevel=2,
            )

    def get(self, key: str) -> dict[str, Any] | None:
        """Return the entry of a key, or None."""
        return self._entries.get(key)

    def extend(self, entries: Sequence[dict[str, Any]]) -> None:
        """Add entries, each with its `key`, and sync. Raises `FileError` where the file cannot be written."""
        content = "".join(json.dumps(sealed(entry), allow_nan=False) + "\n" for entry in entries).encode()
        try:
            with self._path.open("ab") as file:
                # A line that was cut off, by a kill or a full disk, goes.
                file.truncate(self._end)
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise unwritten(self._path, error) from error
        self._end += len(content)
        self._entries |= {entry["key"]: entry for entry in entries}


LARGEST = 2**28
"""Maximum size of an entry [B]."""

MOST_LINES = 5
