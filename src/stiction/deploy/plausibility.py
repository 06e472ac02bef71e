"""Rules on one reading, command and drive: values that no working robot measures and no policy was trained for.

Most faults of a deployment are quiet: an encoder that is no longer read gives its last angle, a computer that forgot to
convert gives degrees, a library that orders quaternions x, y, z, w gives a robot that is always level. A policy acts on
all of it. The rules refuse what cannot be true; dangerous but true states (a fall, a hot motor) are for the runtime.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError, unknown_name
from stiction.core.rotation import up_axis
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import UNIT_ERROR
from stiction.files.contract import Contract
from stiction.files.velocity import COMMANDS, VELOCITY


@dataclass(frozen=True)
class Violation:
    """Broken rule of the robot's state, of a command, or of the machine."""

    rule: str
    """Name of the rule, from `RULES` of the module that has it: `stale state`, `joint range`, ..."""
    joint: str | None
    value: float
    """Measured value, in the rule's unit; NaN where that was measured."""
    limit: float
    unit: str = ""
    """Unit of value and limit: `rad`, `rad/s`, `s`, ..."""

    def sentence(self) -> str:
        """Return the violation in one line: rule, joint, value and limit."""
        where = "" if self.joint is None else f" of {self.joint}"
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.rule}{where}: {self.value:.4g}{unit}, allowed {self.limit:.4g}{unit}"


class Rule(NamedTuple):
    """Rule of plausibility."""

    limit: float
    """Default limit, in `unit`."""
    unit: str
    hint: str
    """Advice in an error on the first thing to check."""


RULES: dict[str, Rule] = {
    # NaN, infinite and absurd numbers of a broken decoder: no sensor of a robot measures a million of an SI unit.
    "not finite": Rule(1e6, "", "stop the robot and find out which sensor sends this"),
    # A clock that stopped or was set back, or one reading twice: two readings are never of one instant.
    "time stands still": Rule(
        0.0, "s", "give each reading the time at which it was measured, on a monotonic clock, in seconds"
    ),
    # Lost readings, times in milliseconds: five control periods at 50 Hz, a body falls 5 cm; of slower policies 2.5.
    "time jump": Rule(0.1, "s", "is the time in seconds? After a pause call reset() once the robot stands"),
    # Readings that were measured long before they are used: training delays actions by up to 20 ms.
    "stale reading": Rule(0.05, "s", "is the link to the robot slow, or its clock another one?"),
    # Zeros of an IMU that has not started.
    "quaternion length": Rule(UNIT_ERROR, "", "has the IMU started? Is the order w, x, y, z?"),
    # Quaternions in another order, an IMU that is mounted otherwise: 29° is steeper than any ground to start on. In the
    # order x, y, z, w a level robot that looks further than that from 0 reads so.
    "leans at the start": Rule(
        0.5, "rad", "is the quaternion in the order w, x, y, z, and in the base's frame (x forward, z up)?"
    ),
    # Quaternions x, y, z, w of a robot that looks along 0 read as level, turned round. Of |(w, x)|: a standing robot
    # leans by under 11°; one of sixteen headings is refused with it.
    "half turn at the start": Rule(
        0.1, "", "if the order is w, x, y, z, turn the robot by 30° and start again; else reorder it"
    ),
    # Degrees per second: a robot that falls turns at up to 10 rad/s; most gyroscopes end at 35.
    "turn rate": Rule(20.0, "rad/s", "is the gyroscope in rad/s?"),
    # A filter that starts anew: beyond rate times time, what a filter corrects at once.
    "orientation jump": Rule(0.3, "rad", "was the IMU restarted, or reset to another heading?"),
    # Degrees, another zero or order: beyond the contract's limits, where stops give way by 0.1 and encoders are off.
    "joint range": Rule(0.2, "rad", "are angles in radians, with the contract's zeros, signs and names?"),
    # Degrees per second, the rotor's speed: the fastest motors of such robots turn their joints at 20 to 40 rad/s.
    "joint rate": Rule(50.0, "rad/s", "is the velocity in rad/s, at the joint?"),
    # An encoder that slips, wraps or restarts: beyond rate times time, noise and quantisation.
    "joint jump": Rule(0.1, "rad", "does the encoder wrap around, or was it reset?"),
    # Order, axes or sign are not the gyroscope's, or one is dead: difference of unit vectors over a second; of walks
    # with noise: results/deploy.
    "attitude and gyroscope": Rule(
        0.15, "", "is the quaternion w, x, y, z, and are both in the base's frame, the gyroscope in rad/s?"
    ),
    # Another joint, sign or unit, an angle that slipped: what velocities add up to in 0.1 s, beside how far the angle
    # moved; between readings 20 ms apart a joint does much that no velocity has (results/deploy).
    "velocity and angle": Rule(
        0.3, "rad", "do velocities have the order, the sign and the unit of the angles, in rad/s? Did an encoder slip?"
    ),
    # An encoder that is read no more beside a velocity that is: what velocities add up to while the angle stays the
    # same to the last bit. A coarse encoder holds an angle for 0.002 rad.
    "frozen angle": Rule(0.02, "rad", "is this joint's encoder still read?"),
    # Equal to the last bit, which noise moves: ten readings of a slow IMU at 100 Hz.
    "frozen IMU": Rule(0.1, "s", "is the robot still read? A simulated IMU needs noise"),
    # The gyroscope alone, beside an orientation that goes on: noise moves one of three axes within ten slow readings.
    "frozen gyroscope": Rule(0.1, "s", "is the gyroscope still read? A simulated one needs noise"),
    # While commanded to walk; at rest coarse encoders may well not move. Friction of 40 % of the torque limit held a
    # joint of a walking robot for up to 1.9 s.
    "frozen joint": Rule(3.0, "s", "is this joint still read, or is it stuck?"),
    # A robot's clock that runs at another rate, beside this machine's: within 0.2 s, but for the largest step.
    "clock rate": Rule(0.08, "s", "is the robot's time in seconds? Is its computer, or a simulated robot, too slow?"),
    # A loop at another rate has another history: factor of the contract's period, mean over ten steps.
    "control period": Rule(
        1.5, "", "call step once every control period; after a pause call reset() once the robot stands"
    ),
    # Velocities beyond the trained range; rounding.
    "command": Rule(1e-6, "", "command less, or train for more (--set task.commands.*)"),
    # Shares of the contract's values: what rounding in drives makes of them.
    "drive kp": Rule(0.01, "", "set the drive to the contract's gain"),
    "drive kd": Rule(0.01, "", "set the drive to the contract's gain"),
    "drive torque limit": Rule(0.01, "", "set the drive to the contract's limit"),
}
"""Rule -> its limit; the comment above it names the fault that it guards against, and the reason for the number."""

