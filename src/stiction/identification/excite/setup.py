"""Knowledge of a joint before it is moved: the flags of `stiction excite`. No estimator is needed to read it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, isfinite

from stiction.core.errors import ConfigurationError
from stiction.robots.model import WIDEST, Joint

SHORTEST = 4.0
"""Shortest log that is designed [s]: in a shorter one a slow and a fast part do not fit."""

MOST_SAMPLES = 1_000_000
"""Most samples of a trajectory: half an hour at 500 Hz."""

SLOWEST_RATE = 50.0
"""Lowest rate of the controller [Hz]: below it the joint does not get a target of straight lines."""

DEFAULTS = {"kp": 20.0, "kd": 0.5, "torque_limit": 20.0, "inertia": 0.0145, "viscous": 0.07, "coulomb": 0.2}
"""Values where neither the user nor a robot gives any: the paper's Saturn Lite shank under low gains, with friction of
the usual 1 % of the torque limit."""

FROM_ROBOT = {"inertia": "armature", "viscous": "damping", "coulomb": "frictionloss"}
"""Field of the setup -> field of a robot's joint that fills it in, where its name is another."""

POSITIVE = ("kp", "torque_limit", "speed_limit", "rate", "duration", "inertia", "coulomb", "wanted")
NOT_NEGATIVE = ("kd", "viscous", "noise_position", "resolution")
FINITE = ("start", "gravity_sin", "gravity_cos")
"""Fields by the values that they may have."""


