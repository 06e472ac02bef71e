"""An Actuator Net as a file: what torque a joint's motor gives, from its last positions and velocities. NPZ, no pickle.

The archive holds `header`, a text (a JSON object with `schema`, `schema_version` and the fields of `ActuatorNet` apart
from the weights), and for group g and layer l the arrays `weight.g.l`, shape (outputs, inputs), and `bias.g.l`, shape
(outputs,), float32. A directory of `stiction train-actuator` has it as `actuator.npz`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.sidecar import TORQUE_SOURCES
from stiction.formats.tables import read_npz_arrays

SCHEMA, SCHEMA_VERSION = "stiction-actuator", 1

FILE = "actuator.npz"
"""Name of the net in the directory of `stiction train-actuator`."""

INPUT_SETS = {
    "default": "position errors (target - position) and velocities, now and over the last H samples",
    "paper": "positions, now and over the last H samples, and velocities of the last H samples without the current one",
}
"""Set of inputs -> what the net sees. The paper's has no target: that net cannot know what was asked for."""

PERIOD_TOLERANCE = 1e-6
"""Largest relative difference of two periods that are the same."""

Layers = tuple[tuple[np.ndarray, np.ndarray], ...]
"""Weights, shape (outputs, inputs), and bias, shape (outputs,), of each layer in turn, float32."""


class ActuatorError(StictionError):
    """An Actuator Net that cannot be read or used; the message says what came and what was expected."""


@dataclass(frozen=True)
class ActuatorNet:
    """A multilayer perceptron with softsign units for each group of joints. All joints of a group share its weights."""

    robot: str
    """Name of the robot whose joints it was trained on."""
    joint_names: tuple[str, ...]
    """Names of the joints, in the order of every vector over joints."""
    torque_limit: tuple[float, ...]
    """Largest torque of each motor [N m]: the net's output is in these units."""
    groups: tuple[tuple[str, ...], ...]
    """Names of the joints that share weights, group by group; every joint is in one."""
    inputs: str
    """Set of inputs, one of `INPUT_SETS`."""
    history: int
    """H, samples of the past beside the current one."""
    period: float
    """Time between two samples [s]: the simulator's physics step must be the same."""
    torque_source: str
    """`motor_side` (the joint's friction is not in the torque, the simulation keeps its own) or `output_side` (dry and
    viscous friction are in it, the simulation drops its own)."""
    layers: tuple[Layers, ...]
    """Weights of each group. Inputs in SI units, row by row: the first signal (error or position) now, one sample ago,
    ..., H samples ago, then the velocity likewise; an input that the set lacks has zero weights."""
    training: Mapping[str, str]
    """File -> SHA-256 of each log that it was fitted to."""
    validation: Mapping[str, str]
    """File -> SHA-256 of each log that was kept out."""
    loss: Mapping[str, float]
    """`training`, `validation`: mean squared error of torque over limit at the end [-]."""
    seed: int
    """Seed of weights, order of samples and split."""
    revision: str
    """Revision of the code that trained it."""
    command: str
    """Command that made it."""

    def __post_init__(self) -> None:
        """Refuse what no simulation could use."""
        _check(self)

    def check_use(self, robot: str, joint_names: Sequence[str], torque_limit: np.ndarray, period: float) -> None:
        """Raise `ActuatorError` unless the net is for these joints and this physics step [s]."""
        if tuple(joint_names) != self.joint_names:
            raise ActuatorError(
                f"the Actuator Net is for the joints of {self.robot!r}, {', '.join(self.joint_names[:3])}, ...; the "
                f"robot {robot!r} has {', '.join(joint_names[:3])}, ...; train one on its logs"
            )
        if not np.allclose(torque_limit, self.torque_limit, rtol=1e-6):
            raise ActuatorError(
                f"the Actuator Net was trained with torque limits of {min(self.torque_limit):g} to "
                f"{max(self.torque_limit):g} N m, the robot {robot!r} has {min(torque_limit):g} to "
                f"{max(torque_limit):g} N m; name the robot that was logged"
            )
        if not math.isclose(period, self.period, rel_tol=PERIOD_TOLERANCE):
            raise ActuatorError(
                f"the Actuator Net has a period of {self.period:g} s, the simulation steps by {period:g} s; use "
                f"--task.timestep {self.period:g}, or train a net on logs sampled every {period:g} s"
            )


def _expect(condition: bool, field: str, value: object, expected: str) -> None:
    """Raise `ActuatorError` naming the field unless the condition holds."""
    if not condition:
        raise ActuatorError(f"Actuator Net, field {field!r}: {str(value)[:80]}; expected {expected}")


def _check(net: ActuatorNet) -> None:
    """Check every field."""
    names = net.joint_names
    _expect(bool(names) and len(set(names)) == len(names) and all(map(_text, names)), "joint_names", names, "names")
    for field in ("robot", "revision", "command"):
        _expect(_text(getattr(net, field)), field, getattr(net, field), "a text")
    limits = net.torque_limit
    fits = len(limits) == len(names) and all(_number(limit) and limit > 0 for limit in limits)
    _expect(fits, "torque_limit", limits, f"{len(names)} positive numbers")
    together = [name for group in net.groups for name in group]
    once = sorted(together) == sorted(names) and all(net.groups)
    _expect(once, "groups", net.groups, "every joint in one group")
    _expect(net.inputs in INPUT_SETS, "inputs", net.inputs, " or ".join(INPUT_SETS))
    whole = isinstance(net.history, int) and not isinstance(net.history, bool)
    _expect(whole and 0 <= net.history <= 100, "history", net.history, "0 to 100 samples")
    _expect(_number(net.period) and 1e-5 <= net.period <= 0.1, "period", net.period, "1e-5 to 0.1 s")
    _expect(net.torque_source in TORQUE_SOURCES, "torque_source", net.torque_source, " or ".join(TORQUE_SOURCES))
    for field in ("training", "validation"):
        value = getattr(net, field)
        named = isinstance(value, Mapping) and all(_text(k) and _text(v) for k, v in value.items())
        _expect(named, field, value, "an object, file -> SHA-256")
    right = isinstance(net.loss, Mapping) and all(_number(value) and value >= 0 for value in net.loss.values())
    _expect(right, "loss", net.loss, "an object of numbers of at least 0")
    seeded = isinstance(net.seed, int) and not isinstance(net.seed, bool) and net.seed >= 0
    _expect(seeded, "seed", net.seed, "an integer of at least 0")
    _check_layers(net)


