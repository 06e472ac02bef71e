"""Damage done to valid logs, thousands of times, in a process with little memory; what the readers made of each.

`python damage.py FOLDER COUNT SEED KIND...` writes a JSON object on standard output, kind by kind: how many inputs were
taken and how many refused, the slowest [s], how much the memory grew [B], and what must not happen, with the number of
the input.
"""

from __future__ import annotations

import gzip
import io
import json
import random
import re
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType

import logfiles
from bounded import bounded, limit_address_space, peak_memory, read_here
from stiction.files.log import Log
from stiction.identification.logs import open_log

LONGEST = 5.0
"""No input may take longer [s]."""

MEMORY = 2**30
"""Address space that a reader may take beyond what the interpreter has [B]."""


def plain_parquet(folder: Path) -> Path:
    """Write Parquet without checksums, compression or dictionaries."""
    from pyarrow import parquet

    path = logfiles.canonical(folder, ".parquet")
    parquet.write_table(parquet.read_table(path), path, compression="none", use_dictionary=False)
    return path


KINDS: dict[str, Callable[[Path], Path]] = {
    "csv": lambda folder: logfiles.canonical(folder, ".csv"),
    "wide": logfiles.wide_csv,
    "npz": lambda folder: logfiles.canonical(folder, ".npz"),
    "parquet": lambda folder: logfiles.canonical(folder, ".parquet"),
    "mcap": logfiles.ros,
    "mat": logfiles.matlab,
    "sidecar": lambda folder: logfiles.canonical(folder, ".csv").with_suffix(".json"),
    "tabs": logfiles.tabs,
    "packed-inside": logfiles.packed,
    "records": logfiles.records,
    "lists": logfiles.lists,
    "database": logfiles.database,
    "npz-inside": lambda folder: logfiles.canonical(folder, ".npz"),
    "parquet-plain": plain_parquet,
    "mcap-plain": lambda folder: logfiles.ros(folder, CompressionType.NONE, crcs=False),
    "mat-plain": lambda folder: logfiles.matlab(folder, compressed=False),
}
"""Kind of input -> what writes a valid one. The last four have no checksum that would keep damage from the parsers:
plain ones were written without, and of those with `inside`, the members of the archive are damaged."""

INSIDE = {"npz-inside": ("time.npy", "position.FL_hip.npy")}
"""Kind -> the members that are damaged."""

WORDS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"1e999", b"-", b",", b"\n", b"\r", b"\x00", b'"', b";", b"{", b"]", b"null"),
    *(b"PK\x03\x04", b"\x89MCAP0\r\n", b"PAR1", b"\x93NUMPY", b"cos\nsystem\n(S'id'\ntR.", b"\x80\x04\x95", b"True"),
)
"""Pieces that mean something to some reader."""

