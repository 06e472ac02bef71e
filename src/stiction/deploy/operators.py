"""Shapes and work of a network, inferred without running it.

Each operator that a policy's network may have has an entry: those of MLPs and of recurrent cells that are
written out. None of them loops, branches, or makes a shape from its observations; so with the size of the
batch every size is known, and a network that would fill the memory or never end is rejected before it is run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import BundleError
from stiction.deploy.network_file import FLOAT, INT64, NetworkFile, Node

MOST_ENTRIES = 2**20
"""Most numbers in the output of one node for one robot: far more than the shipped networks need."""

MOST_WORK = 2**26
"""Most work of one step of one robot, in multiplications: far more than the shipped policies need, and still
within a control period."""

OVERHEAD = 5000
"""Work of a node besides its numbers: calling it takes as long as some thousands of multiplications."""

BATCHES = (1, 2, 7)
"""Sizes of a batch for which all sizes are inferred: none may grow faster than the batch."""


@dataclass(frozen=True)
class Value:
    """Value on an edge of the graph."""

    shape: tuple[int, ...]
    kind: int = FLOAT
    numbers: np.ndarray | None = None
    """Numbers of an integer value that are known beforehand."""


class UnfitError(Exception):
    """Error for inputs of an operator that do not fit; its text names the expected ones."""


VELOCITY_SIZE = 2
"""Entries of the second output: forward and sideways."""

Rule = Callable[[Node, Sequence[Value]], list[Value]]


def check_network(network: NetworkFile, observation_size: int, num_actions: int) -> int:
    """Return the work of one step of one robot.

    Raises `BundleError`: an unknown operator, inputs that do not fit it, outputs of other sizes than
    (batch, num_actions) and (batch, 2), a node with more than `MOST_ENTRIES`, or more work than `MOST_WORK`.
    """
    single = _infer(network, 1, observation_size)[1]
    for batch in BATCHES:
        values, work = _infer(network, batch, observation_size)
        for port, size in ((network.output, num_actions), (network.velocity, VELOCITY_SIZE)):
            if port is not None and ((value := values[port.name]).kind, value.shape) != (FLOAT, (batch, size)):
                raise BundleError(
                    f"policy.onnx has the output {port.name!r} of shape {value.shape} for {batch} observations; "
                    f"expected {(batch, size)}; export the bundle again"
                )
        # A product of the batch with itself would grow with its square.
        if work > batch * single:
            raise BundleError(f"policy.onnx takes more work for each of {batch} robots than for one; expected as much")
    single += OVERHEAD * len(network.nodes)
    if single > MOST_WORK:
        raise BundleError(f"policy.onnx takes {single:.3g} operations a step; at most {MOST_WORK:.3g} are run")
    return single


def _infer(network: NetworkFile, batch: int, observation_size: int) -> tuple[dict[str, Value], int]:
    """Return all values of the network for a batch, by name, and the work of all nodes without their `OVERHEAD`."""
    values = {
        # Shapes, axes and bounds are short; longer integers are data, whose values decide no shape.
        name: Value(
            constant.shape,
            constant.kind,
            constant.numbers if constant.kind == INT64 and constant.numbers.size <= 64 else None,
        )
        for name, constant in network.constants.items()
    }
    work = 0
    if network.input.name in values:
        raise BundleError(f"policy.onnx: the input {network.input.name!r} is a constant too; export the bundle again")
    values[network.input.name] = Value((batch, observation_size))
    for node in network.nodes:
        if node.operator not in OPERATORS:
            raise BundleError(
                f"policy.onnx has the operator {node.operator!r}; expected one of {', '.join(sorted(OPERATORS))}"
            )
        try:
            names = _stated(node)
            if absent := [name for name in names if name not in values]:
                raise UnfitError(f"the input {absent[0]!r} is not computed before")
            results = OPERATORS[node.operator](node, [values[name] for name in names])
        # Rules take nodes as they come: an input that is missing, or has too few axes, fails in many ways.
        except (UnfitError, ArithmeticError, IndexError, KeyError, TypeError, ValueError) as error:
            raise BundleError(f"policy.onnx: {node.operator!r} {node.outputs} cannot be run: {error}") from error
        if len(results) < len(node.outputs):
            raise BundleError(
                f"policy.onnx: {node.operator!r} has {len(node.outputs)} outputs; expected {len(results)}"
            )
        for name, value in zip(node.outputs, results, strict=False):
            if name in values:
                raise BundleError(f"policy.onnx: {name!r} is computed twice; export the bundle again")
            if math.prod(value.shape) > batch * MOST_ENTRIES:
                raise BundleError(
                    f"policy.onnx: {node.operator!r} would put out {value.shape} for {batch} observations; at most "
                    f"{MOST_ENTRIES} numbers each are computed"
                )
            values[name] = value
        work += node_work(node, [values[name] for name in node.inputs if name], results)
    for port in filter(None, (network.output, network.velocity)):
        if port.name not in values:
            raise BundleError(f"policy.onnx: nothing computes the output {port.name!r}; export the bundle again")
    return values, work


def _stated(node: Node) -> list[str]:
    """Return the inputs of a node without those that are left out: the last ones, or any bound of a `Clip`."""
    names = list(node.inputs)
    while names and not names[-1]:
        names.pop()
    # The rules of other operators know inputs by their places: one that is left out in between stays, and is rejected.
    return [name for name in names if name] if node.operator == "Clip" else names


def node_work(node: Node, inputs: Sequence[Value], outputs: Sequence[Value]) -> int:
    """Return the work of a node, in multiplications: those of products, and ten for each output number."""
    products = math.prod(outputs[0].shape) * inputs[0].shape[-1] if node.operator in PRODUCTS else 0
    if node.operator == "Gemm" and node.attributes.get("transA"):
        products = math.prod(outputs[0].shape) * inputs[0].shape[0]
    if node.operator in REDUCTIONS:
        products = math.prod(inputs[0].shape)
    return products + sum(10 * math.prod(value.shape) for value in outputs)


PRODUCTS = ("MatMul", "Gemm")

REDUCTIONS = (
    *("ReduceMean", "ReduceSum", "ReduceMax", "ReduceMin", "ReduceProd", "ReduceL1", "ReduceL2"),
    *("ReduceSumSquare", "ReduceLogSum", "ReduceLogSumExp"),
)
"""Operators that reduce many numbers to one along axes."""


def _floats(inputs: Sequence[Value], least: int, most: int) -> None:
    """Reject inputs that are not floats, or too many or too few."""
    if not least <= len(inputs) <= most or any(value.kind != FLOAT for value in inputs):
        raise UnfitError(f"expected {least} to {most} float32 inputs, got {len(inputs)} of the types "
                         f"{[value.kind for value in inputs]}")  # fmt: skip


def _known(value: Value) -> list[int]:
    """Return integers that are known beforehand, in one row."""
    if value.numbers is None or value.numbers.ndim > 1:
        raise UnfitError("expected integers that are known beforehand, in one row")
    return np.atleast_1d(value.numbers).tolist()


def _integer(node: Node, name: str, default: int | None = None) -> int:
    value = node.attributes.get(name, default)
    if not isinstance(value, int):
        raise UnfitError(f"{name} is {value}; expected an integer")
    return value


def _axis(axis: int, rank: int) -> int:
    if not -rank <= axis < rank:
        raise UnfitError(f"axis {axis} of {rank}")
    return axis % rank


def _broadcast(*shapes: tuple[int, ...]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        raise UnfitError(f"shapes {shapes} do not fit") from error


def _same(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of a function of every number."""
    _floats(inputs, 1, 1)
    return [Value(inputs[0].shape)]