def _check_layers(net: ActuatorNet) -> None:
    """Check that each group's layers fit each other, the inputs, and one output."""
    _expect(len(net.layers) == len(net.groups), "layers", f"{len(net.layers)} groups", f"{len(net.groups)}")
    for index, layers in enumerate(net.layers):
        width, where = 2 * (net.history + 1), f"layers of group {index}"
        _expect(len(layers) >= 1, where, "none", "at least one")
        for weight, bias in layers:
            typed = weight.dtype == np.float32 and bias.dtype == np.float32
            fits = weight.ndim == 2 and weight.shape[1] == width and bias.shape == weight.shape[:1]
            _expect(typed and fits, where, f"{weight.dtype} {weight.shape}", f"float32 (outputs, {width})")
            _expect(bool(np.isfinite(weight).all() and np.isfinite(bias).all()), where, "not finite", "finite numbers")
            width = len(bias)
        _expect(width == 1, where, f"{width} outputs", "one, the torque over its limit")


def _text(value: object) -> bool:
    """Return whether a value is a text that is not empty."""
    return isinstance(value, str) and bool(value.strip())


def _number(value: object) -> bool:
    """Return whether a value is a finite number and not a bool."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def write_actuator(path: Path, net: ActuatorNet) -> None:
    """Write a net, whole or not at all. Raises `ActuatorError` where the file cannot be written."""
    header = {key: value for key, value in asdict(net).items() if key != "layers"}
    header = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION} | header
    arrays = {"header": np.array(json.dumps(header, allow_nan=False))}
    for group, layers in enumerate(net.layers):
        for number, (weight, bias) in enumerate(layers):
            arrays |= {f"weight.{group}.{number}": weight, f"bias.{group}.{number}": bias}
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        part.replace(path)
    except OSError as error:
        raise ActuatorError(f"cannot write {path}: {error.strerror or error}; choose another folder") from error


def actuator_file(path: Path) -> Path:
    """Return the net's file, given as itself or by its folder. Raises `ActuatorError` where there is none."""
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise ActuatorError(f"no Actuator Net at {file}; expected a folder of `stiction train-actuator`, or its {FILE}")
    return file


def read_actuator(path: Path) -> ActuatorNet:
    """Read a net, from its file or from the directory that `stiction train-actuator` made; nothing is executed.

    Raises:
        StictionError: not such a file, another version, a field missing, unknown or of the wrong type or shape.

    """
    file = actuator_file(path)
    arrays = read_npz_arrays(file)
    header = _header(file, arrays.pop("header", np.array(0)))
    layers = []
    for group in range(len(header["groups"])):
        found: list[tuple[np.ndarray, np.ndarray]] = []
        while (name := f"{group}.{len(found)}") and f"weight.{name}" in arrays:
            if f"bias.{name}" not in arrays:
                raise ActuatorError(f"{file}: no array 'bias.{name}'; it is incomplete, train the net again")
            found.append((arrays.pop(f"weight.{name}"), arrays.pop(f"bias.{name}")))
        layers.append(tuple(found))
    if arrays:
        raise ActuatorError(f"{file}: unknown array {min(arrays)!r}; expected weights and biases of its groups")
    try:
        return ActuatorNet(**header, layers=tuple(layers))
    except ActuatorError as error:
        raise ActuatorError(f"{file}: {error}") from error


def _header(file: Path, text: np.ndarray) -> dict[str, Any]:
    """Parse the header; sequences become tuples."""
    if text.dtype.kind != "U" or text.ndim != 0:
        raise ActuatorError(f"{file}: no header; expected the {FILE} of `stiction train-actuator`")
    try:
        data = json.loads(str(text))
    except (ValueError, RecursionError) as error:
        raise ActuatorError(f"{file}: the header is not JSON ({str(error)[:80]})") from error
    if not isinstance(data, dict) or data.pop("schema", None) != SCHEMA:
        raise ActuatorError(f"{file}: the header does not say {SCHEMA!r}; expected the {FILE} of `train-actuator`")
    version = data.pop("schema_version", None)
    if version != SCHEMA_VERSION:
        raise ActuatorError(f"{file}: schema version {version!r}; this program reads version {SCHEMA_VERSION}")
    known = {item.name for item in fields(ActuatorNet)} - {"layers"}
    if odd := sorted(known ^ data.keys()):
        raise ActuatorError(f"{file}: header field {odd[0]!r} is missing or unknown")
    for name in ("joint_names", "torque_limit", "groups"):
        if not isinstance(data[name], list):
            raise ActuatorError(f"{file}: header field {name!r} is {str(data[name])[:80]}; expected a list")
    if not all(isinstance(group, list) and all(map(_text, group)) for group in data["groups"]):
        raise ActuatorError(f"{file}: header field 'groups' is {str(data['groups'])[:80]}; expected lists of joints")
    lists = {"joint_names": tuple(data["joint_names"]), "torque_limit": tuple(data["torque_limit"])}
    return data | lists | {"groups": tuple(map(tuple, data["groups"]))}
