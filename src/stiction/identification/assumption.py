"""What the scale of a joint's friction rests on where nothing in its log shows it: a flag, a weight, somebody's word.

A log stays the same if all torques in it grow by one factor. What fixes that factor is a controller whose gains are
known, a known weight, links of known mass, or what was declared; the verdict's first line then says what that was.
"""

from __future__ import annotations

from typing import Any

from stiction.files.joints import JointRecord
from stiction.identification.runs import Run

NAMED = {
    "--kt": ("kt", "N m/A"),
    "--resistance": ("R", "ohm"),
    "--duty-voltage": ("supply", "V"),
    "--torque-scale": ("scale", "a unit"),
}
"""Flag -> name and unit of a constant that makes torque of a column."""

WEIGHTS = {
    "pendulum_mass": "--pendulum-mass",
    "pendulum_length": "--pendulum-length",
    "pendulum_angle": "--set pendulum_angle",
    "payload_mass": "--payload-mass",
    "payload_distance": "--payload-distance",
    "payload_angle": "--payload-angle",
}
"""Field of the set-up -> flag, of those that say how much a known weight pulls."""


def torque_unit(run: Run) -> dict[str, Any] | None:
    """Return what the log's torque column holds and what its N m rest on, declared numbers by flag; None without one.

    `calibrated`: whether it is in N m; `side`: where it was said to be measured; `weight`: flags of a known weight.
    """
    if not run.measured:
        return None
    drive, scale = run.setup.drive, run.setup.torque_scale
    flags = {"--kt": drive.kt, "--resistance": drive.resistance, "--duty-voltage": drive.supply}
    motor = {"torque": (), "current": ("--kt",), "voltage": ("--kt", "--resistance"), "duty": tuple(flags)}
    known = {flag: flags[flag] for flag in motor[drive.column]} | {"--torque-scale": scale}
    return {
        "column": drive.column,
        "declared": {flag: value for flag, value in known.items() if value is not None},
        "calibrated": run.setup.calibrated,
        "side": run.setup.torque_source,
        "weight": [flag for name, flag in WEIGHTS.items() if getattr(run.setup, name) is not None],
    }


def assumption(record: JointRecord) -> tuple[tuple[str, ...], str]:
    """Return the flags that friction rests on and nothing in the log shows, and the same in words; empty where none."""
    data, rotary = record.diagnostics, record.axis == "rotary"
    source, given = data.get("strength", {}).get("source"), data.get("torque_unit")
    if source == "declared":
        return ("--set motor_strength", "--kp", "--kd"), "all of it if the motor strength and the gains are as declared"
    if record.torque_source is None and record.kp is not None and record.coulomb_friction is None:
        gain = f"{record.kp:.4g} {'N m/rad' if rotary else 'N/m'}"
        said = f"all of it if kp is {gain} and angles are the joint's, as declared: positions alone do not show it"
        return ("--kp", "--kd", "--position-scale"), said
    if record.torque_source is None or record.coulomb_friction is None:
        return (), ""
    if "torque_by_weight" in data:
        shows = "nothing in so short a walk shows it"
        if data["torque_by_weight"] is not None:
            low, high = data["torque_by_weight"]["interval95"]
            together = f"the robot's weight says so of all joints together, to {low:.2g} to {high:.2g} times"
            shows = f"{together}, and of each nothing"
        return ("--torque-scale",), f"all of it if the torque is in N m, as declared: {shows}"
    # Where there is a mismatch, however small, the torque was held against gains and positions: that shows its scale.
    if given is None or data.get("controller_mismatch") is not None:
        return (), ""
    if source == "known_load":
        # A pendulum beside a torque of known unit was held against it.
        if not given["weight"] or (given["calibrated"] and "--pendulum-mass" in given["weight"]):
            return (), ""
        said = "all of it if the known weight is as declared, which tells the scale of the torque"
        return tuple(given["weight"]), said
    return _of_unit(given, data.get("torque_by_links"), "N m" if rotary else "N")


def _of_unit(given: dict[str, Any], links: dict[str, Any] | None, unit: str) -> tuple[tuple[str, ...], str]:
    """Return what a torque column rests on; given: `torque_unit`; links: its scale by the links of a limb, or None."""
    declared = given["declared"]
    if given["column"] == "torque":
        flags, what = ("--torque-scale",), f"the torque is in {unit}"
        shows = "without --kp, --kd and a target nothing shows it"
    else:
        numbers = [f"{name} {declared[flag]:.4g} {of}" for flag, (name, of) in NAMED.items() if flag in declared]
        flags, what = ("--torque-column", *declared), f"the column is a {', '.join([given['column'], *numbers])}"
        shows = "nothing in the log shows it, and a known pendulum would (--pendulum-mass, --pendulum-length)"
    if links is not None:
        low, high = links["interval95"]
        shows = f"the links' masses say so to {low:.2g} to {high:.2g} times"
    # A torque scale leaves the speed as it is, and dry friction does not ask how fast.
    speed = "" if links else ", and of inertia and viscous friction if angles are the joint's and stamps seconds"
    return flags, f"all of it if {what}, as declared{speed}: {shows}"
