"""Dry friction of public robots over their torque limit, each with its source and how it was found.

Only entries of one condition can be compared with each other: a bare motor, a leg in the air and a loaded joint differ
by factors, and what somebody wrote into a simulation model may never have been measured. `place` ranks a joint among
the entries of its own condition and leaves the others out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from stiction.files.joints import Estimate

Quantity = Literal["friction_ratio", "dead_band"]

CONDITIONS = {
    "bare_motor": "on a bare motor",
    "in_air": "on a leg in the air",
    "loaded": "under load",
    "model": "set in a public simulation model",
}
"""Condition of an entry -> the same in words. A record never has `model`, so models are never ranked."""

_DLS = "https://github.com/iit-DLSLab/sim2real-robot-identification"
_MENAGERIE = "https://github.com/google-deepmind/mujoco_menagerie"

SOURCES = {
    "paper": "Hu et al., Impact of Static Friction on Sim2Real in Robotic Reinforcement Learning, Tables I and III",
    "go2": f"{_DLS}/issues/8",
    "aliengo": f"{_DLS}, robot_model/aliengo/aliengo.xml at 68324ee",
    "a2": f"{_DLS}, robot_model/a2/isaaclab_identified_parameters.py at 9b07f12; "
    "limits of sysid_isaaclab/tasks/a2_pace_env_cfg.py at 68324ee",
    "bam": "https://github.com/Rhoban/bam, bam/params/<motor>/m1.json at ea21610; stall torque at 14.8 V from "
    "https://emanual.robotis.com/docs/en/dxl/mx/",
    "go1_model": f"{_MENAGERIE}, unitree_go1/go1.xml at 28ffb48",
    "go2_model": f"{_MENAGERIE}, unitree_go2/go2.xml at 2ffe3e3",
    "a1_model": f"{_MENAGERIE}, unitree_a1/a1.xml at 1b428b0",
    "anymal_model": f"{_MENAGERIE}, anybotics_anymal_c/anymal_c.xml at 1b428b0",
    "barkour_model": f"{_MENAGERIE}, google_barkour_vb/barkour_vb.xml at 2b12d95",
    "op3_model": f"{_MENAGERIE}, robotis_op3/op3.xml at 361161b",
    "cheetah_model": "https://github.com/mit-biomimetics/Cheetah-Software, common/include/Dynamics at aa89b8a",
    "so101_model": "https://huggingface.co/datasets/Genesis-Intelligence/assets, SO101/joints_properties.xml",
    "darwin_model": "https://github.com/cyberbotics/webots/pull/2935",
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
    kp: float | None = None
    """Proportional gain: of the test, or of the model's own position actuators [N m/rad]; None where unknown."""
    note: str = "the source does not say how it was found"
    """How it was found, or what to know about it."""

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
    Entry("Unitree Go1", "shank", "bare_motor", 0.0481, 35.55, "paper", note=_SINES.format("0.00299")),
    Entry("Saturn Lite", "shank", "bare_motor", 0.442, 45.0, "paper", note=_SINES.format("0.0661") + "; sealed"),
    Entry("Unitree Go2", "hip", "in_air", 0.16, 23.7, "go2", 20.0, _FITS.format("0.01")),
    Entry("Unitree Go2", "thigh", "in_air", 0.195, 23.7, "go2", 20.0, _FITS.format("0.015")),
    Entry("Unitree Go2", "stiffer calf", "in_air", 0.74, 45.43, "go2", 20.0, _FITS.format("0.03")),
    Entry("Unitree Go2", "freer calf", "in_air", 0.50, 45.43, "go2", 20.0, _FITS.format("0.02")),
    Entry("Unitree AlienGo", "hip", "in_air", 0.480, 35.278, "aliengo", note=_LEGS.format("0.38 to 0.65 N m")),
    Entry("Unitree AlienGo", "thigh", "in_air", 0.297, 35.278, "aliengo", note=_LEGS.format("0.26 to 0.35 N m")),
    Entry("Unitree AlienGo", "calf", "in_air", 0.370, 44.4, "aliengo", note=_LEGS.format("0.20 to 0.49 N m")),
    Entry("Unitree A2", "hip", "in_air", 1.97, 120.0, "a2", 40.0, _LEGS.format("1.71 to 2.27 N m")),
    Entry("Unitree A2", "thigh", "in_air", 2.02, 120.0, "a2", 40.0, _LEGS.format("1.85 to 2.30 N m")),
    Entry("Dynamixel MX-106", "servo", "loaded", 0.1035, 10.0, "bam", note=_BENCH),
    Entry("Dynamixel MX-64", "servo", "loaded", 0.0904, 7.3, "bam", note=_BENCH),
    Entry("Unitree Go1", "hip, thigh", "model", 0.2, 23.7, "go1_model", 100.0),
    Entry("Unitree Go1", "knee", "model", 0.2, 35.55, "go1_model", 100.0),
    Entry("Unitree Go2", "hip, thigh", "model", 0.2, 23.7, "go2_model"),
    Entry("Unitree Go2", "knee", "model", 0.2, 45.43, "go2_model"),
    Entry("Unitree A1", "all", "model", 0.2, 33.5, "a1_model", 100.0),
    Entry("ANYmal C", "all", "model", 0.1, 80.0, "anymal_model", 100.0),
    Entry("Barkour vB", "all", "model", 0.13, 18.0, "barkour_model", 50.0),
    Entry("ROBOTIS OP3", "all", "model", 0.03, 5.0, "op3_model", 21.1),
    Entry("Mini Cheetah", "hip, thigh", "model", 0.2, 18.0, "cheetah_model"),
    Entry("Mini Cheetah", "knee", "model", 0.2, 28.0, "cheetah_model"),
    Entry("Cheetah 3", "hip, thigh", "model", 1.0, 208.5, "cheetah_model"),
    Entry("Cheetah 3", "knee", "model", 1.0, 240.6, "cheetah_model"),
    Entry("SO-101", "all", "model", 0.052, 3.35, "so101_model", 17.8),
    Entry("DARwIn-OP", "all", "model", 0.80, 2.3, "darwin_model"),
)
"""Verified against their sources in November 2026. Limits of both Cheetahs: motor torque times gear ratio. The A2's
calves are left out: their fit ended at the bound of its search (6 N m)."""


