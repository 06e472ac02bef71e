"""MATLAB version 5 files as named columns. Nothing in such a file is executed."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from stiction.formats.log import Columns, LogError

_BROKEN = (MatReadError, ValueError, TypeError, KeyError, IndexError, EOFError, OSError, NotImplementedError)
_BROKEN_NUMBERS = (OverflowError, MemoryError, zlib.error, UnicodeDecodeError, AttributeError)


def read_mat(path: Path) -> Columns:
    """Read the numeric vectors of a MAT v5 file; scalars are left out, and so is whatever is not a vector of the
    longest length. Raises `LogError`.
    """
    try:
        with path.open("rb") as file:
            head = file.read(128)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror or error}") from error
    if not head.startswith(b"MATLAB 5.0 MAT-file"):
        raise LogError(f"{path.name}: not a MATLAB 5.0 file; in MATLAB save it again with -v7 or -v6, or as CSV")
    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=True)
    except (*_BROKEN, *_BROKEN_NUMBERS) as error:
        raise LogError(f"{path.name}: damaged MATLAB file ({str(error)[:120]})") from error
    vectors = {
        name: np.asarray(values, float)
        for name, values in content.items()
        if isinstance(values, np.ndarray) and values.ndim == 1 and values.dtype.kind in "fiu"
    }
    longest = max((len(values) for values in vectors.values()), default=0)
    columns = {name: values for name, values in vectors.items() if len(values) == longest}
    if not columns:
        raise LogError(f"{path.name}: no numeric vectors in this file")
    return columns
