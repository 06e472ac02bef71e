"""Networks of others: an ONNX file is read within bounds, and rewritten with the parts that a policy needs.

The imported file is never passed to a runtime: nodes, constants, one input and one output are taken, names, notes and
metadata are not; `deploy.network_file` and `deploy.operators` then check the rewritten file like every policy.onnx.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import BundleError, StictionError
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
"""Most entries of metadata, most notes on values, and most bytes of one entry; longer ones are left out."""

OPSETS, LAYOUTS = range(11, 29), range(3, 15)
"""Supported versions of operators and of the file: `ours.OPSETS` and `ours.IR_VERSIONS`, older ones that are
rewritten, and newer ones that gave these operators nothing but more types."""

WITH_AXES = {"Squeeze": "axes", "Unsqueeze": "axes", "ReduceSum": "axes", "Split": "split"}
"""Operator -> its attribute that is an input since version 13."""

EXTERNAL = 1
"""Location of a tensor whose numbers lie in another file."""

ReadFile = Callable[[str], bytes]
"""Reader of a file with numbers of a network, by its name. Raises `StictionError`."""

NOTE: Fields = {1: ("key", BYTES, 1), 2: ("value", BYTES, 1)}
MODEL: Fields = dict(ours.MODEL) | {
    6: ("doc_string", BYTES, 1),
    8: ("opset_import", BYTES, ours.MOST_PARTS),
    14: ("metadata_props", BYTES, MOST_NOTES),
}
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
    13: ("external_data", BYTES, 8),
    14: ("data_location", VARINT, 1),
    16: ("metadata_props", BYTES, MOST_NOTES),
}
PORT: Fields = dict(ours.PORT) | {3: ("doc_string", BYTES, 1), 4: ("metadata_props", BYTES, MOST_NOTES)}
SHAPE_DIMENSION: Fields = dict(ours.DIMENSION) | {3: ("denotation", BYTES, 1)}

NUMBERS = {"f": 1, "i": 2, "ints": 7}
"""Field of a supported attribute -> number of its type."""


@dataclass(frozen=True)
class ForeignNetwork:
    """Supported content of another's network."""

    network: NetworkFile
    """Network with our names: the input `observation`, the output `action`, any batch."""
    metadata: Mapping[str, str]
    """Metadata of the policy in the file."""
    opset: int
    """Version of the operators."""
    layout: int
    """Version of the file's own layout."""
    observation_size: int
    num_actions: int
    files: tuple[str, ...] = ()
    """Names of the external files with its numbers."""

    def write(self) -> bytes:
        """Return the network as policy.onnx."""
        return write_network(self.network, self.opset, self.layout)


def read_foreign(data: bytes, name: str, read_file: ReadFile | None = None) -> ForeignNetwork:
    """Read an ONNX file of others; name: of the file, for messages; read_file: reader of external files.

    Raises `BundleError` with every part that the network of a policy does not have: not ONNX, too large, unknown
    operators, several inputs or outputs, numbers in missing files.
    """
    try:
        return _read(data, read_file)
    except BundleError as error:
        raise BundleError(
            str(error)
            .replace("policy.onnx", name)
            .replace("; export the bundle again", "")
            .replace("; export it again", "")
        ) from error


def _read(data: bytes, read_file: ReadFile | None) -> ForeignNetwork:
    """Read the file; messages call it policy.onnx."""
    if len(data) > ours.MOST_BYTES:
        raise BundleError(f"policy.onnx has {len(data)} bytes; at most {ours.MOST_BYTES} are read")
    model = read_message(memoryview(data), "the model", MODEL)
    faults: list[str] = []
    layout, opset = _versions(model, faults)
    graph = read_message(only(model, "graph", "the model"), "graph", GRAPH)
    constants, nodes = {}, []
    outside = _ExternalFiles(read_file, faults)
    for part in graph["initializer"]:
        tensor = _tensor(part, outside)
        constants[tensor.name] = tensor
    unknown: dict[str, None] = {}
    for part in graph["node"]:
        node = _node(part, outside, unknown)
        if isinstance(node, Tensor):
            constants[node.name] = node
        elif node is not None:
            nodes += _of_today(node, opset, constants)
    if unknown:
        many = "operators" if len(unknown) > 1 else "operator"
        faults.append(f"has the {many} {', '.join(unknown)}; expected one of {', '.join(sorted(OPERATORS))}")
    # Files of before 2019 list constants among the inputs.
    inputs = [port for port in _ports(graph["input"], "input") if port.name not in constants]
    outputs = _ports(graph["output"], "output")
    # The velocity that our own networks estimate besides the action: no other runtime asks for it.
    estimates = [port.name for port in outputs] == [OUTPUT, VELOCITY]
    sides = (inputs, outputs[: len(outputs) - estimates])
    for side, ports in zip(("input", "output"), sides, strict=True):
        if len(ports) != 1:
            faults.append(_several(ports, side))
        elif len(ports[0].shape) != 2 or ports[0].kind != FLOAT or ports[0].shape[-1] is None:
            faults.append(
                f"has the {side} {ports[0].name!r} {ports[0].shape}; expected float32 of the shape (batch, size), the "
                "size fixed"
            )
    if faults:
        raise BundleError("; ".join([f"policy.onnx {faults[0]}", *(f"it {fault}" for fault in faults[1:])]))
    (observed,), (acted,) = sides
    network = _renamed(NetworkFile(tuple(nodes), constants, observed, acted))
    sizes = (observed.shape[-1] or 0, acted.shape[-1] or 0)
    # As our own networks are written.
    opset, layout = (min(max(v, r[0]), r[-1]) for v, r in ((opset, ours.OPSETS), (layout, ours.IR_VERSIONS)))
    return ForeignNetwork(network, _notes(model["metadata_props"]), opset, layout, *sizes, tuple(outside.files))


