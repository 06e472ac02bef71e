"""The Actuator Net in NumPy: what it sees of a joint, and the torque it gives. No torch: evaluation runs it too.

For joint j at sample t the net returns τ_t / τ_max from two signals over a window, H = 3 in the paper. `default`: the
position errors e = a - θ and the velocities θ' at t, t-1, ..., t-H. `paper`, as printed: θ_t ... θ_{t-H} and
θ'_{t-1} ... θ'_{t-H}; without the target, that net cannot tell what was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from stiction.formats.actuator import INPUT_SETS, ActuatorNet, Layers
from stiction.formats.errors import StictionError

ROWS = 3072
"""Rows that go through the layers at once: what they hold stays in the processor's cache. Measured for 9216 rows of a
net 8-32-32-1 on one core: 0.51 ms; 1.5 ms all at once; 0.7 ms by torch."""


@dataclass(frozen=True)
class ActuatorCfg:
    """What the net is and how it is fitted."""

    inputs: Literal["default", "paper"] = "default"
    """`default`: position errors and velocities, the current ones included. `paper`: as the paper prints it, positions
    and past velocities, without the target."""
    history: int = 3
    """H, samples of the past beside the current one; the paper's."""
    share: Literal["kind", "all"] = "kind"
    """Who shares weights: joints of a kind (`FL_shank` is a `shank`), or all. Joints of a kind have the same motor,
    gear and controller, and every leg adds data; between kinds torque limits and gains differ, and an error alone does
    not tell which joint it is of."""
    hidden: tuple[int, ...] = (32, 32)
    """Widths of the hidden layers, softsign units: the field's much-copied net. Empty: a linear law."""
    epochs: int = 40
    """Passes over the training samples."""
    batch: int = 512
    """Samples of one gradient step."""
    learning_rate: float = 1e-2
    """First learning rate; it falls to zero along a cosine."""
    validation_share: float = 0.25
    """Share of the runs that is kept out of the fit, at least one. Whole runs: windows overlap, so windows drawn at
    random would be in both parts."""
    seed: int = 0
    """Seed of weights, order of samples and split."""

    def __post_init__(self) -> None:
        """Refuse what cannot be fitted."""
        if self.inputs not in INPUT_SETS or self.share not in ("kind", "all"):
            raise StictionError(
                f"inputs {self.inputs!r}, shared by {self.share!r}: expected {' or '.join(INPUT_SETS)}, and kind or all"
            )
        if not 1 <= self.history <= 100 or not all(1 <= width <= 4096 for width in self.hidden):
            raise StictionError(
                f"history {self.history}, hidden layers {self.hidden}: expected 1 to 100 samples and widths from 1"
            )
        if min(self.epochs, self.batch) < 1 or not self.learning_rate > 0 or self.seed < 0:
            raise StictionError(
                f"{self.epochs} epochs, batches of {self.batch}, learning rate {self.learning_rate}, seed {self.seed}: "
                "expected at least 1, a positive rate, and a seed of at least 0"
            )
        if not 0 < self.validation_share < 1:
            raise StictionError(f"validation share {self.validation_share}: expected a share between 0 and 1")


def kinds(joint_names: tuple[str, ...], share: str) -> tuple[tuple[str, ...], ...]:
    """Return the joints that share weights, in order of first appearance; `share`: see `ActuatorCfg`."""
    found: dict[str, list[str]] = {}
    for name in joint_names:
        found.setdefault(name.rpartition("_")[2] if share == "kind" else "", []).append(name)
    return tuple(map(tuple, found.values()))


