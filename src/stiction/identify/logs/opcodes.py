"""What `torch.save` wrote of a dictionary of tensors, read without executing anything and without torch.

The file's index is a program for a stack machine that can call any function. Here its instructions are only looked at
(`pickletools.genops` executes nothing) and the few that build dictionaries, lists, tuples, numbers, text and the
description of a tensor are followed by hand. Every other instruction, and every other name of a function, is refused.
"""

from __future__ import annotations

import pickletools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

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