def _versions(model: Mapping[str, list], faults: list[str]) -> tuple[int, int]:
    """Return the versions of the file's layout and of ONNX's own operators; note unsupported ones.

    Other sets of operators may be named: exporters name all that they know, used or not.
    """
    layout, opset = (model["ir_version"] or [0])[0], 0
    for part in model["opset_import"]:
        entry = read_message(part, "opset_import", ours.OPSET)
        if text_of(entry["domain"], "opset_import.domain") in ("", "ai.onnx"):
            opset = (entry["version"] or [0])[0]
    if layout not in LAYOUTS or opset not in OPSETS:
        faults.append(
            f"has the layout {layout} and ONNX's operators of version {opset}; expected layout {LAYOUTS[0]} to "
            f"{LAYOUTS[-1]} and version {OPSETS[0]} to {OPSETS[-1]}: export it again with such an opset"
        )
    return layout, opset


def _of_today(node: Node, opset: int, constants: dict[str, Tensor]) -> list[Node]:
    """Return an operation as version 13 has it; a former attribute becomes a constant of the network."""
    key = WITH_AXES.get(node.operator)
    axes = node.attributes.get(key or "")
    if opset >= ours.OPSETS[0] or key is None or not isinstance(axes, tuple):
        return [node]
    name = f"{key} of {node.outputs[0]}"
    constants[name] = constant(name, np.array(axes, dtype=np.int64))
    left = {other: value for other, value in node.attributes.items() if other != key}
    return [replace(node, inputs=(*node.inputs[:1], name), attributes=left)]


def _several(ports: Sequence[Port], side: str) -> str:
    """Return the fault of a side without exactly one port."""
    names = ", ".join(repr(port.name) for port in ports)
    return (
        f"has {len(ports)} {side}s: {names}; expected one. A policy with a state, a motion or a clock of its own is "
        "not read: export it with one input of observations and one output of actions"
    )


def _notes(parts: Iterable[memoryview]) -> dict[str, str]:
    """Return the metadata, without entries that are too long or not text."""
    metadata: dict[str, str] = {}
    for part in parts:
        note = read_message(part, "metadata", NOTE)
        key, value = text_of(note["key"], "metadata.key"), bytes(note["value"][0]) if note["value"] else b""
        if key in metadata:
            raise BundleError(f"policy.onnx has two entries of metadata {key!r}; expected one")
        if len(value) <= LARGEST_NOTE:
            metadata[key] = value.decode("utf-8", "replace")
    return metadata


def _ports(parts: Iterable[memoryview], side: str) -> list[Port]:
    """Return inputs or outputs, without notes on their shapes."""
    return [read_port(part, side, PORT, SHAPE_DIMENSION) for part in parts]


