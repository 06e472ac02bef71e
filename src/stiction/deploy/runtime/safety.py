"""Rules that stop a robot, one reading at a time: on its motion, not on the plausibility of the reading.

`deploy.plausibility` judges whether a reading can be true at all; both return a `Violation`. Limits and reasons are
in `SafetyCfg`, the purpose of each rule is in docs/safety.md.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from stiction.core.rotation import up_axis
from stiction.deploy.control import JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.plausibility import RULES, Violation
from stiction.deploy.runtime.config import SafetyCfg
from stiction.deploy.transports.link import RobotState
from stiction.files.contract import Contract


def tilt(quaternion: np.ndarray, angular_velocity: np.ndarray, horizon: float) -> tuple[float, float]:
    """Return the tilt now, and after `horizon` [s] of turning on [rad].

    quaternion: w x y z, shape (4,); angular_velocity: in the base's frame [rad/s], shape (3,). Gravity's direction g in
    the base's frame changes by −ω × g.
    """
    # Python's numbers: on three of them NumPy takes several times as long, and this runs at every reading.
    length = math.hypot(*quaternion.tolist())
    x, y, z = (-entry for entry in up_axis(*(quaternion / length).tolist()))
    p, q, r = (horizon * rate for rate in angular_velocity.tolist())
    ahead = (x - (q * z - r * y), y - (r * x - p * z), z - (p * y - q * x))
    return math.acos(min(1.0, max(-1.0, -z))), math.acos(min(1.0, max(-1.0, -ahead[2] / math.hypot(*ahead))))


RESPONSE = 0.006
"""Time from a reading to the one that shows the resulting torque [s]: of buses, and the robot's own computer."""

WEAK_SPEED = 5.0
"""Speed above which a driving motor may give less torque than commanded [rad/s]: its voltage ends."""

OTHER_FIELDS = (
    *("acceleration", "joint_torque", "temperature", "lost", "motor_fault", "foot_contact", "battery"),
    *("kp", "kd", "torque_limit"),
)
"""Fields of a state besides the sensors of a policy: NaN where a robot does not report them."""

LOSS_SECONDS, LOSS_PARTS = 1.0, 10
"""Time over which the share of lost states is judged [s], and number of judgements within it."""

LOST_SECONDS = 0.1
"""Time over which lost messages are counted [s]."""


class Window:
    """The last readings of some numbers, in their order, side by side in memory: so their mean needs no copy."""

    def __init__(self, seconds: float, period: float, *shape: int) -> None:
        """Start empty; seconds: time that it holds [s]; period: between two readings [s]; shape: of one reading."""
        self._length = max(1, round(seconds / period))
        self._rows, self._end = np.empty((2 * self._length, *shape)), 0

    def clear(self) -> None:
        """Forget all readings."""
        self._end = 0

    def append(self, row: np.ndarray | float) -> None:
        """Add a reading, and forget one that is older than the window's time."""
        if self._end == len(self._rows):
            self._rows[: self._length] = self._rows[self._length :]
            self._end = self._length
        self._rows[self._end] = row
        self._end += 1

    def mean(self) -> np.ndarray | None:
        """Return the mean over the window's time, None until it is full."""
        if self._end < self._length:
            return None
        total: np.ndarray = np.add.reduce(self._rows[self._end - self._length : self._end])
        return total / self._length


