"""Actuator Net in NumPy, and its analytic baseline. Without torch, since evaluation runs it too.

For joint j at sample t the net returns τ_t / τ_max from two signals over a window, H = 3 in the paper. `default`: the
position errors e = a - θ and the velocities θ' at t, t-1, ..., t-H. `paper`, as printed: θ_t ... θ_{t-H} and θ'_{t-1}
... θ'_{t-H}; without the target, that net cannot know the command.

The analytic law is τ = clip(kp (a - θ) - kd θ', ±τ_max) - λ kd Δθ' - f sat(θ'/w) - B θ', with f, B and λ of each joint
by least squares. Δθ' is the change of the velocity over the following period, and λ the share of the period after which
kd θ' acts, for a logged torque is a mean over that period: 0 for a controller that holds its torque, one half for one
that runs much faster than the log, and 1 in MuJoCo, which treats kd implicitly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stiction.core.decode import is_integer, is_number, is_text
from stiction.core.errors import ConfigurationError, FileError
from stiction.core.names import kind_of
from stiction.joints.pd import TORQUE_SOURCES as TORQUE_SOURCES
from stiction.joints.pd import TorqueSource as TorqueSource


@dataclass(frozen=True)
class ActuatorNet:
    """Multilayer perceptron with softsign units for each group of joints, which share its weights."""

    robot: str
    joint_names: tuple[str, ...]
    """Names of the joints, in the order of every vector over joints."""
    torque_limit: tuple[float, ...]
    """Torque limit of each motor [N m], the unit of the net's output."""
    groups: tuple[tuple[str, ...], ...]
    """Names of the joints that share weights, group by group; every joint is in one."""
    inputs: str
    """Name of the set of inputs, one of `INPUT_SETS`."""
    history: int
    """H, number of past samples in addition to the current one."""
    period: float
    """Time between two samples [s], equal to the simulator's physics step."""
    torque_source: str
    """`motor_side` (the joint's friction is not in the torque, the simulation keeps its own) or `output_side` (dry and
    viscous friction are in it, the simulation drops its own)."""
    layers: tuple[Layers, ...]
    """Weights of each group. Inputs in SI units, row by row: the first signal (error or position) now, one sample ago,
    ..., H samples ago, then the velocity likewise; an input that is not in the set has zero weights."""
    training: Mapping[str, str]
    """File -> SHA-256 of each training log."""
    validation: Mapping[str, str]
    """File -> SHA-256 of each held-out log."""
    loss: Mapping[str, float]
    """`training`, `validation`: final mean squared error of torque over limit [-]."""
    seed: int
    revision: str
    command: str

    def __post_init__(self) -> None:
        names = self.joint_names
        named = bool(names) and len(set(names)) == len(names) and all(map(is_text, names))
        _expect(named, "joint_names", names, "names")
        for field in ("robot", "revision", "command"):
            _expect(is_text(getattr(self, field)), field, getattr(self, field), "a text")
        limits = self.torque_limit
        fits = len(limits) == len(names) and all(is_number(limit) and limit > 0 for limit in limits)
        _expect(fits, "torque_limit", limits, f"{len(names)} positive numbers")
        once = sorted(name for group in self.groups for name in group) == sorted(names) and all(self.groups)
        _expect(once, "groups", self.groups, "every joint in one group")
        _expect(self.inputs in INPUT_SETS, "inputs", self.inputs, " or ".join(INPUT_SETS))
        counted = is_integer(self.history) and 0 <= self.history <= 100
        _expect(counted, "history", self.history, "0 to 100 samples")
        _expect(is_number(self.period) and 1e-5 <= self.period <= 0.1, "period", self.period, "1e-5 to 0.1 s")
        _expect(self.torque_source in TORQUE_SOURCES, "torque_source", self.torque_source, " or ".join(TORQUE_SOURCES))
        for field in ("training", "validation"):
            value = getattr(self, field)
            right = isinstance(value, Mapping) and all(is_text(k) and is_text(v) for k, v in value.items())
            _expect(right, field, value, "an object, file -> SHA-256")
        right = isinstance(self.loss, Mapping) and all(is_number(loss) and loss >= 0 for loss in self.loss.values())
        _expect(right, "loss", self.loss, "an object of numbers of at least 0")
        _expect(is_integer(self.seed) and self.seed >= 0, "seed", self.seed, "an integer of at least 0")
        _check_layers(self)

    def check_use(self, robot: str, joint_names: Sequence[str], torque_limit: np.ndarray, period: float) -> None:
        """Raise `FileError` unless the net fits these joints and this physics step [s]."""
        if tuple(joint_names) != self.joint_names:
            raise FileError(
                f"the Actuator Net is for the joints of {self.robot!r}, {', '.join(self.joint_names[:3])}, ...; the "
                f"robot {robot!r} has {', '.join(joint_names[:3])}, ...; train one on its logs"
            )
        if not np.allclose(torque_limit, self.torque_limit, rtol=1e-6):
            raise FileError(
                f"the Actuator Net was trained with torque limits of {min(self.torque_limit):g} to "
                f"{max(self.torque_limit):g} N m, the robot {robot!r} has {min(torque_limit):g} to "
                f"{max(torque_limit):g} N m; name the robot that was logged"
            )
        if not math.isclose(period, self.period, rel_tol=PERIOD_TOLERANCE):
            raise FileError(
                f"the Actuator Net has a period of {self.period:g} s, the simulation steps by {period:g} s; use "
                f"--set task.timestep={self.period:g}, or train a net on logs sampled every {period:g} s"
            )


