"""MATLAB version 5 files (`save -v6`, `-v7`) as named columns. Nothing in such a file is executed.

After 128 bytes of header come elements, each a type, a size and as many bytes; a matrix is an element of elements, a
compressed element holds another, deflated. Not read by scipy.io, which a damaged size can crash.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from stiction.core.errors import LogError
from stiction.core.memory import allowance, claim
from stiction.files.tables import Table, read_bytes, table_of

COMPRESSED, MATRIX = 15, 14
"""Types of elements that hold others."""

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of an element -> NumPy's name of its numbers, without the byte order."""

NUMERIC_CLASSES = range(6, 16)
"""Classes of matrices that hold numbers: double, single, and integers of 8 to 64 bits."""

COMPLEX = 0x08
"""Flag of a matrix with an imaginary part, which no signal has."""

ORDERS = {b"IM": "<", b"MI": ">"}
"""Mark in the header -> byte order."""


def read_mat(path: Path) -> Table:
    """Read the numeric vectors of a MAT v5 file, and its matrices, shape (num_samples, num_joints), as `name_0`, ...

    What has another number of samples has a fault. Raises `LogError`.
    """
    content = read_bytes(path)
    # MATLAB itself puts 512 bytes, with a header as of version 5, in front of the HDF5.
    if content.startswith(b"\x89HDF") or content[512:516] == b"\x89HDF":
        raise LogError(f"{path.name}: MATLAB 7.3, which is HDF5; in MATLAB save it again with -v7, or as CSV")
    if not content.startswith(b"MATLAB 5.0 MAT-file"):
        raise LogError(f"{path.name}: not a MATLAB 5.0 file; in MATLAB save it again with -v7 or -v6, or as CSV")
    try:
        variables = _variables(content)
    except (ValueError, zlib.error) as error:
        raise LogError(f"{path.name}: damaged MATLAB file ({str(error)[:120]})") from error
    arrays = {name: array.ravel() if 1 in array.shape else array for name, array in variables.items() if array.size > 1}
    claim(path.name, sum(8 * array.size for array in arrays.values()), "its matrices would take", LogError)
    return table_of(path.name, arrays)


def _variables(content: bytes) -> dict[str, np.ndarray]:
    """Return the real, numeric matrices of two dimensions by name; raise `ValueError` for a damaged file."""
    order = ORDERS.get(content[126:128])
    if order is None:
        raise ValueError("no byte order in the header")
    found: dict[str, np.ndarray] = {}
    left = allowance()
    # Nothing is padded here: a compressed variable ends at any byte, and the size of a plain one counts its padding.
    for kind, body in _elements(content[128:], order, padded=False):
        if kind == COMPRESSED:
            inner = _inflated(body, left)
            left -= len(inner)
            elements = list(_elements(inner, order, padded=False))
            if len(elements) != 1:
                raise ValueError(f"a compressed element holds {len(elements)} variables; expected one")
            kind, body = elements[0]
        variable = _matrix(body, order) if kind == MATRIX else None
        if variable is None:
            continue
        name, array = variable
        if name in found:
            raise ValueError(f"the variable {name[:40]!r} comes twice")
        found[name] = array
    return found


def _elements(data: bytes, order: str, padded: bool = True) -> Iterator[tuple[int, bytes]]:
    """Yield type and content of the elements; padded: each starts at a multiple of eight bytes."""
    place = 0
    while place < len(data):
        if len(data) - place < 8:
            raise ValueError("cut off in front of an element")
        kind, size = (int(word) for word in np.frombuffer(data, f"{order}u4", 2, place))
        start, end = place + 8, place + 8 + size
        if kind >> 16:  # a small element: size and type in one word, the content in the next
            kind, size = kind & 0xFFFF, kind >> 16
            start, end = place + 4, place + 4 + size
            if size > 4:
                raise ValueError(f"a small element of {size} bytes")
        if end > len(data):
            raise ValueError(f"cut off: an element of {size} bytes, {len(data) - start} are left")
        yield kind, data[start:end]
        # A small element takes all of its eight bytes, however few are filled.
        place = max(end, place + 8)
        if padded:
            place = min(-(-place // 8) * 8, len(data))


def _matrix(data: bytes, order: str) -> tuple[str, np.ndarray] | None:
    """Return name and numbers of a matrix, or None for what is no real matrix of numbers in two dimensions."""
    elements = _elements(data, order)
    flags, shape, name = (next(elements, (0, b""))[1] for _ in range(3))
    if len(flags) != 8:
        raise ValueError("a variable without flags")
    word = int(np.frombuffer(flags, f"{order}u4", 1)[0])
    if word & 0xFF not in NUMERIC_CLASSES or (word >> 8) & COMPLEX or len(shape) != 8:
        return None
    rows, columns = (int(size) for size in np.frombuffer(shape, f"{order}i4"))
    kind, numbers = next(elements, (0, b""))
    if kind not in NUMBERS:
        raise ValueError(f"numbers of type {kind}")
    dtype = np.dtype(order + NUMBERS[kind])
    if min(rows, columns) < 0 or math.prod((rows, columns, dtype.itemsize)) != len(numbers):
        raise ValueError(f"{rows} by {columns} numbers of {dtype} in {len(numbers)} bytes")
    if next(elements, None) is not None:
        raise ValueError("a variable with more than its numbers")
    return name.decode("latin-1"), np.frombuffer(numbers, dtype).reshape((rows, columns), order="F")


def _inflated(data: bytes, limit: int) -> bytes:
    """Return a deflated element; raise `ValueError` beyond `limit` bytes or where its end is missing."""
    inflater = zlib.decompressobj()
    inflated = inflater.decompress(data, limit + 1)
    # `decompress` stops at the limit without a word, so one byte beyond it was asked for.
    if len(inflated) > limit:
        raise ValueError(f"inflates to more than {allowance()} bytes")
    if not inflater.eof:
        raise ValueError("cut off: the end of a compressed variable is missing")
    return inflated
