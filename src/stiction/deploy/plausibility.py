"""What no working robot measures, and no policy was trained to be asked: rules on one reading, command and drive.

Most faults of a deployment are quiet: an encoder that is no longer read gives its last angle, a computer that forgot to
convert gives degrees, a library that orders quaternions x, y, z, w gives a robot that is always level. A policy acts on
all of it. The rules refuse what cannot be true; what is true and dangerous (a fall, a hot motor) is for the runtime.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError, PolicyError, unknown_name
from stiction.core.rotation import up_axis
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import UNIT_ERROR
from stiction.deploy.violation import Violation
from stiction.files.contract import Contract
from stiction.files.velocity import COMMANDS, VELOCITY


@dataclass(frozen=True)
class Rule:
    """One thing that is refused."""

    guards: str
    """What it guards against."""
    limit: float
    """Default of what is allowed, in `unit`."""
    unit: str
    why: str
    """Why the limit is this number."""
    hint: str
    """What to look at first, in an error."""


RULES: dict[str, Rule] = {
    "not finite": Rule(
        "NaN, infinite and absurd numbers of a broken decoder", 1e6, "",
        "no sensor of a robot measures a million of an SI unit",
        "stop the robot and find out which sensor sends this",
    ),
    "time stands still": Rule(
        "a clock that stopped or was set back, and one reading that is given twice", 0.0, "s",
        "two readings are never of one instant",
        "give each reading the time at which it was measured, on a monotonic clock, in seconds",
    ),
    "time jump": Rule(
        "lost readings, and times in milliseconds", 0.1, "s",
        "five control periods at 50 Hz: a body falls 5 cm meanwhile; of slower policies, two and a half periods",
        "is the time in seconds? After a pause call reset() once the robot stands",
    ),
    "stale reading": Rule(
        "readings that were measured long before they are used", 0.05, "s",
        "training delays actions by up to 20 ms; more than twice as much it has never met",
        "is the link to the robot slow, or its clock another one?",
    ),
    "quaternion length": Rule(
        "an orientation that is none: zeros of an IMU that has not started", UNIT_ERROR, "",
        "filters keep the length within 0.001, and one of them sends 16-bit integers",
        "has the IMU started? Is the order w, x, y, z?",
    ),
    "leans at the start": Rule(
        "quaternions in another order, an IMU that is mounted otherwise than the base's frame", 0.5, "rad",
        "29°: steeper than any ground to start on; in the order x, y, z, w a level robot that looks further than that "
        "from 0 reads so",
        "is the quaternion in the order w, x, y, z, and in the base's frame (x forward, z up)?",
    ),
    "half turn at the start": Rule(
        "quaternions in the order x, y, z, w of a robot that looks along 0: they read as level, turned round", 0.1, "",
        "of |(w, x)|: a standing robot leans by under 11°; one of sixteen headings is refused with it",
        "if the order is w, x, y, z, turn the robot by 30° and start again; else reorder it",
    ),
    "turn rate": Rule(
        "a gyroscope in degrees per second", 20.0, "rad/s",
        "a robot that falls turns at up to 10 rad/s; most gyroscopes end at 35",
        "is the gyroscope in rad/s?",
    ),
    "orientation jump": Rule(
        "a quaternion whose order changes, a filter that starts anew: more than the turn rate allows",
        0.3, "rad",
        "beyond rate times time: what a filter corrects at once",
        "was the IMU restarted, or reset to another heading?",
    ),
    "joint range": Rule(
        "degrees, another zero, another order of the joints", 0.2, "rad",
        "beyond the contract's limits: stops give way by 0.1, and encoders are off by some hundredths",
        "are angles in radians, with the contract's zeros, signs and names?",
    ),
    "joint rate": Rule(
        "degrees per second, the rotor's speed before the gear, a decoder's spikes", 50.0, "rad/s",
        "the fastest motors of such robots turn their joints at 20 to 40 rad/s",
        "is the velocity in rad/s, at the joint?",
    ),
    "joint jump": Rule(
        "an encoder that slips, wraps or restarts: more between two readings than the joint rate allows", 0.1, "rad",
        "beyond rate times time: noise and quantisation",
        "does the encoder wrap around, or was it reset?",
    ),
    "attitude and gyroscope": Rule(
        "an orientation whose order, axes or sign are not the gyroscope's, and one of both that is dead", 0.3, "",
        "difference of unit vectors over a second; of walks with noise: results/deploy",
        "is the quaternion w, x, y, z, and are both in the base's frame, the gyroscope in rad/s?",
    ),
    "velocity and angle": Rule(
        "a velocity of another joint, sign or unit than its angle", 0.6, "rad",
        "what velocities add up to in 0.3 s beside how far the angle moved; of walks with noise: results/deploy",
        "do velocities have the order, the sign and the unit of the angles, in rad/s?",
    ),
    "frozen IMU": Rule(
        "an IMU, or a whole robot, that is no longer read: orientation and gyroscope equal to the last bit", 0.1, "s",
        "noise moves the last bit of any IMU; 0.1 s are ten readings of a slow one at 100 Hz",
        "is the robot still read? A simulated IMU needs noise",
    ),
    "frozen joint": Rule(
        "an encoder that is no longer read, while the robot is commanded to walk", 1.0, "s",
        "two cycles of a gait. At rest coarse encoders may well not move, so there nothing is said",
        "is this joint still read, or is it stuck?",
    ),
    "control period": Rule(
        "a loop at another rate than the policy's: its history is then another", 1.5, "",
        "factor of the contract's period, mean over ten steps: some missed ticks pass, half or twice the rate does not",
        "call step once every control period; after a pause call reset() once the robot stands",
    ),
    "command": Rule(
        "velocities that the policy was never asked for in training", 1e-6, "",
        "beyond the trained range: rounding",
        "command less, or train for more (--set task.commands.*)",
    ),
    "drive kp": Rule(
        "another proportional gain in the drives than in training", 0.01, "",
        "share of the contract's: what rounding in drives makes of it",
        "set the drive to the contract's gain",
    ),
    "drive kd": Rule(
        "another derivative gain", 0.01, "", "as of kp", "set the drive to the contract's gain"
    ),
    "drive torque limit": Rule(
        "another limit: less torque than was trained with, or more than was meant", 0.01, "", "as of kp",
        "set the drive to the contract's limit",
    ),
}  # fmt: skip
"""Rule -> what it guards against, its limit, and why that number."""

OLDER_RANGE = dict(zip(COMMANDS, ((-0.8, 0.8), (-0.3, 0.3), (-0.6, 0.6)), strict=True))
"""Commands that training draws where nobody says otherwise [m/s, m/s, rad/s]: what is taken for a bundle from before
contracts had `command_range`, which may be wrong for it, and is said."""

MOVING = 0.1
"""A command is a moving one if its norm (m/s and rad/s alike) is above this, as in training."""

ATTITUDE_TIME, ANGLE_TIME = 1.0, 0.3
"""Time constants with which what gyroscope, and joint velocities, add up to forgets [s]."""


class ImplausibleError(PolicyError):
    """Raised for a reading, a command or a time that broke a rule of `RULES`; nothing entered the policy."""

    def __init__(self, violation: Violation) -> None:
        """Say the violation, and what to look at."""
        super().__init__(f"{violation.sentence()}; {RULES[violation.rule].hint}")
        self.violation = violation
        """What was found."""


def limits_of(changed: Mapping[str, float]) -> dict[str, float]:
    """Return the limit of every rule, some of them changed; infinity switches a rule off.

    Raises `ConfigurationError` for a rule that there is not, and a limit that is negative or NaN.
    """
    for name, value in changed.items():
        if name not in RULES:
            raise ConfigurationError(unknown_name("rule", name, RULES))
        if not value >= 0:
            raise ConfigurationError(f"the limit of the rule {name!r} is {value}; expected a number from 0 on")
    return {name: rule.limit for name, rule in RULES.items()} | dict(changed)


def command_range(contract: Contract) -> np.ndarray:
    """Return the commands that a policy was trained for: lower and upper ends [m/s, m/s, rad/s], shape (2, 3)."""
    spans = OLDER_RANGE if contract.command_range is None else contract.command_range
    return np.array([spans[name] for name in COMMANDS]).T


class ReadingGuard:
    """Refuses readings that no working robot gives, from one to the next; for one robot, at any rate of readings."""

    def __init__(self, contract: Contract, limits: Mapping[str, float] | None = None) -> None:
        """Start before the first reading.

        Args:
            contract: of the policy; readings are in the order of its joints.
            limits: rule -> limit in place of that in `RULES`; see `limits_of`, also for errors.

        """
        self.limits = limits_of(limits or {})
        self._names = contract.joint_names
        few = 2.5 * contract.control_period
        self._gap = max(self.limits["time jump"], few)
        # Whoever allows longer gaps does not make a velocity hold for as long.
        self._adds_up = max(RULES["time jump"].limit, few)
        lower, upper = contract.array("lower"), contract.array("upper")
        self._middle, self._half = (lower + upper) / 2, (upper - lower) / 2 + self.limits["joint range"]
        self._commands = command_range(contract).tolist()
        self.assumed_range = contract.command_range is None
        """Whether the contract does not say which commands were trained, and `OLDER_RANGE` is taken."""
        self.reset()

    def reset(self) -> None:
        """Begin anew: what comes next is a first reading, of a robot that stands."""
        self._time: float | None = None
        self._before: _Good | None = None
        self._fresh = True

    def check(
        self,
        time: float,
        sensors: Sensors,
        velocity_command: np.ndarray,
        now: float | None = None,
        acting: bool = True,
    ) -> Violation | None:
        """Return the first rule that a reading or a command breaks, or None.

        A reading that cannot be true by itself is not remembered: the next one is compared with the one before it.

        Args:
            time: when the reading was measured, on a clock that only advances [s].
            sensors: of one robot, shapes (4,), (3,), (J,), (J,).
            velocity_command: forward, sideways [m/s], turn [rad/s], shape (3,).
            now: the present on the same clock [s]; without it the age of the reading is not judged.
            acting: whether a policy obeys the command; a robot that waits, or stands up, may keep still.

        """
        command = np.asarray(velocity_command, dtype=np.float64).tolist()
        good = _Good.of(time, sensors)
        return (
            self._finite(good)
            or self._in_time(time, now)
            or self._orientation(good)
            or self._joints(good)
            or self._motion(good, acting and _norm(command) > MOVING)
            or self._command(command)
        )

    def _broken(self, rule: str, value: float, limit: float, joint: int | None = None, unit: str = "") -> Violation:
        """Return a violation; its unit is the rule's where none is given."""
        name = None if joint is None else self._names[joint]
        return Violation(rule, name, float(value), float(limit), unit or RULES[rule].unit)

    def _finite(self, good: _Good) -> Violation | None:
        """Judge every number by itself."""
        most = self.limits["not finite"]
        others = [*good.quaternion, *good.rate, good.time]
        # A comparison with NaN is false.
        if np.abs(good.joints).max() <= most and all(abs(value) <= most for value in others[:-1]):
            return None if math.isfinite(good.time) else self._broken("not finite", good.time, most, unit="s")
        for values, unit in ((good.position, "rad"), (good.velocity, "rad/s")):
            wrong = ~(np.abs(values) <= most)
            if wrong.any():
                worst = int(np.argmax(wrong))
                return self._broken("not finite", values[worst], most, worst, unit)
        return self._broken("not finite", next(value for value in others if not abs(value) <= most), most)

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
        length, most = _norm(good.quaternion), self.limits["quaternion length"]
        if not abs(length - 1.0) <= most:
            return self._broken("quaternion length", length, 1.0 + math.copysign(most, length - 1.0))
        fastest = max(map(abs, good.rate))
        if fastest > self.limits["turn rate"]:
            return self._broken("turn rate", fastest, self.limits["turn rate"])
        if self._fresh:
            lean = math.acos(min(1.0, max(-1.0, good.up[2])))
            if lean > self.limits["leans at the start"]:
                return self._broken("leans at the start", lean, self.limits["leans at the start"])
            near, least = math.hypot(*good.quaternion[:2]), self.limits["half turn at the start"]
            # A lower bound: infinity, which switches rules off, would here refuse everything.
            if near < least < math.inf:
                return self._broken("half turn at the start", near, least)
        return None

    def _joints(self, good: _Good) -> Violation | None:
        """Judge angles and velocities by themselves, and angles beside the last."""
        position, velocity, limits = good.position, good.velocity, self.limits
        away = np.abs(position - self._middle)
        if (away - self._half).max() > 0.0:
            worst = int(np.argmax(away - self._half))
            limit = self._middle[worst] + math.copysign(self._half[worst], position[worst] - self._middle[worst])
            return self._broken("joint range", position[worst], limit, worst)
        speed, rate = np.abs(velocity), limits["joint rate"]
        if speed.max() > rate:
            return self._broken("joint rate", speed.max(), rate, int(np.argmax(speed)))
        if self._before is not None:
            moved = np.abs(position - self._before.position)
            allowed = rate * (good.time - self._before.time) + limits["joint jump"]
            if moved.max() > allowed:
                return self._broken("joint jump", moved.max(), allowed, int(np.argmax(moved)))
        return None

    def _motion(self, good: _Good, walking: bool) -> Violation | None:
        """Judge the reading beside those before, and remember it: what disagrees now has to go on doing so."""
        # Remembered whatever is found: who asks again every period must not be let through now and then.
        before, self._before, self._fresh = self._before, good, False
        if before is None:
            good.begin()
            return None
        # Of q and -q, which are one orientation, and of lengths that are off by some per cent.
        near = abs(sum(a * b for a, b in zip(good.quaternion, before.quaternion, strict=True)))
        turned = 2.0 * math.acos(min(1.0, near / (_norm(good.quaternion) * _norm(before.quaternion))))
        allowed = self.limits["turn rate"] * (good.time - before.time) + self.limits["orientation jump"]
        if turned > allowed:
            return self._broken("orientation jump", turned, allowed)
        good.follow(before, self._adds_up, walking)
        return self._disagrees(good) or self._frozen(good)

    def _disagrees(self, good: _Good) -> Violation | None:
        """Judge the orientation beside the gyroscope, angles beside velocities."""
        off, most = _norm([u - p for u, p in zip(good.up, good.turned, strict=True)]), self.limits
        if off > most["attitude and gyroscope"]:
            return self._broken("attitude and gyroscope", off, most["attitude and gyroscope"])
        apart = np.abs(good.position - good.moved)
        if apart.max() > most["velocity and angle"]:
            return self._broken("velocity and angle", apart.max(), most["velocity and angle"], int(np.argmax(apart)))
        return None

    def _frozen(self, good: _Good) -> Violation | None:
        """Judge for how long nothing has changed."""
        if (still := good.time - good.imu_changed) >= self.limits["frozen IMU"]:
            return self._broken("frozen IMU", still, self.limits["frozen IMU"])
        since = float(good.joint_changed.min())
        if (still := good.time - since) >= self.limits["frozen joint"]:
            joint = int(np.argmin(good.joint_changed))
            return self._broken("frozen joint", still, self.limits["frozen joint"], joint)
        return None

    def _command(self, command: list[float]) -> Violation | None:
        """Judge the command, NaN included."""
        slack = self.limits["command"]
        for value, low, high, axis in zip(command, *self._commands, VELOCITY, strict=True):
            if not low - slack <= value <= high + slack:
                return self._broken("command", value, low if value < low else high, unit=f"{axis.unit} {axis.name}")
        return None


