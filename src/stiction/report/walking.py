"""The page of a walking log, drawn from `joints.json` and `fit.npz` alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from stiction.core.files import write_text
from stiction.core.names import kind_of
from stiction.files.bam import load_joints
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.walk import WalkFit, read_walk_fit
from stiction.report.identified import identified_card
from stiction.report.joints import (
    VALUE_CAPTION,
    VALUE_COLUMNS,
    contact_line,
    grouped_warnings,
    lead_lines,
    span,
    value_rows,
)
from stiction.report.page import (
    COLORS,
    INK,
    Section,
    figure_block,
    labelled,
    legend,
    new_figure,
    paragraph,
    render_page,
    table,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 1500
"""Points drawn per cloud."""

MOST_PANELS = 3
"""Panels side by side."""


def write_walking_page(folder: Path, command: str = "") -> Path:
    """Write `report.html` beside the `joints.json` and `fit.npz` of `folder`; return its path.

    command: that identified, if it was one.
    """
    joints = load_joints(folder / "joints.json")
    fit = read_walk_fit(folder / "fit.npz")
    sections = [
        Section("What was found", (table(["", *VALUE_COLUMNS], value_rows(joints), VALUE_CAPTION), _condition(joints))),
        Section("Friction under load, robot in stance", _load(joints, fit)),
        Section("Can it be trusted?", (_gait(fit), _diagnostics(joints))),
    ]
    page = folder / "report.html"
    title, warnings = "Joint friction from a walk", grouped_warnings(joints)
    card = identified_card(joints, folder, command)
    figure = _clouds(joints, fit)
    text = render_page(title, sections, lead_lines(joints, folder), warnings, command, figure=figure, card=card)
    write_text(page, text)
    return page


def _kind(name: str, record: JointRecord) -> str:
    """Return the kind of a joint, or of a record that stands for a kind; of a file that does not say, by the name."""
    return str(record.diagnostics.get("kind", kind_of(name)))


def _panels(count: int, label: str) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels in rows of at most `MOST_PANELS`, and its panels; label: of their vertical axes."""
    rows, columns = -(-count // MOST_PANELS), min(count, MOST_PANELS)
    figure, axes = new_figure(rows, columns, (9.0, 3.6 * rows))
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[::MOST_PANELS]:
        axis.set_ylabel(label)
    return figure, axes[:count]


def _condition(joints: JointsFile) -> Markup:
    """Return the assumptions behind the numbers."""
    merged = [name for name, record in joints.joints.items() if name not in record.diagnostics.get("joints", [name])]
    note = f" Rows named by kind ({', '.join(merged)}) put the swings of all legs together." if merged else ""
    contact = contact_line(joints)
    sentence = f" {contact[0].upper()}{contact[1:]}." if contact else ""
    return paragraph(
        "Dry and viscous friction are those of legs in swing, without load. An interval covers the spread between "
        "swings, links up to a few per cent heavier or lighter than stated, and constant errors of the accelerometer "
        "and the current sensor." + sentence + note
    )


def _clouds(joints: JointsFile, fit: WalkFit) -> Markup:
    """Draw torque without links and rotor against speed, a panel a kind, with the fitted law of each record."""
    kinds = {name: _kind(name, record) for name, record in joints.joints.items()}
    shown = list(dict.fromkeys(kinds.values()))
    figure, axes = _panels(len(shown), "friction [N m]")
    for axis, kind in zip(axes, shown, strict=True):
        names = [name for name in fit.swing if kinds[name] == kind]
        for number, name in enumerate(names):
            speed, torque = fit.swing[name]
            color = COLORS[number % len(COLORS)]
            thin = slice(None, None, max(1, len(speed) * len(names) // MOST_POINTS))
            look: dict[str, Any] = {"markersize": 2, "alpha": 0.3, "color": color, "label": "sample in swing"}
            axis.plot(speed[thin], torque[thin], ".", **look)
            _draw_law(axis, joints.joints[name], speed, color, name)
        axis.set_title(kind)
        axis.set_xlabel("speed [rad/s]")
        legend(axis)
        if not names:
            axis.text(0.5, 0.5, "not known", transform=axis.transAxes, ha="center", color=INK)
    return figure_block(
        figure,
        "Legs in swing: torque less that of links and rotor against speed. The step at zero speed is twice the dry "
        "friction, the slope is the viscous friction.",
    )


def _draw_law(axis, record: JointRecord, speed: np.ndarray, color: str, name: str) -> None:
    """Draw a record's law over the speeds that its swings had."""
    level, slope, offset = record.coulomb_friction, record.viscous_friction, record.offset
    if level is None or slope is None:
        return  # a level without its slope is no law over speed
    constant = offset.value if offset is not None else 0.0
    sides = [side for side in (speed[speed > 0], speed[speed < 0]) if len(side)]
    for label, side in zip((name, None), sides, strict=False):
        ends = np.array([side.min(), side.max()])
        law = slope.value * ends + level.value * np.sign(ends) + constant
        axis.plot(ends, law, color=color, linewidth=2, label=label)


def _load(joints: JointsFile, fit: WalkFit) -> tuple[Markup, ...]:
    """Tabulate friction under load, or why it is not known, for each kind of joint; draw it for those that tell."""
    rows: dict[str, list[str]] = {}
    for name, record in joints.joints.items():
        data = record.diagnostics.get("load", {})
        carried, refusal = data.get("carried_torque"), data.get("refusal", "")
        if carried is not None or refusal:
            under_load = None if carried is None else Estimate.from_dict(data["carried_friction"], name)
            torque = "not known" if carried is None else f"{carried:.3g}"
            share = span(under_load, 100 / (record.torque_limit or 1))
            kind = _kind(name, record)
            rows[kind] = [kind, torque, span(under_load), share, refusal]
    header = ["", "torque, foot down [N m]", "dry friction then [N m]", "of limit [%]", "not known, because"]
    blocks = (table(header, rows.values()),) if rows else ()
    if not fit.load:
        return blocks
    figure, axes = _panels(len(fit.load), "friction [N]")
    for axis, (kind, (load, friction)) in zip(axes, fit.load.items(), strict=True):
        thin = slice(None, None, max(1, len(load) // MOST_POINTS))
        axis.plot(load[thin], friction[thin], ".", markersize=2.5, alpha=0.4, color=COLORS[0], label="sample")
        owners = (record.load_coefficient for name, record in joints.joints.items() if _kind(name, record) == kind)
        coefficient = next((estimate for estimate in owners if estimate is not None), None)
        if coefficient is not None:
            ends = np.array([load.min(), load.max()])
            axis.plot(ends, coefficient.value * ends, color=COLORS[1], linewidth=2, label="load coefficient")
            for bound in coefficient.interval95:
                axis.plot(ends, bound * ends, ":", color=COLORS[1], linewidth=1, label="its 95 % interval")
        legend(axis)
        axis.set_title(f"{kind}: {span(coefficient)}")
        axis.set_xlabel("load [N]")
    caption = (
        "The body's force and moment balance in stance, everything but the friction that grows with torque taken off. "
        "Samples that do not follow the line are noise."
    )
    return (*blocks, figure_block(figure, caption))


def _gait(fit: WalkFit) -> Markup:
    """Draw which foot bears load when."""
    figure, (axis,) = new_figure(size=(8.0, 2.4))
    feet = list(fit.gait)
    for number, foot in enumerate(feet):
        down = fit.gait[foot].astype(bool)
        look: dict[str, Any] = {"color": COLORS[0], "label": "the foot bears load"}
        axis.fill_between(fit.gait_time, number - 0.35, number + 0.35, where=down, step="post", **look)
    legend(figure, labelled(axis), loc="outside upper right")
    axis.set_yticks(range(len(feet)), [foot.removesuffix("_foot") for foot in feet])
    axis.invert_yaxis()
    axis.set_xlabel("time [s]")
    return figure_block(figure, "The gaps between the bars are the swings that were used.")


def _diagnostics(joints: JointsFile) -> Markup:
    """Tabulate the numbers behind the fits."""
    shown = {
        "swings": "{:.0f}",
        "samples_used": "{:.0f}",
        "scaled_condition_number": "{:.3g}",
        "rms_residual": "{:.2g}",
        "coulomb_friction_by_heavier_links": "{:+.2g}",
    }
    rows = [
        [name]
        + [form.format(record.diagnostics[key]) if key in record.diagnostics else "" for key, form in shown.items()]
        for name, record in joints.joints.items()
    ]
    header = [
        "",
        "swings",
        "samples",
        "condition number",
        "rms residual [N m]",
        "dry friction if links are heavier [N m]",
    ]
    return table(header, rows, "Diagnostics; the last column is in the intervals already")
