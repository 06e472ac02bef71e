"""Onset and standstill: frictions at which a policy trained without friction is too slow; the second is predicted.

Reach is the least ratio of mean velocity to command, over the commanded axes. The onset is the friction at which the
worst reach of the fast commands falls under `LEAST`, the standstill the one at which their mean reach falls under
`STANDS` of that without friction. On some axis, friction over what a joint's gains, targets, motion or torque can do
against it, those of robots and gains lie close to each other: `onset.json` in this folder has the measured ones,
written by the study of onsets, and the axes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Literal

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.records import two_digits
from stiction.files.advice import robot_title
from stiction.files.contract import Contract, robot_of
from stiction.files.golden import Golden
from stiction.files.plain import read_object, take_version
from stiction.robots.catalog import find_robot
from stiction.robots.model import GRAVITY, Robot

SCHEMA_VERSION = 1

LEAST, NOTICED, STANDS = 0.8, 0.9, 0.5
"""Share of the command under which a policy no longer follows; shares of the reach without friction under which
friction is noticed, and under which a policy stands in it [1]."""

Reading = Literal["onsets", "noticed", "standstill"]
"""Field of `OnsetCondition`: a friction at which something is lost."""

AXES = {
    "torque_limit": "f / τ_max",
    "dead_band_worst": "f / kp [rad], worst joint",
    "dead_band_mean": "f / kp [rad], mean",
    "weight_worst": "f / (weight × height), worst joint",
    "weight_mean": "f / (weight × height), mean",
    "targets_worst": "f / (kp × rms of targets), worst joint",
    "targets_mean": "f / (kp × rms of targets), mean",
    "motion_worst": "f / (kp × rms of angles), worst joint",
    "motion_mean": "f / (kp × rms of angles), mean",
    "torque_worst": "f / rms of torque, worst joint",
    "torque_mean": "f / rms of torque, mean",
    "work": "work against f / work of the motors, all joints",
}
"""Axis -> its text; axes that need less knowledge come first."""


@dataclass(frozen=True)
class Motion:
    """Motion of joints in walking without friction, shape (J,); the first three are root mean squares over walks."""

    targets: np.ndarray
    """Deviation of the policy's targets from their mean over a walk [rad]."""
    angles: np.ndarray
    """Deviation of the angles from their mean over a walk [rad]."""
    torque: np.ndarray
    """Torque of the motors [N m]."""
    speed: np.ndarray
    """Mean absolute speed of the joint [rad/s]."""
    power: np.ndarray
    """Mean absolute power, torque times velocity [W]."""


def motion_of(targets: np.ndarray, angles: np.ndarray, velocity: np.ndarray, torque: np.ndarray) -> Motion:
    """Return the motion of joints in N walks of T steps, each of shape (T, N, J) [rad, rad, rad/s, N m]."""
    return Motion(
        rms(targets - targets.mean(axis=0)),
        rms(angles - angles.mean(axis=0)),
        rms(torque),
        np.abs(velocity).mean(axis=(0, 1)),
        np.abs(torque * velocity).mean(axis=(0, 1)),
    )


def rms(signal: np.ndarray) -> np.ndarray:
    """Return the root mean square over steps and walks, shape (T, N, J) -> (J,)."""
    return np.sqrt(np.square(signal).mean(axis=(0, 1)))


def axes(robot: Robot, kp: np.ndarray, limit: np.ndarray, motion: Motion) -> dict[str, float]:
    """Return each axis per friction over torque limit, by name.

    kp: gains [N m/rad]; limit: torque limits [N m], both (J,).
    """
    values = {"torque_limit": 1.0, "work": float((limit * motion.speed).sum() / motion.power.sum())}
    by_joint = {
        "dead_band": limit / kp,
        "weight": limit / (robot.mass * GRAVITY * robot.standing_height),
        "targets": limit / (kp * motion.targets),
        "motion": limit / (kp * motion.angles),
        "torque": limit / motion.torque,
    }
    for name, each in by_joint.items():
        values |= {f"{name}_worst": float(each.max()), f"{name}_mean": float(each.mean())}
    return values


@dataclass(frozen=True)
class OnsetCondition:
    """Robot with its gains, over the training seeds."""

    robot: str
    onsets: tuple[float, ...]
    """Friction over torque limit at the onset, of each seed [1]."""
    noticed: tuple[float, ...]
    """Friction at which the reach of some command falls under `NOTICED` of that without friction, of each seed [1]."""
    standstill: tuple[float, ...]
    """Friction at which the mean reach falls under `STANDS` of that without friction, of each seed [1]."""
    jitter: tuple[float, ...]
    """Jitter of the joints without friction, mean over commands, of each seed [rad/s²]."""
    factors: Mapping[str, tuple[float, ...]]
    """Axis -> its value per friction over torque limit, of each seed."""

    def each(self, axis: str, reading: Reading = "onsets") -> list[float]:
        """Return the onset of each seed on an axis, or another reading."""
        levels: tuple[float, ...] = getattr(self, reading)
        return [level * factor for level, factor in zip(levels, self.factors[axis], strict=True)]

    def on(self, axis: str, reading: Reading = "onsets") -> float:
        """Return the median over the seeds of an onset on an axis, or of another reading."""
        return median(self.each(axis, reading))

    @property
    def softness(self) -> float:
        """τ_max/kp, mean over joints [rad]."""
        return self.factors["dead_band_mean"][0]


