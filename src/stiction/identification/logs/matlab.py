"""MATLAB files up to version 7 as named columns, by scipy.io, which a damaged size can crash: read by `apart` alone."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal

import numpy as np

from stiction.core.errors import LogError
from stiction.core.memory import claim
from stiction.files.tables import Table, read_bytes, table_of


def read_mat(path: Path) -> Table:
    """Read the numeric vectors of a MAT file, and its matrices, shape (num_samples, num_joints), as `name_0`, ...

    What has another number of samples has a fault. Raises `LogError`.
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
        numeric = [(name, shape) for name, shape, kind in listed if kind in kinds and len(shape) == 2]
        if len({name for name, *_ in listed}) != len(listed):
            raise ValueError("a variable comes twice")
        claim(
            path.name,
            sum(8 * int(np.prod(shape, dtype=object)) for _, shape in numeric),
            "its matrices would take",
            LogError,
        )
        loaded = loadmat(
            io.BytesIO(content), variable_names=[name for name, _ in numeric], verify_compressed_data_integrity=True
        )
    except LogError:
        raise
    # Whatever a damaged file has scipy raise; this process ends here.
    except Exception as error:
        raise LogError(f"{path.name}: damaged MATLAB file ({str(error)[:120]}); save it again") from error
    arrays = {name: loaded[name] for name, _ in numeric if name in loaded and loaded[name].dtype.kind in "fiu"}
    arrays = {name: one.ravel() if 1 in one.shape else one for name, one in arrays.items() if one.size > 1}
    return table_of(path.name, arrays)


def _check_end(content: bytes) -> None:
    """Raise `ValueError` where the last variable ends beyond the file: scipy passes over one that it need not load."""
    order: Literal["little", "big"] = "big" if content[126:128] == b"MI" else "little"
    place = 128
    while place < len(content):
        place += 8 + int.from_bytes(content[place + 4 : place + 8], order)
    if place != len(content):
        raise ValueError(f"cut off: {len(content)} bytes, and a variable ends at {place}")
