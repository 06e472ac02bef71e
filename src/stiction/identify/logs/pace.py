"""PACE's logs, `.pt`: a ZIP archive of tensors that `torch.save` wrote, read without torch and without executing it.

The dictionary has `time`, shape (num_samples,), and matrices of shape (num_samples, num_joints): `dof_pos`,
`des_dof_pos`, and where there are `dof_vel` and `tau`. Its joints have names only where the file lists them.

The file's index is a program for a stack machine that can call any function. Here its instructions are only looked at
(`pickletools.genops` executes nothing) and the few that build dictionaries, lists, tuples, numbers, text and the
description of a tensor are followed by hand. Every other instruction, and every other name of a function, is refused.
"""

from __future__ import annotations

import math
import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.formats.tables import WIDEST_MATRIX, Columns, read_archive, read_bytes, split_matrix

STORAGES = {
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
}
"""Name of a storage's class -> NumPy's name of its numbers, without the byte order."""

REBUILD, ORDERED = "torch._utils _rebuild_tensor_v2", "collections OrderedDict"
"""The two functions whose calls are understood."""


class NotPlainError(ValueError):
    """The index asks for something that tensors in a dictionary do not need; the message says what."""


@dataclass(frozen=True)
class Name:
    """A function or class that the index names. It is never looked up."""

    text: str
    """`module name`."""


@dataclass(frozen=True)
class Storage:
    """Where the numbers of a tensor lie."""

    key: str
    """Name of the member of the archive."""
    kind: str
    """One of the values of `STORAGES`."""
    size: int
    """How many numbers there are."""


@dataclass(frozen=True)
class Tensor:
    """A view on a storage; nothing of it is checked yet."""

    storage: Storage
    """Its numbers."""
    offset: int
    """Index of the first."""
    shape: tuple[int, ...]
    """Size of each dimension."""
    stride: tuple[int, ...]
    """Distance between neighbours in each dimension, in numbers."""


@dataclass
class Machine:
    """The stack machine, reduced to what builds data."""

    stack: list[Any] = field(default_factory=list)
    """What was built and not used yet."""
    marks: list[int] = field(default_factory=list)
    """Heights of the stack at the open marks."""
    memo: dict[int, Any] = field(default_factory=dict)
    """What may be used again."""

    def since_mark(self) -> list[Any]:
        """Take what lies above the last mark."""
        height = self.marks.pop()
        taken = self.stack[height:]
        del self.stack[height:]
        return taken

    def take(self, count: int) -> tuple[Any, ...]:
        """Take the topmost values, in the order in which they were put."""
        if len(self.stack) < count:
            raise NotPlainError("a value is missing")
        taken = tuple(self.stack[-count:])
        del self.stack[-count:]
        return taken

    def put_items(self, items: list[Any]) -> None:
        """Put keys and values into the dictionary on top."""
        target = self.stack[-1]
        if not isinstance(target, dict) or not all(isinstance(key, str | int) for key in items[::2]):
            raise NotPlainError("entries that are not named by text")
        target.update(zip(items[::2], items[1::2], strict=True))

    def put_elements(self, elements: list[Any]) -> None:
        """Put values into the list on top."""
        if not isinstance(self.stack[-1], list):
            raise NotPlainError("an element without a list")
        self.stack[-1].extend(elements)


def read_index(program: bytes) -> Any:
    """Return what the index describes: dict, list, tuple, number, text, None, or `Tensor` of these.

    Raises `NotPlainError` for anything beyond plain data, and `ValueError` and its like for a damaged index.
    """
    machine = Machine()
    for opcode, argument, _ in pickletools.genops(program):
        if opcode.name == "STOP":
            (value,) = machine.take(1)
            return value
        follow = STEPS.get(opcode.name)
        if follow is None:
            raise NotPlainError(f"instruction {opcode.name}")
        follow(machine, argument)
    raise NotPlainError("no end")