class Safety:
    """Rules over one robot's readings."""

    def __init__(self, contract: Contract, cfg: SafetyCfg, period: float) -> None:
        """Start without readings; period: time between two readings [s]."""
        self._cfg, self._names, self._limit = cfg, contract.joint_names, contract.array("torque_limit")
        joints = contract.num_joints
        self._torques = Window(cfg.torque_seconds, period, joints)
        self.errors = Window(cfg.torque_error_seconds, period, joints)
        """Shares of the torque limits by which motors gave another torque than their gains ask for, shape (J,)."""
        self._prompt = 2.0 * max(RESPONSE, period)
        self._expected: deque[tuple[float, np.ndarray]] = deque(maxlen=max(1, round(RESPONSE / period)))
        self._command: JointCommand | None = None
        self._squares = Window(cfg.flailing_seconds, period)
        # One more than for a mean: what a count grows by in n periods is between the first and the last of n + 1
        # readings.
        self._lost: deque[np.ndarray] = deque(maxlen=1 + max(1, round(LOST_SECONDS / period)))
        self._reported: set[str] = set()
        self._losses: deque[tuple[float, float, float]] = deque(maxlen=1 + LOSS_PARTS)
        self._asked, self._losses_from = math.nan, -math.inf

    def reset(self) -> None:
        """Forget all earlier readings."""
        for earlier in (self._torques, self._squares, self._lost, self.errors, self._expected):
            earlier.clear()

    def commanded(self, command: JointCommand) -> None:
        """Note the command to the motors: from now on their torques are compared with it."""
        self._command = command

    def finite(self, state: RobotState) -> Violation | None:
        """Return the first field, other than the sensors, with a NaN or infinity; None if all are finite.

        A field that is NaN in all its entries counts only after it has once been finite: many robots lack some fields.
        """
        fields = {name: getattr(state, name) for name in OTHER_FIELDS}
        # One pass over all of it in the usual case; the field is searched only where one is not finite.
        if np.isfinite(np.concatenate(list(fields.values()), axis=None)).all():
            self._reported.update(fields)
            fields = {}
        for name, value in fields.items():
            values = np.atleast_1d(value)
            right = np.isfinite(values)
            if right.all():
                self._reported.add(name)
            elif name in self._reported or not np.isnan(values).all():
                wrong = int(np.argmin(right))
                joint = self._names[wrong] if len(values) == len(self._names) else None
                return Violation("not finite", joint, float(values[wrong]), RULES["not finite"].limit)
        if math.isinf(state.command):
            return Violation("not finite", None, state.command, RULES["not finite"].limit)
        return None

    def losses(self, bad: float, sent: float, now: float) -> Violation | None:
        """Return a violation if too many states of the last second were lost, came twice, or behind a newer one.

        bad: number of those; sent: number of all that the robot sent; both counted up; now: on the caller's clock [s].
        To be called every few milliseconds: states that are lost between calls overran the caller's queue, which is no
        fault of the link, and the second begins anew.
        """
        part, asked, self._asked = LOSS_SECONDS / LOSS_PARTS, self._asked, now
        if not now - asked <= part:  # The first time, too: the queue filled while the run was prepared.
            self._losses.clear()
            # What a queue that was full did not take is found missing with the first state behind it.
            self._losses_from = now + part
        if now < self._losses_from:
            return None
        self._losses_from = now + part
        self._losses.append((now, bad, sent))
        _, bad_before, sent_before = self._losses[0]
        share = (bad - bad_before) / max(1.0, sent - sent_before)
        if len(self._losses) <= LOSS_PARTS or share <= self._cfg.losses:
            return None
        return Violation("lossy link", None, share, self._cfg.losses)

    def check(self, state: RobotState, answers: bool = True) -> Violation | None:
        """Return the first broken rule of a reading whose sensors are finite, None where none is broken.

        answers: True if the reading came after the last command had been sent; an earlier one does not show it.
        """
        cfg, sensors = self._cfg, state.sensors
        if (fall := self.falling(sensors)) is not None:
            return fall
        speed = np.abs(sensors.joint_velocity)
        if (worst := self._worst(speed, cfg.joint_speed)) is not None:
            return Violation("joint speed", self._names[worst], float(speed[worst]), cfg.joint_speed, "rad/s")
        self._squares.append(np.square(speed).mean())
        if (square := self._squares.mean()) is not None and (rms := math.sqrt(square)) > cfg.flailing:
            return Violation("flailing", None, rms, cfg.flailing, "rad/s")
        return self._of_drives(state, answers) or self._of_motors(state)

    def falling(self, sensors: Sensors) -> Violation | None:
        """Return a violation if the robot leans too far, or will in a moment."""
        cfg = self._cfg
        now, ahead = tilt(sensors.quaternion, sensors.angular_velocity, cfg.horizon)
        if now > cfg.tilt:
            return Violation("tilt", None, now, cfg.tilt, "rad")
        if ahead > cfg.predicted_tilt:
            return Violation("predicted tilt", None, ahead, cfg.predicted_tilt, "rad")
        return None

    def _of_drives(self, state: RobotState, answers: bool) -> Violation | None:
        """Return a violation if a motor gives another torque than its gains ask for at the measured angle and speed."""
        command, sensors, torque = self._command, state.sensors, state.joint_torque
        if command is not None and not answers:
            self._expected.clear()
            return None
        if command is None or not command.kp.any():
            self.errors.clear()
            self._expected.clear()
            return None
        asked = command.forward + command.kp * (command.target - sensors.joint_position)
        asked = np.minimum(np.maximum((asked - command.kd * sensors.joint_velocity) / self._limit, -1.0), 1.0)
        # An earlier reading, behind which others were lost, does not show it either.
        if len(self._expected) == self._expected.maxlen and state.time - self._expected[0][0] < self._prompt:
            before, measured = self._expected[0][1], torque / self._limit
            error = measured - before
            driving = before * sensors.joint_velocity > 0.0
            weak = driving & (before * measured >= 0.0) & (np.abs(measured) < np.abs(before))
            weak &= np.abs(sensors.joint_velocity) > WEAK_SPEED
            # Exactly zero is a robot that measures none.
            self.errors.append(np.where(weak | np.isnan(error) | (torque == 0.0), 0.0, error))
        self._expected.append((state.time, asked))
        mean = self.errors.mean()
        if mean is None or (worst := self._worst(off := np.abs(mean), self._cfg.torque_error)) is None:
            return None
        value, limit = (float(share * self._limit[worst]) for share in (off[worst], self._cfg.torque_error))
        return Violation("torque and command", self._names[worst], value, limit, "N m")

    def _of_motors(self, state: RobotState) -> Violation | None:
        """Return the first broken rule of torques and temperatures; unreported values are not judged."""
        cfg = self._cfg
        self._torques.append(np.abs(_or_zero(state.joint_torque)) / self._limit)
        share = self._torques.mean()
        if share is not None and (worst := self._worst(share, cfg.torque)) is not None:
            value, limit = (float(part * self._limit[worst]) for part in (share[worst], cfg.torque))
            return Violation("torque", self._names[worst], value, limit, "N m")
        if (worst := self._worst(_or_zero(state.temperature), cfg.temperature)) is not None:
            hot = float(state.temperature[worst])
            return Violation("temperature", self._names[worst], hot, cfg.temperature, "°C")
        self._lost.append(_or_zero(state.lost))
        missed = self._lost[-1] - self._lost[0]
        if (worst := self._worst(missed, cfg.lost)) is not None:
            return Violation("motor lost", self._names[worst], float(missed[worst]), cfg.lost)
        fault = _or_zero(state.motor_fault)
        if cfg.motor_fault and (worst := self._worst(np.abs(fault), 0.0)) is not None:
            return Violation("motor fault", self._names[worst], float(fault[worst]), 0.0)
        return None

    def _worst(self, values: np.ndarray, limit: float) -> int | None:
        worst = int(np.argmax(values))
        return worst if values[worst] > limit else None


def _or_zero(values: np.ndarray) -> np.ndarray:
    """Return numbers with zeros in place of those that a robot does not report."""
    return np.where(np.isnan(values), 0.0, values)
