"""Files made to cost more than they weigh, and a process with little memory and time that reads them all.

`python attacks.py FOLDER` writes a JSON object on standard output: name of the attack -> what the reader said, by how
much the memory grew at most [B], and the file's size.
"""

from __future__ import annotations

import gzip
import io
import json
import resource
import sqlite3
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import logfiles
from stiction.core.errors import StictionError
from stiction.core.memory import limit_memory

MEMORY = 2**29
"""Memory limit of the readers [B]; a table may take a quarter of it."""

SECONDS = 60
"""Processor time for all attacks together, imports included [s]: before they were mended one alone took 110 s."""


def sidecar_of_names(folder: Path) -> Path:
    """0.9 MB of different names, the last one twice: to find it was quadratic."""
    log = logfiles.canonical(folder, ".csv")
    names = [f"j{index}" for index in range(80_000)]
    logfiles.sidecar(log, {"names": [*names, names[-1]]})
    return log


def sidecar_of_joints(folder: Path) -> Path:
    """As many joints with fields of their own, and one unknown field whose nearest is looked for."""
    log = logfiles.canonical(folder, ".csv")
    logfiles.sidecar(log, {"joints": {f"j{index}": {} for index in range(40_000)} | {"x" * 300_000: {"kp": 1}}})
    return log


def _with_topic(content: bytes) -> bytes:
    """Return a schema and a channel of joint states, and what follows."""
    from mcap.data_stream import RecordBuilder
    from mcap.records import Channel, Schema

    builder = RecordBuilder()
    kind = "sensor_msgs/msg/JointState"
    Schema(id=1, name=kind, encoding="ros2msg", data=logfiles.DEFINITIONS[kind].encode()).write(builder)
    Channel(id=1, topic="/s", message_encoding="cdr", metadata={}, schema_id=1).write(builder)
    return builder.end() + content


def _message(data: bytes) -> bytes:
    """Return a message record."""
    return b"\x05" + struct.pack("<QHIQQ", 22 + len(data), 1, 0, 1, 1) + data


def mcap_of_zeros(folder: Path) -> Path:
    """A chunk of 400 MB that fits into some tens of kilobytes."""
    return logfiles.chunk(folder / "run.mcap", bytes(400 * 2**20))


def mcap_of_one_message(folder: Path) -> Path:
    """A message of millions of empty names, an object each."""
    head = struct.pack("<IIII", 0x00000100, 1, 1, 1) + b"\0\0\0\0"
    names = struct.pack("<I", 2_000_000) + b"\x01\0\0\0\0\0\0\0" * 2_000_000
    return logfiles.chunk(folder / "run.mcap", _with_topic(_message(head + names)))


def mcap_of_small_messages(folder: Path) -> Path:
    """Half a million messages that say nothing, which once were kept as objects."""
    return logfiles.chunk(folder / "run.mcap", _with_topic(_message(b"\0\x01\0\0") * 380_000))


def npz_of_bytes(folder: Path) -> Path:
    """0.5 MB of zeros, a byte each, of which a double each would be made."""
    path = folder / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in ("time", "position", "torque"):
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.zeros(40 * 2**20, np.int8))
            archive.writestr(f"{name}.npy", buffer.getvalue())
    return path


def written(path: Path, content: bytes) -> Path:
    """Write a file and return it."""
    path.write_bytes(content)
    return path


def csv_with_a_bad_end(folder: Path) -> Path:
    """Tens of megabytes of rows, and a word in the last."""
    names = ",".join(["time", "position", *(f"c{i}" for i in range(38))]).encode()
    row = b",".join([b"0.123456"] * 40) + b"\n"
    return written(folder / "log.csv", names + b"\n" + row * 30_000 + b"0,x" + b",1" * 38 + b"\n")


def csv_of_one_line(folder: Path) -> Path:
    """A line without an end."""
    return written(folder / "log.csv", b"time,position\n" + b"1" * 50_000_000)


