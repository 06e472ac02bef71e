"""An Actuator Net as a file: what torque a joint's motor gives, from its last positions and velocities. NPZ, no pickle.

The archive holds `header`, a text (a JSON object with `schema`, `schema_version` and the fields of `ActuatorNet` apart
from the weights), and for group g and layer l the arrays `weight.g.l`, shape (outputs, inputs), and `bias.g.l`, shape
(outputs,), float32. A directory of `stiction train-actuator` has it as `actuator.npz`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import publish
from stiction.core.errors import FileError
from stiction.formats.tables import read_npz_arrays
from stiction.joints.net import ActuatorNet, _text

SCHEMA, SCHEMA_VERSION = "stiction-actuator", 1

FILE = "actuator.npz"
"""Name of the net in the directory of `stiction train-actuator`."""


def write_actuator(path: Path, net: ActuatorNet) -> None:
    """Write a net, whole or not at all. Raises `FileError` where the file cannot be written."""
    header = {key: value for key, value in asdict(net).items() if key != "layers"}
    header = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION} | header
    arrays = {"header": np.array(json.dumps(header, allow_nan=False))}
    for group, layers in enumerate(net.layers):
        for number, (weight, bias) in enumerate(layers):
            arrays |= {f"weight.{group}.{number}": weight, f"bias.{group}.{number}": bias}
    try:
        with publish(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror or error}; choose another folder") from error


def actuator_file(path: Path) -> Path:
    """Return the net's file, given as itself or by its folder. Raises `FileError` where there is none."""
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise FileError(f"no Actuator Net at {file}; expected a folder of `stiction train-actuator`, or its {FILE}")
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
                raise FileError(f"{file}: no array 'bias.{name}'; it is incomplete, train the net again")
            found.append((arrays.pop(f"weight.{name}"), arrays.pop(f"bias.{name}")))
        layers.append(tuple(found))
    if arrays:
        raise FileError(f"{file}: unknown array {min(arrays)!r}; expected weights and biases of its groups")
    try:
        return ActuatorNet(**header, layers=tuple(layers))
    except FileError as error:
        raise FileError(f"{file}: {error}") from error


def _header(file: Path, text: np.ndarray) -> dict[str, Any]:
    """Parse the header; sequences become tuples."""
    if text.dtype.kind != "U" or text.ndim != 0:
        raise FileError(f"{file}: no header; expected the {FILE} of `stiction train-actuator`")
    try:
        data = json.loads(str(text))
    except (ValueError, RecursionError) as error:
        raise FileError(f"{file}: the header is not JSON ({str(error)[:80]})") from error
    if not isinstance(data, dict) or data.pop("schema", None) != SCHEMA:
        raise FileError(f"{file}: the header does not say {SCHEMA!r}; expected the {FILE} of `train-actuator`")
    version = data.pop("schema_version", None)
    if version != SCHEMA_VERSION:
        raise FileError(f"{file}: schema version {version!r}; this program reads version {SCHEMA_VERSION}")
    known = {item.name for item in fields(ActuatorNet)} - {"layers"}
    if odd := sorted(known ^ data.keys()):
        raise FileError(f"{file}: header field {odd[0]!r} is missing or unknown")
    for name in ("joint_names", "torque_limit", "groups"):
        if not isinstance(data[name], list):
            raise FileError(f"{file}: header field {name!r} is {str(data[name])[:80]}; expected a list")
    if not all(isinstance(group, list) and all(map(_text, group)) for group in data["groups"]):
        raise FileError(f"{file}: header field 'groups' is {str(data['groups'])[:80]}; expected lists of joints")
    lists = {"joint_names": tuple(data["joint_names"]), "torque_limit": tuple(data["torque_limit"])}
    return data | lists | {"groups": tuple(map(tuple, data["groups"]))}


@dataclass(frozen=True)
class ActuatorFit:
    """A piece of a run that was kept out, and how the errors fell."""

    time: np.ndarray
    """Since the start of the run [s], shape (T,)."""
    measured: np.ndarray
    """Torque in the log [N m], shape (T, J)."""
    net: np.ndarray
    """Torque that the net gives [N m], shape (T, J)."""
    baseline: np.ndarray
    """Torque of the PD law with fitted friction [N m], shape (T, J)."""
    loss_training: np.ndarray
    """Mean squared error of torque over limit by group of joints and epoch [-], shape (G, epochs)."""
    loss_validation: np.ndarray
    """... of the runs that were kept out, shape (G, epochs)."""


def write_actuator_fit(path: Path, fit: ActuatorFit) -> None:
    """Write the arrays in single precision."""
    arrays = {item.name: np.asarray(getattr(fit, item.name), np.float32) for item in fields(ActuatorFit)}
    np.savez_compressed(path, allow_pickle=False, **arrays)


def read_actuator_fit(path: Path) -> ActuatorFit:
    """Read what `write_actuator_fit` wrote; raise `StictionError` if something is missing or of another shape."""
    arrays = read_npz_arrays(path)
    names = {item.name for item in fields(ActuatorFit)}
    if arrays.keys() != names:
        raise FileError(f"{path.name}: expected the arrays {', '.join(sorted(names))}; run train-actuator again")
    fit = ActuatorFit(**arrays)
    signals = {fit.measured.shape, fit.net.shape, fit.baseline.shape}
    right = len(signals) == 1 and fit.measured.ndim == 2 and fit.time.shape == fit.measured.shape[:1]
    if not right or fit.loss_training.shape != fit.loss_validation.shape or fit.loss_training.ndim != 2:
        raise FileError(f"{path.name}: its arrays do not fit each other; run train-actuator again")
    return fit