class _Good:
    """A reading as numbers, and what follows from it and those before it."""

    def __init__(self, time: float, quaternion: list[float], rate: list[float], joints: np.ndarray) -> None:
        """Keep one reading; `joints`: angles and velocities, shape (2, J)."""
        self.time, self.quaternion, self.rate = time, quaternion, rate
        self.joints, self.position, self.velocity = joints, joints[0], joints[1]
        self.up = list(up_axis(*quaternion))
        """The world's up as the base sees it."""

    @classmethod
    def of(cls, time: float, sensors: Sensors) -> _Good:
        """Return a reading of sensors; raise `PolicyError` where their shapes are not those of one robot."""
        quaternion, rate = np.asarray(sensors.quaternion), np.asarray(sensors.angular_velocity)
        position = np.asarray(sensors.joint_position)
        joints = np.array([position, sensors.joint_velocity], dtype=np.float64)
        if quaternion.shape != (4,) or rate.shape != (3,) or joints.ndim != 2:
            raise PolicyError(
                f"sensors of the shapes {quaternion.shape}, {rate.shape}, {position.shape}; expected those of one "
                "robot: (4,), (3,), (joints,)"
            )
        # Lists: on three numbers NumPy takes several times as long, and this runs at every reading.
        return cls(float(time), quaternion.tolist(), rate.tolist(), joints)

    def begin(self) -> None:
        """Be the first reading, or the first after a gap."""
        self.turned, self.moved = self.up, self.position
        self.imu_changed, self.joint_changed = self.time, np.full(len(self.position), self.time)

    def follow(self, before: _Good, gap: float, walking: bool) -> None:
        """Add up from the reading before: where gyroscope and velocities say that the robot is now, what has changed.

        The up axis, seen from a base that turns with ω, moves as u × ω. Over more than a gap [s] nothing is added up.
        """
        elapsed = self.time - before.time
        if elapsed > gap:
            self.turned, self.moved = self.up, self.position
        else:
            self._add(before, elapsed)
        same = self.quaternion == before.quaternion and self.rate == before.rate
        self.imu_changed = before.imu_changed if same else self.time
        if walking:
            stuck = (self.position == before.position) & (self.velocity == before.velocity)
            self.joint_changed = np.where(stuck, before.joint_changed, self.time)
        else:
            self.joint_changed = np.full(len(self.position), self.time)

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