def first_signal(inputs: str, target: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return what the net sees beside the velocity: errors a - θ, or θ as printed in the paper [rad], any shape."""
    return position if inputs == "paper" else target - position


def seen(inputs: str, history: int) -> np.ndarray:
    """Return which of the 2 (H + 1) inputs a set has, bool: the paper's lacks the current velocity."""
    mask = np.ones(2 * (history + 1), bool)
    mask[history + 1] = inputs != "paper"
    return mask


def windows(signal: np.ndarray, velocity: np.ndarray, history: int) -> np.ndarray:
    """Return the inputs of every sample that has a whole past, shape (T - H, J, 2 (H + 1)).

    signal: of `first_signal`, velocity: θ' [rad/s], both (T, J). In each row, first the signal now, one sample ago,
    ..., H samples ago, then the velocity likewise.
    """
    length = len(signal) - history
    lags = [x[history - lag : history - lag + length] for x in (signal, velocity) for lag in range(history + 1)]
    return np.stack(lags, axis=-1)


def perceptron(layers: Layers, inputs: np.ndarray) -> np.ndarray:
    """Return the net's output, float32, shape (rows,). inputs: float32, one column a row, shape (width, rows)."""
    rows = inputs.shape[1]
    output = np.empty(rows, np.float32)
    for begin in range(0, rows, ROWS):
        x = inputs[:, begin : begin + ROWS]
        for weight, bias in layers[:-1]:
            x = weight @ x
            x += bias[:, None]
            # Softsign, x / (1 + |x|), in place.
            size = np.abs(x)
            size += 1.0
            x /= size
        weight, bias = layers[-1]
        output[begin : begin + ROWS] = (weight @ x)[0] + bias[0]
    return output


class ActuatorMemory:
    """The last H + 1 samples of the joints of N robots, and the torque that the net gives for them.

    Inside, joints are ordered by group and stand before robots, so that each group's rows lie side by side.
    """

    def __init__(self, net: ActuatorNet, num: int) -> None:
        """Start without a past: the first sample of a robot stands for all that were before it."""
        self.net, self.num = net, num
        places = {name: index for index, name in enumerate(net.joint_names)}
        self._order = np.array([places[name] for group in net.groups for name in group])
        self._back = np.argsort(self._order)
        self._limit = np.array(net.torque_limit)
        self.past = np.zeros((2, net.history + 1, len(self._order), num), np.float32)
        """Signal and velocity, newest first, shape (2, H + 1, J, N)."""
        self.fresh = np.ones(num, bool)
        """Robots without a past, shape (N,)."""

    def forget(self, ids: np.ndarray) -> None:
        """Begin anew with the robots `ids`."""
        self.fresh[ids] = True

    def torque(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Take in one sample, (N, J) [rad, rad/s]; return the torques [N m], not clipped to the limits, (N, J)."""
        self.past[:, 1:] = self.past[:, :-1]
        self.past[0, 0] = first_signal(self.net.inputs, target, position).T[self._order]
        self.past[1, 0] = velocity.T[self._order]
        if self.fresh.any():
            self.past[:, 1:, :, self.fresh] = self.past[:, :1, :, self.fresh]
            self.fresh[:] = False
        rows = self.past.reshape(2 * (self.net.history + 1), -1)
        share, begin = [], 0
        for group, layers in zip(self.net.groups, self.net.layers, strict=True):
            end = begin + len(group) * self.num
            share.append(perceptron(layers, rows[:, begin:end]))
            begin = end
        return np.concatenate(share).reshape(-1, self.num)[self._back].T * self._limit


def predict(net: ActuatorNet, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the torque [N m] for a whole log, clipped to the limit, shape (T - H, J); arguments (T, J)."""
    rows = windows(first_signal(net.inputs, target, position), velocity, net.history).astype(np.float32)
    result = np.empty(rows.shape[:2])
    places = {name: index for index, name in enumerate(net.joint_names)}
    for group, layers in zip(net.groups, net.layers, strict=True):
        columns = [places[name] for name in group]
        part = rows[:, columns]
        result[:, columns] = perceptron(layers, part.reshape(-1, part.shape[-1]).T).reshape(part.shape[:2])
    limit = np.array(net.torque_limit)
    return np.clip(result * limit, -limit, limit)
