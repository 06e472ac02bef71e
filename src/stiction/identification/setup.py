"""Set-up of a log: the flags of `stiction identify`, and the conversion of the torque column to torque.

A motor of torque constant kt [N m/A] and back-EMF ke [V s/rad], both at the joint, gear included, at a voltage U gives

    τ = kt (U − ke θ') / R,          U = duty times the supply's voltage

in SI ke is kt, but for what the gear loses. The brake kt ke/R is one with viscous friction in every such log: both are
proportional to the speed, at any supply voltage. What tells them apart is ke (from kt, or from kt/R by a known weight,
and R), or a run of the same joint whose current was logged. No estimator is needed to read any of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from math import isfinite
from typing import Annotated, Literal

import numpy as np

from stiction.core.effects import needs
from stiction.core.errors import ConfigurationError, LogError
from stiction.core.flags import SETTING
from stiction.core.rotation import GRAVITY
from stiction.files.log import LARGEST_NUMBER, LogSetup

LARGEST_DUTY = 1.02
"""Largest duty: a bridge that is always on, with rounding, makes no more."""

PERCENT = 0.1
"""Scale of a duty column below which it is declared to be in percent or counts."""

BACK_EMF_ERROR = 0.1
"""Share of kt ke/R that the interval of viscous friction admits where ke was assumed: copper that is 25 K
warmer has a tenth more resistance. A choice."""


@dataclass(frozen=True)
class Drive:
    """Conversion of the torque column to torque."""

    column: str = "torque"
    """Content of the column, one of `TorqueColumn`."""
    supply: float | None = None
    """Voltage at a duty of 1 [V]."""
    kt: float | None = None
    """Torque constant at the joint [N m/A]."""
    resistance: float | None = None
    """Resistance R [Ω]."""
    ke: float | None = None
    """Back-EMF at the joint [V s/rad]; None where it was not stated."""

    @property
    def by_voltage(self) -> bool:
        """True if the column is a voltage or a duty."""
        return self.column in ("voltage", "duty")

    @property
    def back_emf(self) -> float | None:
        """Back-EMF constant: ke, else kt, which is the same in SI [V s/rad]; None where neither is known."""
        return self.kt if self.ke is None else self.ke

    @property
    def per_unit(self) -> float | None:
        """Torque per volt or ampere [N m/V, N m/A]; None where that is not known, 1 for torque."""
        if self.column == "torque":
            return 1.0
        if self.column == "current":
            return self.kt
        return None if self.kt is None or self.resistance is None else self.kt / self.resistance

    @property
    def brake(self) -> float:
        """Brake of the motor that was subtracted, in the unit of the torque over speed; 0 where ke is not known."""
        return 0.0 if not self.by_voltage or self.back_emf is None else (self.per_unit or 1.0) * self.back_emf

    @property
    def brakes_unseen(self) -> bool:
        """True if kt ke/R is part of what looks like viscous friction."""
        return self.by_voltage and self.back_emf is None

    @property
    def lacking(self) -> tuple[str, ...]:
        """Missing flags without which the torque's unit is not known."""
        if self.column == "torque" or self.per_unit is not None:
            return ()
        needed = {"--kt": self.kt} | ({"--resistance": self.resistance} if self.by_voltage else {})
        return tuple(flag for flag, value in needed.items() if value is None)

    def check(self) -> None:
        """Raise `ConfigurationError` for impossible numbers, and for numbers without effect."""
        named = {
            "duty voltage": self.supply,
            "kt": self.kt,
            "resistance": self.resistance,
            "ke": self.ke,
        }
        for name, value in named.items():
            if value is not None and not (isfinite(value) and value > 0):
                raise ConfigurationError(f"{name} {value}: expected a positive number")
        if self.column == "duty" and self.supply is None:
            raise ConfigurationError("torque column duty: expected the supply's voltage too, --duty-voltage V")
        # R and ke do nothing to a current, but may hold for other runs of the same motor in the same fit.
        motor = ("kt", "resistance", "ke")
        effective = {"torque": (), "current": motor, "voltage": motor, "duty": tuple(named)}
        for name, value in named.items():
            if value is not None and name not in effective[self.column]:
                raise ConfigurationError(
                    f"{name} {value:g} has no effect on a torque column that holds {self.column}; say what it holds: "
                    "--duty-voltage V for a duty, --torque-column voltage or current"
                )

    def torque(self, where: str, column: np.ndarray, scale: float, velocity: np.ndarray) -> np.ndarray:
        """Return the torque, or U − ke θ' [V], or the current, where its scale is not known; shape (num_samples,).

        where: log and joint, for messages; column: times `scale` already; velocity: θ' [rad/s], both (num_samples,).
        Raises `LogError` for a duty outside -1 to 1.
        """
        signal = column
        if self.column == "duty":
            _check_duty(where, column, scale)
            signal = column * float(self.supply or 1.0)
        if self.by_voltage and self.back_emf is not None:
            signal = signal - self.back_emf * velocity
        return (self.per_unit or 1.0) * signal


