"""Networks of others: an ONNX file is read within bounds, what a policy needs of it is kept, and it is written anew.

Nothing of the file reaches a runtime as it was: nodes, constants, one input and one output are taken, names, notes and
metadata are not; `deploy.network_file` and `deploy.operators` then check what was written like every other policy.onnx.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import BundleError
from stiction.deploy import network_file as ours
from stiction.deploy.network_file import (
    BYTES,
    FLOAT,
    INT64,
    SINGLE,
    VARINT,
    Attribute,
    Fields,
    NetworkFile,
    Node,
    Port,
    Tensor,
    only,
    read_message,
    read_port,
    signed,
    text_of,
)
from stiction.deploy.operators import OPERATORS
from stiction.deploy.policy import INPUT, OUTPUT, VELOCITY

MOST_NOTES, MOST_VALUES, LARGEST_NOTE = 256, 4096, 2**20
"""Entries of metadata, notes on values, and bytes of one entry that is kept; longer ones are left out."""

NOTE: Fields = {1: ("key", BYTES, 1), 2: ("value", BYTES, 1)}
MODEL: Fields = dict(ours.MODEL) | {6: ("doc_string", BYTES, 1), 14: ("metadata_props", BYTES, MOST_NOTES)}
GRAPH: Fields = dict(ours.GRAPH) | {
    10: ("doc_string", BYTES, 1),
    11: ("input", BYTES, ours.MOST_CONSTANTS),
    12: ("output", BYTES, ours.MOST_PARTS),
    13: ("value_info", BYTES, MOST_VALUES),
    16: ("metadata_props", BYTES, MOST_NOTES),
}
NODE: Fields = dict(ours.NODE) | {6: ("doc_string", BYTES, 1), 9: ("metadata_props", BYTES, MOST_NOTES)}
ATTRIBUTE: Fields = dict(ours.ATTRIBUTE) | {
    4: ("s", BYTES, 1),
    5: ("t", BYTES, 1),
    7: ("floats", BYTES, 1),
    13: ("doc_string", BYTES, 1),
}
TENSOR: Fields = dict(ours.TENSOR) | {
    4: ("float_data", BYTES, 1),
    7: ("int64_data", BYTES, 1),
    12: ("doc_string", BYTES, 1),
    16: ("metadata_props", BYTES, MOST_NOTES),
}
PORT: Fields = dict(ours.PORT) | {3: ("doc_string", BYTES, 1), 4: ("metadata_props", BYTES, MOST_NOTES)}
SHAPE_DIMENSION: Fields = dict(ours.DIMENSION) | {3: ("denotation", BYTES, 1)}

NUMBERS = {"f": 1, "i": 2, "ints": 7}
"""Field of an attribute that is kept -> what its type says."""


@dataclass(frozen=True)
class ForeignNetwork:
    """What is kept of somebody's network."""

    network: NetworkFile
    """With our names: the input `observation`, the output `action`, any batch."""
    metadata: Mapping[str, str]
    """What the file says of the policy."""
    opset: int
    """Version of the operators."""
    layout: int
    """Version of the file's own layout."""
    observation_size: int
    num_actions: int

    def write(self) -> bytes:
        """Return the network as policy.onnx."""
        return write_network(self.network, self.opset, self.layout)


def read_foreign(data: bytes, name: str) -> ForeignNetwork:
    """Read an ONNX file of others; `name`: of the file, for messages.

    Raises `BundleError`: not ONNX, too large, an operator that is not known, several inputs or outputs, or anything
    else that the network of a policy does not have.
    """
    try:
        return _read(data)
    except BundleError as error:
        raise BundleError(
            str(error)
            .replace("policy.onnx", name)
            .replace("; export the bundle again", "")
            .replace("; export it again", "")
        ) from error