@dataclass(frozen=True)
class Placement:
    """Where a joint stands among public joints that were measured under the same condition."""

    quantity: Quantity
    """What is compared."""
    condition: str
    """Condition of the joint and of every entry that it is compared with."""
    below: int
    """Entries whose value is smaller."""
    count: int
    """Comparable entries."""
    within: int
    """Entries that lie within the joint's 95 % interval: the rank is not known better than that."""
    next_below: str | None
    """The largest entry that is not above, with its value; None where there is none."""
    next_above: str | None
    """The smallest entry above."""
    text: str
    """The same in one sentence."""


def place(
    estimate: Estimate, condition: str | None, quantity: Quantity = "friction_ratio", at_rest: bool = False
) -> Placement | None:
    """Rank a joint's ratio [1] or dead band [rad] among the entries of its condition; None where there are none.

    Entries of other conditions are not ranked, and the sentence says how many they are. at_rest: whether the estimate
    is of friction at rest, which is then said, for the entries are of Coulomb friction.
    """
    known = [(value, entry) for entry in REFERENCE if (value := getattr(entry, quantity)) is not None]
    comparable = sorted(
        ((value, entry) for value, entry in known if entry.condition == condition), key=lambda pair: pair[0]
    )
    if condition is None or not comparable:
        return None
    low, high = estimate.interval95
    below = [pair for pair in comparable if pair[0] <= estimate.value]
    above = comparable[len(below) :]
    names = [_named(below[-1], quantity) if below else None, _named(above[0], quantity) if above else None]
    where = {
        (True, True): f"between {names[0]} and {names[1]}",
        (True, False): f"above {names[0]}, the largest,",
        (False, True): f"below {names[1]}, the smallest,",
    }[bool(below), bool(above)]
    symbol = "f/τ_max" if quantity == "friction_ratio" else "f/kp"
    symbol += " at rest, beside those of friction in motion," if at_rest else ""
    within = sum(low <= value <= high for value, _ in comparable)
    text = (
        f"Its {symbol} is {where} of {len(comparable)} public joints measured {CONDITIONS[condition]}"
        + (f", {within} of them within its interval" if within else "")
        + f" ({len(known) - len(comparable)} of other conditions are not comparable and not ranked)."
    )
    return Placement(quantity, condition, len(below), len(comparable), within, names[0], names[1], text)


def _named(pair: tuple[float, Entry], quantity: Quantity) -> str:
    """Return `Unitree Go2 hip (0.68 %)`."""
    value, entry = pair
    shown = f"{100 * value:.2g} %" if quantity == "friction_ratio" else f"{value:.2g} rad"
    return f"{entry.robot} {entry.joint} ({shown})"
