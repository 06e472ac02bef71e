"""Onset: the friction at which a policy trained without friction stops following, predicted from measured onsets.

Reach is the least ratio of mean velocity to command, over the commanded axes. The onset is the friction at which the
worst reach of the fast commands falls under `LEAST`. On some axis, friction over what a joint's gains, targets, motion
or torque can do against it, onsets of robots and gains lie close to each other: `onset.json` in this folder has the
measured ones, written by the study of onsets, and that axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

import numpy as np

from stiction.core.decode import from_plain
from stiction.files.contract import Contract, robot_of
from stiction.files.golden import Golden
from stiction.files.plain import read_object, take_version
from stiction.robots.model import GRAVITY, Robot

SCHEMA_VERSION = 1

LEAST, NOTICED = 0.8, 0.9
"""Share of the command under which a policy no longer follows; share of the reach without friction under which friction
is noticed [1]."""

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


def axes(robot: Robot, kp: np.ndarray, limit: np.ndarray, motion: Motion | None) -> dict[str, float]:
    """Return each axis per friction over torque limit, by name; without a motion only axes that need none.

    kp: gains [N m/rad]; limit: torque limits [N m], both (J,).
    """
    values = {"torque_limit": 1.0}
    by_joint = {"dead_band": limit / kp, "weight": limit / (robot.mass * GRAVITY * robot.standing_height)}
    if motion is not None:
        by_joint |= {
            "targets": limit / (kp * motion.targets),
            "motion": limit / (kp * motion.angles),
            "torque": limit / motion.torque,
        }
        values["work"] = float((limit * motion.speed).sum() / motion.power.sum())
    for name, each in by_joint.items():
        values |= {f"{name}_worst": float(each.max()), f"{name}_mean": float(each.mean())}
    return values


@dataclass(frozen=True)
class OnsetCondition:
    """Robot with its gains, over the training seeds."""

    robot: str
    feet: int
    onsets: tuple[float, ...]
    """Friction over torque limit at the onset, of each seed [1]."""
    noticed: tuple[float, ...]
    """Friction at which the reach of some command falls under `NOTICED` of that without friction, of each seed [1]."""
    jitter: tuple[float, ...]
    """Jitter of the joints without friction, mean over commands, of each seed [rad/s²]."""
    factors: Mapping[str, tuple[float, ...]]
    """Axis -> its value per friction over torque limit, of each seed."""

    def on(self, axis: str, noticed: bool = False) -> float:
        """Return the median over the seeds of the onset on an axis, or of the noticed friction."""
        levels = self.noticed if noticed else self.onsets
        return median(level * factor for level, factor in zip(levels, self.factors[axis], strict=True))

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
    conditions: tuple[OnsetCondition, ...]
    command: str
    revision: str

    def middles(self, axis: str, noticed: bool = False) -> list[float]:
        """Return the sorted values of all conditions on an axis."""
        return sorted(condition.on(axis, noticed) for condition in self.conditions)

    def spread(self, axis: str) -> float:
        """Return the largest over the smallest onset on an axis [1]."""
        middles = self.middles(axis)
        return middles[-1] / middles[0]


def read_onsets(path: Path) -> OnsetEvidence:
    """Return the measured onsets. Raises `StictionError`: the file cannot be read, or has another version."""
    return from_plain(OnsetEvidence, take_version(read_object(path, "onsets"), SCHEMA_VERSION, path.name), path.name)


@cache
def shipped_onsets() -> OnsetEvidence:
    """Return the shipped onsets."""
    return read_onsets(Path(__file__).with_name("onset.json"))


@dataclass(frozen=True)
class Prediction:
    """Predicted onset, as a share of each joint's torque limit [1]."""

    level: float
    least: float
    """Onset by the condition that stopped first, on the axis."""
    most: float
    """Onset by the condition that stopped last."""
    axis: str
    """Name in `AXES`."""
    relative: bool
    """True if it is the friction at which reach falls under `LEAST` of that without friction."""
    outside: str
    """Reason why this is an extrapolation, and the nearest evidence; empty if it is not."""

    @property
    def text(self) -> str:
        """Prediction as a sentence, with its basis."""
        span = f"{100 * self.least:.2g} to {100 * self.most:.2g} %"
        what = f"falls under {100 * LEAST:g} % of its speed without friction" if self.relative else "stops following"
        text = f"{what} at {100 * self.level:.2g} % of the torque limit ({span}), by {AXES[self.axis]}"
        return f"{text}; {self.outside}" if self.outside else text


def predict_onset(
    contract: Contract, motion: Motion | None, evidence: OnsetEvidence | None = None
) -> Prediction | None:
    """Return the predicted onset of a policy; None where its axis needs a motion and none is given.

    It is for policies trained without friction; one trained with friction follows as far as it was trained. motion: of
    walks without friction; evidence: by default the shipped one.
    """
    evidence, robot = evidence or shipped_onsets(), robot_of(contract)
    factors = axes(robot, contract.array("kp"), contract.array("torque_limit"), motion)
    if (factor := factors.get(evidence.axis)) is None:
        return None
    middles = evidence.middles(evidence.axis)
    level, least, most = (value / factor for value in (median(middles), middles[0], middles[-1]))
    outside = _outside(robot, factors["dead_band_mean"], evidence)
    return Prediction(level, least, most, evidence.axis, evidence.relative, outside)


def golden_motion(golden: Golden, contract: Contract) -> Motion | None:
    """Return the motion of joints in a recording; None if they had friction in it, or it has no torque."""
    if max(contract.friction) > 0.0 or golden.torque is None:
        return None
    walked = slice(None) if golden.walked is None else golden.walked
    signals = (golden.target, golden.joint_position, golden.joint_velocity, golden.torque)
    return motion_of(*(signal[walked][:, None] for signal in signals))


def _outside(robot: Robot, dead_band: float, evidence: OnsetEvidence) -> str:
    """Return why a robot is outside the measured range, and the condition nearest to it by feet and softness of
    gains.
    """
    feet = sorted({condition.feet for condition in evidence.conditions})
    soft = [condition.softness for condition in evidence.conditions]
    reasons = []
    if len(robot.feet) not in feet:
        reasons.append(f"robots with {' and '.join(map(str, feet))} feet walked, this one has {len(robot.feet)}")
    if not min(soft) / 1.1 <= dead_band <= 1.1 * max(soft):
        reasons.append(f"τ_max/kp was {min(soft):.2g} to {max(soft):.2g} rad, and is {dead_band:.2g}")
    if not reasons:
        return ""
    near = min(
        evidence.conditions,
        key=lambda item: (abs(item.feet - len(robot.feet)), abs(math.log(item.softness / dead_band))),
    )
    onset = f"{100 * median(near.onsets):.2g} %"
    return f"an extrapolation: {'; '.join(reasons)}; the nearest that walked, {near.robot}, stopped at {onset}"