Layers = tuple[tuple[np.ndarray, np.ndarray], ...]
"""Weights, shape (outputs, inputs), and bias, shape (outputs,), of each layer in turn, float32."""

INPUT_SETS = {
    "default": "position errors (target - position) and velocities, now and over the last H samples",
    "paper": "positions, now and over the last H samples, and velocities of the last H samples without the current one",
}
"""Set of inputs -> its signals. The paper's has no target: that net cannot know the command."""

PERIOD_TOLERANCE = 1e-6
"""Maximum relative difference of two equal periods."""


def _expect(condition: bool, field: str, value: object, expected: str) -> None:
    if not condition:
        raise FileError(f"Actuator Net, field {field!r}: {str(value)[:80]}; expected {expected}")


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


ROWS = 3072
"""Rows that go through the layers at once, to stay in the processor's cache."""


@dataclass(frozen=True)
class ActuatorCfg:
    """Inputs, layers and fit of the net."""

    inputs: Literal["default", "paper"] = "default"
    """`default`: position errors and velocities, the current ones included. `paper`: as the paper prints it, positions
    and past velocities, without the target."""
    history: int = 3
    """H, number of past samples in addition to the current one; as in the paper."""
    share: Literal["kind", "all"] = "kind"
    """Joints that share weights: joints of a kind (`FL_shank` is a `shank`), or all. Joints of a kind have the same
    motor, gear and controller, and every leg adds data; between kinds torque limits and gains differ."""
    hidden: tuple[int, ...] = (32, 32)
    """Widths of the hidden layers, softsign units: a net in common use. Empty: a linear law."""
    epochs: int = 40
    """Passes over the training samples."""
    batch: int = 512
    """Samples of one gradient step."""
    learning_rate: float = 1e-2
    """Initial learning rate; it falls to zero along a cosine."""
    validation_share: float = 0.25
    """Share of the runs that is held out of the fit, at least one run. Whole runs: windows overlap, so windows drawn at
    random would be in both parts."""
    seed: int = 0
    """Seed of weights, order of samples and split."""

    def __post_init__(self) -> None:
        if self.inputs not in INPUT_SETS or self.share not in ("kind", "all"):
            raise ConfigurationError(
                f"inputs {self.inputs!r}, shared by {self.share!r}: expected {' or '.join(INPUT_SETS)}, and kind or all"
            )
        if not 1 <= self.history <= 100 or not all(1 <= width <= 4096 for width in self.hidden):
            raise ConfigurationError(
                f"history {self.history}, hidden layers {self.hidden}: expected 1 to 100 samples and widths from 1"
            )
        if min(self.epochs, self.batch) < 1 or not self.learning_rate > 0 or self.seed < 0:
            raise ConfigurationError(
                f"{self.epochs} epochs, batches of {self.batch}, learning rate {self.learning_rate}, seed {self.seed}: "
                "expected at least 1, a positive rate, and a seed of at least 0"
            )
        if not 0 < self.validation_share < 1:
            raise ConfigurationError(f"validation share {self.validation_share}: expected a share between 0 and 1")


def weight_groups(joint_names: tuple[str, ...], share: str) -> tuple[tuple[str, ...], ...]:
    """Return the joints that share weights, in order of first appearance; `share`: see `ActuatorCfg`."""
    groups: dict[str, list[str]] = {}
    for name in joint_names:
        groups.setdefault(kind_of(name) if share == "kind" else "", []).append(name)
    return tuple(map(tuple, groups.values()))