def _check_duty(where: str, duty: np.ndarray, scale: float) -> None:
    """Reject a duty in percent or counts, and a share that was declared to be percent."""
    most = float(np.abs(duty).max())
    if most > LARGEST_DUTY:
        raise LogError(
            f"{where}: the duty reaches {most:.4g}; expected a share from -1 to 1: in percent give --torque-scale "
            "0.01, in counts one over the count of full duty; if the column is in volts, --torque-column voltage"
        )
    # Before it was scaled the column was at most one: no percent, and no count.
    if abs(scale) < PERCENT and most <= abs(scale):
        raise LogError(
            f"{where}: the duty column reaches {most / abs(scale):.4g}, which is {most:.2g} of full duty by "
            f"--torque-scale {scale:g}: it looks like a share already; leave --torque-scale out"
        )


LARGEST_TORQUE = 2000.0
"""Largest torque of a joint of any legged robot [N m]."""

LARGEST_VALUE = 1e9
"""Largest value of any quantity in SI units."""

LONGEST_DELAY = 1.0
"""Longest plausible delay [s]; a controller that is later holds no joint."""


@dataclass(frozen=True)
class Payload:
    """A known mass hung on the joint, which makes the torque's scale visible."""

    mass: float
    """Mass [kg]."""
    distance: float
    """Distance of its centre from the joint's axis, which lies level [m]."""
    angle: float
    """Angle of the joint at which it hangs straight down [rad]."""

    @property
    def weight(self) -> float:
        """Largest torque of the weight, m g r [N m]."""
        return self.mass * GRAVITY * self.distance

    @property
    def inertia(self) -> float:
        """Inertia as a point mass, m r² [kg m²]."""
        return self.mass * self.distance**2


