"""Mutated policy bundles, every digest in them made anew, checked in a process with little memory; what became of each.

`python tests/helpers/bundle_damage.py` mutates every field of two contracts, of a shipped policy and of a Go2, and
prints how many were refused and which were accepted; a third of them, with STICTION_FULL=1 all.

`python bundle_damage.py FOLDER GROUP [COUNT SEED]` writes a JSON object on standard output: how many bundles were
refused, which were accepted, what must not happen, the slowest [s], and how much the memory grew [B]. GROUP is one of
`GROUPS` or `all`, whose bundles contradict themselves or are no robot's, or `random`, COUNT bundles damaged by chance,
of which some may be as good as before.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

import damage
from bounded import bounded, limit_address_space, peak_memory
from bundles import linear_network, make_contract, make_golden, make_wear
from stiction.deploy.check import check_bundle
from stiction.files.bundle import CARD, CONTRACT, GOLDEN, POLICY, SUMS, WEAR, listed
from stiction.files.golden import BOUND, Golden
from stiction.files.observation import proprioception

LONGEST = 10.0
"""No bundle may take longer [s]."""

MEMORY = 512 * 2**20
"""Address space that checking a bundle may take beyond what the interpreter has [B]."""

JOINTS, SIZE = 12, 94
"""Joints of the robot, and entries of its observation: two frames."""

HUGE = 10**400

Files = dict[str, bytes]
"""Name -> content, without SHA256SUMS and golden.npz, which are made of the rest."""

Arrays = dict[str, np.ndarray]
Change = Callable[[Files, Arrays], None]
"""Changes files and golden arrays in place."""


def good() -> tuple[Files, Arrays]:
    """Return a bundle of a shipped robot that passes every check."""
    contract = make_contract("go1", observation=proprioception(JOINTS, 2))
    model = network()
    files = {POLICY: model, CONTRACT: contract.to_json().encode(), CARD: b"# Toy\n"}
    files[WEAR] = make_wear(contract).to_json().encode()
    golden = make_golden(contract, model)
    arrays = {field.name: getattr(golden, field.name) for field in fields(Golden)}
    return files, {name: values for name, values in arrays.items() if values is not None}


def network(seed: int = 0) -> bytes:
    """Return a network of one matrix product."""
    weights = 0.02 * np.random.default_rng(seed).standard_normal((SIZE, JOINTS))
    return linear_network(onnx, weights.astype(np.float32))


def write(folder: Path, files: Files, arrays: Arrays) -> None:
    """Write a bundle, whose every digest fits."""
    folder.mkdir(parents=True, exist_ok=True)
    for left in folder.iterdir():
        left.unlink()
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays, **{BOUND + name: np.array(digest) for name, digest in digests.items()})
    whole = files | {GOLDEN: buffer.getvalue()}
    digests[GOLDEN] = hashlib.sha256(whole[GOLDEN]).hexdigest()
    whole[SUMS] = "".join(f"{digests[name]}  {name}\n" for name in listed(digests)).encode()
    for name, content in whole.items():
        (folder / name).write_bytes(content)


# Contract


def field(name: str, value: Any) -> Change:
    """Set one field of the contract, `a.b` within another."""

    def change(files: Files, arrays: Arrays) -> None:
        data = json.loads(files[CONTRACT])
        *outer, last = name.split(".")
        inner = data
        for part in outer:
            inner = inner[int(part)] if isinstance(inner, list) else inner[part]
        if isinstance(inner, list):
            inner[int(last)] = value
        else:
            inner[last] = value
        files[CONTRACT] = json.dumps(data).encode()

    return change


def text(old: str, new: str) -> Change:
    """Replace a piece of the contract's text."""

    def change(files: Files, arrays: Arrays) -> None:
        content = files[CONTRACT].decode()
        assert old in content
        files[CONTRACT] = content.replace(old, new, 1).encode("utf-8", "surrogatepass")

    return change


def contract_bytes(content: bytes) -> Change:
    """Put something else in the contract's place."""
    return lambda files, arrays: files.update({CONTRACT: content})


def all_joints(value: float) -> list[float]:
    """Return one number for each joint."""
    return [value] * JOINTS


