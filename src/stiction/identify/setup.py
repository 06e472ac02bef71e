"""How a log was made: what `stiction identify` takes as flags. No estimator is needed to read it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import inf, isfinite
from typing import Literal

from stiction.formats.errors import StictionError
from stiction.formats.log import LogSetup


@dataclass(frozen=True)
class IdentifySetup:
    """How the log was made; a field that is None is taken from the log's sidecar, if that has it."""

    kp: float | None = None
    """Proportional gain of the controller during the log [N m/rad, or N/m]."""
    kd: float | None = None
    """Derivative gain during the log [N m s/rad, or N s/m]."""
    torque_limit: float | None = None
    """Largest torque of the motor, at the joint [N m, or N]."""
    torque_source: Literal["motor_side", "output_side"] | None = None
    """Where torque was measured: motor_side is current or command (joint friction not in it), output_side a sensor
    behind the gear, from which joint friction cannot be found."""
    test_condition: Literal["bare_motor", "in_air", "loaded"] | None = None
    """What hung on the motor."""
    axis: Literal["rotary", "linear"] | None = None
    """Linear: read kg, N and m."""
    torque_scale: float = 1.0
    """N m (or N) per unit of the torque column: a torque constant, or -1 where the sign is the other way round."""
    velocity_delay: float = 0.0
    """How late the velocity is that the controller uses [s]: half a sample for a difference over one sample, plus its
    filter. It matters to output error alone."""
    cutoff: float | None = None
    """Corner of the filter [Hz]; by default as high as the noise of the acceleration lets."""

    def with_sidecar(self, sidecar: LogSetup) -> IdentifySetup:
        """Return the setup with what is None filled from the log's sidecar."""
        own = {item.name: getattr(self, item.name) for item in fields(LogSetup) if hasattr(self, item.name)}
        return replace(self, **{name: getattr(sidecar, name) for name, value in own.items() if value is None})

    def check(self) -> None:
        """Raise `StictionError` for numbers that no set-up has, and for torque from which friction cannot be found."""
        for name, lowest_allowed in (("kp", False), ("kd", True), ("torque_limit", False)):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and (value > 0 or (lowest_allowed and value == 0))):
                raise StictionError(f"{name} {value}: expected a positive number{', or 0' if lowest_allowed else ''}")
        if not 1e-9 <= abs(self.torque_scale) <= 1e9:
            raise StictionError(f"torque scale {self.torque_scale}: expected a size between 1e-9 and 1e9")
        if not 0 <= self.velocity_delay < inf:
            raise StictionError(f"velocity delay {self.velocity_delay} s: expected a number that is not negative")
        if self.torque_source == "output_side":
            raise StictionError(
                "torque source output_side: a sensor behind the gear does not see the joint's friction; "
                "use the motor's current or command (motor_side)"
            )