@dataclass(frozen=True, kw_only=True)
class IdentifySetup:
    """Set-up of a log; a field that is None is taken from the log's sidecar, if that has it."""

    kp: float | None = None
    """Proportional gain of the controller during the log [N m/rad, or N/m]."""
    kd: float | None = None
    """Derivative gain during the log [N m s/rad, or N s/m]."""
    torque_limit: float | None = None
    """Largest torque of the motor, at the joint [N m, or N; with torque_calibrated false in the unit of the torque
    column]."""
    torque_source: Literal["motor_side", "output_side"] | None = None
    """Side of the torque measurement: motor_side is current or command (joint friction not in it), output_side a sensor
    behind the gear, from which joint friction cannot be found."""
    test_condition: Literal["bare_motor", "in_air", "loaded"] | None = None
    """Load on the motor during the log."""
    axis: Literal["rotary", "linear"] | None = None
    """Kind of axis; linear: read kg, N and m."""
    torque_scale: float | None = None
    """N m (or N) per unit of the torque column: a torque constant, or -1 where the sign is the other way round; 1 if
    not given. Where the column holds something else, A, V or a share of full duty per unit: 0.01 for percent."""
    torque_column: Literal["torque", "current", "voltage", "duty"] | None = None
    """Content of the torque column, times the scale: torque if not given, and with --duty-voltage a duty, from -1 to 1.
    Torque is then kt current, or kt (voltage - ke speed)/R. Gains, where given, stay those of the torque."""
    duty_voltage: float | None = None
    """Voltage across the motor at a duty of 1, that of the supply [V]; the torque column is a duty then."""
    kt: float | None = None
    """Torque constant at the joint: that of the motor times the gear ratio [N m/A]."""
    resistance: float | None = None
    """Resistance of motor and driver, for a duty or a voltage [ohm]. Without kt and this the scale of torque is not
    known, unless a pendulum or a payload tells it."""
    ke: Annotated[float | None, SETTING] = None
    """Back-EMF at the joint [V s/rad], a supply's voltage over the speed without load; kt if not given, the same in SI
    but for what the gear loses."""
    disturbance_scale: Annotated[float | None, SETTING] = None
    """N m (or N) per unit of the disturbance column; negative where it counts against the position; 1 if not given."""
    feedforward_scale: Annotated[float | None, SETTING] = None
    """N m (or N) per unit of the feedforward column; that of the torque column if not given, for both are the
    controller's."""
    position_scale: float | None = None
    """rad (or m) per unit of position, target and velocity; 1 if not given. 0.0174533 for degrees, one over the gear
    ratio for the angle of a motor."""
    walking_kp: Annotated[float | None, SETTING] = None
    """Proportional gain with which the robot walks [N m/rad], where the log was made with another: the dead band, and
    whether friction matters, are of this one; kp if not given."""
    velocity_delay: Annotated[float | None, SETTING] = None
    """Delay of the velocity that the controller uses [s]: half a sample for a difference over one sample, plus its
    filter; 0 if not given. It affects output error only."""
    delay: Annotated[float | None, SETTING] = None
    """Delay of the whole controller, from sensors and target to torque [s]; 0 if not given."""
    motor_strength: Annotated[float | None, SETTING] = None
    """Motor strength k, torque delivered over torque logged or commanded. Position-only logs do not show it: all
    results then have the scale of this value."""
    torque_calibrated: Annotated[bool | None, SETTING] = None
    """True if the torque column, times the scale, is in N m; true if not given. A current without a torque constant is
    not: inertia and friction then come out over k."""
    payload_mass: float | None = None
    """Known mass hung on the joint for this log [kg], which tells k."""
    payload_distance: float | None = None
    """Distance of the payload's centre from the axis [m]."""
    payload_angle: float | None = None
    """Angle of the joint at which the payload hangs straight down [rad]."""
    pendulum_mass: float | None = None
    """Mass of all that hangs on the joint, if known: its weight is then the gravity of this log, none is
    fitted, and it tells the scale of the torque [kg]."""
    pendulum_length: float | None = None
    """Distance of its centre of mass from the axis, which lies level [m]."""
    pendulum_angle: Annotated[float | None, SETTING] = None
    """Angle of the joint at which it hangs straight down [rad]; found from the log if not given."""
    hanging_angle: Annotated[float | None, SETTING] = None
    """Angle of the joint, known from the geometry, at which the link hangs straight down [rad]: gravity then tells
    the encoder's bias."""
    unknowns: Annotated[tuple[Literal["encoder_bias"], ...], SETTING] = ()
    """Bias of the encoder, to be estimated too."""
    gravity: bool | None = None
    """Fit gravity on the link; by default for a leg in the air, and where the test condition is loaded or not stated,
    if it predicts parts of the log that the fit did not see better."""
    cutoff: Annotated[float | None, SETTING] = None
    """Corner of the filter [Hz]; by default as high as the noise of the acceleration lets."""

    def with_sidecar(self, sidecar: LogSetup) -> IdentifySetup:
        """Return the setup with what is None filled from the log's sidecar."""
        shared = {item.name for item in fields(LogSetup)} & {item.name for item in fields(self)}
        # Without a flag `unknowns` is an empty tuple, all else None.
        return replace(self, **{name: getattr(sidecar, name) for name in shared if getattr(self, name) in (None, ())})

    def for_repeat(self) -> IdentifySetup:
        """Return the setup for another log of the same joint, without a load, which that log's sidecar states."""
        bare = replace(self, pendulum_mass=None, pendulum_length=None, pendulum_angle=None)
        return replace(bare, payload_mass=None, payload_distance=None, payload_angle=None)

    @property
    def used_kp(self) -> float | None:
        """Proportional gain with which the robot walks [N m/rad], that of the log where no other is given."""
        return self.walking_kp or self.kp

    @property
    def drive(self) -> Drive:
        """Content of the torque column."""
        column = self.torque_column or ("torque" if self.duty_voltage is None else "duty")
        return Drive(column, self.duty_voltage, self.kt, self.resistance, self.ke)

    @property
    def calibrated(self) -> bool:
        """True if the torque column, if logged, is converted to N m."""
        return self.torque_calibrated is not False and self.drive.per_unit is not None

    @property
    def pendulum(self) -> bool:
        """True if all that hangs on the joint is known."""
        return self.pendulum_mass is not None

    @property
    def fits_gravity(self) -> bool:
        """True if gravity enters the torque equation."""
        if self.pendulum:
            return False
        if self.gravity is None:
            return self.test_condition == "in_air" and self.axis != "linear"
        return self.gravity

    @property
    def payload(self) -> Payload | None:
        """Known payload, or None; a pendulum is one, once its angle is known."""
        if self.pendulum_mass is not None and self.pendulum_length is not None and self.pendulum_angle is not None:
            return Payload(self.pendulum_mass, self.pendulum_length, self.pendulum_angle)
        if self.payload_mass is None or self.payload_distance is None or self.payload_angle is None:
            return None
        return Payload(self.payload_mass, self.payload_distance, self.payload_angle)

    def check(self) -> None:
        """Raise `StictionError` for impossible numbers, and for torque from which friction cannot be found."""
        positive = ("kp", "walking_kp", "torque_limit", "motor_strength", *PAYLOAD[:2], *PENDULUM[:2])
        for name in (*positive, "kd", "delay", "velocity_delay"):
            value, less = getattr(self, name), "" if name in positive else ", or 0"
            if value is not None and not (isfinite(value) and (value > 0 or (value == 0 and less))):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected a positive number{less}")
            if value is not None and value > (most := LONGEST_DELAY if name.endswith("delay") else LARGEST_NUMBER):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected at most {most:g}")
        for name in ("torque_scale", "disturbance_scale", "feedforward_scale", "position_scale"):
            if getattr(self, name) is not None and not 1e-9 <= abs(getattr(self, name)) <= 1e9:
                raise ConfigurationError(
                    f"{name.replace('_', ' ')} {getattr(self, name)}: expected a size between 1e-9 and 1e9"
                )
        if self.torque_source == "output_side":
            raise ConfigurationError(
                "torque source output_side: a sensor behind the gear does not see the joint's friction; "
                "use the motor's current or command (motor_side)"
            )
        stated = [name for name in PAYLOAD if getattr(self, name) is not None]
        if stated and len(stated) < len(PAYLOAD):
            missing = next(name for name in PAYLOAD if name not in stated)
            raise ConfigurationError(f"{stated[0]} without {missing}: a payload needs mass, distance and angle")
        self._check_pendulum(stated)
        self.check_torque_limit()
        self.drive.check()
        for name in ("payload_angle", "pendulum_angle", "hanging_angle"):
            value = getattr(self, name)
            if value is not None and not isfinite(value):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected an angle in rad")
        if self.axis == "linear" and (stated or self.pendulum or self.gravity or self.hanging_angle is not None):
            raise ConfigurationError("a linear axis has no hanging angle: payload and gravity are for rotary joints")

    def check_torque_limit(self) -> None:
        """Reject a torque limit above that of any motor: raises `ConfigurationError`."""
        limit = self.torque_limit
        if limit is None or limit <= LARGEST_TORQUE:
            return
        if self.axis != "linear" and self.calibrated:
            raise ConfigurationError(
                f"torque limit {limit:g}: expected at most {LARGEST_TORQUE:g} N m, what the motor gives at the joint; "
                "of a linear axis say so: --axis linear"
            )
        if not limit <= LARGEST_VALUE:
            raise ConfigurationError(f"torque limit {limit:g}: expected at most {LARGEST_VALUE:g}")

    def _check_pendulum(self, payload: list[str]) -> None:
        """Reject half a pendulum, and one together with other weights; payload: stated fields of a payload."""
        stated = [name for name in PENDULUM if getattr(self, name) is not None]
        missing = [name for name in PENDULUM[:2] if name not in stated]
        if stated and missing:
            raise ConfigurationError(f"{stated[0]} without {missing[0]}: a pendulum needs mass and length")
        if stated and (payload or self.gravity):
            other = payload[0] if payload else "gravity"
            raise ConfigurationError(
                f"{stated[0]} and {other}: a pendulum is all that hangs on the joint; leave {other} out, or give the "
                "known part as a payload"
            )


