"""Foreign networks: the accepted part of their ONNX files, and rejections by name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foreign import MJLAB, network
from stiction.core.errors import BundleError
from stiction.deploy.network_file import FLOAT, NetworkFile, Node, Port
from stiction.deploy.policy import Network, check_model
from stiction.exchange.policies.importer import read_network
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
    """Rejects unsupported networks by name, such as a policy with internal state."""
    with pytest.raises(BundleError, match=message):
        read_foreign(make(), "theirs.onnx")


WEIGHTS = np.random.default_rng(0).standard_normal((4, 2)).astype(np.float32)


def made(*nodes: Any, opset: int = 18, layout: int = 10, domains: tuple[str, ...] = ()) -> Any:
    """Return an ONNX model from `obs` (1, 4) to `actions` (1, 2), with the constant `w`; domains: of other sets."""
    onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make a network")
    port, float32 = onnx.helper.make_tensor_value_info, onnx.TensorProto.FLOAT
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node(name, inputs.split(), outputs.split(), **more) for name, inputs, outputs, more in nodes],
        "main",
        [port("obs", float32, [1, 4])],
        [port("actions", float32, [1, 2])],
        [onnx.numpy_helper.from_array(WEIGHTS, "w")],
    )
    sets = [onnx.helper.make_opsetid(*one) for one in (("", opset), *((name, 1) for name in domains))]
    return onnx.helper.make_model(graph, opset_imports=sets, ir_version=layout)


PRODUCT = ("MatMul", "obs w", "actions", {})
SEEN = np.array([[1.0, -2.0, 3.0, 0.5]], dtype=np.float32)


def computed(model: bytes) -> np.ndarray:
    """Return the actions of an imported network for `SEEN`."""
    check_model(model, 4, 2)
    return np.asarray(Network(model, 4, 2)(SEEN))


@pytest.mark.parametrize(("opset", "layout"), [(11, 6), (12, 6), (13, 7), (23, 11), (25, 12), (28, 14)])
def test_versions_of_years_are_read(opset: int, layout: int) -> None:
    """From PyTorch 1.3 to what onnx writes by default today; other sets of operators may be named and not used."""
    model = made(PRODUCT, opset=opset, layout=layout, domains=("pkg.torch", "ai.onnx.ml", "com.microsoft"))
    np.testing.assert_allclose(
        computed(read_foreign(model.SerializeToString(), "x").write()), SEEN @ WEIGHTS, rtol=1e-6
    )


def test_axes_that_were_attributes_are_inputs_now() -> None:
    """Axes are attributes in operator set 11, and become inputs: a normalised observation, split and joined again."""
    nodes = [
        ("ReduceSum", "square", "sum", {"axes": [1], "keepdims": 0}),
        ("Sqrt", "sum", "root", {}),
        ("Unsqueeze", "root", "norm", {"axes": [1]}),
        ("Div", "obs norm", "unit", {}),
        ("Split", "unit", "a b", {"axis": 1, "split": [1, 3]}),
        ("Concat", "b a", "turned", {"axis": 1}),
        ("MatMul", "turned w", "actions", {}),
    ]
    model = made(("Mul", "obs obs", "square", {}), *nodes, opset=11, layout=6)
    unit = SEEN / np.linalg.norm(SEEN)
    expected = np.roll(unit, -1, axis=1) @ WEIGHTS
    np.testing.assert_allclose(computed(read_foreign(model.SerializeToString(), "x").write()), expected, rtol=1e-6)


@pytest.mark.parametrize(("place", "read"), [(0, True), (1, False)])
def test_inside_is_inside(place: int, read: bool) -> None:
    """`data_location` may say DEFAULT, as after `onnx.save(onnx.load(...))`; EXTERNAL without a file is refused."""
    model = made(PRODUCT)
    for tensor in model.graph.initializer:
        tensor.data_location = place
    if read:
        np.testing.assert_allclose(
            computed(read_foreign(model.SerializeToString(), "x").write()), SEEN @ WEIGHTS, rtol=1e-6
        )
    else:
        with pytest.raises(BundleError, match="keeps tensors in the file"):
            read_foreign(model.SerializeToString(), "x")


def apart(folder: Path, location: str = "x.onnx.data", **entries: str) -> Path:
    """Write a network whose numbers lie in a file beside it, as torch does."""
    onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make a network")
    model = made(PRODUCT)
    (tensor,) = model.graph.initializer
    content = tensor.raw_data
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    for key, value in ({"location": location, "offset": "8", "length": str(len(content))} | entries).items():
        entry = tensor.external_data.add()
        entry.key, entry.value = key, value
    (folder / "x.onnx").write_bytes(model.SerializeToString())
    (folder / "x.onnx.data").write_bytes(bytes(8) + content)
    return folder / "x.onnx"


def test_numbers_in_a_file_beside_are_read(tmp_path: Path) -> None:
    """At their offset."""
    foreign = read_network(apart(tmp_path))[1]
    np.testing.assert_allclose(computed(foreign.write()), SEEN @ WEIGHTS, rtol=1e-6)
    assert foreign.files == ("x.onnx.data",)


@pytest.mark.parametrize(
    ("location", "entries", "message"),
    [
        ("y.data", {}, "'y.data', which is no file beside it.*python -c .*onnx.save"),
        ("../x.onnx.data", {}, "plain name"),
        ("/etc/hostname", {}, "plain name"),
        ("", {}, "plain name"),
        ("link", {}, "no file beside it"),
        ("x.onnx.data", {"length": "4"}, "as many as its shape says"),
        ("x.onnx.data", {"offset": "999999"}, "as many as its shape says"),
        ("x.onnx.data", {"offset": "-4"}, "has the offset '-4'"),
    ],
)
def test_no_other_file_is_read(tmp_path: Path, location: str, entries: dict[str, str], message: str) -> None:
    """A network may name any path: only a plain file of its own folder is opened, and must fit the tensor."""
    path = apart(tmp_path, location, **entries)
    (tmp_path / "link").symlink_to("x.onnx.data")
    with pytest.raises(BundleError, match=message):
        read_network(path)


def test_all_faults_are_told_at_once() -> None:
    """Two operators that are not known, one of another set, and a version that is too old."""
    model = made(("LSTM", "obs", "h", {}), ("Loop", "h", "k", {}), ("Fast", "k", "actions", {"domain": "own"}), opset=9)
    message = r"version 9; expected.*operators 'LSTM', 'Loop', 'Fast' of 'own'; expected one of"
    with pytest.raises(BundleError, match=message):
        read_foreign(model.SerializeToString(), "x.onnx")
