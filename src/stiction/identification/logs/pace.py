"""PACE's logs, `.pt`: a ZIP archive of tensors that `torch.save` wrote, read without torch and without executing it.

The dictionary has `time`, shape (num_samples,), and matrices of shape (num_samples, num_joints): `dof_pos`,
`des_dof_pos`, and where there are `dof_vel` and `tau`. The file's index is a program for a stack machine that can call
any function. Here the few instructions that build plain data and describe tensors are followed by hand
(`pickletools.genops` executes nothing), and every other one, and every other function's name, is refused.
"""

from __future__ import annotations

import math
import pickletools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.memory import claim
from stiction.files.tables import Table, read_archive, read_bytes, table_of

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
"""Functions whose calls are understood."""


PLAIN = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
"""Instruction -> value that it puts."""


class NotPlainError(ValueError):
    """Error for an index that asks for more than tensors in a dictionary need; the message names it."""


@dataclass(frozen=True)
class GlobalRef:
    """Unresolved global that the pickle refers to; it is never looked up."""

    text: str
    """Text `module name`."""


@dataclass(frozen=True)
class Storage:
    """Location of a tensor's numbers."""

    key: str
    """Name of the member of the archive."""
    kind: str
    """NumPy's name of the numbers, a value of `STORAGES`."""
    size: int
    """Count of the numbers."""


@dataclass(frozen=True)
class Tensor:
    """View on a storage, as the file declares it: not yet checked."""

    storage: Storage
    """Storage of the numbers."""
    offset: int
    """Index of the first number."""
    shape: tuple[int, ...]
    """Size of each dimension."""
    stride: tuple[int, ...]
    """Distance between neighbours in each dimension, in numbers."""


def read_index(program: bytes) -> Any:
    """Return the value that the index describes: dict, list, tuple, number, text, None, or `Tensor` of these.

    Raises `NotPlainError` for anything beyond plain data, and `ValueError` and its like for a damaged index.
    """
    machine = _Machine()
    for opcode, argument, _ in pickletools.genops(program):
        if opcode.name == "STOP":
            return machine.take(1)[0]
        machine.follow(opcode.name, argument)
    raise NotPlainError("no end")


