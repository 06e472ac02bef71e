"""Words and table cells of an identification, for terminal and page alike."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from stiction.files.joints import ARMATURE, Estimate, JointRecord, JointsFile
from stiction.report.glance import plus_minus

EXTRA = ("static_friction", "gravity_sin", "gravity_cos", "motor_strength", "encoder_bias", "delay")
"""Quantities that are shown only where they were found."""

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
    "dynamic_ratio": ("The same in motion alone", "1", "1"),
    "dead_band": ("Dead band f/kp", "rad", "m"),
    "viscous_friction_forward": ("Viscous friction forward", "N m s/rad", "N s/m"),
    "viscous_friction_backward": ("Viscous friction backward", "N m s/rad", "N s/m"),
    "coulomb_friction_forward": ("Dry friction forward", "N m", "N"),
    "coulomb_friction_backward": ("Dry friction backward", "N m", "N"),
    "static_friction": ("Dry friction at rest (static)", "N m", "N"),
    "stribeck_velocity": ("Stribeck velocity", "rad/s", "m/s"),
    "load_coefficient": ("Friction per load", "1", "1"),
    "effort_coefficient": ("Friction per torque of the motor", "1", "1"),
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


def label(record: JointRecord, quantity: str, over: str = "") -> str:
    """Return a quantity as people read it, with its unit; over: what it is divided by, ` / k`."""
    return f"{LABELS[quantity][0]}{over} [{unit(record, quantity)}]"


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


def in_degrees(record: JointRecord, quantity: str) -> Estimate | None:
    """Return the dead band of a rotary joint in degrees; None for any other quantity or axis."""
    if quantity != "dead_band" or record.dead_band is None or record.axis == "linear":
        return None
    return record.dead_band.scaled(math.degrees(1.0))


def cells(estimate: Estimate | None) -> list[str]:
    """Return value, deviation and interval as table cells."""
    if estimate is None:
        return ["not known", "", ""]
    low, high = estimate.interval95
    return [number(estimate.value), number(estimate.std), f"{number(low)} to {number(high)}"]


def lead_lines(joints: JointsFile, folder: Path | None = None) -> tuple[str, ...]:
    """Return the verdict as the page and the terminal begin with it. folder: where the files it names lie.

    Of one joint its three lines; of several how many there are, what to do first about those that are not valid, a line
    for all with the same reason, and the lines of the one with the most friction for its motor.
    """
    identified = {name: record for name, record in joints.joints.items() if record.diagnostics}
    lines = {
        name: tuple(in_folder(line, folder) for line in verdict)
        for name, record in identified.items()
        if (verdict := record.diagnostics.get("verdict", {}).get("lines")) is not None
    }
    if len(joints.joints) == 1:
        return next(iter(lines.values()), ())
    bad = [name for name, record in identified.items() if record.objections]
    first = [_do_first(identified, names) for names in alike(identified, bad)]
    valid = {name: record for name, record in identified.items() if name not in bad}
    ratios = {name: record.friction_ratio for name, record in valid.items() if record.friction_ratio is not None}
    count = f"{len(identified)} of {len(joints.joints)} joints were identified"
    none = "any" if len(bad) == len(identified) else ", ".join(bad)
    count += f", {len(bad)} of them not validly: no friction is stated for {none}." if bad else "."
    if not valid:
        return (count, *first)
    if not ratios:
        return (count, *first, "Without torque limits their friction cannot be judged: --torque-limit.")
    # By the upper end: a joint whose friction is badly known may be the worst.
    worst = max(ratios, key=lambda name: ratios[name].interval95[1])
    return (count, *first, f"{worst} has the most dry friction for its motor:", *lines.get(worst, ()))


def in_folder(line: str, folder: Path | None) -> str:
    """Return a line of a verdict with the paths of the files that its command reads."""
    for word, file in (("--friction-from", "training.json"), ("stiction convert", "joints.json")):
        if folder is not None:
            line = line.replace(f"{word} {file}", f"{word} {shlex.quote(str(folder / file))}")
    return line


def alike(records: Mapping[str, JointRecord], bad: Sequence[str]) -> list[list[str]]:
    """Return the joints that are not valid, those together that have the same first reason and the same to do."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in bad:
        first = records[name].objections[0]
        groups.setdefault((first.reason, first.remedy), []).append(name)
    return list(groups.values())


def _do_first(records: Mapping[str, JointRecord], names: Sequence[str]) -> str:
    """Return what to do first about joints that are alike, and what was seen: of the first one, where each differs."""
    first = [records[name].objections[0] for name in names]
    who = "all joints" if 1 < len(names) == len(records) else ", ".join(names)
    whose = f"{names[0]}, and the others alike: " if len({one.seen for one in first}) > 1 else ""
    return f"{who}: do first: {first[0].remedy}. {whose}{first[0].seen}."