def one_joint(name: str, factor: float) -> list[float]:
    """Return a field of the good contract with its first joint's number multiplied."""
    first, *others = getattr(make_contract("go1"), name)
    return [first * factor, *others]


def contract_cases() -> Iterator[tuple[str, Change]]:
    """Yield contracts that contradict themselves, the recording, or every robot; `contract_mutants` has every field."""
    both = make_contract("go1")
    values: dict[str, list[Any]] = {
        "seed": [2**70, HUGE],
        "decimation": [10**6, 8],
        "physics_timestep": [4e-9, 0.01],
        "control_period": [4e-9, 0.04],
        "kp": [all_joints(1e8), 50.0, one_joint("kp", 1.01)],
        "kd": [all_joints(1e8), one_joint("kd", 2.0)],
        "torque_limit": [all_joints(1e9), one_joint("torque_limit", 0.5), one_joint("torque_limit", 2)],
        "armature": [all_joints(1e9)],
        "friction": [one_joint("friction", 1.5)],
        "lower": [list(both.upper), [angle - 1e-3 for angle in both.standing]],
        "upper": [list(both.lower), [angle + 1e-3 for angle in both.standing]],
        "standing": [list(both.upper), [angle + 0.1 for angle in both.standing], all_joints(HUGE)],
        "action_scale": [100.0, 0.26],
        "action_clip": [1e9, 0.001],
        "compensation": [all_joints(10.0), all_joints(0.05)],
        "command_correction": [
            {"time": 1.0, "share": 0.6},
            {"time": 0.0, "share": 0.6, "least": 0.05},
            {"time": 1.0, "share": 1.5, "least": 0.05},
            {"time": 1.0, "share": 0.6, "least": -0.1},
            0.6,
        ],
        "target_limits": [{"slew": 40.0}, {"slew": 40.0, "margin": 9}],
        "friction_range": [[0.2, 0.1], [0, 1e9]],
        "joint_names": [["a"] * JOINTS, list(both.joint_names)[::-1], ["x" * 300, *both.joint_names[1:]]],
        "command_range": [{"forward": [1, 0], "sideways": [0, 1], "turn": [0, 1]}],
        "settings": [{"x" * 200: 1}, {"a\x1b[31m": 1}, {"a": HUGE}, {"a": "x" * 5000}, {"a": [0] * 1000}],
        "anatomy": [{}, asdict(make_robot("go2")), asdict(make_robot("saturn_lite"))],
        "observation.history_length": [3, 10**9],
    }
    for name, wrong_values in values.items():
        for number, value in enumerate(wrong_values):
            yield f"contract {name} {number}", field(name, value)
    frames = ("base", "joint", "world", "")
    for number, term in enumerate(both.observation.terms):
        wrong = next(frame for frame in frames if frame != term.frame)
        yield f"contract frame of {term.name}", field(f"observation.terms.{number}.frame", wrong)
        yield f"contract scale of {term.name}", field(f"observation.terms.{number}.scale", 1e12)
    yield "contract doubled gains", text('"decimation": 4', '"kp": [1], "decimation": 4')
    yield "contract 1e999", text('"action_clip": 4.0', '"action_clip": 1e999')
    yield "contract lone surrogate", text('"go1"', '"go\\ud800"')
    yield "contract escape", text('"go1"', '"\\u001b[31mgo1"')
    yield "contract deep", contract_bytes(b'{"robot":' + b"[" * 200_000 + b"]" * 200_000 + b"}")
    nested = "[" * 900 + "]" * 900
    yield "contract settings 900 deep", text('"settings": null', f'"settings": {{"a": {nested}}}')
    yield "contract endless number", contract_bytes(b'{"seed": ' + b"9" * 100_000 + b"}")
    for number, content in enumerate((b"", b"{", b"[]", b"\xff\xfe{}", b"\xef\xbb\xbf{}", b"{}" * 1000)):
        yield f"contract text {number}", contract_bytes(content)


def make_robot(name: str) -> Any:
    """Return a shipped robot."""
    from stiction.robots.catalog import find_robot

    return find_robot(name)


# Golden vectors


