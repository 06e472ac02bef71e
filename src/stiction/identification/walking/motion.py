"""From a walking log to how every leg and the base moved: differences of what was measured, nothing filtered.

A sample holds the state at its time and the torque over the period that follows, so rates are forward differences of
angle and angular velocity; the acceleration is the second difference of the angle. Filtering waits until the equations
are written down (`swing.py`, `stance.py`): the products of filtered signals are not the filtered products.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import LogError
from stiction.core.rotation import up_in_frames
from stiction.files.walk import WalkLog
from stiction.identification.walking.body import BaseMotion, JointMotion
from stiction.identification.walking.setup import WalkSetup
from stiction.joints.pd import controller_torque
from stiction.robots.model import GRAVITY, Robot

SHORTEST = 1.0
"""Shortest walk that is looked at [s]."""

LONGEST_PERIOD = 0.005
"""Longest time between samples [s]. A swing of 0.15 s has 30 samples at 200 Hz, and seven at the policy's 50 Hz."""

RATE_SPAN = 0.005
"""Time over which a joint's rate is taken [s]: shorter, encoder noise would pretend reversals."""


@dataclass(frozen=True)
class WalkMotion:
    """A walk, T samples."""

    period: float
    """Time between samples [s]."""
    base: BaseMotion
    """Motion of the base."""
    joints: JointMotion
    """Motion of the joints."""
    torque: np.ndarray
    """Torque of the motors [N m], shape (T, J)."""
    rate: np.ndarray
    """Joint velocity in the middle of the period that follows each sample, as friction sees it [rad/s], (T, J)."""
    upward: np.ndarray
    """Direction up in the base frame, unit vectors, shape (T, 3)."""
    measured_torque: bool
    """Whether the torque was logged; else it is that of the PD law with the log's gains."""
    measured_acceleration: bool
    """Whether there was an accelerometer."""
    sampled_torque: bool
    """Whether the torque is that at the stamp, as a robot says it; else the mean over the period that follows."""
    unplaced: float
    """How far from the base's origin the accelerometer may be along each axis [m]; 95 % bound."""
    jumps: np.ndarray
    """Change of the torque by the target's, kp times its rate, where torque was sampled [N m/s], shape (T, J): a torque
    that jumps with every target is not known between two samples. Zero where the torque is a mean."""

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.torque)


def walk_motion(log: WalkLog, spec: Robot, sampled: bool = False, unplaced: float = 0.0) -> WalkMotion:
    """Return the motion in a log of the robot `spec`.

    sampled: the torque is that at the stamp, no mean over a period; unplaced: see `WalkMotion`.

    Raises `LogError` where the log is not of this robot, too short or too slow, or its torque has the joint friction
    in it.
    """
    if log.header.joint_names != spec.joint_names:
        raise LogError(
            f"the log has the joints {', '.join(log.header.joint_names[:4])}, ..., robot {spec.name!r} "
            f"{', '.join(spec.joint_names[:4])}, ...; name the robot that walked with --robot"
        )
    if log.foot_contact is not None and log.header.foot_names != spec.foot_names:
        raise LogError(
            f"the log has the feet {', '.join(log.header.foot_names)}, robot {spec.name!r} "
            f"{', '.join(spec.foot_names)}; order the columns of foot_contact and their names as the robot's"
        )
    if log.header.torque_source == "output_side":
        raise LogError(
            "torque source output_side: a sensor behind the gear does not see the joint's friction; "
            "log the motor's current or command (motor_side)"
        )
    period = log.header.period
    if len(log) * period < SHORTEST or period > 1.001 * LONGEST_PERIOD:
        raise LogError(
            f"the log has {len(log)} samples {period:g} s apart; expected at least {SHORTEST:g} s, sampled at "
            f"{1 / LONGEST_PERIOD:.0f} Hz or more, for the acceleration of a leg in swing: log for longer, or faster"
        )
    up = up_in_frames(log.quaternion)
    # Where there is no accelerometer, gravity is all of the specific force.
    base = BaseMotion(
        angular_velocity=log.angular_velocity,
        angular_acceleration=forward_difference(log.angular_velocity, period),
        specific_force=GRAVITY * up if log.specific_force is None else log.specific_force,
    )
    torque = log.joint_torque
    return WalkMotion(
        period=period,
        base=base,
        joints=JointMotion(log.joint_position, log.joint_velocity, second_difference(log.joint_position, period)),
        torque=asked_torque(log) if torque is None else torque,
        rate=joint_rate(log.joint_position, period),
        upward=up,
        measured_torque=torque is not None,
        measured_acceleration=log.specific_force is not None,
        sampled_torque=sampled,
        unplaced=unplaced,
        jumps=np.array(log.header.kp) * forward_difference(log.joint_target, period) * sampled,
    )