def remaining_warnings(joints: JointsFile) -> list[str]:
    """Return `shared_warnings` without what the verdict says already: page and terminal have them below it."""
    lead = " ".join(lead_lines(joints))
    return [text for text in shared_warnings(joints) if text not in lead]


def joint_columns(records: Mapping[str, JointRecord]) -> list[str]:
    """Return the headings of `joint_row`, with the units of the joints, or of each kind of axis among them."""

    def units(quantity: str) -> str:
        return " or ".join(dict.fromkeys(unit(record, quantity) for record in records.values())) or "1"

    friction = units("coulomb_friction")
    return [
        *(f"dry friction [{friction}]", f"95 % interval [{friction}]", f"viscous [{units('viscous_friction')}]"),
        *(f"inertia [{units('inertia')}]", "f/τ_max [%]", f"f/kp [{units('dead_band')}]", "law"),
    ]


def joint_row(record: JointRecord) -> list[str]:
    """Return one joint among several, under `joint_columns`: what is known over the motor strength k in its place."""
    damping = "(B + k·kd)/k" if record.torque_source is None else "B/k"
    viscous = record.viscous_friction or record.combinations.get(damping)
    inertia = record.inertia or record.combinations.get("I/k") or record.combinations.get(ARMATURE)
    friction, _, interval = cells(record.moving_friction)
    if (holding := record.holding_friction) is not None:
        friction += f" ({number(holding.value)} at rest)"
    ratio = "" if record.friction_ratio is None else f"{record.friction_ratio.value:.2%}"
    numbers = ("" if each is None else number(each.value) for each in (viscous, inertia))
    band = "" if record.dead_band is None else number(record.dead_band.value)
    if (degrees := in_degrees(record, "dead_band")) is not None:
        band += f" ({number(degrees.value)}°)"
    return [friction, interval, *numbers, ratio, band, (record.friction_law or {}).get("law") or ""]


def shared_warnings(joints: JointsFile) -> list[str]:
    """Return the warnings of a single joint; else those that several share, and why joints were refused."""
    warnings = gather_warnings(joints)
    if len(joints.joints) == 1:
        return list(warnings)
    refused = {name for name, record in joints.joints.items() if not record.diagnostics}
    return [
        f"{', '.join(names) if len(names) < len(joints.joints) else 'all'}: {text}"
        for text, names in warnings.items()
        if len(names) > 1 or set(names) & refused
    ]


def gather_warnings(joints: JointsFile) -> dict[str, list[str]]:
    """Return every warning once, with the joints that it concerns."""
    warnings: dict[str, list[str]] = {}
    for name, record in joints.joints.items():
        for text in record.warnings:
            warnings.setdefault(text, []).append(name)
    return warnings


def grouped_warnings(joints: JointsFile) -> list[str]:
    """Return every warning once, with the joints that it is about in front; not what their lead lines begin with."""
    everyone = len(joints.joints)
    led = {one.seen for record in joints.joints.values() for one in record.objections[:1]}
    return [
        f"{'all joints' if len(names) == everyone else ', '.join(names)}: {text}"
        for text, names in gather_warnings(joints).items()
        if text not in led
    ]


def span(estimate: Estimate | None, factor: float = 1.0) -> str:
    """Return `plus_minus` of an estimate, or that there is none."""
    return "not known" if estimate is None else plus_minus(estimate, factor)


VALUE_COLUMNS = ("dry friction [N m]", "of limit [%]", "viscous [N m s/rad]", "per load [1]", "swings")
VALUE_CAPTION = "Friction of the unloaded leg, and what load adds to it; ± is the half-width of the 95 % interval"


def value_rows(joints: JointsFile) -> list[list[str]]:
    """Return what was found, a row a joint: its name, then `VALUE_COLUMNS`."""
    return [
        [
            name,
            span(record.coulomb_friction),
            span(record.friction_ratio, 100),
            span(record.viscous_friction),
            span(record.load_coefficient),
            str(record.diagnostics.get("swings", "")),
        ]
        for name, record in joints.joints.items()
    ]


def contact_line(joints: JointsFile) -> str:
    """Return the sources of the foot contacts, empty without any."""
    sources = {record.diagnostics["contact"] for record in joints.joints.values() if "contact" in record.diagnostics}
    return f"feet on the ground, from {'; '.join(sorted(sources))}" if sources else ""