def array(name: str, value: Callable[[np.ndarray], Any]) -> Change:
    """Change one golden array."""

    def change(files: Files, arrays: Arrays) -> None:
        arrays[name] = np.asarray(value(arrays[name].copy()))

    return change


def put(place: Any, number: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that puts a number into an array."""

    def value(data: np.ndarray) -> np.ndarray:
        data[place] = number
        return data

    return value


def every(change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Change every golden array but the names of the joints."""

    def all_of(files: Files, arrays: Arrays) -> None:
        arrays.update({name: change(data) for name, data in arrays.items() if name != "joint_names"})

    return all_of


def golden_cases() -> Iterator[tuple[str, Change]]:
    """Yield recordings that are none of this robot under this policy."""
    values: dict[str, list[Callable[[np.ndarray], Any]]] = {
        "time": [lambda x: x + 1, lambda x: 2 * x, lambda x: x[::-1], put(250, 4.99), put(3, np.nan), lambda x: 0 * x],
        "reset": [lambda x: ~x, put(slice(1, None), False), put(0, False), lambda x: x.astype(float)],
        "joint_names": [lambda x: x[::-1], lambda x: x[1:], lambda x: x.astype("S"), lambda x: x.reshape(3, 4)],
        "command": [lambda x: x + 1e6, put((5, 0), np.inf), lambda x: x[:, :2], put((5, 0), 0.9)],
        "quaternion": [lambda x: 2 * x, lambda x: 0 * x, lambda x: x[:, ::-1], put((9, 0), 0.5)],
        "angular_velocity": [lambda x: 1e9 * x, put((5, 0), 3.0)],
        "joint_position": [lambda x: x + 10, lambda x: 0 * x, put(np.s_[:, 3], 0.1), put((7, 1), 0.0), lambda x: x.T],
        "joint_velocity": [lambda x: 1e9 * x, put(np.s_[:, 2], 0.0), put((7, 1), 9.0)],
        "observation": [lambda x: 0 * x, put((250, 7), 0.5), lambda x: x.astype(np.int64), lambda x: x[:, :-1]],
        "action": [lambda x: x + 1e-3, lambda x: 100 * x, put((99, 3), np.nan), lambda x: x.astype(complex)],
        "target": [lambda x: x + 0.01, lambda x: x + 100, lambda x: np.where(x == x, x[0], x)],
        "torque": [lambda x: 2 * x, lambda x: -x, lambda x: x[:, :5], lambda x: 0 * x, put((4, 4), 1e9)],
    }
    for name, changes in values.items():
        for number, change in enumerate(changes):
            yield f"golden {name} {number}", array(name, change)
    yield "golden one row", every(lambda data: np.repeat(data[:1], len(data), axis=0))
    yield "golden rows again", every(lambda data: np.concatenate([data[:250]] * 2))
    yield "golden too short", every(lambda data: data[:400])
    yield "golden too long", every(lambda data: np.concatenate([data] * 50))
    yield "golden lacks an array", lambda files, arrays: arrays.pop("target") is None
    yield "golden array too many", lambda files, arrays: arrays.update(more=np.zeros(3))
    yield "golden text for numbers", array("target", lambda data: data.astype(str))
    yield "golden records", array("time", lambda data: np.zeros(500, dtype=[("a", "f8")]))


# Network


def nodes(*made: onnx.NodeProto, constants: dict[str, np.ndarray] | None = None) -> Change:
    """Put nodes behind the matrix product, whose result `x` they turn into `action`."""

    def change(files: Files, arrays: Arrays) -> None:
        model = onnx.load_from_string(files[POLICY])
        model.graph.node[0].output[0] = "x"
        model.graph.node.extend(made)
        model.graph.initializer.extend(numpy_helper.from_array(a, name) for name, a in (constants or {}).items())
        files[POLICY] = model.SerializeToString()

    return change


def node(operator: str, inputs: str = "x", outputs: str = "action", **attributes: Any) -> onnx.NodeProto:
    """Return a node."""
    return helper.make_node(operator, inputs.split(), outputs.split(), **attributes)


def edit(change: Callable[[onnx.ModelProto], Any]) -> Change:
    """Change the model as a message."""

    def apply(files: Files, arrays: Arrays) -> None:
        model = onnx.load_from_string(files[POLICY])
        change(model)
        files[POLICY] = model.SerializeToString()

    return apply


def raw(change: Callable[[bytes], bytes]) -> Change:
    """Change the model's bytes."""
    return lambda files, arrays: files.update({POLICY: change(files[POLICY])})


def loop(count: int) -> Change:
    """A loop around the result."""
    body = helper.make_graph(
        [node("Identity", "c", "d"), node("Identity", "y", "z")],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, []),
            helper.make_tensor_value_info("c", TensorProto.BOOL, []),
            helper.make_tensor_value_info("y", TensorProto.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("d", TensorProto.BOOL, []),
            helper.make_tensor_value_info("z", TensorProto.FLOAT, None),
        ],
    )
    constants = {"count": np.array(count), "yes": np.array(True)}
    return nodes(node("Loop", "count yes x", body=body), constants=constants)


