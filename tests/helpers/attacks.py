"""Damaged and forged files of a run, in the number that is asked for: the same ones for the same seed."""

from __future__ import annotations

import hashlib
import json
import os
import random
import shutil
from pathlib import Path
from typing import Any

HUGE = "1" + "0" * 400

STRANGE = (
    *(None, True, -1, 0, 2**63, 1e308, 0.5, "", "x", "\ud800", "\x1b[2J", "[red]x[/]", "$\\frac$", "a" * 300, [], {}),
    *([1] * 1000, {"a": {"b": {}}}, "../../etc/passwd", "NaN"),
)
"""Values that no field expects."""

RAW = (HUGE, "NaN", "Infinity", "-Infinity", "1e999", "[" * 100_000, '{"a":' * 50_000)
"""Texts that are no JSON, or numbers and depths that readers stumble over."""


def _places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of everything in a tree of JSON."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    return [path, *(place for key, value in inner for place in _places(value, (*path, key)))]


def change_json(content: bytes, pick: random.Random) -> bytes:
    """Change one place of some JSON; of lines of JSON, of one of them."""
    lines = content.decode().splitlines()
    whole = len(lines) < 2 or lines[0].strip() in ("{", "[")
    number = pick.randrange(len(lines)) if lines and not whole else 0
    try:
        tree = json.loads(content if whole else lines[number])
    except ValueError:
        return content[:-1]
    place = pick.choice(_places(tree))
    mark = "\0place\0"
    how = pick.choice(("value", "value", "raw", "remove", "add"))
    if not place:
        tree = mark
    else:
        owner = tree
        for key in place[:-1]:
            owner = owner[key]
        if how == "remove":
            del owner[place[-1]]
        elif how == "add" and isinstance(owner, dict):
            owner[f"{place[-1]}_"] = pick.choice(STRANGE)
        else:
            owner[place[-1]] = mark
    value = pick.choice(RAW) if how == "raw" else json.dumps(pick.choice(STRANGE))
    text = json.dumps(tree).replace(json.dumps(mark), value)
    if whole:
        return text.encode()
    lines[number] = text
    return ("\n".join(lines) + "\n").encode()


def change_bytes(content: bytes, pick: random.Random) -> bytes:
    """Damage a file as a disk, a cable or an editor does."""
    if not content:
        return b"\0"
    at, length = pick.randrange(len(content)), pick.randrange(1, 64)
    other = content[at] ^ (1 << pick.randrange(8))
    return pick.choice(
        (
            content[:at] + bytes([other]) + content[at + 1 :],
            content[:at],
            content[:at] + content[at + length :],
            content[:at] + pick.randbytes(length) + content[at:],
            content[:at] + content[at : at + length] * 3 + content[at + length :],
            content[:at] + bytes(length) + content[at + length :],
            content + content,
            b"",
        )
    )


def seal(run: Path) -> None:
    """Give the checkpoints of a run the digests that belong to what they hold now, as a forger can."""
    for header in (run / "checkpoints").glob("*.json"):
        try:
            data = json.loads(header.read_text())
            tensors = header.with_suffix(".safetensors").read_bytes()
            text = json.dumps(data["tree"]).encode()
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            continue
        data["sha256"] = hashlib.sha256(hashlib.sha256(tensors).digest() + text).hexdigest()
        header.write_text(json.dumps(data))


def attack(run: Path, seed: int) -> str:
    """Change one file of a run folder; return what was done.

    Of those who change a checkpoint every second one also forges its digest.
    """
    pick = random.Random(seed)
    names = ("config.json", "metrics.jsonl", "robot.json", "checkpoints/*.json", "checkpoints/*.safetensors")
    kind = pick.choice((*names, "summary.json"))
    files = sorted(run.glob(kind)) or [run / "config.json"]
    file = pick.choice(files)
    how = pick.choice(("json", "json", "json", "bytes", "bytes", "gone", "folder", "loop", "pipe", "device"))
    if file.suffix == ".safetensors" and how == "json":
        how = "bytes"
    content = file.read_bytes()
    if how in ("json", "bytes"):
        file.write_bytes((change_json if how == "json" else change_bytes)(content, pick))
    else:
        file.unlink()
        if how == "folder":
            file.mkdir()
        elif how == "loop":
            file.symlink_to(file.name)
        elif how == "pipe":
            os.mkfifo(file)
        elif how == "device":
            file.symlink_to("/dev/zero")
    forged = "checkpoints" in file.parts and how in ("json", "bytes") and pick.random() < 0.5
    if forged:
        seal(run)
    return f"{file.relative_to(run)}: {how}{', digest forged' * forged}"


def copy_run(run: Path, to: Path) -> Path:
    """Return a fresh copy of a run folder."""
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(run, to)
    return to