def forward_difference(values: np.ndarray, period: float) -> np.ndarray:
    """Return the mean rate over the period after each sample, shape of `values`, (T, ...); the last one twice."""
    rate = np.diff(values, axis=0) / period
    return np.concatenate([rate, rate[-1:]])


def joint_rate(position: np.ndarray, period: float) -> np.ndarray:
    """Return the velocity in the middle of the period after each sample, over at least `RATE_SPAN`, shape (T, J)."""
    reach = max(0, round((RATE_SPAN / period - 1) / 2))
    index = np.arange(len(position))
    # As far to either side of the middle of the period that follows the sample.
    after, before = np.minimum(index + 1 + reach, len(position) - 1), np.maximum(index - reach, 0)
    return (position[after] - position[before]) / (np.maximum(after - before, 1) * period)[:, None]


def second_difference(values: np.ndarray, period: float) -> np.ndarray:
    """Return the acceleration at each sample, shape of `values`, (T, ...); zero at both ends."""
    acceleration = np.zeros_like(values)
    acceleration[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) / period**2
    return acceleration


def asked_torque(log: WalkLog) -> np.ndarray:
    """Return kp (target - θ) - kd θ' within the limit [N m], shape (T, J): what the motors were asked for.

    The mean over the period that follows each sample: of the law at both ends, under the target of its start.
    """
    header = log.header
    gains = [np.array(values) for values in (header.kp, header.kd, header.torque_limit)]
    later = [np.concatenate([signal[1:], signal[-1:]]) for signal in (log.joint_position, log.joint_velocity)]
    asked = [
        controller_torque(log.joint_target, position, velocity, *gains)
        for position, velocity in ((log.joint_position, log.joint_velocity), later)
    ]
    return (asked[0] + asked[1]) / 2


def hann_weights(length: float, period: float) -> np.ndarray:
    """Return the weights of a Hann window of `length` [s] without its zeros, an odd number of them that add up to 1."""
    half = max(1, round(length / period / 2))
    weights = np.hanning(2 * half + 1)[1:-1]
    return weights / weights.sum()


def smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean of neighbours along axis 0, shape of `values`; half a window at each end is unusable."""
    flat = values.reshape(len(values), -1)
    columns = [np.convolve(column, weights, "same") for column in flat.T]
    return np.stack(columns, axis=1).reshape(values.shape)


def grow(mask: np.ndarray, samples: int) -> np.ndarray:
    """Return a mask, shape (T,), widened by `samples` on each side of every sample set; the ends count as set."""
    if samples == 0:
        return mask.copy()
    grown = np.convolve(mask, np.ones(2 * samples + 1), "same") > 0.5
    grown[:samples] = grown[-samples:] = True
    return grown


def carriers(spec: Robot) -> np.ndarray:
    """Return whether a foot hangs on a joint, bool, shape (L, J); `down @ carriers`: which joints bear load, (T, J)."""
    chains = [spec.chain(foot.link) for foot in spec.feet]
    return np.array([[joint in chain for joint in range(spec.num_joints)] for chain in chains])


def swings(down: np.ndarray, margin: int) -> np.ndarray:
    """Return the number of the swing that each sample of one foot belongs to, 0 where it is in none, shape (T,).

    down: bool, shape (T,). `margin` samples are left out at both ends of each swing, and the log's ends are no swing.
    """
    air = ~grow(down, margin + 1)
    starts = np.diff(air, prepend=False) & air
    return np.where(air, np.cumsum(starts), 0)


def slow_samples(velocity: np.ndarray, setup: WalkSetup, period: float) -> np.ndarray:
    """Return where a joint hardly moves or turns round, margin included, bool, shape (T,). velocity: θ', shape (T,)."""
    slow = np.abs(velocity) < setup.slow
    slow[1:] |= np.diff(np.sign(velocity)) != 0
    return grow(slow, round(setup.stop_margin / period))