OLDER_RANGE = dict(zip(COMMANDS, ((-0.8, 0.8), (-0.3, 0.3), (-0.6, 0.6)), strict=True))
"""Commands that training draws by default [m/s, m/s, rad/s]: assumed for a bundle from before contracts had
`command_range`, for which it may be wrong, and reported."""

MOVING = 0.1
"""Norm of a command (m/s and rad/s alike) above which it moves the robot, as in training."""

ATTITUDE_TIME, ANGLE_TIME, STILL_TIME = 1.0, 0.1, 0.3
"""Time constants of the sums of the gyroscope, of joint velocities, and of those of joints with constant angles
[s]."""

STILL_AFTER = 0.02
"""Time after which an angle that stays the same counts as still [s]: filtered velocities end later than angles."""

CLOCK_WINDOW = 0.2
"""Time over which the robot's clock is compared with this machine's [s]."""


class ImplausibleError(PolicyError):
    """Error for a reading, a command or a time that broke a rule of `RULES`; nothing entered the policy."""

    def __init__(self, violation: Violation) -> None:
        super().__init__(f"{violation.sentence()}; {RULES[violation.rule].hint}")
        self.violation = violation
        """Broken rule."""


def limits_of(changed: Mapping[str, float]) -> dict[str, float]:
    """Return the limit of every rule, some of them changed; infinity switches a rule off.

    Raises `ConfigurationError` for an unknown rule, and a limit that is negative or NaN.
    """
    for name, value in changed.items():
        if name not in RULES:
            raise ConfigurationError(unknown_name("rule", name, RULES))
        if not value >= 0:
            raise ConfigurationError(f"limit of rule {name!r}: got {value}, expected a number of 0 or more")
    return {name: rule.limit for name, rule in RULES.items()} | dict(changed)


def command_range(contract: Contract) -> np.ndarray:
    """Return the commands that a policy was trained for: lower and upper ends [m/s, m/s, rad/s], shape (2, 3)."""
    spans = OLDER_RANGE if contract.command_range is None else contract.command_range
    return np.array([spans[name] for name in COMMANDS]).T