def _read(data: bytes) -> ForeignNetwork:
    """Read the file; messages call it policy.onnx."""
    if len(data) > ours.MOST_BYTES:
        raise BundleError(f"policy.onnx has {len(data)} bytes; at most {ours.MOST_BYTES} are read")
    model = read_message(memoryview(data), "the model", MODEL)
    layout = model["ir_version"][0] if model["ir_version"] else 0
    operators = read_message(only(model, "opset_import", "the model"), "opset_import", ours.OPSET)
    domain, opset = text_of(operators["domain"], "opset_import.domain"), (operators["version"] or [0])[0]
    if layout not in ours.IR_VERSIONS or opset not in ours.OPSETS or domain not in ("", "ai.onnx"):
        raise BundleError(
            f"policy.onnx has the layout {layout} and operators of {domain or 'ONNX'!r}, version {opset}; expected "
            f"layout {ours.IR_VERSIONS[0]} to {ours.IR_VERSIONS[-1]} and ONNX's own operators, {ours.OPSETS[0]} to "
            f"{ours.OPSETS[-1]}: export it again with such an opset"
        )
    graph = read_message(only(model, "graph", "the model"), "graph", GRAPH)
    constants = {tensor.name: tensor for tensor in map(_tensor, graph["initializer"])}
    # Files of before 2019 list constants among the inputs.
    inputs = [port for port in _ports(graph["input"], "input") if port.name not in constants]
    outputs = _ports(graph["output"], "output")
    # The velocity that our own networks estimate beside the action: no other runtime asks for it.
    observed, acted = _single(inputs, "input"), _single(outputs[: len(outputs) - _estimates(outputs)], "output")
    nodes = []
    for part in graph["node"]:
        node = _node(part)
        if isinstance(node, Tensor):
            constants[node.name] = node
        else:
            nodes.append(node)
    sizes = [port.shape[-1] if len(port.shape) == 2 and port.kind == FLOAT else None for port in (observed, acted)]
    if sizes[0] is None or sizes[1] is None:
        raise BundleError(
            f"policy.onnx has the input {observed.name!r} {observed.shape} and the output {acted.name!r} "
            f"{acted.shape}; expected float32 of the shapes (batch, observations) and (batch, actions), the sizes fixed"
        )
    network = _renamed(NetworkFile(tuple(nodes), constants, observed, acted))
    return ForeignNetwork(network, _notes(model["metadata_props"]), opset, layout, sizes[0], sizes[1])


def _estimates(outputs: list[Port]) -> bool:
    """Return True if the outputs are those of a policy with a `command_correction`."""
    return [port.name for port in outputs] == [OUTPUT, VELOCITY]


def _single(ports: list[Port], side: str) -> Port:
    """Return the one port of a side; refuse several by their names."""
    if len(ports) != 1:
        names = ", ".join(repr(port.name) for port in ports)
        raise BundleError(
            f"policy.onnx has {len(ports)} {side}s: {names}; expected one. A policy with a state, a motion or a clock "
            "of its own is not read: export it with one input of observations and one output of actions"
        )
    return ports[0]


def _notes(parts: Iterable[memoryview]) -> dict[str, str]:
    """Return the metadata, without entries that are too long or no text."""
    found: dict[str, str] = {}
    for part in parts:
        note = read_message(part, "metadata", NOTE)
        key, value = text_of(note["key"], "metadata.key"), bytes(note["value"][0]) if note["value"] else b""
        if key in found:
            raise BundleError(f"policy.onnx has two entries of metadata {key!r}; expected one")
        if len(value) <= LARGEST_NOTE:
            found[key] = value.decode("utf-8", "replace")
    return found


def _ports(parts: Iterable[memoryview], side: str) -> list[Port]:
    """Return inputs or outputs, their shapes' notes left out."""
    return [read_port(part, side, PORT, SHAPE_DIMENSION) for part in parts]


def _node(data: memoryview) -> Node | Tensor:
    """Read one operation; a constant is a tensor."""
    found = read_message(data, "node", NODE)
    operator, domain = text_of(found["op_type"], "node.op_type"), text_of(found["domain"], "node.domain")
    inputs, outputs = (tuple(text_of([part], f"node.{side}") for part in found[side]) for side in ("input", "output"))
    if domain not in ("", "ai.onnx") or operator not in {"Constant", *OPERATORS}:
        raise BundleError(
            f"policy.onnx has the operator {operator!r}{f' of {domain!r}' if domain else ''}; expected one of "
            f"{', '.join(sorted(OPERATORS))}"
        )
    attributes: dict[str, Attribute] = {}
    for part in found["attribute"]:
        said = read_message(part, f"attribute of {operator!r}", ATTRIBUTE)
        name, kind = text_of(said["name"], "attribute.name"), said["type"]
        if operator == "Constant" and said["t"] and len(outputs) == 1:
            # As a constant among the others: `deploy.network_file` knows no tensors in attributes.
            return replace(_tensor(said["t"][0]), name=outputs[0])
        number = next((field for field, value in NUMBERS.items() if kind == [value]), None)
        if number is None or operator == "Constant":
            raise BundleError(f"policy.onnx: attribute {name!r} of {operator!r}: expected a number, or integers")
        if number == "ints":
            attributes[name] = tuple(map(signed, said["ints"]))
        else:
            value = said[number][0] if said[number] else 0
            attributes[name] = signed(value) if number == "i" else float(value)
    return Node(operator, inputs, outputs, attributes)