def branch() -> Change:
    """A branch on a constant."""
    one = helper.make_graph([node("Identity", "x", "y")], "one", [], [helper.make_tensor_value_info("y", 1, None)])
    return nodes(node("If", "yes", then_branch=one, else_branch=one), constants={"yes": np.array(True)})


def outer(size: int) -> Change:
    """A product of a column and a row, as large as their sizes multiplied, added up again."""
    column, row = np.ones((size, 1), np.float32), np.ones((1, size), np.float32)
    made = (node("MatMul", "column row", "square"), node("MatMul", "square column", "sum"),
            node("MatMul", "row sum", "one"), node("Mul", "x one"))  # fmt: skip
    return nodes(*made, constants={"column": column, "row": row})


def row_of(count: int) -> Change:
    """A long row of nodes."""
    names = ["x", *(f"x{number}" for number in range(count)), "action"]
    return nodes(*(node("Tanh", *pair) for pair in pairwise(names)))


def network_cases() -> Iterator[tuple[str, Change]]:
    """Yield networks that loop, grow, hide something, or are none."""
    size = {"size": np.array([2**15, 2**15, JOINTS])}
    row = {"size": np.array([40000, 40000])}
    for count in (2, 10**5, 2**63 - 1):
        yield f"network loop {count}", loop(count)
    yield "network branch", branch()
    yield "network expand", nodes(node("Expand", "x size", "y"), node("ReduceMax", "y"), constants=size)
    yield "network tile", nodes(node("Tile", "x size", "y"), node("ReduceMax", "y"), constants=row)
    yield "network zeros", nodes(node("ConstantOfShape", "size", "y"), node("Identity", "x"), constants=row)
    yield "network range", nodes(
        node("Range", "a b c", "y"), node("Identity", "x"),
        constants={"a": np.array(0), "b": np.array(2**40), "c": np.array(1)},
    )  # fmt: skip
    for many in (2**11, 2**13, 2**15):
        yield f"network outer product {many}", outer(many)
    wide = {"wide": np.ones((1, 1, 2**21), np.float32)}
    yield "network wide sum", nodes(node("Unsqueeze", "x axes", "y"), node("Add", "y wide", "z"), node("Identity", "x"),
                                    constants=wide | {"axes": np.array([2])})  # fmt: skip
    yield "network squared batch", nodes(node("Transpose", "x", "y"), node("MatMul", "x y", "z"), node("MatMul", "z x"))
    for operator in ("NonZero", "RandomNormalLike", "Multinomial", "Unique", "Bernoulli", "Dropout", "Resize", "Scan"):
        yield f"network {operator}", nodes(node(operator))
    yield "network other domain", nodes(node("Tanh", domain="com.microsoft"))
    yield "network long chain", row_of(3000)
    yield (
        "network constant node",
        nodes(node("Constant", "", "y", value=numpy_helper.from_array(np.zeros(1, np.float32))), node("Add", "x y")),
    )
    yield "network missing input", nodes(node("Add", "x nothing"))
    yield "network circle", nodes(node("Add", "x z", "y"), node("Tanh", "y", "z"), node("Tanh", "z"))
    yield "network computed twice", nodes(node("Tanh", "x", "y"), node("Elu", "x", "y"), node("Tanh", "y"))
    yield "network no output", nodes(node("Tanh", "x", "y"))
    yield "network other output", nodes(node("Concat", "x x", axis=1))
    yield "network integer", nodes(node("Shape"))
    yield "network wrong sizes", nodes(node("Add", "x b"), constants={"b": np.ones(5, np.float32)})
    yield "network not finite", nodes(node("Mul", "x b"), constants={"b": np.array(np.inf, np.float32)})
    yield "network not a number", nodes(node("Add", "x b"), constants={"b": np.array(np.nan, np.float32)})
    for kind in (np.float64, np.float16, np.int32, np.bool_, np.uint8):
        yield f"network {kind.__name__}", nodes(node("Identity", "x"), constants={"b": np.ones(3, kind)})
    yield "network text", edit(lambda m: m.graph.initializer.append(helper.make_tensor("t", 8, [1], [b"a"])))
    yield "network many axes", edit(lambda m: m.graph.initializer[0].dims.extend([1] * 10))
    yield "network too short", edit(lambda m: setattr(m.graph.initializer[0], "raw_data", b"1234"))
    yield "network negative", edit(lambda m: m.graph.initializer[0].dims.__setitem__(0, -SIZE))
    yield "network overflow", edit(lambda m: m.graph.initializer[0].dims.extend([2**62]))
    yield "network external", edit(external)
    yield "network metadata", edit(lambda m: m.metadata_props.add(key="ort_config", value="{}"))
    yield "network note", edit(lambda m: setattr(m, "doc_string", "x"))
    yield "network function", edit(lambda m: m.functions.add(name="f", domain="d"))
    yield "network training", edit(lambda m: m.training_info.add())
    yield "network sparse", edit(lambda m: m.graph.sparse_initializer.add())
    yield "network quantised", edit(lambda m: m.graph.quantization_annotation.add(tensor_name="weights"))
    yield "network two constants", edit(lambda m: m.graph.initializer.append(m.graph.initializer[0]))
    yield (
        "network two inputs",
        edit(lambda m: m.graph.input.append(helper.make_tensor_value_info("i", 1, ["batch", 3]))),
    )
    yield "network two outputs", edit(lambda m: m.graph.output.append(m.graph.output[0]))
    yield "network constant input", edit(lambda m: setattr(m.graph.initializer[0], "name", "observation"))
    yield "network other name", edit(lambda m: setattr(m.graph.input[0], "name", "obs"))
    yield "network other size", edit(lambda m: setattr(m.graph.input[0].type.tensor_type.shape.dim[1], "dim_value", 3))
    yield "network fixed batch", edit(lambda m: setattr(m.graph.input[0].type.tensor_type.shape.dim[0], "dim_value", 1))
    yield "network wrong type", edit(lambda m: setattr(m.graph.input[0].type.tensor_type, "elem_type", 11))
    for version in (1, 12, 99, 2**40):
        yield f"network operators {version}", edit(lambda m, v=version: setattr(m.opset_import[0], "version", v))
    yield "network no operators", edit(lambda m: m.ClearField("opset_import"))
    yield "network more operators", edit(lambda m: m.opset_import.append(helper.make_opsetid("ai.onnx.ml", 3)))
    yield "network layout 99", edit(lambda m: setattr(m, "ir_version", 99))
    yield "network of another seed", raw(lambda data: network(1))
    yield "network of no weight", nodes(node("Mul", "x b"), constants={"b": np.array(0.0, np.float32)})
    yield "network ORTM", raw(lambda data: data[:4] + b"ORTM" + data[4:])
    yield "network ORTM alone", raw(lambda data: b"\x18\0\0\0ORTM" + bytes(64))
    yield "network ORTM in a note", raw(lambda data: b"\x12\x08..ORTM.." + data)
    odd = b"\x02\x01a", b"\x00\x01", b"\x9a\x06\x01a", b"\x0b", b"\x0f", b"\x08" + b"\xff" * 11
    for number, piece in enumerate(odd):
        yield f"network odd field {number}", raw(lambda data, piece=piece: piece + data)
        yield f"network odd field {number} behind", raw(lambda data, piece=piece: data + piece)
    yield "network twice", raw(lambda data: data + data)
    yield "network large", raw(lambda data: data + b"\x12\xff\xff\xff\x13" + bytes(40 * 2**20))
    for number, content in enumerate((b"", b"\x08", b"PK\x03\x04", b"\x80\x04\x95", b"\xff" * 1000, bytes(1000))):
        yield f"network bytes {number}", raw(lambda data, content=content: content)
    for share in (0.1, 0.5, 0.99):
        yield f"network cut at {share}", raw(lambda data, share=share: data[: int(share * len(data))])