PAYLOAD = ("payload_mass", "payload_distance", "payload_angle")
"""Fields of a payload: all of them are set, or none."""

PENDULUM = ("pendulum_mass", "pendulum_length", "pendulum_angle")
"""Fields of a pendulum: the first two are set, or none."""


SINGLE = (*PAYLOAD, *PENDULUM, "hanging_angle", "gravity")
"""Fields of `IdentifySetup` for one joint alone: a robot's model replaces them."""


@dataclass(frozen=True)
class LimbSetup:
    """Set-up of a log in which all joints of a limb move."""

    model_error: float = field(default=0.1, metadata=needs("--robot"))
    """Standard deviation of each link's errors in the model: of mass and inertia as shares, of the centre of mass as a
    share of the link's radius of gyration [1]. Estimates and intervals admit it. A drawing or a maker's file, with its
    cables, screws and gear boxes, is seldom better than a tenth."""
    timing_error: Annotated[float, SETTING] = field(default=0.5, metadata=needs("--robot"))
    """Standard deviation of the shift in time of all torques in the log against the angles, over its step [1]: a
    controller that holds its torque between updates is half a step off."""
    up: tuple[float, float, float] | None = field(default=None, metadata=needs("--robot"))
    """Direction up in the base's frame; by default as the robot's file has it."""
    joint_map: tuple[str, ...] = field(default=(), metadata=needs("--robot"))
    """LOG=MODEL pairs for joints that are called otherwise in the log, such as joint_1=shoulder_pan."""

    def check_with(self, declared: IdentifySetup) -> None:
        """Raise `ConfigurationError` for impossible values, and for declarations of a single joint's log."""
        for name in ("model_error", "timing_error"):
            value = getattr(self, name)
            if not (isfinite(value) and 0 < value <= 1):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected more than 0 and at most 1")
        if self.joint_map:
            from stiction.files.joint_map import parse_joint_map

            parse_joint_map(self.joint_map)
        single = [name for name in SINGLE if getattr(declared, name) is not None] + list(declared.unknowns)
        if single:
            raise ConfigurationError(
                f"{single[0].replace('_', ' ')} is for a single joint; with --robot the model says what the links "
                "weigh and carry: leave it out, or put the load into the model"
            )
        if declared.axis == "linear" or declared.test_condition == "bare_motor":
            what = "a linear axis" if declared.axis == "linear" else "a bare motor"
            raise ConfigurationError(f"{what} is no part of a limb: identify it without --robot")