class ReadingGuard:
    """Guard against readings that no working robot gives; for one robot, at any rate of readings."""

    def __init__(self, contract: Contract, limits: Mapping[str, float] | None = None) -> None:
        """Start before the first reading.

        contract: of the policy; readings are in the order of its joints; limits: rule -> limit in place of that in
        `RULES`; see `limits_of`, also for errors.
        """
        self.limits = limits_of(limits or {})
        self._names = contract.joint_names
        few = 2.5 * contract.control_period
        self._gap = max(self.limits["time jump"], few)
        # Longer gaps may be allowed, but a velocity does not hold for as long.
        self._adds_up = max(RULES["time jump"].limit, few)
        lower, upper = contract.array("lower"), contract.array("upper")
        self._middle, self._half = (lower + upper) / 2, (upper - lower) / 2 + self.limits["joint range"]
        self._commands = command_range(contract).tolist()
        self.assumed_range = contract.command_range is None
        """True if the contract lacks the trained commands, and `OLDER_RANGE` is assumed."""
        self.reset()

    def reset(self) -> None:
        """Start again: the next reading is the first, of a robot that stands."""
        self._time: float | None = None
        self._before: _Good | None = None
        self._fresh = True

    def check(
        self, time: float, sensors: Sensors, velocity: np.ndarray, now: float | None = None, acting: bool = True
    ) -> Violation | None:
        """Return the first rule that a reading or a command breaks, or None.

        A reading that cannot be true by itself is not remembered: the next one is compared with the one before it.

        time: of the measurement, on a clock that only advances [s]; sensors: of one robot, shapes (4,), (3,), (J,),
        (J,); velocity: commanded, (3,) [m/s, rad/s]; now: the present on the same clock [s]; the age is not judged
        without it; acting: True if a policy obeys the command: a robot that waits, or stands up, may keep still.
        """
        command = np.asarray(velocity, dtype=np.float64).tolist()
        good = _Good(time, sensors)
        return (
            self._finite(good)
            or self._in_time(time, now)
            or self._orientation(good)
            or self._joints(good)
            or self._motion(good, acting and math.hypot(*command) > MOVING)
            or self._command(command)
        )

    def _broken(self, rule: str, value: float, limit: float, joint: int | None = None, unit: str = "") -> Violation:
        name = None if joint is None else self._names[joint]
        return Violation(rule, name, float(value), float(limit), unit or RULES[rule].unit)

    def _over(self, rule: str, values: np.ndarray | float, limit: float | None = None) -> Violation | None:
        """Return a violation if a value, or the largest of the joints', is over a limit, by default the rule's."""
        limit, joint = self.limits[rule] if limit is None else limit, None
        if isinstance(values, np.ndarray):
            joint = int(np.argmax(values))
            values = float(values[joint])
        return self._broken(rule, values, limit, joint) if values > limit else None

    def _finite(self, good: _Good) -> Violation | None:
        most = self.limits["not finite"]
        scalars = [*good.quaternion, *good.rate, good.time]
        # A comparison with NaN is false.
        if np.abs(good.joints).max() <= most and all(abs(value) <= most for value in scalars[:-1]):
            return None if math.isfinite(good.time) else self._broken("not finite", good.time, most, unit="s")
        for values, unit in ((good.position, "rad"), (good.velocity, "rad/s")):
            wrong = ~(np.abs(values) <= most)
            if wrong.any():
                worst = int(np.argmax(wrong))
                return self._broken("not finite", values[worst], most, worst, unit)
        return self._broken("not finite", next(value for value in scalars if not abs(value) <= most), most)

    def _in_time(self, time: float, now: float | None) -> Violation | None:
        """Judge the time of the reading, and remember it."""
        before, limits = self._time, self.limits
        if before is not None and not time > before:
            return self._broken("time stands still", time - before, limits["time stands still"])
        # Also where it is refused below: the next reading is judged by its own gap.
        self._time = time
        if before is not None and time - before > self._gap:
            self._before = None
            return self._broken("time jump", time - before, self._gap)
        if now is not None and not now - time <= limits["stale reading"]:
            return self._broken("stale reading", now - time, limits["stale reading"])
        return None

    def _orientation(self, good: _Good) -> Violation | None:
        """Judge orientation and rate by themselves, and the first orientation as that of a robot that stands."""
        length, most = math.hypot(*good.quaternion), self.limits["quaternion length"]
        if not abs(length - 1.0) <= most:
            return self._broken("quaternion length", length, 1.0 + math.copysign(most, length - 1.0))
        if (broken := self._over("turn rate", max(map(abs, good.rate)))) is not None:
            return broken
        if self._fresh:
            lean = math.acos(min(1.0, max(-1.0, good.up[2])))
            if (broken := self._over("leans at the start", lean)) is not None:
                return broken
            near, least = math.hypot(*good.quaternion[:2]), self.limits["half turn at the start"]
            # A lower bound: infinity, which switches rules off, would here refuse everything.
            if near < least < math.inf:
                return self._broken("half turn at the start", near, least)
        return None

    def _joints(self, good: _Good) -> Violation | None:
        """Judge angles and velocities by themselves, and angles against the last ones."""
        position, limits = good.position, self.limits
        away = np.abs(position - self._middle)
        if (away - self._half).max() > 0.0:
            worst = int(np.argmax(away - self._half))
            limit = self._middle[worst] + math.copysign(self._half[worst], position[worst] - self._middle[worst])
            return self._broken("joint range", position[worst], limit, worst)
        broken = self._over("joint rate", np.abs(good.velocity))
        if broken is not None or self._before is None:
            return broken
        allowed = limits["joint rate"] * (good.time - self._before.time) + limits["joint jump"]
        return self._over("joint jump", np.abs(position - self._before.position), allowed)

    def _motion(self, good: _Good, walking: bool) -> Violation | None:
        """Judge the reading against those before, and remember it: a disagreement has to last."""
        # Remembered whatever the result: a caller who asks again every period must not be let through now and then.
        before, self._before, self._fresh = self._before, good, False
        if before is None:
            good.begin()
            return None
        # Of q and -q, which are one orientation, and of lengths that are off by some per cent.
        near = abs(sum(a * b for a, b in zip(good.quaternion, before.quaternion, strict=True)))
        turned = 2.0 * math.acos(min(1.0, near / (math.hypot(*good.quaternion) * math.hypot(*before.quaternion))))
        allowed = self.limits["turn rate"] * (good.time - before.time) + self.limits["orientation jump"]
        if (broken := self._over("orientation jump", turned, allowed)) is not None:
            return broken
        good.follow(before, self._adds_up, walking)
        off, most = math.dist(good.up, good.turned), self.limits
        apart = np.abs(good.position - good.moved)
        if broken := self._over("attitude and gyroscope", off) or self._over("velocity and angle", apart):
            return broken
        if broken := self._over("frozen angle", np.abs(good.unmoved)):
            return broken
        if (still := good.time - good.imu_changed) >= most["frozen IMU"]:
            return self._broken("frozen IMU", still, most["frozen IMU"])
        if (still := good.time - good.gyroscope_changed) >= most["frozen gyroscope"]:
            return self._broken("frozen gyroscope", still, most["frozen gyroscope"])
        joint = int(np.argmin(good.joint_changed))
        if (still := good.time - float(good.joint_changed[joint])) >= most["frozen joint"]:
            return self._broken("frozen joint", still, most["frozen joint"], joint)
        return None

    def _command(self, command: list[float]) -> Violation | None:
        slack = self.limits["command"]
        for value, low, high, axis in zip(command, *self._commands, VELOCITY, strict=True):
            if not low - slack <= value <= high + slack:
                return self._broken("command", value, low if value < low else high, unit=f"{axis.unit} {axis.name}")
        return None


