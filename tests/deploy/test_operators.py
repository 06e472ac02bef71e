"""Sizes and work of networks, worked out by hand, and networks rejected before they run."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from bundles import linear_network
from stiction.core.errors import BundleError
from stiction.deploy import first_run as first
from stiction.deploy.first_run import first_run
from stiction.deploy.network_file import MOST_BYTES, read_network
from stiction.deploy.operators import MOST_WORK, OVERHEAD, REDUCTIONS, check_network
from stiction.deploy.policy import check_model

onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")


def network(*nodes, **constants: np.ndarray) -> bytes:
    """Return a network from 4 observations to 2 actions."""
    port = onnx.helper.make_tensor_value_info
    graph = onnx.helper.make_graph(
        nodes,
        "small",
        [port("observation", onnx.TensorProto.FLOAT, ["batch", 4])],
        [port("action", onnx.TensorProto.FLOAT, ["batch", 2])],
        [onnx.numpy_helper.from_array(np.asarray(array), name) for name, array in constants.items()],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=10)
    return model.SerializeToString()


def node(operator: str, inputs: str, outputs: str = "action", **attributes: object):
    """Return a node."""
    return onnx.helper.make_node(operator, inputs.split(), outputs.split(), **attributes)


def test_the_work_of_a_product_by_hand() -> None:
    """715 times 18 multiplications, ten for each of 18 results, and one call."""
    model = linear_network(onnx, np.ones((715, 18), np.float32))
    assert check_model(model, 715, 18) == 715 * 18 + 10 * 18 + OVERHEAD


@pytest.mark.parametrize(
    ("nodes", "constants"),
    [
        ([node("Slice", "observation a b c")], {"a": [1], "b": [3], "c": [1]}),
        ([node("Slice", "observation a b c")], {"a": [-2], "b": [2**63 - 1], "c": [-1]}),
        ([node("Split", "observation", "action rest", axis=1, num_outputs=2)], {}),
        ([node("Split", "observation s", "rest action", axis=-1)], {"s": [2, 2]}),
        ([node("Reshape", "observation s", "x"), node("Slice", "x a b", "y"), node("Squeeze", "y one")],
         {"s": [-1, 2, 2], "a": [0, 1], "b": [9999, 2], "one": [1]}),
        ([node("Shape", "observation", "n", end=1), node("Concat", "n two", "s", axis=0), node("ConstantOfShape", "s")],
         {"two": [2]}),
        ([node("Gemm", "observation w b", transB=1, alpha=0.5)], {"w": np.ones((2, 4), np.float32),
                                                                 "b": np.zeros(2, np.float32)}),
        ([node("Transpose", "observation", "x", perm=[1, 0]), node("Gemm", "x w", transA=1)],
         {"w": np.ones((4, 2), np.float32)}),
        ([node("Unsqueeze", "observation one", "x"), node("MatMul", "x w", "y"), node("Flatten", "y")],
         {"one": [1], "w": np.ones((4, 2), np.float32)}),
        *(([node(name, "observation one", "x"), node("Mul", "x w")], {"one": [1], "w": np.ones((1, 2), np.float32)})
          for name in REDUCTIONS),
        *(([node(name, "observation", "x"), node("Slice", "x a b c")], {"a": [0], "b": [2], "c": [1]})
          for name in ("Sin", "Cos", "Log", "Reciprocal", "Sign", "Floor", "Ceil", "Round", "HardSwish", "Mish")),
        ([onnx.helper.make_node("Clip", ["observation", "", "high"], ["x"]), node("Slice", "x a b c")],
         {"high": np.float32(1.0), "a": [0], "b": [2], "c": [1]}),
        ([node("PRelu", "observation s", "x"), node("Slice", "x a b c")],
         {"s": np.ones(4, np.float32), "a": [0], "b": [2], "c": [1]}),
    ],
)  # fmt: skip
def test_the_sizes_are_those_that_the_runtime_finds(nodes: list, constants: dict) -> None:
    """The predicted sizes are those of onnxruntime."""
    model = network(*nodes, **{name: np.asarray(array) for name, array in constants.items()})
    assert check_model(model, 4, 2) > 0
    first_run(model, np.random.default_rng(0).uniform(0.5, 2.0, (6, 4)).astype(np.float32))


@pytest.mark.parametrize("operator", REDUCTIONS)
def test_no_robot_of_a_batch_sees_another(operator: str) -> None:
    """Rejects a sum over the batch, which mixes robots."""
    nodes = node(operator, "observation axis", "x"), node("Slice", "x a b c")
    with pytest.raises(BundleError, match="over the robots of a batch"):
        check_model(network(*nodes, axis=np.array([0]), a=np.array([0]), b=np.array([2]), c=np.array([1])), 4, 2)


def test_more_work_than_a_step_may_take_is_refused_unrun() -> None:
    """Ten products of 2048 by 2048: 4.2e7 multiplications, and twenty are over 6.7e7."""
    square = np.zeros((2048, 2048), np.float32)
    ends = {"first": np.ones((4, 2048), np.float32), "last": np.ones((2048, 2), np.float32), "square": square}
    names = [f"x{number}" for number in range(21)]
    middle = [node("MatMul", f"{before} square", after) for before, after in pairwise(names)]
    for count, allowed in ((10, True), (20, False)):
        made = [node("MatMul", "observation first", "x0"), *middle[:count], node("MatMul", f"{names[count]} last")]
        file = read_network(network(*made, **ends))
        if allowed:
            assert 10 * 2048**2 < check_network(file, 4, 2) < MOST_WORK
        else:
            with pytest.raises(BundleError, match="operations a step"):
                check_network(file, 4, 2)


def test_a_file_of_any_size_is_refused_by_its_size() -> None:
    """A file beyond the size limit is rejected unread."""
    with pytest.raises(BundleError, match="at most"):
        read_network(bytes(MOST_BYTES + 1))


@pytest.mark.parametrize(("name", "value"), [("MEMORY", 2**20), ("SECONDS", 0)])
def test_a_first_run_is_bounded(name: str, value: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a megabyte, or no time, a good network of 17 MB fails in its own process, and this one says so."""
    wide = {"first": np.ones((4, 2048), np.float32), "square": np.zeros((2048, 2048), np.float32)}
    wide["last"] = np.ones((2048, 2), np.float32)
    nodes = node("MatMul", "observation first", "x"), node("MatMul", "x square", "y"), node("MatMul", "y last")
    model = network(*nodes, **wide)
    observations = np.ones((3, 4), np.float32)
    program = (
        f"import sys; sys.argv = ['x']; from stiction.deploy import first_run; first_run.{name} = {value}; "
        "first_run.main()"
    )
    command = [first.sys.executable, "-P", "-c", program]
    monkeypatch.setattr("stiction.core.isolation.python_module", lambda module, words: command)
    monkeypatch.setattr(first, "_passed", set())
    with pytest.raises(BundleError, match="did not run within"):
        first_run(model, observations)