def _tensor(data: memoryview) -> Tensor:
    """Read one constant: as raw bytes, or as numbers of its type."""
    for number, _, _ in ours.entries(data, "tensor"):
        if number in ours.EXTERNAL:
            raise BundleError("policy.onnx keeps tensors in other files; expected all within: save it as one file")
    found = read_message(data, "tensor", TENSOR)
    name, kind = text_of(found["name"], "tensor.name"), (found["data_type"] or [0])[0]
    shape = tuple(map(signed, found["dims"]))
    # Packed float32 lie in the file as raw bytes do; packed integers are of various lengths.
    content = (found["raw_data"] or found["float_data"] or [memoryview(b"")])[0]
    if found["int64_data"]:
        numbers = [signed(value) for value in ours.packed(found["int64_data"][0])]
        content = memoryview(np.array(numbers, dtype="<i8").tobytes())
    ours.expect_size(name, kind, shape, content)
    return Tensor(name, kind, shape, content)


def _renamed(network: NetworkFile) -> NetworkFile:
    """Return a network with our names for its ports, and plain ones for all else."""
    # The empty name is that of an input which is left out.
    names = {network.input.name: INPUT, network.output.name: OUTPUT, "": ""}
    if network.input.name == network.output.name:
        raise BundleError("policy.onnx: its output is its input; expected a network")
    for name in (*network.constants, *(output for node in network.nodes for output in node.outputs)):
        names.setdefault(name, f"v{len(names)}")

    def known(name: str) -> str:
        if name not in names:
            raise BundleError(f"policy.onnx: nothing computes {name!r}; is the file cut off?")
        return names[name]

    nodes = tuple(
        replace(node, inputs=tuple(map(known, node.inputs)), outputs=tuple(map(known, node.outputs)))
        for node in network.nodes
    )
    constants = {known(name): replace(tensor, name=known(name)) for name, tensor in network.constants.items()}
    ports = (
        Port(name, FLOAT, (None, port.shape[-1])) for name, port in ((INPUT, network.input), (OUTPUT, network.output))
    )
    return NetworkFile(nodes, constants, *ports)


def constant(name: str, numbers: np.ndarray) -> Tensor:
    """Return a constant of a network: float32, or int64 where the numbers are integers."""
    kind = INT64 if numbers.dtype.kind == "i" else FLOAT
    content = np.ascontiguousarray(numbers, dtype="<i8" if kind == INT64 else "<f4").tobytes()
    return Tensor(name, kind, numbers.shape, memoryview(content))


def write_network(network: NetworkFile, opset: int, layout: int, metadata: Mapping[str, str] | None = None) -> bytes:
    """Return a network as ONNX: one file, names as they are; opset, layout: versions; metadata: said of the policy."""
    graph = [_field(1, _node_bytes(node)) for node in network.nodes]
    graph += [_field(2, b"policy")]
    graph += [_field(5, _tensor_bytes(tensor)) for tensor in network.constants.values()]
    graph += [_field(11, _port_bytes(network.input)), _field(12, _port_bytes(network.output))]
    model = [_number(1, layout), _field(7, b"".join(graph)), _field(8, _number(2, opset))]
    notes = ({} if metadata is None else metadata).items()
    model += [_field(14, _field(1, key.encode()) + _field(2, value.encode())) for key, value in notes]
    return b"".join(model)


def _varint(value: int) -> bytes:
    """Return a number in base 128, as the 64 bits of its two's complement."""
    value &= 2**64 - 1
    parts = []
    while value > 0x7F:
        parts.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*parts, value])


def _field(number: int, content: bytes) -> bytes:
    """Return a field that holds bytes."""
    return _varint(number << 3 | BYTES) + _varint(len(content)) + content


def _number(number: int, value: int) -> bytes:
    """Return a field that holds a number."""
    return _varint(number << 3 | VARINT) + _varint(value)


def _node_bytes(node: Node) -> bytes:
    """Return one operation."""
    parts = [_field(1, name.encode()) for name in node.inputs] + [_field(2, name.encode()) for name in node.outputs]
    parts.append(_field(4, node.operator.encode()))
    for name, value in node.attributes.items():
        if isinstance(value, tuple):
            said = b"".join(_number(8, item) for item in value) + _number(20, NUMBERS["ints"])
        elif isinstance(value, float):
            said = _varint(2 << 3 | SINGLE) + struct.pack("<f", value) + _number(20, NUMBERS["f"])
        else:
            said = _number(3, value) + _number(20, NUMBERS["i"])
        parts.append(_field(5, _field(1, name.encode()) + said))
    return b"".join(parts)


def _tensor_bytes(tensor: Tensor) -> bytes:
    """Return one constant."""
    dims = b"".join(_number(1, size) for size in tensor.shape)
    return dims + _number(2, tensor.kind) + _field(8, tensor.name.encode()) + _field(9, bytes(tensor.data))


def _port_bytes(port: Port) -> bytes:
    """Return an input or output; a free size is called `batch`."""
    sizes = [_field(2, b"batch") if size is None else _number(1, size) for size in port.shape]
    shape = b"".join(_field(1, size) for size in sizes)
    kind = _field(1, _number(1, port.kind) + _field(2, shape))
    return _field(1, port.name.encode()) + _field(2, kind)
