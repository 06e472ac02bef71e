"""Named arrays of numbers, as NPZ or Parquet: read whole or not at all, without executing code.

A matrix, shape (num_samples, num_joints), becomes the columns `name_0`, `name_1`, ... Text is read in `text`.
"""

from __future__ import annotations

import io
import json
import math
import os
import tokenize
import warnings
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from stiction.core.errors import FileError, LogError
from stiction.core.extras import remedy
from stiction.core.files import open_regular, publish, published
from stiction.core.memory import allowance, claim
from stiction.files.plain import parse_object, take_version

Columns = dict[str, np.ndarray]
"""Column name -> values, shape (num_samples,)."""

WIDEST_MATRIX = 256
"""Maximum number of columns of a matrix of joints."""

MOST_MEMBERS = 10_000
"""Maximum number of arrays: each takes time, even if empty."""


@dataclass(frozen=True)
class Table:
    """File as columns, with notes and faults."""

    columns: Columns
    """Name -> numbers; a faulty column is NaN."""
    notes: tuple[str, ...] = ()
    """Notes for readers of the results on how the file was read; one sentence each."""
    faults: Mapping[str, str] = field(default_factory=dict)
    """Column -> reason why it is not a signal, for users who request it."""
    blanks: Mapping[str, int] = field(default_factory=dict)
    """Column -> number of its empty cells, which are NaN."""
    starts: Mapping[str, float] = field(default_factory=dict)
    """Column of time stamps -> the first one, subtracted from it [s]."""
    period: float | None = None
    """Time between two messages of the IMU, if they came separately from the rows and were interpolated [s]."""


def read_bytes(path: Path) -> bytes:
    """Read a file of a bounded size; raise `LogError` where it cannot be read."""
    try:
        with open_regular(path) as file:
            claim(path.name, os.fstat(file.fileno()).st_size, "the file has", LogError)
            return file.read()
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error


def read_npz(path: Path) -> Table:
    """Read an NPZ table: arrays of samples, or of samples by joints, transposed if necessary.

    The number of samples is that of the array `time`, or of most arrays; arrays of other lengths or of more dimensions
    are faults; single numbers and text are left out. Raises `LogError`.
    """
    arrays = read_npz_arrays(path)
    signals = {name: array for name, array in arrays.items() if array.dtype.kind in "fiub" and array.size > 1}
    claim(path.name, sum(8 * array.size for array in signals.values()), "its arrays would take", LogError)
    return table_of(path.name, signals)


def table_of(source: str, arrays: Mapping[str, np.ndarray]) -> Table:
    """Return arrays of one number of samples as columns; others are faults. Raises `LogError` without samples."""
    samples = _count_samples(arrays)
    columns: Columns = {}
    faults: dict[str, str] = {}
    notes = []
    for name, array in arrays.items():
        fits = [axis for axis, size in enumerate(array.shape) if size == samples and array.ndim <= 2]
        if not fits or array.size // samples > WIDEST_MATRIX:
            faults[name] = f"array {name!r} has shape {array.shape}; expected {samples} samples, or samples by joints"
            # A view of one number: a column that is no signal costs no memory.
            columns[name] = np.broadcast_to(np.nan, samples)
            continue
        if fits[0] == 1:
            array = array.T
            if array.shape[1] > 1:
                notes.append(f"the array {name!r} was joints by samples, and was turned")
        columns |= split_matrix(name, array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array)
    if len(faults) == len(arrays):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in list(arrays.items())[:8])
        raise LogError(f"{source}: no arrays of samples, or of samples by joints; found {shapes or 'none of numbers'}")
    return Table(columns, tuple(notes), faults)


def _count_samples(arrays: Mapping[str, np.ndarray]) -> int:
    """Return the number of samples: that of the time, or of most vectors, or of the longest side of a matrix."""
    for name in ("time", "timestamps", "timestamp", "t"):
        if name in arrays and max(arrays[name].shape) == arrays[name].size:
            return int(arrays[name].size)
    sizes = Counter(max(array.shape) for array in arrays.values() if 1 <= array.ndim <= 2)
    return max(sizes, key=lambda size: (sizes[size], size), default=0)


def split_matrix(name: str, array: np.ndarray) -> Columns:
    """Return a vector as one column, and a matrix, shape (num_samples, num_joints), as `name_0`, `name_1`, ..."""
    if array.ndim == 1:
        return {name: array.astype(float)}
    return {f"{name}_{index}": column.astype(float) for index, column in enumerate(array.T)}


def read_npz_arrays(path: Path) -> Columns:
    """Read the arrays of an NPZ file, numbers or text of any shape; pickled objects are refused.

    Every member is inflated whole, so that its checksum is compared, after a check of its declared size.
    """
    return parse_npz(path.name, read_bytes(path))


