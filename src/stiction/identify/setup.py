"""How a log was made: what `stiction identify` takes as flags. No estimator is needed to read it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import Literal

from stiction.core.errors import ConfigurationError
from stiction.formats.log import LogSetup
from stiction.robots.model import GRAVITY


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
    """Largest torque of the motor, at the joint [N m, or N; with --torque-calibrated False in the unit of the torque
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
    not given."""
    disturbance_scale: float | None = None
    """N m (or N) per unit of the disturbance column; negative where it counts against the position; 1 if not given."""
    feedforward_scale: float | None = None
    """N m (or N) per unit of the feedforward column; that of the torque column if not given, for both are the
    controller's."""
    position_scale: float | None = None
    """rad (or m) per unit of position, target and velocity; 1 if not given. 0.0174533 for degrees, one over the gear
    ratio for the angle of a motor."""
    velocity_delay: float | None = None
    """How late the velocity is that the controller uses [s]: half a sample for a difference over one sample, plus its
    filter; 0 if not given. It matters to output error alone."""
    delay: float | None = None
    """How late the whole controller is, from sensors and target to torque [s]; 0 if not given."""
    motor_strength: float | None = None
    """k, torque delivered over torque logged or commanded. Position-only logs do not show it: whoever gives it here
    vouches for the scale of all that follows."""
    torque_calibrated: bool | None = None
    """Whether the torque column, times the scale, is in N m; true if not given. A current without a torque constant is
    not: inertia and friction then come out over k."""
    payload_mass: float | None = None
    """A known mass hung on the joint for this log [kg], which tells k."""
    payload_distance: float | None = None
    """Distance of the payload's centre from the axis [m]."""
    payload_angle: float | None = None
    """Angle of the joint at which the payload hangs straight down [rad]."""
    hanging_angle: float | None = None
    """Angle of the joint, known from the geometry, at which the link hangs straight down [rad]: gravity then tells
    the encoder's bias."""
    unknowns: tuple[Literal["delay", "encoder_bias"], ...] = ()
    """What output error is to find besides: the delay of the controller, the bias of the encoder."""
    gravity: bool | None = None
    """Fit gravity on the link; by default for a leg in the air, and where the test condition is loaded or not stated,
    if it predicts parts of the log that the fit did not see better."""
    cutoff: float | None = None
    """Corner of the filter [Hz]; by default as high as the noise of the acceleration lets."""

    def with_sidecar(self, sidecar: LogSetup) -> IdentifySetup:
        """Return the setup with what is None filled from the log's sidecar."""
        shared = {item.name for item in fields(LogSetup)} & {item.name for item in fields(self)}
        return replace(self, **{name: getattr(sidecar, name) for name in shared if getattr(self, name) in (None, ())})

    def for_repeat(self) -> IdentifySetup:
        """Return the setup for another log of the same joint: what hung on it is for that log's sidecar to say."""
        return replace(self, payload_mass=None, payload_distance=None, payload_angle=None)

    @property
    def fits_gravity(self) -> bool:
        """Whether gravity enters the torque equation."""
        if self.gravity is None:
            return self.test_condition == "in_air" and self.axis != "linear"
        return self.gravity

    @property
    def payload(self) -> Payload | None:
        """The known payload, if there is one."""
        if self.payload_mass is None or self.payload_distance is None or self.payload_angle is None:
            return None
        return Payload(self.payload_mass, self.payload_distance, self.payload_angle)

    def check(self) -> None:
        """Raise `StictionError` for numbers that no set-up has, and for torque from which friction cannot be found."""
        positive = ("kp", "torque_limit", "motor_strength", "payload_mass", "payload_distance")
        for name in (*positive, "kd", "delay", "velocity_delay"):
            value, less = getattr(self, name), "" if name in positive else ", or 0"
            if value is not None and not (isfinite(value) and (value > 0 or (value == 0 and less))):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected a positive number{less}")
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
        for name in ("payload_angle", "hanging_angle"):
            value = getattr(self, name)
            if value is not None and not isfinite(value):
                raise ConfigurationError(f"{name.replace('_', ' ')} {value}: expected an angle in rad")
        if self.axis == "linear" and (given or self.gravity or self.hanging_angle is not None):
            raise ConfigurationError("a linear axis has no hanging angle: payload and gravity are for rotary joints")


PAYLOAD = ("payload_mass", "payload_distance", "payload_angle")
"""All of them, or none."""
