"""Friction at rest over that in motion, as ranges that a training draws from: the law `stribeck` of `stiction train`.

The level of that law is friction in motion, and the advice is of friction at rest under Coulomb's law, where the two
are one. So the level is divided by the ratio: at rest as much is drawn as in the trainings that are counted, in motion
less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stiction.files.joints import JointRecord

LAW = "stribeck"
"""Law of training with both frictions."""

RATIOS = (1.0, 10.0)
"""Least and most friction at rest over that in motion that training takes."""

SLOWEST = 0.005
"""Stribeck velocity [rad/s], at least: under it what a held joint creeps by in simulation would make it let go."""

AT_ONCE = (0.02, 0.1)
"""Stribeck velocities [rad/s] of a joint whose log shows a fall at once, the law `breakaway`: a choice. Simulated steps
of some ms let no joint move slower than that once it moves."""


@dataclass(frozen=True)
class Rise:
    """Ranges of the law `stribeck` for one joint."""

    value: float
    """Friction at rest over that in motion [1], as estimated."""
    ratio: tuple[float, float]
    """Lowest and highest that are drawn: least at rest over most in motion, and most over least, by the 95 % intervals,
    within `RATIOS`."""
    velocity: tuple[float, float]
    """Lowest and highest speed at which 63 % of the rise is gone [rad/s]."""
    at_once: bool
    """True if the log shows no such speed, and `velocity` is a choice."""

    @property
    def fields(self) -> dict[str, list[float]]:
        """Fields of `FrictionCfg` with the ranges."""
        return {"static_ratio": [*self.ratio], "stribeck_velocity": [*self.velocity]}

    def settings(self, coulomb: Mapping[str, Any]) -> dict[str, Any]:
        """Return fields of `FrictionCfg` that draw at rest what those of a training under Coulomb's law draw."""
        return {**coulomb, "law": LAW, "level": round(coulomb["level"] / min(self.value, RATIOS[1]), 3), **self.fields}

    def flags(self, coulomb: Mapping[str, Any]) -> str:
        """Return them as words of `stiction train`."""
        cfg = self.settings(coulomb)
        shape = (f"--set task.friction.{name}=[{low:g},{high:g}]" for name, (low, high) in self.fields.items())
        return " ".join(
            (f"--method {cfg['method']} --friction-level {cfg['level']:g} --friction-law {LAW}", *shape),
        )

    @property
    def text(self) -> str:
        """What is drawn, in words."""
        ratio, speeds = (
            f"{low:g} to {high:g}" if low < high else f"{low:g}" for low, high in (self.ratio, self.velocity)
        )
        most = f" (the most that training takes; this joint's is {self.value:.3g})" if self.value > RATIOS[1] else ""
        chosen = ", speeds that are chosen, for the log shows a fall at once" if self.at_once else ""
        return f"{ratio} times as much friction at rest as in motion{most}, gone over {speeds} rad/s{chosen}"


def rise_of(record: JointRecord) -> Rise | None:
    """Return what a training draws of the friction that holds a joint at rest; None unless that is more.

    Frictions of which nothing is known in newton metres have a ratio too.
    """
    rest, moving = record.holding_friction, record.moving_friction
    if rest is None or moving is None or record.axis != "rotary":
        return None
    least, most = RATIOS
    ends = (rest.interval95[0] / max(moving.interval95[1], 1e-9), rest.interval95[1] / max(moving.interval95[0], 1e-9))
    low, high = (float(f"{min(max(end, least), most):.3g}") for end in ends)
    value = rest.value / moving.value if moving.value > 0 else most
    speed = record.stribeck_velocity
    if speed is None:
        return Rise(value, (low, high), AT_ONCE, at_once=True)
    slow, fast = (float(f"{max(end, SLOWEST):.3g}") for end in speed.interval95)
    return Rise(value, (low, high), (slow, fast), at_once=False)