def csv_of_commas(folder: Path) -> Path:
    """A header of very many columns."""
    return written(folder / "log.csv", (b"," * 100_000 + b"\n") * 300)


def gzip_of_lines(folder: Path) -> Path:
    """Lines without end in a small packed file."""
    return written(folder / "log.csv.gz", gzip.compress(b"time,position\n" + b"\n" * 60_000_000))


def json_of_objects(folder: Path) -> Path:
    """Empty objects, each many times its text."""
    return written(folder / "log.json", b"[" + b"{}," * 2_000_000 + b"{}]")


def json_of_depth(folder: Path) -> Path:
    """Lists in lists."""
    return written(folder / "log.json", b"[" * 1_000_000)


def parquet_of_one_number(folder: Path) -> Path:
    """Hundreds of millions of the same number, in a few kilobytes."""
    import pyarrow as arrow
    from pyarrow import parquet

    path = folder / "log.parquet"
    zeros = arrow.array(np.zeros(2**22, np.int8))
    part = arrow.table({"time": zeros, "position": zeros})
    with parquet.ParquetWriter(path, part.schema) as writer:
        for _ in range(12):
            writer.write_table(part)
    return path


def parquet_of_lists(folder: Path) -> Path:
    """Few rows of very long lists."""
    import pyarrow as arrow
    from pyarrow import parquet

    path = folder / "log.parquet"
    lists = arrow.ListArray.from_arrays(arrow.array([0, 2**25], arrow.int32()), arrow.array(np.zeros(2**25, np.int8)))
    parquet.write_table(arrow.table({"time": [0.0], "position": lists}), path)
    return path


def _base(folder: Path, *statements: str) -> Path:
    """Write an SQLite file."""
    path = folder / "bag.db3"
    base = sqlite3.connect(path)
    for statement in statements:
        base.execute(statement)
    base.commit()
    base.close()
    return path


TOPICS = "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
MESSAGES = "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
STATE = "INSERT INTO topics VALUES (1, '/s', 'sensor_msgs/msg/JointState', 'cdr')"


def database_of_views(folder: Path) -> Path:
    """A table of messages that is a query without end."""
    endless = (
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id, i AS timestamp"
    )
    return _base(folder, TOPICS, STATE, f"CREATE VIEW messages AS {endless}, zeroblob(9) AS data FROM n")


def database_of_a_column(folder: Path) -> Path:
    """A column of the table that is computed, and would take a gigabyte a row."""
    computed = MESSAGES.replace("data BLOB", "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL")
    return _base(folder, TOPICS, STATE, computed, "INSERT INTO messages (id, topic_id, timestamp) VALUES (1, 1, 1)")


def database_of_one_cell(folder: Path) -> Path:
    """A message of 60 MB."""
    return _base(folder, TOPICS, STATE, MESSAGES, "INSERT INTO messages VALUES (1, 1, 1, zeroblob(60000000))")


ATTACKS: dict[str, Callable[[Path], Path]] = {
    attack.__name__: attack
    for attack in (
        *(sidecar_of_names, sidecar_of_joints, mcap_of_zeros, mcap_of_one_message, mcap_of_small_messages),
        *(npz_of_bytes, csv_with_a_bad_end, csv_of_one_line, csv_of_commas, gzip_of_lines),
        *(json_of_objects, json_of_depth, parquet_of_one_number, parquet_of_lists),
        *(database_of_views, database_of_a_column, database_of_one_cell),
    )
}


def main() -> None:
    """Read every attack that lies in the folder, in little memory."""
    from stiction.identification.logs import open_log

    folder = Path(sys.argv[1])
    open_log(logfiles.canonical(folder, ".parquet"))  # what is imported late counts for nobody
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    outcomes = {}
    for name, path in json.loads((folder / "attacks.json").read_text()).items():
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            with limit_memory(MEMORY):
                open_log(Path(path))
            message = "taken"
        except StictionError as error:
            message = str(error)
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        outcomes[name] = {"error": message, "grown": grown, "size": Path(path).stat().st_size}
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main()
