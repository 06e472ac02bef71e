"""MATLAB version 5 files as named columns. Nothing in such a file is executed."""

from __future__ import annotations

import io
import math
import warnings
import zlib
from pathlib import Path

import numpy as np
from scipy.io import loadmat, whosmat
from scipy.io.matlab import MatReadError, MatReadWarning

from stiction.formats.errors import LogError
from stiction.formats.tables import LARGEST_TABLE, WIDEST_MATRIX, Columns, read_bytes, split_matrix

COMPRESSED = 15
"""Type of an element that holds a deflated one."""

NUMBERS = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
"""Classes of variables that may be signals."""

_BROKEN = (MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, OSError, NotImplementedError)
_BROKEN_NUMBERS = (OverflowError, MemoryError, zlib.error, UnicodeDecodeError, AttributeError, MatReadWarning)


def read_mat(path: Path) -> Columns:
    """Read the numeric vectors of a MAT v5 file, and its matrices, shape (num_samples, num_joints), as `name_0`, ...

    The longest length is that of the samples: what is shorter is left out. Raises `LogError`.
    """
    content = read_bytes(path)
    if not content.startswith(b"MATLAB 5.0 MAT-file"):
        raise LogError(f"{path.name}: not a MATLAB 5.0 file; in MATLAB save it again with -v7 or -v6, or as CSV")
    try:
        _check_elements(content)
        with warnings.catch_warnings():
            warnings.simplefilter("error", MatReadWarning)
            listed = whosmat(io.BytesIO(content))
            sizes = {name: math.prod(shape) for name, shape, kind in listed if kind in NUMBERS and len(shape) == 2}
            if 8 * sum(sizes.values()) > LARGEST_TABLE or min(sizes.values(), default=0) < 0:
                raise ValueError(f"{sum(sizes.values())} numbers; at most {LARGEST_TABLE // 8} are read")
            loaded = loadmat(io.BytesIO(content), variable_names=list(sizes)) if sizes else {}
    except (*_BROKEN, *_BROKEN_NUMBERS) as error:
        raise LogError(f"{path.name}: damaged MATLAB file ({str(error)[:120]})") from error
    arrays = {name: _upright(loaded[name]) for name in sizes if isinstance(loaded.get(name), np.ndarray)}
    arrays = {name: array for name, array in arrays.items() if array.dtype.kind in "fiu" and array.size > 1}
    longest = max((len(values) for values in arrays.values()), default=0)
    columns: Columns = {}
    for name, array in arrays.items():
        if len(array) == longest and (array.ndim == 1 or array.shape[1] <= WIDEST_MATRIX):
            columns |= split_matrix(name, array)
    if not columns:
        raise LogError(f"{path.name}: no numeric vectors in this file")
    return columns


def _upright(array: np.ndarray) -> np.ndarray:
    """Return a row or column vector as a vector, and a matrix with its longer side as samples."""
    if min(array.shape) == 1:
        return array.ravel()
    return array if array.shape[0] >= array.shape[1] else array.T


def _check_elements(content: bytes) -> None:
    """Walk the elements of the file; raise `ValueError` if one is cut off or would inflate to too much."""
    order = {b"IM": "little", b"MI": "big"}.get(content[126:128])
    if order is None:
        raise ValueError("no byte order in the header")
    place, total = 128, 0
    while place < len(content):
        kind = int.from_bytes(content[place : place + 4], order)  # type: ignore[arg-type]
        size = int.from_bytes(content[place + 4 : place + 8], order)  # type: ignore[arg-type]
        body = content[place + 8 : place + 8 + size]
        if place + 8 > len(content) or len(body) != size:
            raise ValueError(f"cut off: an element of {size} bytes, {len(content) - place - 8} are left")
        if kind == COMPRESSED:
            total += _inflated_size(body, LARGEST_TABLE - total)
        place += 8 + size


def _inflated_size(data: bytes, limit: int) -> int:
    """Return what a deflated element inflates to; raise `ValueError` beyond `limit` or where the end is missing."""
    inflater, size = zlib.decompressobj(), 0
    while not inflater.eof:
        piece = inflater.decompress(data, 2**20)
        data = inflater.unconsumed_tail
        size += len(piece)
        if size > limit:
            raise ValueError(f"inflates to more than {limit} bytes")
        if not piece and not data:
            raise ValueError("cut off: the end of a compressed variable is missing")
    return size
