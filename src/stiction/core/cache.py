"""One cache for what takes minutes or hours to make; its entries are files, folders, or lines of a ledger.

An entry is known by a key, the SHA-256 of everything that it was made from: settings, digests of its inputs, the code
that made it and the versions of the packages under it. What has changed since has another key and is made anew. An
entry is written under another name, brought to the disk, and renamed: one that an interruption cut off is never read.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stiction.core.errors import FileError
from stiction.core.provenance import made_by

ENTRY = "entry.json"
"""File of a folder that is an entry: its key, and what is in it, for people."""


def key_of(made_from: Any, *code: str) -> str:
    """Return the key of what is made from something.

    Args:
        made_from: everything that an entry depends on beside code and packages: plain data, or frozen dataclasses,
            whose `repr` tells all of their fields.
        code: that makes it, as `made_by` takes it; without any, code and packages do not count.

    """
    everything = [made_from, made_by(*code) if code else None]
    return hashlib.sha256(json.dumps(everything, sort_keys=True, default=repr).encode()).hexdigest()


def entry_file(folder: Path, name: str, key: str, suffix: str) -> Path:
    """Return the file of an entry: `name`, for people, and its key. Entries of other keys lie beside it, and stay."""
    return folder / f"{name}-{key[:12]}{suffix}"


@contextmanager
def publish(path: Path) -> Iterator[Path]:
    """Give a name beside `path` to write a file or a folder under; it then takes the place of `path`, whole.

    Where the writing fails, what was at `path` before is there still. Raises `OSError` as the writing does.
    """
    partial, before = (path.with_name(f".{path.name}.{os.getpid()}.{kind}") for kind in ("part", "before"))
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield partial
        for written in (partial, *partial.rglob("*")):
            _sync(written)
        if path.is_dir():
            # A folder that is not empty cannot be renamed over, and half of one may not stay under its name.
            path.rename(before)
        partial.replace(path)
        _sync(path.parent)
    finally:
        for left in (partial, before):
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
            else:
                left.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Bring a file, or the names in a folder, to the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def cached(folder: Path, name: str, key: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the entry of a key from its JSON file, which is made first where it is not there or cannot be read.

    Args:
        folder: of the entries.
        name: what it is, for people who look into the folder.
        key: as from `key_of`.
        make: returns the entry, as JSON takes it.

    Raises:
        FileError: the file cannot be written; and whatever `make` raises.

    """
    file = entry_file(folder, name, key, ".json")
    found = _read(file)
    if found is not None:
        return found
    made = json.dumps(make(), allow_nan=False)
    try:
        with publish(file) as partial:
            partial.write_text(made, encoding="utf-8")
    except OSError as error:
        raise FileError(f"{file} cannot be written: {error}; give another --out") from error
    return dict(json.loads(made))


def read_entry(file: Path, key: str) -> dict[str, Any] | None:
    """Return the JSON object in a file that names its own `key`; None where it is another's, or none at all."""
    found = _read(file)
    return found if found is not None and found.get("key") == key else None


def _read(file: Path) -> dict[str, Any] | None:
    """Return the JSON object in a file; None where there is none."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def has_entry(folder: Path, key: str) -> bool:
    """Say whether a folder is the entry of a key."""
    return read_entry(folder / ENTRY, key) is not None


@contextmanager
def publish_entry(folder: Path, key: str, label: str) -> Iterator[Path]:
    """Give an empty folder to fill; it then takes the place of `folder`, as the entry of `key`.

    label: what is in it, for people. Raises `OSError` as the writing does.
    """
    with publish(folder) as partial:
        partial.mkdir()
        yield partial
        (partial / ENTRY).write_text(json.dumps({"label": label, "key": key}) + "\n", encoding="utf-8")


class Ledger:
    """Many small entries in one file, a line of JSON each, that grows while they are made."""

    def __init__(self, path: Path) -> None:
        """Read what is there, every whole line; what an interruption cut off is none, and what comes next is behind it.

        path: the file; its folder exists. Raises `FileError` where it cannot be read.
        """
        self._path = path
        self._entries: dict[str, dict[str, Any]] = {}
        try:
            text = path.read_text(encoding="utf-8") if path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(f"{path} cannot be read: {error}; move it away, or give another --out") from error
        self._torn = bool(text) and not text.endswith("\n")
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                self._entries[entry["key"]] = entry
            except (ValueError, TypeError, KeyError):
                continue

    def get(self, key: str) -> dict[str, Any] | None:
        """Return the entry of a key; None where there is none."""
        return self._entries.get(key)

    def extend(self, entries: Sequence[dict[str, Any]]) -> None:
        """Add entries, each with its `key`; they are on the disk when this returns.

        Raises:
            FileError: the file cannot be written.

        """
        lines = [json.dumps(entry, allow_nan=False) + "\n" for entry in entries]
        self._entries |= {entry["key"]: entry for entry in entries}
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write("\n" * self._torn + "".join(lines))
                file.flush()
                os.fsync(file.fileno())
            self._torn = False
        except OSError as error:
            raise FileError(f"{self._path} cannot be written: {error}; give another --out") from error
