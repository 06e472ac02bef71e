"""Arrays of numbers with names, as CSV, NPZ or Parquet: read whole or not at all, and nothing that executes code.

A matrix in an NPZ file, shape (num_samples, num_joints), becomes the columns `name_0`, `name_1`, ...
"""

from __future__ import annotations

import csv
import io
import json
import math
import tokenize
import warnings
import zipfile
import zlib
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from stiction.core.cache import publish
from stiction.core.errors import FileError, LogError
from stiction.formats.plain import parse_object, take_version

Columns = dict[str, np.ndarray]
"""Column name -> values, shape (num_samples,)."""

LARGEST_TABLE = 2**29
"""Bytes that a file, or what it inflates to, may have: a day of one joint at 100 Hz, an hour of twelve at 1 kHz."""

WIDEST_MATRIX = 256
"""More columns than this are no joints."""


def read_bytes(path: Path) -> bytes:
    """Read a file of a bounded size; raise `LogError` where that cannot be done."""
    try:
        size = path.stat().st_size
        if size > LARGEST_TABLE:
            raise LogError(f"{path.name}: {size} bytes; at most {LARGEST_TABLE} are read: cut the log into parts")
        return path.read_bytes()
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


def read_csv(path: Path) -> tuple[Columns, tuple[str, ...]]:
    """Read a comma-separated file whose first line names the columns and whose every cell is a number.

    A last line without an end may have been cut in the middle of a number, and nothing in it would show it. It is left
    out, and the notes, the second thing returned, say so; where it is short of cells, the file was cut, and is refused.
    """
    content = read_bytes(path)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LogError(f"{path.name}: not a text file (byte {error.start} is not UTF-8); expected CSV") from error
    if not text.strip():
        raise LogError(f"{path.name}: the file is empty; expected a header that names the columns, and rows of numbers")
    first, _, body = text.partition("\n")
    names = _header(path, first)
    body, notes = _whole_lines(path, body, names)
    if not body.strip():
        raise LogError(f"{path.name}: no samples after the header")
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2, dtype=float)
    except ValueError as error:
        raise LogError(f"{path.name}: {_first_fault(body, names) or str(error)[:160]}") from error
    if values.shape[1] != len(names):
        raise LogError(f"{path.name}: {_first_fault(body, names)}")
    return dict(zip(names, values.T.copy(), strict=True)), notes


def _header(path: Path, first: str) -> list[str]:
    """Return the columns' names."""
    try:
        names = [name.strip() for name in next(csv.reader([first.rstrip("\r")], strict=True), [])]
    except csv.Error as error:
        raise LogError(
            f"{path.name}: the header cannot be read ({error}); expected names separated by commas"
        ) from error
    if not all(names) or not names or len(set(names)) != len(names):
        raise LogError(f"{path.name}: the header is {first[:80]!r}; expected one different name a column")
    if len(names) == 1 and (mark := next((mark for mark in ";\t" if mark in first), "")):
        raise LogError(f"{path.name}: the columns are separated by {mark!r}; expected commas, and decimal points")
    return names


def _whole_lines(path: Path, body: str, names: list[str]) -> tuple[str, tuple[str, ...]]:
    """Return the lines that have an end, and a note on the one that has none."""
    whole, _, last = body.rpartition("\n")
    if not last.strip():
        return body, ()
    number = whole.count("\n") + (3 if whole else 2)
    if last.count(",") + 1 != len(names):
        raise LogError(
            f"{path.name}: line {number}, the last, has {last.count(',') + 1} values and no end, the header names "
            f"{len(names)} columns: the file was cut off; get it again, or take that line out"
        )
    return whole + "\n" if whole else "", (
        f"line {number}, the last, has no line end and may be cut off in a number: it is left out",
    )


def _first_fault(body: str, names: list[str]) -> str:
    """Return what is wrong with the first line that is not one number a column; the file's first line is the header."""
    for number, line in enumerate(body.split("\n"), 2):
        cells = line.split(",")
        if not line.strip():
            continue
        if len(cells) != len(names):
            return f"line {number} has {len(cells)} values, the header names {len(names)} columns"
        for name, cell in zip(names, cells, strict=True):
            try:
                float(cell)
            except ValueError:
                return f"line {number}: {cell.strip()[:40]!r} in column {name!r} is not a number"
    return ""


def read_npz(path: Path) -> Columns:
    """Read an NPZ table: its arrays must be of one length; matrices become columns, single numbers and text are left
    out.
    """
    columns: Columns = {}
    for name, array in read_npz_arrays(path).items():
        if array.dtype.kind not in "fiu" or array.ndim == 0:
            continue
        if array.ndim > 2 or (array.ndim == 2 and not 1 <= array.shape[1] <= WIDEST_MATRIX):
            raise LogError(
                f"{path.name}: array {name!r} has shape {array.shape}; expected samples, or samples by joints"
            )
        columns |= split_matrix(name, array)
    lengths = sorted({len(array) for array in columns.values()})
    if len(lengths) != 1:
        raise LogError(f"{path.name}: arrays of lengths {lengths}; expected one length for all")
    return columns


