"""Tables of numbers as Parquet, by pyarrow, which only those need who have such files: `pip install "stiction[logs]"`.

The one module of this room that leans on a library beyond NumPy, and only when a Parquet file is read or written.
"""

from __future__ import annotations

import io
from pathlib import Path
from types import ModuleType

import numpy as np

from stiction.formats.errors import LogError
from stiction.formats.tables import LARGEST_TABLE, Columns, read_bytes

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