def parse_npz(source: str, content: bytes, most: int | None = None) -> Columns:
    """Return the arrays of an NPZ file from its content, as `read_npz_arrays` does.

    source: name of the file, for messages; most: maximum inflated size [B].
    """
    # Not by np.load: it takes what is no archive for a pickle, and its error says how to load that unsafely.
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


def read_archive(source: str, content: bytes, most: int | None = None) -> dict[str, bytes]:
    """Return the members of a ZIP archive, name -> bytes; reject one that would inflate to more than `most` bytes.

    source: name of the file, for messages.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if len(entries) > MOST_MEMBERS:
                raise LogError(f"{source}: an archive of {len(entries)} members; at most {MOST_MEMBERS} are read")
            total, most = sum(entry.file_size for entry in entries), allowance() if most is None else most
            if total > most:
                raise LogError(f"{source}: would inflate to {total} bytes; at most {most} are read")
            names = [entry.filename for entry in entries]
            if len(set(names)) != len(names):
                raise LogError(f"{source}: the archive has a repeated member; write it again")
            # The reading of an entry ends at the size that it declares, and these were added up above.
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
        raise ValueError(f"array format version {version} is unknown")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a header by Python 2, say, is read all the same
        shape, fortran_order, dtype = readers[version](file)
    # Refused by its header, before there is an array: to read an array of objects is to run a pickle.
    if dtype.hasobject or dtype.kind not in "fiubU":
        raise ValueError(f"{dtype} is not a plain number or text; save numbers, array.astype(float)")
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
"""Exceptions of the zip reader and the inflater for damaged files."""

BROKEN_ARRAY = (
    *(ValueError, SyntaxError, TypeError, KeyError, MemoryError, OverflowError, RecursionError),
    *(tokenize.TokenError, IndexError, AttributeError),
)
"""Exceptions of NumPy's reader of array headers."""


def read_header(arrays: Columns, schema: str, version: int, where: str) -> dict[str, Any]:
    """Remove the text `header` from an NPZ file's arrays; return its JSON object without `schema` and version.

    Raises `LogError` for a missing header, or another schema or version; messages name `where`.
    """
    text = arrays.pop("header", None)
    if text is None or text.dtype.kind != "U" or text.ndim != 0:
        raise LogError(f"{where}: no header; expected a file of the schema {schema!r}")
    data = parse_object(str(text), f"{where}: header", f"one of the schema {schema!r}", LogError)
    if data.pop("schema", None) != schema:
        raise LogError(f"{where}: the header's schema is not {schema!r}; expected a file of that schema")
    return take_version(data, version, where, LogError)


def write_header(schema: str, version: int, header: dict[str, Any]) -> np.ndarray:
    """Return the header of `read_header`, a text as an array of no dimension."""
    return np.array(json.dumps({"schema": schema, "schema_version": version} | header, allow_nan=False))


def publish_npz(path: Path, arrays: Columns, compressed: bool = False) -> None:
    """Write arrays atomically; raise `UnwrittenError` on failure."""
    save = np.savez_compressed if compressed else np.savez
    with published(path) as file:
        save(file, allow_pickle=False, **arrays)


Record = TypeVar("Record")


def write_arrays(path: Path, record: Any) -> None:
    """Write the fields of a dataclass, all arrays, in single precision."""
    arrays = {item.name: np.asarray(getattr(record, item.name), np.float32) for item in fields(record)}
    publish_npz(path, arrays, compressed=True)


def read_arrays(path: Path, kind: type[Record], remedy: str) -> Record:
    """Return the dataclass that `write_arrays` wrote; raise `FileError`, with a `remedy`, for an invalid array."""
    arrays = read_npz_arrays(path)
    if odd := sorted(arrays.keys() ^ {item.name for item in fields(kind)}):  # type: ignore[arg-type]
        raise FileError(f"{path.name}: the array {odd[0]!r} is missing or unknown; {remedy}")
    return kind(**arrays)


def write_csv(path: Path, table: Columns) -> None:
    """Write columns of one length with nine significant digits, time with fifteen: it may count from 1970."""
    formats = ["%.15g" if name == "time" else "%.9g" for name in table]
    rows = np.column_stack(list(table.values()))
    with publish(path) as partial:
        np.savetxt(partial, rows, fmt=formats, delimiter=",", header=",".join(table), comments="")


SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Unit of a column of time stamps -> seconds."""


def _load(path: Path) -> tuple[ModuleType, ModuleType]:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(f"{path.name}: Parquet needs pyarrow; {remedy('logs')}") from error
    return pyarrow, parquet


def read_parquet(path: Path) -> Table:
    """Read the columns of numbers, of lists of numbers, and of time stamps (then in seconds from the first).

    A null becomes NaN. A list column becomes `name_0`, `name_1`, ...; lists of different lengths, and other contents,
    are faults. Raises `LogError`.
    """
    arrow, parquet = _load(path)
    content = read_bytes(path)
    try:
        file = parquet.ParquetFile(io.BytesIO(content), page_checksum_verification=True)
        samples, schema = file.metadata.num_rows, file.schema_arrow
        if len(set(schema.names)) != len(schema.names):
            raise LogError(f"{path.name}: a column name is repeated; expected different names")
        kinds = {item.name: item.type for item in schema if _is_number(arrow, _element(arrow, item.type))}
        claim(path.name, _parquet_size(file, kinds, samples), f"{samples} rows would take", LogError)
        columns: Columns = {}
        starts: dict[str, float] = {}
        faults = {name: f"column {name!r} holds no numbers" for name in schema.names if name not in kinds}
        for name, kind in kinds.items():
            # One after the other, so that two forms of a column lie in memory, and not of the whole table.
            column = file.read(columns=[name], use_threads=False).column(name)
            if kind == _element(arrow, kind):
                columns[name], starts[name] = _to_array(arrow, column, kind)
            elif (matrix := _to_matrix(column, samples)) is not None:
                columns |= split_matrix(name, matrix)
            else:
                faults[name] = f"the lists in column {name!r} are not all of one length, up to {WIDEST_MATRIX}"
    except (arrow.ArrowException, *BROKEN_PARQUET) as error:
        raise LogError(f"{path.name}: not a readable Parquet file ({str(error).splitlines()[0][:120]})") from error
    if not columns:
        raise LogError(f"{path.name}: no column of numbers; the columns are {', '.join(schema.names[:20])}")
    if any(len(values) != samples for values in columns.values()):
        raise LogError(f"{path.name}: the columns are not all {samples} rows long; write the file again")
    return Table(columns | {name: np.broadcast_to(np.nan, samples) for name in faults}, (), faults, starts=starts)


BROKEN_PARQUET = (OSError, ValueError, KeyError, IndexError, TypeError, OverflowError, AttributeError)
"""Exceptions of pyarrow for damaged files, other than its own."""


def _parquet_size(file: Any, kinds: Mapping[str, object], samples: int) -> int:
    """Return the larger of the declared inflated size of the wanted columns and their size as doubles [B]."""
    numbers = declared = 0
    for group in range(file.metadata.num_row_groups):
        row_group = file.metadata.row_group(group)
        for index in range(row_group.num_columns):
            leaf = row_group.column(index)
            if leaf.path_in_schema.split(".list.")[0] in kinds or leaf.path_in_schema in kinds:
                numbers += leaf.num_values
                declared += leaf.total_uncompressed_size
    return max(8 * numbers, 8 * samples * len(kinds), declared)


def _element(arrow: ModuleType, kind: Any) -> Any:
    """Return the type of a list's elements, or the type itself for others."""
    types = arrow.types
    lists = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    return kind.value_type if lists else kind


def _is_number(arrow: ModuleType, kind: object) -> bool:
    types = arrow.types
    return types.is_integer(kind) or types.is_floating(kind) or types.is_timestamp(kind) or types.is_duration(kind)


def _to_array(arrow: ModuleType, column: Any, kind: Any) -> tuple[np.ndarray, float]:
    """Return a column as doubles, shape (num_samples,), and its start; stamps count from there, to keep digits."""
    if arrow.types.is_timestamp(kind) or arrow.types.is_duration(kind):
        counts = column.cast(arrow.int64())
        first = counts[0].as_py() if len(counts) else 0
        if counts.null_count or first is None:
            raise ValueError("a time stamp is missing")
        # Subtracted as integers: nanoseconds since 1970 have more digits than a double.
        return (counts.to_numpy() - first) * SECONDS[kind.unit], first * SECONDS[kind.unit]
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float), 0.0


def _to_matrix(column: Any, samples: int) -> np.ndarray | None:
    """Return a column of lists as a matrix, shape (num_samples, length); None for different lengths."""
    parts = []
    for chunk in column.chunks:
        values = np.asarray(chunk.flatten().to_numpy(zero_copy_only=False), dtype=float)
        lengths = chunk.value_lengths()
        if lengths.null_count or chunk.null_count or not len(chunk) or len(values) % len(chunk):
            return None
        width = len(values) // len(chunk)
        if not 1 <= width <= WIDEST_MATRIX or (np.asarray(lengths) != width).any():
            return None
        parts.append(values.reshape(len(chunk), width))
    if not parts or len({part.shape[1] for part in parts}) != 1:
        return None
    return np.concatenate(parts)


def write_parquet(path: Path, table: Columns) -> None:
    """Write columns of doubles, with a checksum on every page."""
    arrow, parquet = _load(path)
    with publish(path) as partial:
        parquet.write_table(arrow.table(table), partial, write_page_checksum=True)