def split_matrix(name: str, array: np.ndarray) -> Columns:
    """Return a vector as one column, and a matrix, shape (num_samples, num_joints), as `name_0`, `name_1`, ..."""
    if array.ndim == 1:
        return {name: array.astype(float)}
    return {f"{name}_{index}": column.astype(float) for index, column in enumerate(array.T)}


def read_npz_arrays(path: Path) -> Columns:
    """Read the arrays of an NPZ file, numbers or text of any shape; pickled objects are refused.

    Every member is inflated whole, so that its checksum is compared, and only after the sizes that it declares.
    """
    return parse_npz(path.name, read_bytes(path))


def parse_npz(source: str, content: bytes, most: int = LARGEST_TABLE) -> Columns:
    """Return the arrays of an NPZ file of that content, as `read_npz_arrays` does.

    source: the file's name, for messages; most: bytes that it may inflate to.
    """
    if not zipfile.is_zipfile(io.BytesIO(content)):
        raise LogError(f"{source}: not an NPZ file, which is a ZIP archive of arrays; write it with numpy.savez")
    arrays = {}
    for member, data in read_archive(source, content, most).items():
        try:
            arrays[member.removesuffix(".npy")] = _parse_array(data)
        except BROKEN_ARRAY as error:
            raise LogError(
                f"{source}: not a readable NPZ file of plain arrays ({member}: {str(error)[:120]})"
            ) from error
    return arrays


def read_archive(source: str, content: bytes, most: int = LARGEST_TABLE) -> dict[str, bytes]:
    """Return the members of a ZIP archive, name -> bytes; refuse one that would inflate to more than `most` bytes.

    source: the file's name, for messages.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            total = sum(entry.file_size for entry in entries)
            if total > most:
                raise LogError(f"{source}: would inflate to {total} bytes; at most {most} are read")
            names = [entry.filename for entry in entries]
            if len(set(names)) != len(names):
                raise LogError(f"{source}: the archive has a member twice; write it again")
            members = {entry.filename: archive.read(entry) for entry in entries}
    except BROKEN_ARCHIVE as error:
        raise LogError(f"{source}: not a readable archive ({str(error)[:120]})") from error
    for entry in entries:
        if len(members[entry.filename]) != entry.file_size:
            raise LogError(f"{source}: {entry.filename} is shorter than it says; get the file again")
    return members


def _parse_array(data: bytes) -> np.ndarray:
    """Return the array of an NPY file, whose header must account for every byte."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"array format version {version} is not known")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a header by Python 2, say, is read all the same
        shape, fortran_order, dtype = readers[version](file)
    if dtype.hasobject or dtype.kind not in "fiubU":
        raise ValueError(f"{dtype} is not a plain number or text")
    size = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or size != len(data) - file.tell():
        raise ValueError(f"shape {shape} of {dtype} does not fit {len(data) - file.tell()} bytes")
    if size == 0:
        return np.zeros(shape, dtype)
    flat = np.frombuffer(data, dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if fortran_order else "C")


BROKEN_ARCHIVE = (
    *(OSError, ValueError, EOFError, KeyError, IndexError, zipfile.BadZipFile, zlib.error, NotImplementedError),
    *(RuntimeError, AttributeError, MemoryError, OverflowError, zipfile.LargeZipFile),
)
"""What the zip reader and the inflater let through for damaged files."""

BROKEN_ARRAY = (
    *(ValueError, SyntaxError, TypeError, KeyError, MemoryError, OverflowError, RecursionError),
    *(tokenize.TokenError, IndexError, AttributeError),
)
"""What NumPy's reader of array headers lets through."""


def read_header(arrays: Columns, schema: str, version: int, where: str) -> dict[str, Any]:
    """Take the text `header` out of an NPZ file's arrays; return its JSON object without `schema` and version.

    Raises `LogError` where it is no such text, or of another schema or version; `where` is named in messages.
    """
    text = arrays.pop("header", None)
    if text is None or text.dtype.kind != "U" or text.ndim != 0:
        raise LogError(f"{where}: no header; expected a file of the schema {schema!r}")
    data = parse_object(str(text), f"{where}: header", f"one of the schema {schema!r}", LogError)
    if data.pop("schema", None) != schema:
        raise LogError(f"{where}: the header does not say {schema!r}; expected a file of that schema")
    return take_version(data, version, where, LogError)


def write_header(schema: str, version: int, header: dict[str, Any]) -> np.ndarray:
    """Return what `read_header` reads, a text as an array of no dimension."""
    return np.array(json.dumps({"schema": schema, "schema_version": version} | header, allow_nan=False))