def external(model: onnx.ModelProto) -> None:
    """Let the weights lie in another file."""
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/hostname")


# Wear


def wear(name: str, value: Any) -> Change:
    """Set one field of wear.json."""
    return lambda files, arrays: files.update({WEAR: json.dumps(json.loads(files[WEAR]) | {name: value}).encode()})


def wear_cases() -> Iterator[tuple[str, Change]]:
    """Yield maps of another robot, or of none."""
    values: dict[str, list[Any]] = {
        "joint_names": [["a"] * JOINTS, ["FL_hip"]],
        "window": [0, 10**9, "3", HUGE],
        "center": [[0.0] * 3, [1e300] * 145],
        "scale": [[0.0] * 145, [-1.0] * 145],
        "limit": [0, 1e300],
        "weights": [[], [[0.0]] * 145],
        "coverage": [[1.5] * 13],
        "highest": [0, HUGE],
        "more": [1],
    }
    for name, wrong_values in values.items():
        for number, value in enumerate(wrong_values):
            yield f"wear {name} {number}", wear(name, value)
    yield "wear doubled key", lambda files, arrays: files.update({WEAR: files[WEAR][:-2] + b', "window": 3}'})
    yield "wear no text", lambda files, arrays: files.update({WEAR: b"\xff"})
    yield "card no text", lambda files, arrays: files.update({CARD: b"\xff\xfe"})
    yield "card too long", lambda files, arrays: files.update({CARD: b"x" * 2**21})


