"""What drove a motor: torque, current, the voltage across it or the duty of its bridge; and its own brake.

A motor of torque constant kt [N m/A] and back-EMF ke [V s/rad], both at the joint, gear included, at a voltage U gives

    τ = kt (U − ke θ') / R,          U = duty times the supply's voltage

in SI ke is kt, but for what the gear loses. The brake kt ke/R is one with viscous friction in every such log: both are
proportional to the speed, at any supply voltage. What tells them apart is ke (from kt, or from kt/R by a known weight,
and R), or a run of the same joint whose current was logged.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np

from stiction.core.errors import ConfigurationError, LogError

LARGEST_DUTY = 1.02
"""A duty beyond this is no share: of a bridge that is always on, rounding makes no more."""

PERCENT = 0.1
"""Scale of a duty column under which it is declared to be in percent or counts."""

BACK_EMF_ERROR = 0.1
"""Share of kt ke/R that the interval of viscous friction admits where ke was taken and not found: copper that is 25 K
warmer has a tenth more resistance. A choice."""

BRAKE = "B + kt·ke/R"
"""Name among the combinations of viscous friction and the motor's brake together [N m s/rad]."""


@dataclass(frozen=True)
class Drive:
    """How the torque column becomes torque."""

    column: str = "torque"
    """One of `TorqueColumn`."""
    supply: float | None = None
    """Voltage at a duty of 1 [V]."""
    kt: float | None = None
    """Torque constant at the joint [N m/A]."""
    resistance: float | None = None
    """R [Ω]."""
    ke: float | None = None
    """Back-EMF at the joint [V s/rad], where it was said."""

    @property
    def by_voltage(self) -> bool:
        """Whether the column is a voltage, or a duty."""
        return self.column in ("voltage", "duty")

    @property
    def back_emf(self) -> float | None:
        """ke, else kt, which is the same in SI [V s/rad]; None where neither is known."""
        return self.kt if self.ke is None else self.ke

    @property
    def per_unit(self) -> float | None:
        """N m per volt or ampere; None where that is not known, 1 for torque."""
        if self.column == "torque":
            return 1.0
        if self.column == "current":
            return self.kt
        return None if self.kt is None or self.resistance is None else self.kt / self.resistance

    @property
    def brake(self) -> float:
        """What the motor's own brake took off, in the unit of the torque over speed; 0 where ke is not known."""
        return 0.0 if not self.by_voltage or self.back_emf is None else (self.per_unit or 1.0) * self.back_emf

    @property
    def brakes_unseen(self) -> bool:
        """Whether kt ke/R is in what looks like viscous friction."""
        return self.by_voltage and self.back_emf is None

    @property
    def lacking(self) -> tuple[str, ...]:
        """Flags without which the torque's unit is not known."""
        if self.column == "torque" or self.per_unit is not None:
            return ()
        needed = {"--kt": self.kt} | ({"--resistance": self.resistance} if self.by_voltage else {})
        return tuple(flag for flag, value in needed.items() if value is None)

    def check(self) -> None:
        """Raise `ConfigurationError` for numbers that no motor has, and for those that have no effect."""
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
        Raises `LogError` for a duty that is no share.
        """
        signal = column
        if self.column == "duty":
            _check_duty(where, column, scale)
            signal = column * float(self.supply or 1.0)
        if self.by_voltage and self.back_emf is not None:
            signal = signal - self.back_emf * velocity
        return (self.per_unit or 1.0) * signal


def _check_duty(where: str, duty: np.ndarray, scale: float) -> None:
    """Refuse a duty in percent or counts, and a share that was taken for percent."""
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