@dataclass(frozen=True)
class OnsetEvidence:
    """Measured onsets, and the axis on which they lie closest."""

    axis: str
    """Name in `AXES`."""
    relative: bool
    """True if an onset is the friction at which reach falls under `LEAST` of that without friction."""
    again: float
    """Share of samples of the seeds that choose this axis too [1]."""
    standstill_axis: str
    """Axis by which a standstill is predicted, in `AXES`."""
    conditions: tuple[OnsetCondition, ...]
    """Robots and gains that chose the axes."""
    others: tuple[OnsetCondition, ...]
    """Robots that walked and chose nothing."""
    command: str
    revision: str

    def middles(self, axis: str, reading: Reading = "onsets") -> list[float]:
        """Return the sorted values of all conditions on an axis."""
        return sorted(condition.on(axis, reading) for condition in self.conditions)


def read_onsets(path: Path) -> OnsetEvidence:
    """Return the measured onsets. Raises `StictionError`: the file cannot be read, or has another version."""
    return from_plain(OnsetEvidence, take_version(read_object(path, "onsets"), SCHEMA_VERSION, path.name), path.name)


@cache
def shipped_onsets() -> OnsetEvidence:
    """Return the shipped onsets."""
    return read_onsets(Path(__file__).with_name("onset.json"))


GAINS_ALIKE = 1.25
"""Largest factor between torque limits and gains for the same robot with the same gains: a choice."""


@dataclass(frozen=True)
class Nearest:
    """Condition that is nearest to a robot or to one of its joints."""

    condition: OnsetCondition
    same: bool
    """True if it is this robot with these gains; else what it shows is an extrapolation."""

    @property
    def title(self) -> str:
        """Robot and the change of its gains, for readers: `Saturn Lite with kp × 2`."""
        name, _, change = self.condition.robot.partition("@")
        field, _, factor = change.partition("=")
        return robot_title(name) + (f" with {field} × {factor}" if change else "")


def nearest(robot: str | None, gains: np.ndarray, evidence: OnsetEvidence) -> Nearest:
    """Return the condition nearest to a robot's joints, or to one of them: the same robot first, then by gains.

    robot: name, None where unknown; gains: torque limit and kp of each joint, (J, 2) [N m, N m/rad], NaN where unknown.
    """
    distances = []
    for condition in evidence.conditions:
        apart = np.nansum(np.abs(np.log(gains)[:, None] - _log_gains(condition.robot)), axis=-1)
        distances.append((condition.robot.partition("@")[0] != robot, float(apart.min(axis=-1).mean())))
    other, apart = min(distances)
    return Nearest(evidence.conditions[distances.index((other, apart))], not other and apart <= math.log(GAINS_ALIKE))


@cache
def _log_gains(robot: str) -> np.ndarray:
    """Return the logarithms of torque limit and kp of a robot's joints, shape (J, 2)."""
    joints = find_robot(robot)
    return np.log(np.stack((joints.joint_values("torque_limit"), joints.joint_values("kp")), axis=-1))


@dataclass(frozen=True)
class Prediction:
    """Predicted standstill, as a share of each joint's torque limit [1].

    The onset is not predicted: of two robots that had chosen no axis it was off by factors of two and three.
    """

    level: float
    """By the median of the conditions, on the axis."""
    least: float
    """By the policy that stood with the least friction, those that chose no axis among them."""
    most: float
    """By the policy that stood with the most."""
    policies: int
    """Policies behind the least and the most."""
    axis: str
    """Name in `AXES`."""
    outside: str
    """Reason why this is an extrapolation, and the nearest evidence; empty if it is not."""

    @property
    def span(self) -> str:
        """`21 % friction (11 to 32 %, the range of 21 policies)`."""
        level, least, most = (two_digits(100 * value) for value in (self.level, self.least, self.most))
        return f"{level} % friction ({least} to {most} %, the range of {self.policies} policies)"

    @property
    def text(self) -> str:
        """Prediction as a sentence, with its basis."""
        text = f"half of its speed is lost at {self.span}, by {AXES[self.axis]}"
        return f"{text}; {self.outside}" if self.outside else text


def predict_standstill(contract: Contract, motion: Motion, evidence: OnsetEvidence | None = None) -> Prediction:
    """Return the predicted standstill of a policy.

    It is for policies trained without friction; one trained with friction follows as far as it was trained. motion: of
    walks without friction; evidence: by default the shipped one.
    """
    evidence, robot = evidence or shipped_onsets(), robot_of(contract)
    kp, limit = contract.array("kp"), contract.array("torque_limit")
    axis = evidence.standstill_axis
    factor = axes(robot, kp, limit, motion)[axis]
    walked = [each.each(axis, "standstill") for each in (*evidence.conditions, *evidence.others)]
    levels = sorted(level / factor for each in walked for level in each)
    near, outside = nearest(contract.robot, np.stack((limit, kp), axis=-1), evidence), ""
    if not near.same:
        level = two_digits(100 * near.condition.on("torque_limit", "standstill"))
        outside = (
            f"an extrapolation: no such robot walked with such gains; {near.title}, the nearest, lost it at {level} %"
        )
    middle = median(evidence.middles(axis, "standstill")) / factor
    return Prediction(middle, levels[0], levels[-1], len(levels), axis, outside)


def golden_motion(golden: Golden, contract: Contract) -> Motion | None:
    """Return the motion of joints in a recording; None if they had friction in it, or it has no torque."""
    if max(contract.friction) > 0.0 or golden.torque is None:
        return None
    walked = slice(None) if golden.walked is None else golden.walked
    signals = (golden.target, golden.joint_position, golden.joint_velocity, golden.torque)
    return motion_of(*(signal[walked][:, None] for signal in signals))
