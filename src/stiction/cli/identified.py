"""What `stiction identify` prints for a person: tables of joints, a limb or a walk, and the warnings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from stiction.files.joints import PARAMETERS, JointRecord, JointsFile


def show(console: Console, joints: JointsFile, folder: Path) -> None:
    """Print for a person what was found, and lies in a folder: the verdict in three lines, numbers, and warnings."""
    from stiction.identification.held_out import prediction_text, predictions_text
    from stiction.identification.warnings import repeat_lines
    from stiction.report.identification import lead_lines, own_warnings, remaining_warnings

    found = {name: record for name, record in joints.joints.items() if record.diagnostics}
    for line in lead_lines(joints, folder):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if len(found) == 1:
        for name, record in found.items():
            console.print(_one(name, record))
            if record.friction_law and record.friction_law["law"] not in (None, "coulomb"):
                console.print(_law(record))
            console.print(record.friction_law["text"] if record.friction_law else "", highlight=False, soft_wrap=True)
    elif found:
        console.print(_several(found))
    for name, record in found.items():
        for line in repeat_lines(record):
            console.print(f"{name}: {line}", highlight=False, markup=False, soft_wrap=True)
        if len(found) == 1 and (held := record.diagnostics.get("held_out")) is not None:
            line = f"{name}: {held['source']}, held out: {prediction_text(held, record.axis)}"
            console.print(line, highlight=False, markup=False, soft_wrap=True)
    if len(found) > 1 and (line := predictions_text(found)):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for text in remaining_warnings(joints):
        console.print(f"warning: {text}", highlight=False, markup=False, soft_wrap=True)
    own = own_warnings(joints)
    if len(found) == 1:
        for name, text in own:
            console.print(f"warning: {name}: {text}", highlight=False, markup=False, soft_wrap=True)
    elif own:
        console.print(f"warning: {len(own)} more about single joints: see the page, joint by joint", soft_wrap=True)


def _one(name: str, record: JointRecord) -> Table:
    """Tabulate one joint: values, combinations where parameters are not known, the symmetric fit beside a law."""
    from stiction.report.identification import EXTRA
    from stiction.report.page import number, unit

    symmetric = (record.friction_law or {}).get("symmetric") or {}
    title = f"{name}: NOT VALID, see above" if record.objections else name
    table = Table("", "unit", "value", "95 % interval", *(["symmetric"] if symmetric else []), title=title)
    for quantity in (*PARAMETERS, *EXTRA, "friction_ratio", "dynamic_ratio", "dead_band"):
        estimate = getattr(record, quantity)
        if estimate is None:
            if quantity in (*PARAMETERS, "friction_ratio", "dead_band"):
                table.add_row(quantity, unit(record, quantity), "not known")
            continue
        second = [number(symmetric[quantity]["value"])] if quantity in symmetric else []
        table.add_row(quantity, unit(record, quantity), number(estimate.value), _interval(estimate.interval95), *second)
    for label, estimate in record.combinations.items():
        table.add_row(label, "", number(estimate.value), _interval(estimate.interval95))
    return table


def _interval(ends: Sequence[float]) -> str:
    """Return both ends of an interval."""
    from stiction.report.page import number

    return " to ".join(map(number, ends))


def _law(record: JointRecord) -> Table:
    """Tabulate the law that was chosen."""
    from stiction.report.page import number, unit

    law = record.friction_law or {}
    table = Table("", "unit", "value", "95 % interval", title=f"{law['law']} law")
    over = "/k" if law["over_strength"] else ""
    for name, data in law["parameters"].items():
        table.add_row(name, unit(record, name) + over, number(data["value"]), _interval(data["interval95"]))
    return table


def _several(found: dict[str, JointRecord]) -> Table:
    """Tabulate several joints, a row each; what is known over k only carries it in its heading."""
    from stiction.report.identification import joint_columns, joint_row

    table = Table("joint", *joint_columns(found))
    for name, record in found.items():
        table.add_row(name, *joint_row(record))
        if record.coulomb_friction is None:
            damped = "; viscous includes the controller's kd: (B + k·kd)/k" if record.torque_source is None else ""
            table.caption = f"in units of the motor strength k{damped}"
    return table


def show_limb(console: Console, joints: JointsFile, folder: Path, model_error: float) -> None:
    """Print what was found in the log of a limb, and what was taken to be known of its links, for a person."""
    show(console, joints, folder)
    console.print(
        f"inertia is the rotor's (armature), behind the links of the model; each link's mass, inertia and centre were "
        f"admitted to be off by {model_error:.0%}, one standard deviation (--model-error)",
        highlight=False,
        soft_wrap=True,
    )


def show_walk(console: Console, joints: JointsFile, folder: Path) -> None:
    """Print what was found in a walk, and the warnings, for a person."""
    from stiction.report.identification import lead_lines
    from stiction.report.walking import VALUE_CAPTION, VALUE_COLUMNS, contact_line, grouped_warnings, value_rows

    table = Table("", *VALUE_COLUMNS, caption=VALUE_CAPTION)
    for line in lead_lines(joints, folder):
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    for row in value_rows(joints):
        table.add_row(*row)
    console.print(table)
    console.print(contact_line(joints), highlight=False, soft_wrap=True)
    for text in grouped_warnings(joints):
        console.print(f"warning: {text}", highlight=False, soft_wrap=True)
