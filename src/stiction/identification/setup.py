"""How a log was made: what `stiction identify` takes as flags. No estimator is needed to read it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import Annotated, Literal

from stiction.core.errors import ConfigurationError
from stiction.core.flags import SETTING
from stiction.files.log import LARGEST_NUMBER, LogSetup
from stiction.identification.drive import Drive
from stiction.robots.model import GRAVITY

LARGEST_TORQUE = 2000.0
"""More than any joint of a legged robot delivers [N m]."""

LARGEST_VALUE = 1e9
"""In SI units no joint has more of anything."""

LONGEST_DELAY = 1.0
"""Delay that is believed [s]; a controller that is later holds no joint."""


@dataclass(frozen=True)
class Payload:
    """A known mass hung on the joint, which makes the torque's scale visible."""

    mass: float
    """[kg]."""
    distance: float
    """Of its centre from the joint's axis, which lies level [m]."""
    angle: float
    """Angle of the joint at which it hangs straight down [rad]."""

    @property
    def weight(self) -> float:
        """Largest torque of its weight, m g r [N m]."""
        return self.mass * GRAVITY * self.distance

    @property
    def inertia(self) -> float:
        """As a point mass, m r² [kg m²]."""
        return self.mass * self.distance**2


@dataclass(frozen=True)
class IdentifySetup:
    """How the log was made; a field that is None is taken from the log's sidecar, if that has it."""

    kp: float | None = None
    """Proportional gain of the controller during the log [N m/rad, or N/m]."""
    kd: float | None = None
    """Derivative gain during the log [N m s/rad, or N s/m]."""
    torque_limit: float | None = None
    """Largest torque of the motor, at the joint [N m, or N; with torque_calibrated false in the unit of the torque
    column]."""
    torque_source: Literal["motor_side", "output_side"] | None = None
    """Where torque was measured: motor_side is current or command (joint friction not in it), output_side a sensor
    behind the gear, from which joint friction cannot be found."""
    test_condition: Literal["bare_motor", "in_air", "loaded"] | None = None
    """What hung on the motor."""
    axis: Literal["rotary", "linear"] | None = None
    """Linear: read kg, N and m."""
    torque_scale: float | None = None
    """N m (or N) per unit of the torque column: a torque constant, or -1 where the sign is the other way round; 1 if
    not given. Where the column holds something else, A, V or a share of full duty per unit: 0.01 for percent."""
    torque_column: Literal["torque", "current", "voltage", "duty"] | None = None
    """What the torque column holds, times the scale: torque if not given, and with --duty-voltage a duty, from -1 to 1.
    Torque is then kt current, or kt (voltage - ke speed)/R. Gains, where given, stay those of the torque."""
    duty_voltage: float | None = None
    """Voltage across the motor at a duty of 1, that of the supply [V]; the torque column is a duty then."""
    kt: float | None = None
    """Torque constant at the joint: that of the motor times the gear ratio [N m/A]."""
    resistance: float | None = None
    """Of the motor and its driver, for a duty or a voltage [ohm]. Without kt and this the scale of torque is not known,
    unless a pendulum or a payload tells it."""
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
    velocity_delay: Annotated[float | None, SETTING] = None
    """How late the velocity is that the controller uses [s]: half a sample for a difference over one sample, plus its
    filter; 0 if not given. It matters to output error alone."""
    delay: Annotated[float | None, SETTING] = None
    """How late the whole controller is, from sensors and target to torque [s]; 0 if not given."""
    motor_strength: Annotated[float | None, SETTING] = None
    """k, torque delivered over torque logged or commanded. Position-only logs do not show it: whoever gives it here
    vouches for the scale of all that follows."""
    torque_calibrated: Annotated[bool | None, SETTING] = None
    """Whether the torque column, times the scale, is in N m; true if not given. A current without a torque constant is
    not: inertia and friction then come out over k."""
    payload_mass: float | None = None
    """A known mass hung on the joint for this log [kg], which tells k."""
    payload_distance: float | None = None
    """Distance of the payload's centre from the axis [m]."""
    payload_angle: float | None = None
    """Angle of the joint at which the payload hangs straight down [rad]."""
    pendulum_mass: float | None = None
    """Mass of all that hangs on the joint, where that is known: its weight is then the gravity of this log, none is
    fitted, and it tells the scale of the torque [kg]."""
    pendulum_length: float | None = None
    """Distance of its centre of mass from the axis, which lies level [m]."""
    pendulum_angle: Annotated[float | None, SETTING] = None
    """Angle of the joint at which it hangs straight down [rad]; found from the log if not given."""
    hanging_angle: Annotated[float | None, SETTING] = None
    """Angle of the joint, known from the geometry, at which the link hangs straight down [rad]: gravity then tells
    the encoder's bias."""
    unknowns: Annotated[tuple[Literal["encoder_bias"], ...], SETTING] = ()
    """Bias of the encoder, to be found too."""
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
        """Return the setup for another log of the same joint: what hung on it is for that log's sidecar to say."""
        bare = replace(self, pendulum_mass=None, pendulum_length=None, pendulum_angle=None)
        return replace(bare, payload_mass=None, payload_distance=None, payload_angle=None)

    @property
    def drive(self) -> Drive:
        """What the torque column holds."""
        column = self.torque_column or ("torque" if self.duty_voltage is None else "duty")
        return Drive(column, self.duty_voltage, self.kt, self.resistance, self.ke)

    @property
    def calibrated(self) -> bool:
        """Whether the torque column, if there is one, comes out in N m."""
        return self.torque_calibrated is not False and self.drive.per_unit is not None

    @property
    def pendulum(self) -> bool:
        """Whether all that hangs on the joint is known."""
        return self.pendulum_mass is not None

    @property
    def fits_gravity(self) -> bool:
        """Whether gravity enters the torque equation."""
        if self.pendulum:
            return False
        if self.gravity is None:
            return self.test_condition == "in_air" and self.axis != "linear"
        return self.gravity

    @property
    def payload(self) -> Payload | None:
        """The known payload, if there is one; a pendulum is one, once its angle is known."""
        if self.pendulum_mass is not None and self.pendulum_length is not None and self.pendulum_angle is not None:
            return Payload(self.pendulum_mass, self.pendulum_length, self.pendulum_angle)
        if self.payload_mass is None or self.payload_distance is None or self.payload_angle is None:
            return None
        return Payload(self.payload_mass, self.payload_distance, self.payload_angle)

    def check(self) -> None:
        """Raise `StictionError` for numbers that no set-up has, and for torque from which friction cannot be found."""
        positive = ("kp", "torque_limit", "motor_strength", *PAYLOAD[:2], *PENDULUM[:2])
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
        given = [name for name in PAYLOAD if getattr(self, name) is not None]
        if given and len(given) < len(PAYLOAD):
            missing = next(name for name in PAYLOAD if name not in given)
            raise ConfigurationError(f"{given[0]} without {missing}: a payload needs mass, distance and angle")
        self._check_pendulum(given)
        self.check_torque_limit()
        self.drive.check()
        for name in ("payload_angle", "pendulum_angle", "hanging_angle"):
            value = getattr(self, name)
            if value is not None and not isfinite(value):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected an angle in rad")
        if self.axis == "linear" and (given or self.pendulum or self.gravity or self.hanging_angle is not None):
            raise ConfigurationError("a linear axis has no hanging angle: payload and gravity are for rotary joints")

    def check_torque_limit(self) -> None:
        """Refuse a limit that no motor has, of which any friction is a vanishing share: raises `ConfigurationError`."""
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
        """Refuse half a pendulum, and one beside other weights; payload: what of a payload was given."""
        given = [name for name in PENDULUM if getattr(self, name) is not None]
        missing = [name for name in PENDULUM[:2] if name not in given]
        if given and missing:
            raise ConfigurationError(f"{given[0]} without {missing[0]}: a pendulum needs mass and length")
        if given and (payload or self.gravity):
            other = payload[0] if payload else "gravity"
            raise ConfigurationError(
                f"{given[0]} and {other}: a pendulum is all that hangs on the joint; leave {other} out, or give the "
                "known part as a payload"
            )


PAYLOAD = ("payload_mass", "payload_distance", "payload_angle")
"""All of them, or none."""

PENDULUM = ("pendulum_mass", "pendulum_length", "pendulum_angle")
"""The first two, or none."""