def _pairs(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of a function of two numbers each."""
    _floats(inputs, 2, 2)
    return [Value(_broadcast(inputs[0].shape, inputs[1].shape))]


def _clip(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape within bounds that are single numbers."""
    _floats(inputs, 1, 3)
    if any(value.shape for value in inputs[1:]):
        raise UnfitError("expected bounds without dimensions")
    return [Value(inputs[0].shape)]


def _reduce(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of means, sums and the like along axes of an attribute or an input; never over the batch."""
    _floats(inputs[:1], 1, 1)
    shape, named = inputs[0].shape, node.attributes.get("axes")
    chosen = _known(inputs[1]) if len(inputs) > 1 else named
    if not isinstance(chosen, tuple | list) or not chosen:
        raise UnfitError(f"axes {chosen}: expected some axes, known beforehand")
    gone = {_axis(axis, len(shape)) for axis in chosen}
    if 0 in gone:
        raise UnfitError(f"axes {sorted(gone)}: reduces over the robots of a batch")
    keep = bool(node.attributes.get("keepdims", 1))
    return [Value(tuple(1 if axis in gone else size for axis, size in enumerate(shape) if keep or axis not in gone))]


def _layer_normalization(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return shapes of normalised numbers along the last axes, and of their mean and deviation."""
    _floats(inputs, 2, 3)
    shape = inputs[0].shape
    axis = _axis(_integer(node, "axis", -1), len(shape))
    if axis == 0 or any(_broadcast(value.shape, shape) != shape for value in inputs[1:]):
        raise UnfitError(f"axis {axis}, shapes {[value.shape for value in inputs]}")
    reduced = tuple(size if place < axis else 1 for place, size in enumerate(shape))
    return [Value(shape), Value(reduced), Value(reduced)]


def _matmul(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of products of matrices, as many as the dimensions before have."""
    _floats(inputs, 2, 2)
    (*before, rows, inner), (*after, same, columns) = inputs[0].shape, inputs[1].shape
    if inner != same:
        raise UnfitError(f"shapes {inputs[0].shape} and {inputs[1].shape} do not fit")
    return [Value((*_broadcast(tuple(before), tuple(after)), rows, columns))]


def _gemm(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of alpha A' B' + beta C."""
    _floats(inputs, 2, 3)
    first, second = (
        value.shape[::-1] if node.attributes.get(name, 0) else value.shape
        for value, name in zip(inputs, ("transA", "transB"), strict=False)
    )
    (rows, inner), (same, columns) = first, second
    if inner != same or (len(inputs) == 3 and _broadcast(inputs[2].shape, (rows, columns)) != (rows, columns)):
        raise UnfitError(f"shapes {[value.shape for value in inputs]} do not fit")
    return [Value((rows, columns))]


def _reshape(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the reshaped value: size -1 is what is left, 0 the input's own size on that axis."""
    value, sizes = inputs[0], _known(inputs[1])
    _floats(inputs[:1], 1, 1)
    if node.attributes.get("allowzero", 0) == 0:
        sizes = [value.shape[place] if size == 0 else size for place, size in enumerate(sizes)]
    left = math.prod(size for size in sizes if size != -1)
    if min(sizes, default=1) < -1 or sizes.count(-1) > 1 or left <= 0:
        raise UnfitError(f"shape {sizes}")
    shape = tuple(math.prod(value.shape) // left if size == -1 else size for size in sizes)
    if math.prod(shape) != math.prod(value.shape):
        raise UnfitError(f"{value.shape} cannot become {shape}")
    return [Value(shape)]


def _flatten(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of two dimensions: those before the axis, and those from it on."""
    _floats(inputs, 1, 1)
    shape, axis = inputs[0].shape, _integer(node, "axis", 1)
    place = len(shape) if axis == len(shape) else _axis(axis, len(shape))
    return [Value((math.prod(shape[:place]), math.prod(shape[place:])))]


def _squeeze(node: Node, inputs: Sequence[Value]) -> list[Value]:
    shape = inputs[0].shape
    _floats(inputs[:1], 1, 1)
    gone = {_axis(axis, len(shape)) for axis in _known(inputs[1])}
    if any(shape[axis] != 1 for axis in gone):
        raise UnfitError(f"axes {sorted(gone)} of {shape}")
    return [Value(tuple(size for axis, size in enumerate(shape) if axis not in gone))]


def _unsqueeze(node: Node, inputs: Sequence[Value]) -> list[Value]:
    _floats(inputs[:1], 1, 1)
    axes = _known(inputs[1])
    rank = len(inputs[0].shape) + len(axes)
    new, old = {_axis(axis, rank) for axis in axes}, iter(inputs[0].shape)
    if len(new) < len(axes):
        raise UnfitError(f"axes {axes}")
    return [Value(tuple(1 if axis in new else next(old) for axis in range(rank)))]


def _transpose(node: Node, inputs: Sequence[Value]) -> list[Value]:
    _floats(inputs, 1, 1)
    shape = inputs[0].shape
    order = node.attributes.get("perm", tuple(range(len(shape)))[::-1])
    if not isinstance(order, tuple) or sorted(order) != list(range(len(shape))):
        raise UnfitError(f"order {order} of {shape}")
    return [Value(tuple(shape[axis] for axis in order))]


def _concat(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of parts joined along an axis; known integers stay known."""
    kinds = {value.kind for value in inputs}
    if kinds == {INT64}:
        joined = np.array([number for value in inputs for number in _known(value)], dtype=np.int64)
        return [Value(joined.shape, INT64, joined)]
    _floats(inputs, 1, 64)
    shape = list(inputs[0].shape)
    axis = _axis(_integer(node, "axis"), len(shape))
    for value in inputs[1:]:
        if len(value.shape) != len(shape) or any(
            size != shape[place] for place, size in enumerate(value.shape) if place != axis
        ):
            raise UnfitError(f"shapes {[value.shape for value in inputs]} do not fit")
    shape[axis] = sum(value.shape[axis] for value in inputs)
    return [Value(tuple(shape))]


def _slice(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of parts along some axes."""
    _floats(inputs[:1], 1, 1)
    shape = list(inputs[0].shape)
    starts, ends = _known(inputs[1]), _known(inputs[2])
    axes = _known(inputs[3]) if len(inputs) > 3 else list(range(len(starts)))
    steps = _known(inputs[4]) if len(inputs) > 4 else [1] * len(starts)
    places = [_axis(axis, len(shape)) for axis in axes]
    if len(set(places)) < len(places) or min(steps, default=1) < 1:
        raise UnfitError(f"axes {axes}, steps {steps}: expected each once, and steps forward")
    for place, start, end, step in zip(places, starts, ends, steps, strict=True):
        # Ends beyond the axis, and those counted from its end, mean in Python what they mean in ONNX.
        shape[place] = len(range(shape[place])[slice(start, end, step)])
    return [Value(tuple(shape))]


def _split(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shapes of parts along one axis, of known sizes, or alike."""
    _floats(inputs[:1], 1, 1)
    shape, count = inputs[0].shape, len(node.outputs)
    axis = _axis(_integer(node, "axis", 0), len(shape))
    # Parts alike but for the last, which is the shorter one where they do not divide (ONNX from version 18 on).
    size = -(-shape[axis] // count)
    sizes = _known(inputs[1]) if len(inputs) > 1 else [size] * (count - 1) + [shape[axis] - size * (count - 1)]
    if len(sizes) != count or sum(sizes) != shape[axis] or min(sizes) < 0:
        raise UnfitError(f"parts of {sizes} of {shape}")
    return [Value((*shape[:axis], part, *shape[axis + 1 :])) for part in sizes]


def _shape(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the sizes of a value, from `start` to `end`."""
    shape = inputs[0].shape
    sizes = np.array(shape[_integer(node, "start", 0) : _integer(node, "end", len(shape))], dtype=np.int64)
    return [Value(sizes.shape, INT64, sizes)]


def _constant_of_shape(node: Node, inputs: Sequence[Value]) -> list[Value]:
    """Return the shape of zeros, float32: the attribute for another number is a tensor, which is not read."""
    shape = tuple(_known(inputs[0]))
    if min(shape, default=1) < 0 or len(shape) > 6:
        raise UnfitError(f"shape {shape}")
    return [Value(shape)]


OPERATORS: dict[str, Rule] = {
    **dict.fromkeys(("Elu", "Relu", "LeakyRelu", "Selu", "Celu", "Sigmoid", "HardSigmoid"), _same),
    **dict.fromkeys(("Softplus", "Softsign", "Tanh", "Exp", "Neg", "Abs", "Sqrt", "Identity", "Erf", "Atan"), _same),
    **dict.fromkeys(("Sin", "Cos", "Log", "Reciprocal", "Sign", "Floor", "Ceil", "Round", "HardSwish", "Mish"), _same),
    **dict.fromkeys(("Add", "Sub", "Mul", "Div", "Pow", "Max", "Min", "PRelu"), _pairs),
    **dict.fromkeys(REDUCTIONS, _reduce),
    "LayerNormalization": _layer_normalization,
    "Clip": _clip,
    "MatMul": _matmul,
    "Gemm": _gemm,
    "Reshape": _reshape,
    "Flatten": _flatten,
    "Squeeze": _squeeze,
    "Unsqueeze": _unsqueeze,
    "Transpose": _transpose,
    "Concat": _concat,
    "Slice": _slice,
    "Split": _split,
    "Shape": _shape,
    "ConstantOfShape": _constant_of_shape,
}