def first_signal(inputs: str, target: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the net's first signal, the second being velocity: errors a - θ, or θ as in the paper [rad], any shape."""
    return position if inputs == "paper" else target - position


def used_inputs(inputs: str, history: int) -> np.ndarray:
    """Return the mask of the 2 (H + 1) inputs in a set, bool: the paper's lacks the current velocity."""
    mask = np.ones(2 * (history + 1), bool)
    mask[history + 1] = inputs != "paper"
    return mask


def windows(signal: np.ndarray, velocity: np.ndarray, history: int) -> np.ndarray:
    """Return the inputs of every sample that has a complete past, shape (T - H, J, 2 (H + 1)).

    signal: of `first_signal`, velocity: θ' [rad/s], both (T, J). In each row, first the signal now, one sample ago,
    ..., H samples ago, then the velocity likewise.
    """
    length = len(signal) - history
    lags = [x[history - lag : history - lag + length] for x in (signal, velocity) for lag in range(history + 1)]
    return np.stack(lags, axis=-1)


def perceptron(layers: Layers, inputs: np.ndarray) -> np.ndarray:
    """Return the net's output, float32, shape (rows,). inputs: float32, one column per row, shape (width, rows)."""
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
    """Last H + 1 samples of the joints of N robots, and the net's torque for them.

    Joints are ordered by group and come before robots, so that each group's rows are contiguous.
    """

    def __init__(self, net: ActuatorNet, num: int) -> None:
        """Start with an empty history: a robot's first sample fills it."""
        self.net, self.num = net, num
        self._order = np.array([net.joint_names.index(name) for group in net.groups for name in group])
        self._back = np.argsort(self._order)
        self._limit = np.array(net.torque_limit)
        self.past = np.zeros((2, net.history + 1, len(self._order), num), np.float32)
        """Signal and velocity, newest first, shape (2, H + 1, J, N)."""
        self.fresh = np.ones(num, bool)
        """Robots without a past, shape (N,)."""

    def forget(self, ids: np.ndarray) -> None:
        """Clear the history of the robots `ids`."""
        self.fresh[ids] = True

    def torque(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Add one sample, (N, J) [rad, rad/s]; return the torques [N m], not clipped to the limits, (N, J)."""
        # The two views overlap; NumPy copies as if the right side had been set aside first.
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
    for group, layers in zip(net.groups, net.layers, strict=True):
        columns = [net.joint_names.index(name) for name in group]
        part = rows[:, columns]
        result[:, columns] = perceptron(layers, part.reshape(-1, part.shape[-1]).T).reshape(part.shape[:2])
    limit = np.array(net.torque_limit)
    return np.clip(result * limit, -limit, limit)


WIDTH = 0.05
"""Speed at which the friction of the baseline reaches f [rad/s]. At rest friction takes any value up to f, which no
function of the speed alone can represent."""


@dataclass(frozen=True)
class Baseline:
    """Analytic law of every joint, arrays of shape (J,)."""

    kp: np.ndarray
    """Proportional gains [N m/rad]."""
    kd: np.ndarray
    """Derivative gains [N m s/rad]."""
    torque_limit: np.ndarray
    """Torque limits [N m]."""
    coulomb: np.ndarray
    """f, fitted [N m]."""
    viscous: np.ndarray
    """B, fitted [N m s/rad]."""
    later: np.ndarray
    """λ, fitted, share of a period by which kd θ' acts later than the sample, in [0, 1] [-]."""

    def torque(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the torque [N m] of one run, shape (T, J), Δθ' of the last sample taken as 0; arguments (T, J)."""
        motor, change = self._at_the_sample(target, position, velocity)
        return motor + self.later * change - self.coulomb * ramp(velocity) - self.viscous * velocity

    def _at_the_sample(
        self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the PD law of the sample, and -kd Δθ' where that law is within its limit, (T, J) each [N m]."""
        commanded = self.kp * (target - position) - self.kd * velocity
        ahead = np.diff(velocity, axis=0, append=velocity[-1:])
        free = np.abs(commanded) < self.torque_limit
        return np.clip(commanded, -self.torque_limit, self.torque_limit), -self.kd * ahead * free


def ramp(velocity: np.ndarray) -> np.ndarray:
    """Return the direction of motion, sat(θ'/w), in [-1, 1], any shape."""
    return np.clip(velocity / WIDTH, -1.0, 1.0)


def fit_baseline(
    gains: tuple[np.ndarray, np.ndarray, np.ndarray],
    runs: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
) -> Baseline:
    """Fit f, B and λ of each joint to the training runs: target, position, velocity, torque of each, (T, J).

    gains: kp, kd and torque limit, each (J,). A joint that never moved has no friction, one without kd no λ.
    """
    none = np.zeros_like(gains[0])
    plain = Baseline(*gains, none, none, none)
    differences, columns = [], []
    for target, position, velocity, torque in runs:
        motor, change = plain._at_the_sample(target, position, velocity)
        differences.append(motor - torque)
        columns.append(np.stack([ramp(velocity), velocity, -change], axis=-1))
    lost, known = np.concatenate(differences), np.concatenate(columns)
    return Baseline(*gains, *np.array([_fit_joint(known[:, j], lost[:, j]) for j in range(lost.shape[1])]).T)


def _fit_joint(columns: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Return f, B and λ by least squares with λ in [0, 1]; columns: of f, B and λ, (T, 3), lost: (T,) [N m]."""
    # `lstsq` takes the least norm: a column of zeros, of a joint that never moved or has no kd, gets zero.
    free = np.linalg.lstsq(columns, lost, rcond=None)[0]
    later = float(np.clip(free[2], 0.0, 1.0))
    if later == free[2]:
        return free
    # The squares are convex, so that with one bound the least of them is on it.
    return np.append(np.linalg.lstsq(columns[:, :2], lost - later * columns[:, 2], rcond=None)[0], later)
