"""Networks of others: what is taken of their ONNX files, and what is refused by name."""

import numpy as np
import pytest

from foreign import MJLAB, network
from stiction.core.errors import BundleError
from stiction.deploy.network_file import FLOAT, NetworkFile, Node, Port
from stiction.deploy.policy import Network, check_model
from stiction.exchange.policies.onnx_file import read_foreign, write_network


def test_a_network_of_others_becomes_ours_and_computes_the_same() -> None:
    """Other names, a batch of one and metadata: all that its own file has and ours may not."""
    foreign = read_foreign(network(5, 3, MJLAB, ("actor_obs", "mu"), batch=1), "theirs.onnx")
    assert (foreign.observation_size, foreign.num_actions, foreign.opset) == (5, 3, 13)
    assert foreign.metadata["command_names"] == "twist"
    model = foreign.write()
    check_model(model, 5, 3)
    observation = np.random.default_rng(1).standard_normal((4, 5)).astype(np.float32)
    weights = 0.1 * np.random.default_rng(0).standard_normal((5, 3))
    np.testing.assert_allclose(Network(model, 5, 3)(observation), np.tanh(observation @ weights), atol=1e-6)


def test_what_the_exporter_of_torch_writes_is_read() -> None:
    """Constants as nodes, notes on values, numbers that are not raw bytes, a mean along the entries of a robot."""
    onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make a network")
    port, float32 = onnx.helper.make_tensor_value_info, onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        [
            onnx.helper.make_node("Constant", [], ["two"], value=onnx.helper.make_tensor("", float32, [], [2.0])),
            onnx.helper.make_node("ReduceMean", ["obs"], ["mean"], axes=[-1]),
            onnx.helper.make_node("Sub", ["obs", "mean"], ["centred"], doc_string="from line 7"),
            onnx.helper.make_node("Pow", ["centred", "two"], ["square"]),
            onnx.helper.make_node("Gemm", ["square", "w"], ["actions"], alpha=0.5),
        ],
        "main",
        [port("obs", float32, [1, 4])],
        [port("actions", float32, [1, 2])],
        [onnx.helper.make_tensor("w", float32, [4, 2], list(range(8)))],
        value_info=[port("mean", float32, [1, 1])],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=7)
    made = read_foreign(model.SerializeToString(), "theirs.onnx").write()
    check_model(made, 4, 2)
    seen = np.array([[1.0, 2.0, 3.0, 6.0]], dtype=np.float32)
    # About their mean of 3: squares 4, 1, 0, 9; half of their products with the columns 0 2 4 6 and 1 3 5 7.
    np.testing.assert_allclose(Network(made, 4, 2)(seen), [[28.0, 35.0]])


def two_inputs() -> bytes:
    """Return a network with a state."""
    onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make a network")
    port, float32 = onnx.helper.make_tensor_value_info, onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Add", ["obs", "h_in"], ["actions"])],
        "main",
        [port("obs", float32, [1, 4]), port("h_in", float32, [1, 4])],
        [port("actions", float32, [1, 4])],
    )
    return onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8
    ).SerializeToString()


def recurrent() -> bytes:
    """Return a network with an operator that keeps a state."""
    ports = (Port("obs", FLOAT, (1, 4)), Port("actions", FLOAT, (1, 4)))
    return write_network(NetworkFile((Node("LSTM", ("obs",), ("actions",), {}),), {}, *ports), 13, 8)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (two_inputs, "theirs.onnx has 2 inputs: 'obs', 'h_in'; expected one"),
        (recurrent, "theirs.onnx has the operator 'LSTM'; expected one of"),
        (lambda: network(4, 4)[:40], "theirs.onnx is not an ONNX file"),
        (lambda: b"ORTM" * 9, "theirs.onnx is not an ONNX file"),
        (lambda: network(4, 4, {"note": "a", "\x1bkey": "b"}), "printable"),
    ],
)
def test_what_cannot_be_taken_is_refused_by_name(make, message: str) -> None:
    """A policy with a state of its own would walk without it, and badly."""
    with pytest.raises(BundleError, match=message):
        read_foreign(make(), "theirs.onnx")
