"""Names and units of identified quantities, as people read them."""

from __future__ import annotations

from stiction.formats.joints import Estimate, JointRecord

LABELS = {
    "inertia": ("Inertia I", "kg m²", "kg"),
    "viscous_friction": ("Viscous friction B", "N m s/rad", "N s/m"),
    "coulomb_friction": ("Dry (Coulomb) friction f", "N m", "N"),
    "offset": ("Offset", "N m", "N"),
    "gravity_sin": ("Gravity, part of sin θ", "N m", "N"),
    "gravity_cos": ("Gravity, part of cos θ", "N m", "N"),
    "motor_strength": ("Motor strength k", "1", "1"),
    "encoder_bias": ("Encoder bias", "rad", "m"),
    "delay": ("Delay of the controller", "s", "s"),
    "friction_ratio": ("Friction over torque limit f/τ_max", "1", "1"),
    "dead_band": ("Dead band f/kp", "rad", "m"),
    "viscous_friction_forward": ("Viscous friction forward", "N m s/rad", "N s/m"),
    "viscous_friction_backward": ("Viscous friction backward", "N m s/rad", "N s/m"),
    "coulomb_friction_forward": ("Dry friction forward", "N m", "N"),
    "coulomb_friction_backward": ("Dry friction backward", "N m", "N"),
    "static_friction": ("Static friction", "N m", "N"),
    "stribeck_velocity": ("Stribeck velocity", "rad/s", "m/s"),
    "load_coefficient": ("Friction per load", "1", "1"),
    "position_slope": ("Dry friction per angle from the middle", "N m/rad", "N/m"),
    "position_curvature": ("and per angle squared", "N m/rad²", "N/m²"),
}
"""Quantity -> label, unit of a rotary joint, unit of a linear axis."""

CONDITIONS = {"bare_motor": "bare motor", "in_air": "leg in the air", "loaded": "under load", None: "not stated"}

SOURCES = {
    "motor_side": "measured on the motor's side (current or command)",
    "output_side": "behind the gear",
    None: "not measured; taken from the controller's law",
}


def unit(record: JointRecord, quantity: str) -> str:
    """Return the unit of a quantity on this kind of axis."""
    return LABELS[quantity][2 if record.axis == "linear" else 1]


def axis_units(record: JointRecord) -> tuple[str, str]:
    """Return the units of position and torque; torque of unknown strength is in units of the command."""
    if record.axis == "linear":
        return "m", "N"
    if record.torque_source is None:
        return "rad", "N m of command"
    known = record.diagnostics.get("strength", {}).get("source") in ("measured", "declared", None)
    return "rad", "N m" if known else "unit of the torque column"


def number(value: float) -> str:
    """Return a number with four digits."""
    return f"{value:.4g}"


def cells(estimate: Estimate | None) -> list[str]:
    """Return value, deviation and interval as table cells."""
    if estimate is None:
        return ["not known", "", ""]
    low, high = estimate.interval95
    return [number(estimate.value), number(estimate.std), f"{number(low)} to {number(high)}"]
