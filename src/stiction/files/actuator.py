"""Actuator Net file: a net from a joint's last positions and velocities to its motor's torque. NPZ, no pickle.

The archive holds `header`, a text (a JSON object with `schema`, `schema_version` and the fields of `ActuatorNet` apart
from the weights), and for group g and layer l the arrays `weight.g.l`, shape (outputs, inputs), and `bias.g.l`, shape
(outputs,), float32. In a directory of `stiction train-actuator` it is `actuator.npz`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import FileError
from stiction.files.tables import publish_npz, read_arrays, read_header, read_npz_arrays, write_header
from stiction.joints.net import ActuatorNet

SCHEMA, SCHEMA_VERSION = "stiction-actuator", 1

FILE = "actuator.npz"
"""Name of the net in the directory of `stiction train-actuator`."""


def write_actuator(path: Path, net: ActuatorNet) -> None:
    """Write a net atomically. Raises `FileError` where the file cannot be written."""
    header = {key: value for key, value in asdict(net).items() if key != "layers"}
    arrays = {"header": write_header(SCHEMA, SCHEMA_VERSION, header)}
    for group, layers in enumerate(net.layers):
        for number, (weight, bias) in enumerate(layers):
            arrays |= {f"weight.{group}.{number}": weight, f"bias.{group}.{number}": bias}
    publish_npz(path, arrays)


def actuator_file(path: Path) -> Path:
    """Return the net's file, given as a file or its folder. Raises `FileError` for a missing file."""
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise FileError(f"no Actuator Net at {file}; expected a folder of `stiction train-actuator`, or its {FILE}")
    return file


def read_actuator(path: Path) -> ActuatorNet:
    """Read a net, from its file or from the directory of `stiction train-actuator`; nothing is executed.

    Raises `StictionError`: another kind of file, another version, a field missing, unknown or of the wrong type or
    shape.
    """
    file = actuator_file(path)
    arrays = read_npz_arrays(file)
    header = read_header(arrays, SCHEMA, SCHEMA_VERSION, file.name)
    layers: list[list[list[np.ndarray]]] = []
    for group, _ in enumerate(header["groups"] if isinstance(header.get("groups"), list) else ()):
        layers.append([])
        while f"weight.{(name := f'{group}.{len(layers[-1])}')}" in arrays:
            if f"bias.{name}" not in arrays:
                raise FileError(f"{file}: no array 'bias.{name}'; it is incomplete, train the net again")
            layers[-1].append([arrays.pop(f"weight.{name}"), arrays.pop(f"bias.{name}")])
    try:
        net = from_plain(ActuatorNet, header | {"layers": layers}, "header")
    except (FileError, TypeError) as error:
        raise FileError(f"{file}: {error}") from error
    if arrays:
        raise FileError(f"{file}: unknown array {min(arrays)!r}; expected weights and biases of its groups")
    return net


@dataclass(frozen=True)
class ActuatorFit:
    """Signals of a held-out part of a run, and the errors during the fit."""

    time: np.ndarray
    """Time since the start of the run [s], shape (T,)."""
    measured: np.ndarray
    """Torque in the log [N m], shape (T, J)."""
    net: np.ndarray
    """Torque of the net [N m], shape (T, J)."""
    baseline: np.ndarray
    """Torque of the PD law with fitted friction [N m], shape (T, J)."""
    loss_training: np.ndarray
    """Mean squared error of torque over limit by group of joints and epoch [-], shape (G, epochs)."""
    loss_validation: np.ndarray
    """The same of the held-out runs, shape (G, epochs)."""


def read_actuator_fit(path: Path) -> ActuatorFit:
    """Read the result of `tables.write_arrays`; raise `StictionError` for a missing array or another shape."""
    fit = read_arrays(path, ActuatorFit, "run train-actuator again")
    signals = {fit.measured.shape, fit.net.shape, fit.baseline.shape}
    right = len(signals) == 1 and fit.measured.ndim == 2 and fit.time.shape == fit.measured.shape[:1]
    if not right or fit.loss_training.shape != fit.loss_validation.shape or fit.loss_training.ndim != 2:
        raise FileError(f"{path.name}: its arrays do not fit each other; run train-actuator again")
    return fit