def publish_npz(path: Path, arrays: Columns, compressed: bool = False) -> None:
    """Write arrays, whole or not at all; raise `FileError` where that cannot be done."""
    save = np.savez_compressed if compressed else np.savez
    try:
        with publish(path) as partial, partial.open("wb") as file:
            save(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror or error}; choose another folder") from error


Record = TypeVar("Record")


def write_arrays(path: Path, record: Any) -> None:
    """Write the fields of a dataclass, all arrays, in single precision."""
    arrays = {item.name: np.asarray(getattr(record, item.name), np.float32) for item in fields(record)}
    np.savez_compressed(path, allow_pickle=False, **arrays)


def read_arrays(path: Path, kind: type[Record], remedy: str) -> Record:
    """Return the dataclass that `write_arrays` wrote; raise `FileError`, with a `remedy`, where an array is odd."""
    arrays = read_npz_arrays(path)
    if odd := sorted(arrays.keys() ^ {item.name for item in fields(kind)}):  # type: ignore[arg-type]
        raise FileError(f"{path.name}: the array {odd[0]!r} is missing or unknown; {remedy}")
    return kind(**arrays)


def write_csv(path: Path, table: Columns) -> None:
    """Write columns of one length with nine significant digits, time with fifteen: it may count from 1970."""
    formats = ["%.15g" if name == "time" else "%.9g" for name in table]
    rows = np.column_stack(list(table.values()))
    np.savetxt(path, rows, fmt=formats, delimiter=",", header=",".join(table), comments="")


def write_npz(path: Path, table: Columns) -> None:
    """Write columns as arrays of doubles."""
    np.savez_compressed(path, allow_pickle=False, **table)


SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Unit of a column of time stamps -> seconds."""


def _load(path: Path) -> tuple[ModuleType, ModuleType]:
    """Return pyarrow and its Parquet module, or say how to get them."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(f'{path.name}: Parquet needs pyarrow: pip install "stiction[logs]"') from error
    return pyarrow, parquet


def read_parquet(path: Path) -> Columns:
    """Read the columns of numbers and of time stamps (then in seconds from the first); a null becomes NaN.

    Columns of text and of lists are left out. Raises `LogError`.
    """
    arrow, parquet = _load(path)
    content = read_bytes(path)
    try:
        file = parquet.ParquetFile(io.BytesIO(content), page_checksum_verification=True)
        samples, width = file.metadata.num_rows, file.metadata.num_columns
        declared = sum(file.metadata.row_group(index).total_byte_size for index in range(file.metadata.num_row_groups))
        if max(samples * max(width, 1) * 8, declared) > LARGEST_TABLE:
            raise LogError(f"{path.name}: {samples} rows of {width} columns; at most {LARGEST_TABLE} bytes are read")
        schema = file.schema_arrow
        kinds = {item.name: item.type for item in schema if _is_number(arrow, item.type)}
        if len(set(schema.names)) != len(schema.names):
            raise LogError(f"{path.name}: a column's name comes twice; expected different names")
        table = file.read(columns=list(kinds), use_threads=False)
        columns = {name: _to_array(arrow, table.column(name), kinds[name]) for name in kinds}
    except (arrow.ArrowException, *BROKEN_PARQUET) as error:
        raise LogError(f"{path.name}: not a readable Parquet file ({str(error).splitlines()[0][:120]})") from error
    if not columns:
        raise LogError(f"{path.name}: no column of numbers; the columns are {', '.join(schema.names[:20])}")
    if any(len(values) != samples for values in columns.values()):
        raise LogError(f"{path.name}: the columns are not all {samples} rows long; write the file again")
    return columns


BROKEN_PARQUET = (OSError, ValueError, KeyError, IndexError, TypeError, MemoryError, OverflowError, AttributeError)
"""What pyarrow lets through for damaged files besides its own exceptions."""


def _is_number(arrow: ModuleType, kind: object) -> bool:
    """Return whether a column can be a signal or a time."""
    types = arrow.types
    return types.is_integer(kind) or types.is_floating(kind) or types.is_timestamp(kind) or types.is_duration(kind)


def _to_array(arrow: ModuleType, column: object, kind: object) -> np.ndarray:
    """Return a column as doubles, shape (num_samples,); stamps count from the first, which keeps their digits."""
    if arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        counts = column.cast(arrow.int64())  # type: ignore[attr-defined]
        first = counts[0].as_py() if len(counts) else 0
        if counts.null_count or first is None:
            raise ValueError("a time stamp is missing")
        return (counts.to_numpy() - first) * SECONDS[kind.unit]  # type: ignore[attr-defined]
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)  # type: ignore[attr-defined]


def write_parquet(path: Path, table: Columns) -> None:
    """Write columns of doubles, with a checksum on every page."""
    arrow, parquet = _load(path)
    parquet.write_table(arrow.table(table), path, write_page_checksum=True)
