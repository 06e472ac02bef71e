"""PACE's logs, `.pt`: a ZIP archive of tensors that `torch.save` wrote, read without torch and without executing it.

The dictionary has `time`, shape (num_samples,), and matrices of shape (num_samples, num_joints): `dof_pos`,
`des_dof_pos`, and where there are `dof_vel` and `tau`. Its joints have names only where the file lists them.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from stiction.formats.errors import LogError
from stiction.formats.tables import WIDEST_MATRIX, Columns, read_archive, read_bytes, split_matrix
from stiction.identify.logs.opcodes import Tensor, read_index

NAMES = ("joint_names", "joint_order")
"""Entries that list the joints' names, in files that have one."""

LARGEST_INDEX = 2**20
"""A dictionary of a dozen tensors takes less than a kilobyte [B]."""

BYTE_ORDERS = {b"little": "<", b"big": ">"}

_BROKEN_INDEX = (ValueError, KeyError, IndexError, TypeError, OverflowError, MemoryError, RecursionError)
"""What a damaged index raises; `NotPlainError` and `UnicodeDecodeError` are of the first kind."""


def read_pace(path: Path) -> tuple[Columns, tuple[str, ...]]:
    """Return the tensors as columns, `dof_pos_0` and so on, and the joints' names where the file lists them.

    What is neither a vector nor a matrix of as many rows as the longest is left out. Raises `LogError`.
    """
    content = read_bytes(path)
    if not content.startswith(b"PK"):
        raise LogError(f"{path.name}: not an archive of torch.save; in torch load and save it again, or as NPZ")
    members = read_archive(path.name, content)
    indices = [name for name in members if name.endswith("/data.pkl")]
    if len(indices) != 1 or len(members[indices[0]]) > LARGEST_INDEX:
        raise LogError(f"{path.name}: not an archive of torch.save: it has {len(indices)} index files of a usual size")
    folder = indices[0].removesuffix("data.pkl")
    order = BYTE_ORDERS.get(members.get(f"{folder}byteorder", b"little"))
    if order is None:
        raise LogError(f"{path.name}: the byte order is neither little nor big; save the file again")
    try:
        entries = read_index(members[indices[0]])
        if not isinstance(entries, dict):
            raise ValueError(f"a {type(entries).__name__} instead of a dictionary")
        tensors = {
            name: value for name, value in entries.items() if isinstance(value, Tensor) and isinstance(name, str)
        }
        arrays = {name: _numbers(tensor, members, folder, order) for name, tensor in tensors.items()}
    except _BROKEN_INDEX as error:
        raise LogError(
            f"{path.name}: {str(error)[:120]}: only a dictionary of tensors is read, as "
            "torch.save({'time': ..., 'dof_pos': ..., 'des_dof_pos': ...}, file) writes it; nothing was executed"
        ) from error
    return _columns(path.name, arrays), _listed_names(path.name, entries)


def _columns(source: str, arrays: dict[str, np.ndarray]) -> Columns:
    """Return what has as many rows as the longest as columns."""
    signals = {name: array for name, array in arrays.items() if array.ndim in (1, 2)}
    longest = max((len(array) for array in signals.values()), default=0)
    columns: Columns = {}
    for name, array in signals.items():
        if len(array) == longest and (array.ndim == 1 or array.shape[1] <= WIDEST_MATRIX):
            columns |= split_matrix(name, array)
    if not columns or not longest:
        raise LogError(f"{source}: no tensor of samples, or of samples by joints; found {', '.join(arrays) or 'none'}")
    return columns


def _numbers(tensor: Tensor, members: dict[str, bytes], folder: str, order: str) -> np.ndarray:
    """Return a tensor's numbers; raise `ValueError` if it reaches beyond its storage, or the storage is cut off."""
    storage = tensor.storage
    data = members.get(f"{folder}data/{storage.key}")
    kind = np.dtype(order + storage.kind)
    if data is None or len(data) != storage.size * kind.itemsize:
        found = "is missing" if data is None else f"has {len(data)} bytes"
        raise ValueError(f"storage {storage.key[:40]!r} {found}; {storage.size} numbers of {kind} were promised")
    sizes = (*tensor.shape, *tensor.stride, tensor.offset)
    if len(tensor.shape) != len(tensor.stride) or min(sizes) < 0 or len(tensor.shape) > 8:
        raise ValueError(f"a tensor of shape {tensor.shape} and stride {tensor.stride}")
    if math.prod(tensor.shape) == 0:
        return np.zeros(tensor.shape)
    last = tensor.offset + sum((size - 1) * step for size, step in zip(tensor.shape, tensor.stride, strict=True))
    if last >= storage.size or math.prod(tensor.shape) > storage.size:
        raise ValueError(f"a tensor of shape {tensor.shape} does not fit its storage of {storage.size} numbers")
    flat = np.frombuffer(data, kind)[tensor.offset :]
    strides = [step * kind.itemsize for step in tensor.stride]
    return np.lib.stride_tricks.as_strided(flat, tensor.shape, strides, writeable=False)


def _listed_names(source: str, entries: dict[Any, Any]) -> tuple[str, ...]:
    """Return the joints' names where the file has them."""
    for key in NAMES:
        listed = entries.get(key)
        if isinstance(listed, list | tuple) and listed and all(isinstance(name, str) for name in listed):
            if len(set(listed)) != len(listed) or len(listed) > WIDEST_MATRIX:
                raise LogError(f"{source}: {key} lists a joint twice; expected different names")
            return tuple(listed)
    return ()