def _persistent(machine: Machine) -> Storage:
    """Return the storage that a reference means."""
    (reference,) = machine.take(1)
    if not isinstance(reference, tuple) or len(reference) != 5 or reference[0] != "storage":
        raise NotPlainError("a reference to something else than a storage")
    _, kind, key, _, size = reference
    module, _, name = kind.text.partition(" ") if isinstance(kind, Name) else ("", "", "")
    if module != "torch" or name not in STORAGES:
        raise NotPlainError(f"numbers of kind {getattr(kind, 'text', kind)!r}")
    if not isinstance(key, str) or type(size) is not int:
        raise NotPlainError("a storage without name or size")
    return Storage(key, STORAGES[name], size)


def _call(machine: Machine) -> Any:
    """Return what one of the two calls would have built."""
    function, arguments = machine.take(2)
    text = function.text if isinstance(function, Name) else "something that is no function"
    if text == ORDERED and arguments == ():
        return {}
    if text != REBUILD:
        raise NotPlainError(f"a call of {text.replace(' ', '.')}")
    if not isinstance(arguments, tuple) or not 6 <= len(arguments) <= 7:
        raise NotPlainError("a tensor with other fields than expected")
    storage, offset, shape, stride = arguments[:4]
    whole = all(isinstance(sizes, tuple) and all(type(size) is int for size in sizes) for sizes in (shape, stride))
    if not isinstance(storage, Storage) or type(offset) is not int or not whole:
        raise NotPlainError("a tensor with other fields than expected")
    return Tensor(storage, offset, shape, stride)


def _keep(machine: Machine, place: int) -> None:
    """Remember what is on top."""
    machine.memo[place] = machine.stack[-1]


def _push(machine: Machine, value: Any) -> None:
    """Put a value on the stack."""
    machine.stack.append(value)


Step = Callable[[Machine, Any], None]

STEPS: dict[str, Step] = {
    **dict.fromkeys(("PROTO", "FRAME"), lambda machine, argument: None),
    **dict.fromkeys(
        ("BINUNICODE", "SHORT_BINUNICODE", "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT"),
        lambda machine, argument: _push(machine, argument),
    ),
    "NONE": lambda machine, argument: _push(machine, None),
    "NEWTRUE": lambda machine, argument: _push(machine, True),
    "NEWFALSE": lambda machine, argument: _push(machine, False),
    "EMPTY_DICT": lambda machine, argument: _push(machine, {}),
    "EMPTY_LIST": lambda machine, argument: _push(machine, []),
    "EMPTY_TUPLE": lambda machine, argument: _push(machine, ()),
    "MARK": lambda machine, argument: machine.marks.append(len(machine.stack)),
    "TUPLE": lambda machine, argument: _push(machine, tuple(machine.since_mark())),
    "TUPLE1": lambda machine, argument: _push(machine, machine.take(1)),
    "TUPLE2": lambda machine, argument: _push(machine, machine.take(2)),
    "TUPLE3": lambda machine, argument: _push(machine, machine.take(3)),
    **dict.fromkeys(("BINPUT", "LONG_BINPUT"), _keep),
    "MEMOIZE": lambda machine, argument: _keep(machine, len(machine.memo)),
    **dict.fromkeys(("BINGET", "LONG_BINGET"), lambda machine, argument: _push(machine, machine.memo[argument])),
    "SETITEM": lambda machine, argument: machine.put_items(list(machine.take(2))),
    "SETITEMS": lambda machine, argument: machine.put_items(machine.since_mark()),
    "APPEND": lambda machine, argument: machine.put_elements(list(machine.take(1))),
    "APPENDS": lambda machine, argument: machine.put_elements(machine.since_mark()),
    "GLOBAL": lambda machine, argument: _push(machine, Name(argument)),
    "STACK_GLOBAL": lambda machine, argument: _push(machine, Name(" ".join(map(str, machine.take(2))))),
    "BINPERSID": lambda machine, argument: _push(machine, _persistent(machine)),
    "REDUCE": lambda machine, argument: _push(machine, _call(machine)),
}
"""Instruction -> what it does here."""

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
