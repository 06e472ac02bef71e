"""Looks into an ONNX file without the onnx package, to find tensors that are stored outside the file.

An ONNX file is a protocol-buffer message: a sequence of (field number, wire type, value). Only the few messages that
can contain a tensor are followed; the field numbers are those of onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator

from stiction.formats.errors import StictionError

NESTED = {
    "model": {7: "graph", 20: "training", 25: "function"},
    "training": {1: "graph", 2: "graph"},
    "function": {7: "node", 11: "attribute"},
    "graph": {1: "node", 5: "tensor", 15: "sparse"},
    "node": {5: "attribute"},
    "attribute": {5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse", 23: "sparse"},
    "sparse": {1: "tensor", 2: "tensor"},
    "tensor": {},
}
"""Message -> field number -> message within it, as far as tensors can hide there."""

TENSOR_NAME, TENSOR_EXTERNAL_DATA, TENSOR_LOCATION = 8, 13, 14

MAX_DEPTH = 32
"""Deepest nesting that is followed: graphs within attributes of graphs."""


class OnnxError(StictionError):
    """A file that is not an ONNX model that this program runs."""


def external_tensors(data: bytes) -> list[str]:
    """Return the names of the tensors that the ONNX model `data` keeps in other files; empty for a whole model.

    Raises:
        OnnxError: the bytes are not a protocol-buffer message.

    """
    return list(_search(memoryview(data), "model", 0))


def _search(data: memoryview, message: str, depth: int) -> Iterator[str]:
    """Yield the names of external tensors within one message."""
    if depth > MAX_DEPTH:
        raise OnnxError(f"policy.onnx is nested deeper than {MAX_DEPTH} messages; it is not a network that is run here")
    name, external = "", False
    for field, value in _fields(data):
        if message == "tensor":
            if field == TENSOR_NAME and isinstance(value, memoryview):
                name = bytes(value).decode("utf-8", "replace")
            external |= field == TENSOR_EXTERNAL_DATA or (field == TENSOR_LOCATION and value != 0)
        elif (inner := NESTED[message].get(field)) and isinstance(value, memoryview):
            yield from _search(value, inner, depth + 1)
    if external:
        yield name


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yield (field number, value) of a message; the value is a number or the bytes of a field with a length."""
    position = 0
    while position < len(data):
        key, position = _varint(data, position)
        field, wire = key >> 3, key & 7
        if wire == 0:
            value, position = _varint(data, position)
            yield field, value
            continue
        if wire == 2:
            length, position = _varint(data, position)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise OnnxError(f"policy.onnx is not an ONNX file: wire type {wire}; export the bundle again")
        if field == 0 or position + length > len(data):
            raise OnnxError("policy.onnx is not an ONNX file, or it is cut off; export the bundle again")
        yield field, data[position : position + length]
        position += length


def _varint(data: memoryview, position: int) -> tuple[int, int]:
    """Return a base-128 number and the position after it."""
    value, shift = 0, 0
    while position < len(data) and shift < 70:
        byte = data[position]
        value |= (byte & 0x7F) << shift
        position, shift = position + 1, shift + 7
        if byte < 0x80:
            return value, position
    raise OnnxError("policy.onnx is not an ONNX file, or it is cut off; export the bundle again")