class _Good:
    """Reading as numbers, with values that follow from it and those before it."""

    def __init__(self, time: float, sensors: Sensors) -> None:
        """Store one reading; raise `PolicyError` where the shapes are not those of one robot."""
        quaternion, rate = np.asarray(sensors.quaternion), np.asarray(sensors.angular_velocity)
        position = np.asarray(sensors.joint_position)
        joints = np.array([position, sensors.joint_velocity], dtype=np.float64)
        if quaternion.shape != (4,) or rate.shape != (3,) or joints.ndim != 2:
            raise PolicyError(
                f"sensors of the shapes {quaternion.shape}, {rate.shape}, {position.shape}; expected those of one "
                "robot: (4,), (3,), (joints,)"
            )
        # Lists: on three numbers NumPy takes several times as long, and this runs at every reading.
        self.time, self.quaternion, self.rate = float(time), quaternion.tolist(), rate.tolist()
        self.joints, self.position, self.velocity = joints, joints[0], joints[1]
        self.up = list(up_axis(*self.quaternion))
        """Direction up of the world in the base's frame."""

    def begin(self) -> None:
        """Start the sums: the first reading, or the first after a gap."""
        self.turned, self.moved = self.up, self.position
        self.imu_changed = self.gyroscope_changed = self.time
        self.joint_changed = self.angle_changed = np.full(len(self.position), self.time)
        self.unmoved = np.zeros(len(self.position))

    def follow(self, before: _Good, gap: float, walking: bool) -> None:
        """Update the sums from the reading before: the pose by gyroscope and velocities, and the times of changes.

        The up axis, seen from a base that turns with ω, moves as u × ω. Over more than a gap [s] nothing is added up.
        """
        self.begin()
        elapsed, same = self.time - before.time, self.position == before.position
        if self.rate == before.rate:
            self.gyroscope_changed = before.gyroscope_changed
            if self.quaternion == before.quaternion:
                self.imu_changed = before.imu_changed
        if elapsed <= gap:
            self._add(before, elapsed)
            self.angle_changed = np.where(same, before.angle_changed, self.time)
            # A velocity that stays the same too is not a velocity: the whole joint is frozen, or the whole reading.
            alive = np.where(self.velocity == before.velocity, 0.0, self.velocity)
            kept = max(0.0, 1.0 - elapsed / STILL_TIME) * before.unmoved + elapsed * alive
            self.unmoved = np.where(self.time - self.angle_changed > STILL_AFTER, kept, 0.0)
        if walking:
            stuck = same & (self.velocity == before.velocity)
            self.joint_changed = np.where(stuck, before.joint_changed, self.time)

    def _add(self, before: _Good, elapsed: float) -> None:
        """Add up rates and velocities over the time since the reading before [s]; what is older is forgotten slowly."""
        remaining = max(0.0, 1.0 - elapsed / ATTITUDE_TIME)
        # The difference fades: without that the gyroscope's offset would add up for as long as the robot is on.
        a, b, c = (u + remaining * (t - u) for u, t in zip(before.up, before.turned, strict=True))
        p, q, r = (0.5 * elapsed * (old + new) for old, new in zip(before.rate, self.rate, strict=True))
        self.turned = [a + b * r - c * q, b + c * p - a * r, c + a * q - b * p]
        remaining = max(0.0, 1.0 - elapsed / ANGLE_TIME)
        self.moved = before.position + remaining * (before.moved - before.position)
        self.moved += 0.5 * elapsed * (before.velocity + self.velocity)


