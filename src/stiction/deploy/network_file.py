"""Reader of a network file, policy.onnx, within bounds, before any runtime sees it.

An ONNX file is a protocol-buffer message: a sequence of (field number, wire type, value); the field numbers are those
of onnx.proto. Only the parts of a policy's network are known here: a graph of nodes with numbers for attributes, and
constants that lie in the file. Everything else is rejected by its name: subgraphs (control flow), functions, training,
sparse, quantised and external tensors, metadata, unknown fields, and fields that stand twice where they may stand once,
which two readers could take differently.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.core.errors import BundleError

MOST_BYTES = 32 * 2**20
"""Size of the largest network [B]: eight million weights."""

MOST_NODES, MOST_CONSTANTS, MOST_PARTS = 1024, 1024, 64
"""Most nodes of a graph, constants, and inputs, outputs or attributes of a node. Our own have some 30, 30 and 5."""

MOST_TEXT, MOST_DIMENSIONS = 256, 6
"""Most bytes of a name, and dimensions of a tensor."""

FLOAT, INT64 = 1, 7
"""Known types of tensors: TensorProto.FLOAT and INT64."""

WIDTH = {FLOAT: 4, INT64: 8}

OPSETS = range(13, 24)
"""Versions of the operators that `operators` knows."""

IR_VERSIONS = range(7, 12)

VARINT, DOUBLE, BYTES, SINGLE = 0, 1, 2, 5

Fields = Mapping[int, tuple[str, int, int]]
"""Number of a field -> name, wire type, and largest count."""


def _fields(text: str) -> Fields:
    """Return fields such as `7:graph`, a message or text that may stand once, and `8:ints:varint*64`."""
    fields = {}
    for word in text.split():
        field, _, most = word.partition("*")
        number, name, wire = (*field.split(":"), "bytes")[:3]
        fields[int(number)] = name, {"varint": VARINT, "bytes": BYTES, "single": SINGLE}[wire], int(most or 1)
    return fields


MODEL = _fields(
    "1:ir_version:varint 2:producer_name 3:producer_version 4:domain 5:model_version:varint 7:graph 8:opset_import"
)
OPSET = _fields("1:domain 2:version:varint")
GRAPH = _fields(f"1:node*{MOST_NODES} 2:name 5:initializer*{MOST_CONSTANTS} 11:input 12:output*2")
NODE = _fields(f"1:input*{MOST_PARTS} 2:output*{MOST_PARTS} 3:name 4:op_type 5:attribute*{MOST_PARTS} 7:domain")
ATTRIBUTE = _fields(f"1:name 2:f:single 3:i:varint 8:ints:varint*{MOST_PARTS} 20:type:varint")
TENSOR = _fields(f"1:dims:varint*{MOST_DIMENSIONS} 2:data_type:varint 8:name 9:raw_data")
PORT = _fields("1:name 2:type")
TYPE = _fields("1:tensor_type")
TENSOR_TYPE = _fields("1:elem_type:varint 2:shape")
SHAPE = _fields(f"1:dim*{MOST_DIMENSIONS}")
DIMENSION = _fields("1:dim_value:varint 2:dim_param")

EXTERNAL = (13, 14)
"""Fields of a tensor whose numbers lie in another file."""

ATTRIBUTE_TYPES = {"f": 1, "i": 2, "ints": 7}
"""Field of an attribute -> number of its type."""


@dataclass(frozen=True)
class Tensor:
    """Constant of a network."""

    name: str
    kind: int
    """`FLOAT` or `INT64`."""
    shape: tuple[int, ...]
    data: memoryview = field(repr=False)

    @property
    def numbers(self) -> np.ndarray:
        """Numbers, int64 or float32, of its shape."""
        return np.frombuffer(self.data, dtype="<i8" if self.kind == INT64 else "<f4").reshape(self.shape)


Attribute = float | int | tuple[int, ...]


@dataclass(frozen=True)
class Node:
    """Operation of a network."""

    operator: str
    inputs: tuple[str, ...]
    """Names of the inputs; empty for one that is left out."""
    outputs: tuple[str, ...]
    attributes: Mapping[str, Attribute]


@dataclass(frozen=True)
class Port:
    """Input or output of a network."""

    name: str
    kind: int
    shape: tuple[int | None, ...]
    """Sizes of the dimensions; None where a size is free."""


@dataclass(frozen=True)
class NetworkFile:
    """Content of a network file."""

    nodes: tuple[Node, ...]
    constants: Mapping[str, Tensor]
    input: Port
    output: Port
    velocity: Port | None = None
    """Second output, the estimated velocity of the base."""


def read_network(data: bytes) -> NetworkFile:
    """Return the content of an ONNX file.

    Raises `BundleError`: not an ONNX file, too large, or with an unknown part.
    """
    if len(data) > MOST_BYTES:
        raise BundleError(f"policy.onnx has {len(data)} bytes; at most {MOST_BYTES} are read")
    if data[4:8] == b"ORTM":
        # onnxruntime would read the whole file as its own format, whatever else it could be read as.
        raise BundleError("policy.onnx is in the format of onnxruntime (ORTM); expected ONNX; export the bundle again")
    model = read_message(memoryview(data), "the model", MODEL)
    if model["ir_version"] and model["ir_version"][0] not in IR_VERSIONS:
        raise BundleError(f"policy.onnx has the layout {model['ir_version'][0]}; expected {_span(IR_VERSIONS)}")
    operators = read_message(only(model, "opset_import", "the model"), "opset_import", OPSET)
    domain, version = text_of(operators["domain"], "opset_import.domain"), operators["version"]
    if domain not in ("", "ai.onnx") or not version or version[0] not in OPSETS:
        raise BundleError(
            f"policy.onnx has operators of {domain or 'ONNX'!r}, version {version}; expected ONNX's own, version "
            f"{_span(OPSETS)}; export the bundle again"
        )
    graph = read_message(only(model, "graph", "the model"), "graph", GRAPH)
    constants = {tensor.name: tensor for tensor in map(_tensor, graph["initializer"])}
    if len(constants) < len(graph["initializer"]):
        raise BundleError("policy.onnx has two constants of one name; export the bundle again")
    ports = (read_port(only(graph, name, "graph"), name) for name in ("input", "output"))
    velocity = (read_port(part, "output") for part in graph["output"][1:])
    return NetworkFile(tuple(map(_node, graph["node"])), constants, *ports, *velocity)


def _span(versions: range) -> str:
    return f"{versions[0]} to {versions[-1]}"


def _node(data: memoryview) -> Node:
    fields = read_message(data, "node", NODE)
    operator, domain = text_of(fields["op_type"], "node.op_type"), text_of(fields["domain"], "node.domain")
    if domain not in ("", "ai.onnx"):
        raise BundleError(f"policy.onnx: the operator {operator!r} is of {domain!r}; expected ONNX's own alone")
    attributes: dict[str, Attribute] = {}
    for part in fields["attribute"]:
        name, value = _attribute(part, operator)
        if name in attributes:
            raise BundleError(f"policy.onnx: {operator!r} has two attributes {name!r}; export the bundle again")
        attributes[name] = value
    inputs, outputs = (tuple(text_of([part], f"node.{side}") for part in fields[side]) for side in ("input", "output"))
    if not all(outputs) or not outputs:
        raise BundleError(f"policy.onnx: {operator!r} has an output without a name; export the bundle again")
    return Node(operator, inputs, outputs, attributes)


def _attribute(data: memoryview, operator: str) -> tuple[str, Attribute]:
    """Read one attribute: a number or several integers."""
    fields = read_message(data, f"attribute of {operator!r}", ATTRIBUTE)
    name, present = text_of(fields["name"], "attribute.name"), [kind for kind in ATTRIBUTE_TYPES if fields[kind]]
    # Fields of the value zero may be left out: the type says which it is.
    kind = next((kind for kind, number in ATTRIBUTE_TYPES.items() if fields["type"] == [number]), None)
    if kind is None or present not in ([kind], []):
        raise BundleError(
            f"policy.onnx: attribute {name!r} of {operator!r}: expected one number, or integers; export it again"
        )
    if kind == "ints":
        return name, tuple(map(signed, fields["ints"]))
    value = fields[kind][0] if fields[kind] else 0
    return name, signed(value) if kind == "i" else float(value)


def _tensor(data: memoryview) -> Tensor:
    # Asked for first, so that the error says what to do and not that a field is unknown.
    for number, _, _ in entries(data, "tensor"):
        if number in EXTERNAL:
            raise BundleError("policy.onnx keeps tensors in other files; expected all within; export the bundle again")
    fields = read_message(data, "tensor", TENSOR)
    name, kind = text_of(fields["name"], "tensor.name"), (fields["data_type"] or [0])[0]
    shape, content = (
        tuple(map(signed, fields["dims"])),
        fields["raw_data"][0] if fields["raw_data"] else memoryview(b""),
    )
    expect_size(name, kind, shape, content)
    return Tensor(name, kind, shape, content)


def expect_size(name: str, kind: int, shape: tuple[int, ...], content: memoryview) -> None:
    """Reject a constant of another type than ours, or of another size than its shape says."""
    if kind not in WIDTH or min(shape, default=1) < 0 or math.prod(shape) * WIDTH[kind] != len(content):
        raise BundleError(
            f"policy.onnx: the constant {name!r} of type {kind} and shape {shape} has {len(content)} bytes; expected "
            "float32 or int64, as many as its shape says"
        )


def read_port(data: memoryview, side: str, port: Fields = PORT, dimension: Fields = DIMENSION) -> Port:
    """Read the input or the output; port, dimension: fields that they may have."""
    fields = read_message(data, side, port)
    kind = read_message(
        only(read_message(only(fields, "type", side), side, TYPE), "tensor_type", side), side, TENSOR_TYPE
    )
    sizes: list[int | None] = []
    for part in read_message(only(kind, "shape", side), side, SHAPE)["dim"]:
        size = read_message(part, f"dimension of the {side}", dimension)
        sizes.append(signed(size["dim_value"][0]) if size["dim_value"] else None)
    return Port(text_of(fields["name"], f"{side}.name"), (kind["elem_type"] or [0])[0], tuple(sizes))


def only(fields: Mapping[str, list], name: str, where: str) -> memoryview:
    """Return the only message of a name."""
    if not fields[name]:
        raise BundleError(f"policy.onnx is not an ONNX file, or it is cut off: {where} has no {name}")
    return fields[name][0]


def text_of(values: list, where: str) -> str:
    """Return a text of a bounded length, empty where there is none."""
    # Cut off before it is decoded: a name may be as long as the file.
    content = bytes(values[0][: MOST_TEXT + 1]) if values else b""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise BundleError(f"policy.onnx: {where} is no text; export the bundle again") from error
    if len(content) > MOST_TEXT or not (text == "" or text.isprintable()):
        raise BundleError(f"policy.onnx: {where} is {text[:40]!r}; expected at most {MOST_TEXT} printable characters")
    return text


def signed(value: int) -> int:
    """Return a number of a protocol buffer as int64."""
    return value - 2**64 if value >= 2**63 else value


def read_message(data: memoryview, where: str, known: Fields) -> dict[str, list]:
    """Return name -> values of the known fields of a message; reject any other, and too many of one."""
    fields: dict[str, list] = {name: [] for name, _, _ in known.values()}
    for number, wire, value in entries(data, where):
        if number not in known:
            raise BundleError(
                f"policy.onnx: field {number} of {where} is none that the network of a policy has; export the bundle "
                "again"
            )
        name, expected, most = known[number]
        values: list[Any] = [value]
        # Numbers that may stand several times may also be packed into bytes: readers have to take both.
        if isinstance(value, memoryview) and expected == VARINT and most > 1:
            values = list(packed(value))
        elif wire != expected:
            raise BundleError(f"policy.onnx is not an ONNX file: {name} of {where} has the wire type {wire}")
        fields[name] += values
        if len(fields[name]) > most:
            raise BundleError(f"policy.onnx: {where} has more than {most} of {name}; export the bundle again")
    return fields


def packed(data: memoryview) -> Iterator[int]:
    """Yield packed numbers; at most one more than a part may have, which the caller then rejects."""
    position, count = 0, 0
    while position < len(data) and count <= MOST_PARTS:
        value, position = _varint(data, position)
        count += 1
        yield value


def entries(data: memoryview, where: str) -> Iterator[tuple[int, int, int | float | memoryview]]:
    """Yield (field number, wire type, value) of a message; the value is a number or the bytes of a length."""
    position = 0
    while position < len(data):
        key, position = _varint(data, position)
        number, wire = key >> 3, key & 7
        value: int | float | memoryview
        if number == 0:
            raise BundleError(f"policy.onnx is not an ONNX file: {where} has a field 0; export the bundle again")
        if wire == VARINT:
            value, position = _varint(data, position)
        else:
            if wire == BYTES:
                length, position = _varint(data, position)
            else:
                # All other wire types have none: groups, which protocol buffers have given up, and unknown ones.
                length = {DOUBLE: 8, SINGLE: 4}.get(wire, -1)
            if length < 0 or position + length > len(data):
                raise BundleError(f"policy.onnx is not an ONNX file, or it is cut off, in {where}; export it again")
            value = data[position : position + length]
            position += length
            if wire == SINGLE:
                value = struct.unpack("<f", value)[0]
        yield number, wire, value


def _varint(data: memoryview, position: int) -> tuple[int, int]:
    """Return a base-128 number of at most 64 bits and the position after it."""
    value = 0
    for shift, byte in enumerate(data[position : position + 10]):
        value |= (byte & 0x7F) << 7 * shift
        if byte < 0x80 and value < 2**64:
            return value, position + shift + 1
    raise BundleError("policy.onnx is not an ONNX file, or it is cut off; export the bundle again")