def _norm(values: list[float]) -> float:
    """Return the length of a short vector."""
    return math.sqrt(sum(value * value for value in values))


def compare_drive(
    contract: Contract,
    kp: np.ndarray | None = None,
    kd: np.ndarray | None = None,
    torque_limit: np.ndarray | None = None,
) -> list[Violation]:
    """Return by joint where the drives have other gains and limits than the contract: those that a policy learned with.

    Args:
        contract: of the policy.
        kp: read back from the drives [N m/rad], shape (J,) in the order of the contract's joints; None where the
            transport cannot read it.
        kd: the same [N m s/rad].
        torque_limit: the same [N m].

    Raises `PolicyError` for another number of joints.
    """
    allowed, found = limits_of({}), []
    for name, unit, given in (
        ("kp", "N m/rad", kp),
        ("kd", "N m s/rad", kd),
        ("torque_limit", "N m", torque_limit),
    ):
        if given is None:
            continue
        values, right = np.asarray(given, dtype=np.float64), contract.array(name)
        if values.shape != right.shape:
            raise PolicyError(f"{name} of {values.shape} drives; expected {right.shape}, one for each joint")
        rule = f"drive {name.replace('_', ' ')}"
        # Infinity less infinity is NaN, which is near nothing, and is reported as a violation.
        with np.errstate(invalid="ignore"):
            near = np.abs(values - right) <= allowed[rule] * np.abs(right)
        for joint in np.flatnonzero(~near):
            found.append(Violation(rule, contract.joint_names[joint], float(values[joint]), float(right[joint]), unit))
    return found