class ClockRate:
    """Comparison of a robot's clock rate with this machine's; tolerates one step of either, and one late message."""

    def __init__(self, limit: float) -> None:
        """Start without readings; limit: of the rule "clock rate" [s]."""
        self._limit, self._last, self._steps = limit, (math.nan, math.nan), deque[tuple[float, float]]()

    def check(self, time: float, arrived: float) -> Violation | None:
        """Return a violation if the clocks went too far apart, else None.

        time: time of a reading, on the robot's clock [s]; arrived: its arrival, on this machine's [s].
        """
        (before, came), self._last = self._last, (time, arrived)
        self._steps.append((arrived, (arrived - came) - (time - before)))
        while arrived - self._steps[0][0] > CLOCK_WINDOW or math.isnan(self._steps[0][1]):
            self._steps.popleft()
            if not self._steps:
                return None
        apart = [step for _, step in self._steps]
        drift = sum(apart) - max(apart, key=abs)
        return Violation("clock rate", None, drift, self._limit, "s") if abs(drift) > self._limit else None


def compare_drive(
    contract: Contract,
    kp: np.ndarray | None = None,
    kd: np.ndarray | None = None,
    torque_limit: np.ndarray | None = None,
) -> list[Violation]:
    """Return the drives, by joint, whose gains and limits differ from the contract's, with which the policy learned.

    kp, kd, torque_limit: read back from the drives [N m/rad, N m s/rad, N m], shape (J,); None where the transport
    cannot read it. Raises `PolicyError` for another number of joints.
    """
    violations = []
    for name, unit, measured in (("kp", "N m/rad", kp), ("kd", "N m s/rad", kd), ("torque_limit", "N m", torque_limit)):
        if measured is None:
            continue
        values, right = np.asarray(measured, dtype=np.float64), contract.array(name)
        if values.shape != right.shape:
            raise PolicyError(f"{name} of {values.shape} drives; expected {right.shape}, one for each joint")
        rule = f"drive {name.replace('_', ' ')}"
        # Infinity less infinity is NaN, which is near nothing, and is reported as a violation.
        with np.errstate(invalid="ignore"):
            near = np.abs(values - right) <= RULES[rule].limit * np.abs(right)
        for joint in np.flatnonzero(~near):
            violations.append(
                Violation(rule, contract.joint_names[joint], float(values[joint]), float(right[joint]), unit)
            )
    return violations