GROUPS: dict[str, Callable[[], Iterator[tuple[str, Change]]]] = {
    "contract": contract_cases,
    "golden": golden_cases,
    "network": network_cases,
    "wear": wear_cases,
}
"""Group -> its bundles."""


def damaged_at_random(count: int, seed: int) -> Iterator[tuple[str, Change]]:
    """Yield bundles of which one file has injuries of any kind, see `damage`."""
    for number in range(count):
        rng = random.Random(f"bundle {seed} {number}")
        name = rng.choice((POLICY, POLICY, CONTRACT, CONTRACT, WEAR, CARD))
        yield (
            f"random {number} {name}",
            lambda files, arrays, name=name, rng=rng: files.update({name: damage.damaged(files[name], rng)}),
        )


def attack(folder: Path, cases: Iterator[tuple[str, Change]]) -> dict[str, Any]:
    """Check every bundle; return the statistics."""
    files, arrays = good()
    target = folder / "bundle"
    write(target, files, arrays)
    check_bundle(target)
    start = peak_memory()
    refused, accepted, wrong, slowest = 0, [], [], 0.0
    for name, change in cases:
        own, recorded = dict(files), dict(arrays)
        change(own, recorded)
        write(target, own, recorded)
        before = time.perf_counter()
        result, fault = bounded(lambda: check_bundle(target), LONGEST)
        slowest = max(slowest, time.perf_counter() - before)
        refused += result is None
        accepted += [] if result is None else [name]
        wrong += [f"{name}: {fault}"] if fault else []
    growth = peak_memory() - start
    return {"refused": refused, "accepted": accepted, "wrong": wrong, "slowest": slowest, "growth": growth}


def main() -> None:
    """Run as a program, with an alarm and a bound on memory."""
    if len(sys.argv) == 1:
        from contract_mutants import report

        sys.exit(report())
    folder, group, *more = sys.argv[1:]
    groups = GROUPS.values() if group == "all" else [GROUPS[group]] if group in GROUPS else []
    cases = chain.from_iterable(each() for each in groups) if groups else damaged_at_random(*map(int, more))
    limit_address_space(MEMORY)
    np.seterr(all="ignore")
    print(json.dumps(attack(Path(folder), cases)))


if __name__ == "__main__":
    main()