@dataclass(frozen=True, kw_only=True)
class ExciteSetup:
    """Joint, controller, limits and sensors. Guesses suffice: the design holds over a range around them."""

    kp: float | None = None
    """Proportional gain of the controller [N m/rad]; from --robot, else 20."""
    kd: float | None = None
    """Derivative gain [N m s/rad]; from --robot, else 0.5."""
    torque_limit: float | None = None
    """Largest torque of the motor, at the joint [N m]; from --robot, whose it may not exceed, else 20."""
    position_limits: tuple[float, float] | None = None
    """Lowest and highest angle [rad]; from --robot, whose they may not exceed, else -0.6 0.6."""
    start: float | None = None
    """Angle at which the motion starts and ends, and about which it swings [rad]; by default the middle."""
    speed_limit: float = 10.0
    """Largest speed of the joint [rad/s]."""
    rate: float = 500.0
    """Samples per second that the controller plays back and the log holds [Hz]."""
    duration: float = 20.0
    """Length of the log [s]."""
    inertia: float | None = None
    """Guess of I, rotor and whatever hangs on it [kg m²]; from --robot (the bare motor), else 0.0145."""
    viscous: float | None = None
    """Guess of B [N m s/rad]; from --robot, else 0.07."""
    coulomb: float | None = None
    """Guess of the Coulomb friction f [N m]; from --robot, else 1 % of the torque limit."""
    spread: float = 2.0
    """Factor by which the guesses of I, B and f may be wrong, either way; limits hold and the worst case is judged over
    that range [1]."""
    gravity_sin: float = 0.0
    """Guess of the torque that holds the link at an angle of pi/2 [N m]; it is taken to grow with the inertia."""
    gravity_cos: float = 0.0
    """Guess of the torque that holds the link at an angle of 0 [N m]."""
    noise_position: float = 1e-4
    """White noise of the logged angle [rad]."""
    noise_torque: float = 0.05
    """White noise of the logged torque [N m]."""
    resolution: float = 0.0
    """Step of the logged angle [rad]; 6.2832 / 2^14 is a 14-bit encoder on the output."""
    position_only: bool = False
    """No torque will be logged: what can be known are combinations of the parameters with the motor's strength."""
    fixed_gains: bool = False
    """Keep the given gains, even where lower ones would show friction better."""
    wanted: float = 0.02
    """Relative standard deviation of f for which the necessary length of the log is given [1]."""
    seed: int = 0
    """Seed of the search."""

    @property
    def position_std(self) -> float:
        """Standard deviation of the logged angle [rad]; rounding to the step r of the encoder adds r²/12."""
        return hypot(self.noise_position, self.resolution / 12**0.5)

    def filled(self, joint: Joint | None = None) -> ExciteSetup:
        """Return the setup without None, from a robot's joint or else `DEFAULTS`; raise `StictionError` if absurd."""
        self._check_joint(joint)
        known = {} if joint is None else {name: getattr(joint, FROM_ROBOT.get(name, name)) for name in DEFAULTS}
        # Friction of zero says that nobody measured it.
        known = {name: value for name, value in known.items() if value or name not in ("viscous", "coulomb")}
        known |= {name: value for name in DEFAULTS if (value := getattr(self, name)) is not None}
        values = DEFAULTS | known
        if "coulomb" not in known:
            values["coulomb"] = 0.01 * values["torque_limit"]
        limits = self.position_limits or ((joint.lower, joint.upper) if joint else (-0.6, 0.6))
        start = 0.5 * (limits[0] + limits[1]) if self.start is None else self.start
        setup = replace(self, position_limits=limits, start=start, **values)
        setup.check()
        return setup

    def _check_joint(self, joint: Joint | None) -> None:
        """Raise `StictionError` for limits beyond a robot's joint, or that can only be degrees."""
        if self.position_limits is not None:
            low, high = self.position_limits
            flag = f"--position-limits {low:g} {high:g}"
            if joint and not joint.lower <= low < high <= joint.upper:
                raise ConfigurationError(
                    f"{flag}: {joint.name} has {joint.lower:g} to {joint.upper:g} rad; give limits within, the lower "
                    "one first, or leave them out"
                )
            if not joint and high - low > WIDEST:
                raise ConfigurationError(f"{flag}: that is more than two turns; expected radians, are these degrees?")
        if joint and self.torque_limit is not None and self.torque_limit > joint.torque_limit:
            raise ConfigurationError(
                f"--torque-limit {self.torque_limit:g}: the motor of {joint.name} has {joint.torque_limit:g} N m; give "
                "no more, or leave it out"
            )

    def check(self) -> None:
        """Raise `StictionError` for values that no joint, controller or log has, or without motion; nothing is None."""
        low, high = self.position_limits or (0.0, 0.0)
        if not (isfinite(low) and isfinite(high) and low < high):
            raise ConfigurationError(
                f"--position-limits {low} {high}: expected the lower angle, then the higher one, in rad"
            )
        positive = POSITIVE if self.position_only else (*POSITIVE, "noise_torque")
        for name in (*positive, *NOT_NEGATIVE, *FINITE):
            value, expected = getattr(self, name), "a finite number"
            if name not in FINITE:
                expected = "a positive number" if name in positive else "a number that is not negative"
            if not isfinite(value) or (name in positive and value <= 0) or (name in NOT_NEGATIVE and value < 0):
                raise ConfigurationError(f"--{name.replace('_', '-')} {value}: expected {expected}")
        needed = float(self.coulomb or 0.0) + hypot(self.gravity_sin, self.gravity_cos)
        logged = self.rate >= SLOWEST_RATE and self.duration >= SHORTEST and self.rate * self.duration <= MOST_SAMPLES
        for right, message in (
            (1 <= self.spread <= 10, f"--spread {self.spread}: expected a factor from 1 (the guesses are right) to 10"),
            (self.seed >= 0, f"--seed {self.seed}: expected a whole number that is not negative"),
            (
                low < float(self.start or 0.0) < high,
                f"--start {self.start}: expected an angle between the limits {low:g} and {high:g}",
            ),
            (
                self.noise_position > 0 or self.resolution > 0,
                "--noise-position 0 and --resolution 0: no sensor is perfect; give one of the two",
            ),
            (
                logged,
                f"--rate {self.rate:g} --duration {self.duration:g}: expected at least {SLOWEST_RATE:g} Hz and "
                f"{SHORTEST:g} s, and at most {MOST_SAMPLES} samples",
            ),
            (
                needed < float(self.torque_limit or 0.0),
                f"friction and gravity of {needed:.4g} N m against a torque limit of {self.torque_limit:g}: the motor "
                "could not move the joint; check --coulomb, --gravity-sin, --gravity-cos and --torque-limit",
            ),
        ):
            if not right:
                raise ConfigurationError(message)