LARGE = (b"\xff" * 4, b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x00" * 8, b"\xff" * 7 + b"\x7f")
"""Sizes that somebody might declare."""


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return `data` with one to four injuries."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = rng.choice(INJURIES)(data, rng) or b"\x00"
    return data


def damaged_inside(data: bytes, members: tuple[str, ...], rng: random.Random) -> bytes:
    """Return a ZIP archive with injuries in one of the members, and right checksums."""
    name = rng.choice(members)
    result = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(result, "w") as new:
        for entry in old.namelist():
            new.writestr(entry, damaged(old.read(entry), rng) if entry == name else old.read(entry))
    return result.getvalue()


def _place(data: bytes, rng: random.Random) -> int:
    """Return a place in the data, near one of the ends more often than chance."""
    spread = rng.choice((len(data), len(data), min(64, len(data))))
    place = rng.randrange(spread)
    return place if rng.random() < 0.5 else len(data) - 1 - place


def _flip(data: bytes, rng: random.Random) -> bytes:
    """Turn one bit round."""
    place = _place(data, rng)
    return data[:place] + bytes([data[place] ^ (1 << rng.randrange(8))]) + data[place + 1 :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    """Lose the end."""
    return data[: _place(data, rng)]


def _insert(data: bytes, rng: random.Random) -> bytes:
    """Put something in."""
    place = _place(data, rng)
    return data[:place] + rng.choice((rng.choice(WORDS), rng.randbytes(rng.randint(1, 16)))) + data[place:]


def _lose(data: bytes, rng: random.Random) -> bytes:
    """Lose something in between."""
    place = _place(data, rng)
    return data[:place] + data[place + rng.randint(1, 64) :]


def _double(data: bytes, rng: random.Random) -> bytes:
    """Repeat a block, up to a hundred times."""
    place, size = _place(data, rng), rng.randint(1, 128)
    return data[:place] + data[place : place + size] * rng.choice((2, 3, 100)) + data[place + size :]


def _swap(data: bytes, rng: random.Random) -> bytes:
    """Exchange two blocks."""
    first, second = sorted((_place(data, rng), _place(data, rng)))
    size = rng.randint(1, 32)
    if first + size > second:
        return data
    return (
        data[:first]
        + data[second : second + size]
        + data[first + size : second]
        + data[first : first + size]
        + (data[second + size :])
    )


def _declare(data: bytes, rng: random.Random) -> bytes:
    """Overwrite a few bytes with a large number, of this or that kind."""
    place, number = _place(data, rng), rng.choice((*LARGE, rng.randbytes(4)))
    return data[:place] + number + data[place + len(number) :]


def _overwrite(data: bytes, rng: random.Random) -> bytes:
    """Overwrite with a word."""
    place, word = _place(data, rng), rng.choice(WORDS)
    return data[:place] + word + data[place + len(word) :]


INJURIES = (_flip, _flip, _cut, _insert, _lose, _double, _swap, _declare, _overwrite)


def complete(log: Log, path: Path) -> str | None:
    """Return what is wrong with a log that was taken, or None.

    Every signal has a value a stamp, and there are as many as the file promises: in CSV as many as lines with an end,
    elsewhere as many as were written, for no reader may take a part for the whole without saying so.
    """
    shapes = {array.shape for signals in log.joints.values() for array in vars(signals).values() if array is not None}
    if not log.joints or shapes != {log.time.shape} or log.time.ndim != 1:
        return f"shapes {shapes} for {log.time.shape} stamps"
    promised = logfiles.SAMPLES
    if path.suffix in (".csv", ".tsv", ".jsonl", ".gz"):
        content = path.read_bytes()
        text = (gzip.decompress(content) if path.suffix == ".gz" else content).decode("utf-8-sig", "replace")
        lines = re.split(r"\r\n|\r|\n", text)
        ended = lines[1:-1] if path.suffix != ".jsonl" else text.split("\n")
        promised = sum(1 for line in ended if line.strip())
    told = any("left out" in note for note in log.notes)
    if len(log.time) != promised and not told:
        return f"{len(log.time)} samples, {promised} were promised"
    return None


def attack(folder: Path, kind: str, count: int, seed: int) -> dict[str, object]:
    """Damage a valid input `count` times; return the statistics."""
    valid = KINDS[kind](folder)
    data, others = valid.read_bytes(), [path for path in folder.iterdir() if path != valid]
    bad = folder / f"bad{''.join(valid.suffixes)}"
    log = bad
    if kind == "sidecar":
        log = bad.with_suffix(".csv")
        log.write_bytes(next(path for path in others if path.suffix == ".csv").read_bytes())
    open_log(valid if kind != "sidecar" else log)
    tally = {"taken": 0, "refused": 0}
    wrong, slowest = [], 0.0
    start = peak_memory()
    for number in range(count):
        rng = random.Random(f"{kind} {seed} {number}")
        members = INSIDE.get(kind)
        if kind == "packed-inside":
            bad.write_bytes(gzip.compress(damaged(gzip.decompress(data), rng), mtime=0))
        else:
            bad.write_bytes(damaged_inside(data, members, rng) if members else damaged(data, rng))
        before = time.perf_counter()
        read, fault = bounded(lambda: open_log(log), LONGEST)
        slowest = max(slowest, time.perf_counter() - before)
        tally["refused" if read is None else "taken"] += 1
        if fault := fault if read is None else complete(read, log):
            wrong.append(f"input {number}: {fault}")
    growth = peak_memory() - start
    return {**tally, "slowest": slowest, "growth": growth, "wrong": wrong}


def main() -> None:
    """Run as a program, with an alarm and a bound on memory."""
    folder, count, seed, kinds = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:]
    for kind in kinds:
        (folder / kind).mkdir(parents=True)
        KINDS[kind](folder / kind)
    read_here()
    limit_address_space(MEMORY)
    np.seterr(all="ignore")
    print(json.dumps({kind: attack(folder / kind, kind, count, seed) for kind in kinds}))


if __name__ == "__main__":
    main()
