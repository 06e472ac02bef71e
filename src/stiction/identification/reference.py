"""Dry friction of public robots over their torque limit, each with its source and how it was found.

Only entries of one condition can be compared with each other: a bare motor, a leg in the air and a loaded joint differ
by factors. `place` ranks a joint among the entries of its own condition and leaves the others out. What somebody wrote
into a simulation model may never have been measured, and is not listed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from stiction.files.joints import Estimate, JointRecord

Quantity = Literal["friction_ratio", "dead_band"]

CONDITIONS = {"bare_motor": "on a bare motor", "in_air": "on a leg in the air", "loaded": "under load"}
"""Condition of an entry, and of a log -> the same in words."""

_DLS = "https://github.com/iit-DLSLab/sim2real-robot-identification"

SOURCES = {
    "paper": "Hu et al., Impact of Static Friction on Sim2Real in Robotic Reinforcement Learning, Tables I and III",
    "go2": f"{_DLS}/issues/8",
    "aliengo": f"{_DLS}, robot_model/aliengo/aliengo.xml at 68324ee",
    "a2": f"{_DLS}, robot_model/a2/isaaclab_identified_parameters.py at 9b07f12; "
    "limits of sysid_isaaclab/tasks/a2_pace_env_cfg.py at 68324ee",
    "bam": "https://github.com/Rhoban/bam, bam/params/<motor>/m1.json at ea21610; stall torque at 14.8 V from "
    "https://emanual.robotis.com/docs/en/dxl/mx/",
}
"""Short name -> where the numbers were read."""


@dataclass(frozen=True)
class Entry:
    """Dry friction of one kind of joint."""

    robot: str
    """Robot, or servo."""
    joint: str
    """Joint, or joints that share the numbers."""
    condition: str
    """One of `CONDITIONS`."""
    friction: float
    """Coulomb friction [N m]."""
    torque_limit: float
    """[N m]."""
    source: str
    """Key of `SOURCES`."""
    note: str
    """How it was found, or what to know about it."""
    kp: float | None = None
    """Proportional gain of the test [N m/rad]; None where unknown."""

    @property
    def friction_ratio(self) -> float:
        """f/τ_max [1]."""
        return self.friction / self.torque_limit

    @property
    def dead_band(self) -> float | None:
        """f/kp [rad], None without a gain."""
        return None if self.kp is None else self.friction / self.kp


_SINES = "sine excitation of the shank motor, no load; std {} N m"
_FITS = "repeated fits by simulation of one public record, 12 joints in the air; std {} N m"
_LEGS = "fit by simulation, mean of the four legs ({})"
_BENCH = "pendulum with weights, symmetric Coulomb and viscous law; its authors find that friction grows with load"

REFERENCE: tuple[Entry, ...] = (
    Entry("Unitree Go1", "shank", "bare_motor", 0.0481, 35.55, "paper", _SINES.format("0.00299")),
    Entry("Saturn Lite", "shank", "bare_motor", 0.442, 45.0, "paper", _SINES.format("0.0661") + "; sealed"),
    Entry("Unitree Go2", "hip", "in_air", 0.16, 23.7, "go2", _FITS.format("0.01"), 20.0),
    Entry("Unitree Go2", "thigh", "in_air", 0.195, 23.7, "go2", _FITS.format("0.015"), 20.0),
    Entry("Unitree Go2", "stiffer calf", "in_air", 0.74, 45.43, "go2", _FITS.format("0.03"), 20.0),
    Entry("Unitree Go2", "freer calf", "in_air", 0.50, 45.43, "go2", _FITS.format("0.02"), 20.0),
    Entry("Unitree AlienGo", "hip", "in_air", 0.480, 35.278, "aliengo", _LEGS.format("0.38 to 0.65 N m")),
    Entry("Unitree AlienGo", "thigh", "in_air", 0.297, 35.278, "aliengo", _LEGS.format("0.26 to 0.35 N m")),
    Entry("Unitree AlienGo", "calf", "in_air", 0.370, 44.4, "aliengo", _LEGS.format("0.20 to 0.49 N m")),
    Entry("Unitree A2", "hip", "in_air", 1.97, 120.0, "a2", _LEGS.format("1.71 to 2.27 N m"), 40.0),
    Entry("Unitree A2", "thigh", "in_air", 2.02, 120.0, "a2", _LEGS.format("1.85 to 2.30 N m"), 40.0),
    Entry("Dynamixel MX-106", "servo", "loaded", 0.1035, 10.0, "bam", _BENCH),
    Entry("Dynamixel MX-64", "servo", "loaded", 0.0904, 7.3, "bam", _BENCH),
)
"""Verified against their sources in November 2026. The A2's calves are left out: their fit ended at the bound of its
search (6 N m)."""


@dataclass(frozen=True)
class Placement:
    """Rank of a joint among public joints that were measured under the same condition."""

    quantity: Quantity
    """What is compared."""
    condition: str
    """Condition of the joint and of every entry that it is compared with."""
    below: int
    """Entries whose value is not larger."""
    count: int
    """Comparable entries."""
    text: str
    """The same in one sentence, with the nearest entries, and how many lie within the joint's 95 % interval: the rank
    is not known better than that."""


def place(record: JointRecord, quantity: Quantity) -> Placement | None:
    """Rank a joint's ratio [1] or dead band [rad] among the entries of its condition; None where there are none.

    A linear axis has none. Entries are of Coulomb friction: where the joint's is that at rest, the sentence says so.
    """
    estimate: Estimate | None = getattr(record, quantity)
    symbol, scale, unit = ("f/τ_max", 100, "%") if quantity == "friction_ratio" else ("f/kp", 1, "rad")
    entries = sorted(
        (value, f"{entry.robot} {entry.joint} ({scale * value:.2g} {unit})")
        for entry in REFERENCE
        if entry.condition == record.test_condition and (value := getattr(entry, quantity)) is not None
    )
    if estimate is None or record.axis != "rotary" or record.test_condition is None or not entries:
        return None
    low, high = estimate.interval95
    below = sum(value <= estimate.value for value, _ in entries)
    if 0 < below < len(entries):
        where = f"between {entries[below - 1][1]} and {entries[below][1]}"
    else:
        where = f"above {entries[-1][1]}, the largest," if below else f"below {entries[0][1]}, the smallest,"
    within = sum(low <= value <= high for value, _ in entries)
    symbol += "" if record.holding_friction is None else " at rest, beside those of friction in motion,"
    text = f"Its {symbol} is {where} of {len(entries)} public joints measured {CONDITIONS[record.test_condition]}"
    text += f", {within} of them within its interval." if within else "."
    return Placement(quantity, record.test_condition, below, len(entries), text)