class _Machine:
    """The stack machine of pickles, reduced to the instructions that build data."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memo: dict[int, Any] = {}

    def follow(self, name: str, argument: Any) -> None:
        """Follow one instruction; reject all that build no data."""
        stack = self.stack
        match name:
            case "PROTO" | "FRAME":
                pass
            case "BINUNICODE" | "SHORT_BINUNICODE" | "BININT" | "BININT1" | "BININT2" | "LONG1" | "BINFLOAT":
                stack.append(argument)
            case _ if name in PLAIN:
                stack.append(PLAIN[name])
            case "EMPTY_DICT":
                stack.append({})
            case "MARK":
                self.marks.append(len(stack))
            case "TUPLE":
                stack.append(self.since_mark())
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                stack.append(self.take(int(name[-1])))
            case "BINPUT" | "LONG_BINPUT":
                self.memo[argument] = stack[-1]
            case "MEMOIZE":
                self.memo[len(self.memo)] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(self.memo[argument])
            case "SETITEM" | "SETITEMS":
                self.set_items(self.take(2) if name == "SETITEM" else self.since_mark())
            case "GLOBAL":
                stack.append(GlobalRef(argument))
            case "STACK_GLOBAL":
                stack.append(GlobalRef(" ".join(map(str, self.take(2)))))
            case "BINPERSID":
                stack.append(_storage(*self.take(1)))
            case "REDUCE":
                stack.append(_called(*self.take(2)))
            case _:
                raise NotPlainError(f"instruction {name}")

    def since_mark(self) -> tuple[Any, ...]:
        """Take the values above the last mark."""
        height = self.marks.pop()
        taken = tuple(self.stack[height:])
        del self.stack[height:]
        return taken

    def take(self, count: int) -> tuple[Any, ...]:
        """Take the topmost values, in their original order."""
        if len(self.stack) < count:
            raise NotPlainError("a value is missing")
        taken = tuple(self.stack[-count:])
        del self.stack[-count:]
        return taken

    def set_items(self, items: tuple[Any, ...]) -> None:
        """Put keys and values into the dictionary on top."""
        target = self.stack[-1]
        if not isinstance(target, dict) or not all(isinstance(key, str | int) for key in items[::2]):
            raise NotPlainError("entries that are not named by text")
        target.update(zip(items[::2], items[1::2], strict=True))


def _storage(reference: Any) -> Storage:
    """Return the storage that a reference names."""
    if not isinstance(reference, tuple) or len(reference) != 5 or reference[0] != "storage":
        raise NotPlainError("a reference to something else than a storage")
    _, kind, key, _, size = reference
    module, _, name = kind.text.partition(" ") if isinstance(kind, GlobalRef) else ("", "", "")
    if module != "torch" or name not in STORAGES:
        raise NotPlainError(f"numbers of kind {getattr(kind, 'text', kind)!r}")
    if not isinstance(key, str) or type(size) is not int:
        raise NotPlainError("a storage without name or size")
    return Storage(key, STORAGES[name], size)


def _called(function: Any, arguments: Any) -> Any:
    """Return the result of one of the two calls that are understood."""
    text = function.text if isinstance(function, GlobalRef) else "something that is no function"
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


LARGEST_INDEX = 2**20
"""Largest index [B]; a dictionary of a dozen tensors takes less than a kilobyte."""

BYTE_ORDERS = {b"little": "<", b"big": ">"}

_BROKEN_INDEX = (ValueError, KeyError, IndexError, TypeError, OverflowError, MemoryError, RecursionError)
"""Exceptions of a damaged index; `NotPlainError` and `UnicodeDecodeError` are of the first kind."""


def read_pace(path: Path) -> Table:
    """Return the tensors as columns, `dof_pos_0` and so on.

    An array that is neither a vector nor a matrix of as many samples as the time has a fault. Raises `LogError`.
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
        taken = sum(8 * math.prod(tensor.shape) for tensor in tensors.values())
        claim(path.name, taken, "its tensors would take", LogError)
        arrays = {name: _numbers(tensor, members, folder, order) for name, tensor in tensors.items()}
    except _BROKEN_INDEX as error:
        raise LogError(
            f"{path.name}: {str(error)[:120]}: only a dictionary of tensors is read, as "
            "torch.save({'time': ..., 'dof_pos': ..., 'des_dof_pos': ...}, file) writes it; nothing was executed"
        ) from error
    return table_of(path.name, {name: array for name, array in arrays.items() if array.size > 1})


def _numbers(tensor: Tensor, members: dict[str, bytes], folder: str, order: str) -> np.ndarray:
    """Return a tensor's numbers; raise `ValueError` if it reaches beyond its storage, or the storage is cut off."""
    storage = tensor.storage
    data = members.get(f"{folder}data/{storage.key}")
    kind = np.dtype(order + storage.kind)
    if data is None or len(data) != storage.size * kind.itemsize:
        state = "is missing" if data is None else f"has {len(data)} bytes"
        raise ValueError(f"storage {storage.key[:40]!r} {state}; {storage.size} numbers of {kind} were promised")
    sizes = (*tensor.shape, *tensor.stride, tensor.offset)
    if len(tensor.shape) != len(tensor.stride) or min(sizes) < 0 or len(tensor.shape) > 8:
        raise ValueError(f"a tensor of shape {tensor.shape} and stride {tensor.stride}")
    if math.prod(tensor.shape) == 0:
        return np.zeros(tensor.shape)
    last = tensor.offset + sum((size - 1) * step for size, step in zip(tensor.shape, tensor.stride, strict=True))
    # `as_strided` checks nothing: beyond the storage it would read whatever lies there, and a stride of zero makes any
    # number of samples out of one.
    if last >= storage.size or math.prod(tensor.shape) > storage.size:
        raise ValueError(f"a tensor of shape {tensor.shape} does not fit its storage of {storage.size} numbers")
    flat = np.frombuffer(data, kind)[tensor.offset :]
    strides = [step * kind.itemsize for step in tensor.stride]
    return np.lib.stride_tricks.as_strided(flat, tensor.shape, strides, writeable=False)
