"""Formats with native or complex parsers, read in a process of its own with bounded memory and time.

A file from a stranger can crash such a parser, or make it take all memory. The process reads one file, writes the
columns of a table and plain facts on its standard output, and ends.
"""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stiction.core.errors import LogError
from stiction.core.isolation import run_isolated
from stiction.core.memory import SHARES, allowance, bound, claim, limit_memory
from stiction.files.tables import Table, read_bytes, read_parquet, table_of

SECONDS, PATIENCE = 120, 600.0
"""Longest processor time for one file [s]; an hour of twelve joints at 1 kHz takes ten. And the longest time on a
machine that is busy with other things [s]."""


def read_apart(path: Path, options: Mapping[str, Any]) -> Table:
    """Read a file in another process, by one of `readers`. options: keyword arguments. Raises `LogError`."""
    words = (path, allowance() * SHARES, json.dumps(dict(options)))
    try:
        done = run_isolated("stiction.identification.logs.apart", PATIENCE, words)
    except subprocess.TimeoutExpired as error:
        raise LogError(f"{path.name}: reading it took more than {PATIENCE:.0f} s; export it as CSV or NPZ") from error
    except OSError as error:
        raise LogError(f"{path.name}: no process can be started to read it: {error.strerror or error}") from error
    if done.returncode != 0:
        raise LogError(
            f"{path.name}: its reader broke down within {SECONDS} s of processor time and the memory limit (status "
            f"{done.returncode}): the file is damaged, or too large; get it again, or export it as CSV or NPZ"
        )
    head, _, data = done.stdout.partition(b"\n")
    facts = json.loads(head)
    if "refusal" in facts:
        raise LogError(facts["refusal"])
    names, rows = facts.pop("columns"), facts.pop("rows")
    sent = [name for name in names if name not in facts["faults"]]
    numbers = dict(zip(sent, np.frombuffer(data, "<f8").reshape(len(sent), rows), strict=True))
    columns = {name: numbers.get(name, np.broadcast_to(np.nan, rows)) for name in names}
    return Table(columns, **facts | {"notes": tuple(facts["notes"])})


def readers() -> dict[str, Callable[..., Table]]:
    """Return suffix -> reader of such a file; imported where it runs, in its own process."""
    from stiction.identification.logs.bags import read_bag
    from stiction.identification.logs.pace import read_pace

    bags = dict.fromkeys((".mcap", ".db3", ".bag"), read_bag)
    return {".mat": read_mat, ".parquet": read_parquet, ".pt": read_pace, **bags}


def main(words: list[str]) -> None:
    """Read one file and write the answer for `read_apart`; words: its path, memory [B], and options as JSON."""
    path, memory, options = Path(words[0]), int(words[1]), json.loads(words[2])
    bound(resource.RLIMIT_CPU, SECONDS)
    bound(resource.RLIMIT_CORE, 0)
    # Whatever a library prints must not reach the columns.
    output, sys.stdout = sys.stdout.buffer, sys.stderr
    try:
        with limit_memory(memory):
            table = readers()[path.suffix.lower()](path, **options)
            rows = len(next(iter(table.columns.values())))
            facts = vars(table) | {"columns": list(table.columns), "rows": rows}
            output.write(json.dumps(facts).encode() + b"\n")
            # A column with a fault is named, and not sent.
            for name, values in table.columns.items():
                if name not in table.faults:
                    output.write(np.ascontiguousarray(values, "<f8").data)
    except LogError as error:
        output.write(json.dumps({"refusal": str(error)}).encode() + b"\n")
    output.flush()


def read_mat(path: Path) -> Table:
    """Read the numeric vectors of a MATLAB file up to version 7, and its matrices, shape (num_samples, num_joints).

    The reader is scipy.io, which a damaged size can crash. Matrices become `name_0`, ...; one with another number of
    samples has a fault. Raises `LogError`.
    """
    content = read_bytes(path)
    # MATLAB itself puts 512 bytes, with a header as of version 5, in front of the HDF5.
    if content.startswith(b"\x89HDF") or content[512:516] == b"\x89HDF":
        raise LogError(f"{path.name}: MATLAB 7.3, which is HDF5; in MATLAB save it again with -v7, or as CSV")
    if not content.startswith(b"MATLAB 5.0 MAT-file"):
        raise LogError(f"{path.name}: not a MATLAB 5.0 file; in MATLAB save it again with -v7 or -v6, or as CSV")
    from scipy.io import loadmat, whosmat

    try:
        _check_end(content)
        # The declared sizes first; `whosmat` inflates no more than headers.
        kinds = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
        listed = whosmat(io.BytesIO(content))
        numeric = {name: shape for name, shape, kind in listed if kind in kinds and len(shape) == 2}
        if len({name for name, *_ in listed}) != len(listed):
            raise ValueError("a variable comes twice")
        size = sum(8 * int(np.prod(shape, dtype=object)) for shape in numeric.values())
        claim(path.name, size, "its matrices would take", LogError)
        loaded = loadmat(io.BytesIO(content), variable_names=list(numeric), verify_compressed_data_integrity=True)
    except LogError:
        raise
    # Whatever a damaged file has scipy raise; this process ends here.
    except Exception as error:
        raise LogError(f"{path.name}: damaged MATLAB file ({str(error)[:120]}); save it again") from error
    arrays = {name: loaded[name] for name in numeric if name in loaded and loaded[name].dtype.kind in "fiu"}
    return table_of(
        path.name,
        {name: array.ravel() if 1 in array.shape else array for name, array in arrays.items() if array.size > 1},
    )


def _check_end(content: bytes) -> None:
    """Raise `ValueError` where the last variable ends beyond the file: scipy passes over one that it need not load."""
    order: Literal["little", "big"] = "big" if content[126:128] == b"MI" else "little"
    place = 128
    while place < len(content):
        place += 8 + int.from_bytes(content[place + 4 : place + 8], order)
    if place != len(content):
        raise ValueError(f"cut off: {len(content)} bytes, and a variable ends at {place}")


if __name__ == "__main__":
    main(sys.argv[1:])