def _node(data: memoryview, outside: _ExternalFiles, unknown: dict[str, None]) -> Node | Tensor | None:
    """Read one operation; a constant is a tensor. None: it is unknown, and its name is noted."""
    fields = read_message(data, "node", NODE)
    operator, domain = text_of(fields["op_type"], "node.op_type"), text_of(fields["domain"], "node.domain")
    inputs, outputs = (tuple(text_of([part], f"node.{side}") for part in fields[side]) for side in ("input", "output"))
    if domain not in ("", "ai.onnx") or operator not in {"Constant", *OPERATORS}:
        unknown[f"{operator!r}{f' of {domain!r}' if domain else ''}"] = None
        return None
    attributes: dict[str, Attribute] = {}
    for part in fields["attribute"]:
        entry = read_message(part, f"attribute of {operator!r}", ATTRIBUTE)
        name, kind = text_of(entry["name"], "attribute.name"), entry["type"]
        if operator == "Constant" and len(outputs) == 1 and (tensor := _constant(entry, name, outside)) is not None:
            # As a constant among the others: `deploy.network_file` knows no tensors in attributes.
            return replace(tensor, name=outputs[0])
        number = next((field for field, value in NUMBERS.items() if kind == [value]), None)
        if number is None or operator == "Constant":
            raise BundleError(f"policy.onnx: attribute {name!r} of {operator!r}: expected a number, or integers")
        if number == "ints":
            attributes[name] = tuple(map(signed, entry["ints"]))
        else:
            value = entry[number][0] if entry[number] else 0
            attributes[name] = signed(value) if number == "i" else float(value)
    return Node(operator, inputs, outputs, attributes)


def _constant(entry: Mapping[str, list], name: str, outside: _ExternalFiles) -> Tensor | None:
    """Return the value of a constant that stands in an attribute: a tensor, a number, or integers."""
    if entry["t"]:
        return _tensor(entry["t"][0], outside)
    if name == "value_float":
        return constant("", np.array(entry["f"][0] if entry["f"] else 0.0, dtype=np.float32))
    if name == "value_int":
        return constant("", np.array(signed(entry["i"][0]) if entry["i"] else 0, dtype=np.int64))
    return constant("", np.array([*map(signed, entry["ints"])], dtype=np.int64)) if name == "value_ints" else None


class _ExternalFiles:
    """Numbers in external files; each file is read once."""

    def __init__(self, read_file: ReadFile | None, faults: list[str]) -> None:
        """Start without files; read_file: reader of a file; faults: list for files that cannot be read."""
        self._read_file, self._faults = read_file, faults
        self.failed = False
        self.files: dict[str, bytes] = {}

    def content(self, parts: Sequence[memoryview]) -> memoryview:
        """Return the stretch of a file that the entries of a tensor name; empty without one."""
        notes = [read_message(part, "external_data", NOTE) for part in parts]
        entries = {text_of(note["key"], "external_data.key"): text_of(note["value"], "external_data") for note in notes}
        name, start, length = entries.get("location", ""), entries.get("offset", "0"), entries.get("length", "")
        if not start.isdecimal() or not (length or "0").isdecimal() or max(len(start), len(length)) > 15:
            raise BundleError(
                f"policy.onnx: a tensor outside has the offset {start[:20]!r}, the length {length[:20]!r}"
            )
        if name not in self.files:
            self.files[name] = b""
            try:
                if self._read_file is None:
                    raise BundleError(f"keeps tensors in the file {name!r}; expected all within")
                self.files[name] = self._read_file(name)
            except StictionError as error:
                # One of them is enough: there may be a file for each tensor.
                self._faults += [] if self.failed else [str(error)]
                self.failed = True
            if sum(map(len, self.files.values())) > ours.MOST_BYTES:
                raise BundleError(f"policy.onnx has over {ours.MOST_BYTES} bytes in other files; a policy's are fewer")
        whole = memoryview(self.files[name])
        return whole[int(start) :][: int(length) if length else None]


def _tensor(data: memoryview, outside: _ExternalFiles) -> Tensor:
    """Read one constant: as raw bytes, as numbers of its type, or from an external file."""
    fields = read_message(data, "tensor", TENSOR)
    name, kind = text_of(fields["name"], "tensor.name"), (fields["data_type"] or [0])[0]
    shape = tuple(map(signed, fields["dims"]))
    # Packed float32 lie in the file as raw bytes do; packed integers are of various lengths.
    content = (fields["raw_data"] or fields["float_data"] or [memoryview(b"")])[0]
    if fields["int64_data"]:
        numbers = [signed(value) for value in ours.packed(fields["int64_data"][0])]
        content = memoryview(np.array(numbers, dtype="<i8").tobytes())
    # `data_location` 0 is inside, as where it is missing.
    if fields["data_location"] == [EXTERNAL]:
        content = outside.content(fields["external_data"])
        if outside.failed:
            return Tensor(name, kind, shape, content)
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
    """Return a network as ONNX: one file, names as they are; opset, layout: versions; metadata: of the policy."""
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
            content = b"".join(_number(8, item) for item in value) + _number(20, NUMBERS["ints"])
        elif isinstance(value, float):
            content = _varint(2 << 3 | SINGLE) + struct.pack("<f", value) + _number(20, NUMBERS["f"])
        else:
            content = _number(3, value) + _number(20, NUMBERS["i"])
        parts.append(_field(5, _field(1, name.encode()) + content))
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
