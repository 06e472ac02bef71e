"""The page of an identification, drawn from `joints.json` and `fit.npz` alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from stiction.core.files import write_text
from stiction.core.parallel import spread
from stiction.core.provenance import num_threads
from stiction.files.bam import load_joints
from stiction.files.joints import PARAMETERS, Estimate, FitSignals, JointRecord, JointsFile, read_fit
from stiction.identification.consistency import COMPARED, REPEAT
from stiction.identification.held_out import prediction_text, predictions_text
from stiction.report.identified import identified_card, reservations
from stiction.report.joints import (
    CONDITIONS,
    EXTRA,
    SOURCES,
    axis_units,
    cells,
    gather_warnings,
    in_degrees,
    joint_columns,
    joint_row,
    label,
    lead_lines,
    number,
)
from stiction.report.page import (
    COLORS,
    Section,
    bullets,
    figure_block,
    fold,
    legend,
    new_figure,
    paragraph,
    render_page,
    table,
)


def agreement(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate what the halves of the log, its slow and fast parts, and repeats give by themselves."""
    blocks = []
    how = "by torque regression" if record.diagnostics.get("closed_loop") else "by output error"
    for comparison in record.diagnostics.get("comparisons", ()):
        one, two = comparison["parts"]
        rows = [
            [label(record, name), *map(_plus_minus, comparison["values"][name]), f"{comparison['sigmas'][name]:.1f}"]
            for name in COMPARED
        ]
        a, b = comparison["friction"]
        gap = abs(a["value"] - b["value"]) / max((a["std"] ** 2 + b["std"] ** 2) ** 0.5, 1e-300)
        position, torque = axis_units(record)
        speed = f"Friction at a speed of {number(comparison['speed'])} {position}/s [{torque}]"
        rows.append([speed, _plus_minus(a), _plus_minus(b), f"{gap:.1f}"])
        blocks.append(table(["", one, two, "apart [combined std]"], rows, _caption(comparison, how)))
    tried = [
        [entry["source"], f"{entry['torque_error']:.2%}", _errors(entry["simulation_errors"] or {}) or "not done"]
        for entry in record.diagnostics.get("predictions", ())
        if "refusal" not in entry
    ]
    if tried:
        header = ["log", "torque not explained [%]", "simulation error [% of the signal]"]
        blocks.append(table(header, tried, "The law that was chosen, tried on logs that it has not seen"))
    if (held := record.diagnostics.get("held_out")) is not None:
        blocks.append(paragraph(f"{held['source']}, held out: {prediction_text(held, record.axis)}."))
    drift = record.diagnostics.get("drift", {})
    if drift.get("change"):
        low, high = drift["change"]["interval95"]
        text = f"Friction changes by {drift['change']['value']:+.1%} from start to end ({low:+.1%} to {high:+.1%})."
        blocks.append(paragraph(text))
    elif drift.get("reason"):
        blocks.append(paragraph(f"Whether friction drifts cannot be told: {drift['reason']}."))
    return tuple(blocks)


def _caption(comparison: dict[str, Any], how: str) -> str:
    """Return the caption of a comparison; repeats are always by torque regression."""
    if comparison["alternative"]:
        return "Torque and angle at the same instant, or not"
    if comparison["label"].startswith(REPEAT):
        how = "by torque regression"
    return f"The same again: {comparison['label']}, each {how}"


def estimators(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate regression against output error, where that was done."""
    simulated = record.diagnostics.get("output_error")
    if not simulated:
        reason = record.diagnostics.get("closed_loop") or "gains and target are not known"
        return (paragraph(f"Only the torque regression was done: {reason}."),)
    seen = record.diagnostics["seen"]
    rows = [
        [
            label(record, name),
            *("" if name not in data else _plus_minus(data[name]) for data in (seen, simulated)),
        ]
        for name in (*COMPARED, "offset")
        if name in seen
    ]
    caption = "Estimators that fail in different ways: where they agree, the number can be trusted"
    if not record.torque_source:
        caption += "; in units of k"
    law = record.diagnostics.get("output_error_law")
    text = f"Simulation error: {_errors(simulated['relative_errors'])} of the signal, with viscous and Coulomb friction"
    text += f"; {_errors(law['relative_errors'])} with the law chosen." if law else "."
    return table(["", "regression", "output error"], rows, caption), paragraph(text)


def _errors(errors: dict[str, float]) -> str:
    """Return simulation errors in words."""
    return ", ".join(f"{name} {value:.3%}" for name, value in errors.items() if value is not None)


def _plus_minus(estimate: dict[str, Any]) -> str:
    """Return value ± deviation of an estimate as plain data."""
    return f"{number(estimate['value'])} ± {number(estimate['std'])}"


def diagnostics(record: JointRecord) -> Markup:
    """Tabulate the numbers behind the fit."""
    shown = {
        "samples": ("samples in the log", "{:.0f}"),
        "samples_used": ("samples used", "{:.0f}"),
        "duration": ("duration [s]", "{:.3g}"),
        "sampling_rate": ("sampling rate [Hz]", "{:.4g}"),
        "cutoff": ("corner of the filter [Hz]", "{:.3g}"),
        "condition_number": ("condition number of the regressor", "{:.4g}"),
        "scaled_condition_number": ("the same, columns of unit length", "{:.4g}"),
        "relative_torque_error": ("torque not explained", "{:.2%}"),
        "blocks": ("blocks behind the intervals", "{:.0f}"),
        "controller_mismatch": ("declared gains against logged torque", "{:.1%}"),
    }
    values = record.diagnostics
    rows = [[label, form.format(values[key])] for key, (label, form) in shown.items() if values.get(key) is not None]
    white = values.get("whiteness")
    if white:
        rows.append(["residual's memory [samples used]", f"{white['correlation_time']:.1f}"])
        rows.append(["correlation of neighbouring residuals", f"{white['first_lag']:.2f}"])
        rows.append(["probability of that from white noise", f"{white['probability']:.2g}"])
    timing = values.get("timing")
    if timing:
        jitter = "not visible" if timing["synthetic"] else f"{timing['jitter']:.2%}"
        rows.append(["jitter of the stamps [steps]", jitter])
        lost = f"{timing['dropped']}, {timing['duplicated']}, {timing['disordered']}"
        rows.append(["samples dropped, doubled, out of order", lost])
    return table(["", "value"], rows, "Diagnostics")


MANY = 4
"""Joints from which on they are drawn by several processes."""

MOST_NAMES = 4
"""Joints whose names fit into a title."""


def write_identification_page(folder: Path, command: str = "") -> Path:
    """Write `report.html` beside the `joints.json` and `fit.npz` of `folder`; return its path.

    command: that identified, if it was one.
    """
    joints = load_joints(folder / "joints.json")
    identified = {name: record for name, record in joints.joints.items() if record.diagnostics}
    if len(joints.joints) == 1:
        sections = [section for name in identified for section in _sections(folder, name)]
    else:
        tasks = [(folder, name) for name in identified]
        drawn = dict(spread(_sections, tasks, num_threads() if len(tasks) >= MANY else 1))
        sections = _many(joints, {name: drawn[number] for number, name in enumerate(identified)})
    page = folder / "report.html"
    named = ", ".join(joints.joints) if len(joints.joints) <= MOST_NAMES else f"{len(joints.joints)} joints"
    title = f"Joint identification: {named}"
    lead, card = lead_lines(joints, folder), identified_card(joints, folder, command)
    write_text(page, render_page(title, sections, lead, reservations(joints), command, card=card))
    return page


def joint_sections(name: str, record: JointRecord, fit: FitSignals) -> list[Section]:
    """Return the sections of one joint."""
    return [
        Section(f"{name}: what was found", (_values(record), *_combinations(record), _setting(record))),
        Section(f"{name}: friction", (cloud(record, fit), *against_angle(record, fit), *_law(record))),
        Section(f"{name}: signals and fit", (signals(record, fit), residuals(record, fit))),
        Section(f"{name}: can it be trusted?", (*agreement(record), *estimators(record), diagnostics(record))),
        *_meaning(name, record),
    ]


def _sections(folder: Path, name: str) -> list[Section]:
    """Return the sections of one joint of `folder`."""
    record = load_joints(folder / "joints.json").joints[name]
    return joint_sections(name, record, read_fit(folder / "fit.npz", name))


def _many(joints: JointsFile, drawn: dict[str, list[Section]]) -> list[Section]:
    """Return the sections of a page with several joints: all side by side first, then each behind its name.

    drawn: the sections of each joint that was identified.
    """
    records = {name: joints.joints[name] for name in drawn}
    rows = [[name, *joint_row(record)] for name, record in joints.joints.items()]
    over = all(record.coulomb_friction is None for record in records.values())
    caption = "In units of the motor strength k" if over else ""
    blocks = []
    shared = gather_warnings(joints)
    for name, record in records.items():
        parts = [block for section in drawn[name] for block in section.blocks]
        verdict = map(paragraph, record.diagnostics.get("verdict", {}).get("lines", ()))
        own = [text for text in record.warnings if len(shared[text]) == 1]
        title = f"{name}: not valid" if record.objections else name
        blocks.append(fold(title, [*verdict, *([bullets(own)] if own else []), *parts]))
    every = [table(["joint", *joint_columns(records)], rows, caption), overview(records)]
    if line := predictions_text(records):
        every.append(paragraph(line))
    return [
        Section("All joints", tuple(every)),
        Section("Joint by joint", tuple(blocks)),
    ]


def _values(record: JointRecord) -> Markup:
    """Tabulate the parameters."""
    always = (*PARAMETERS, "friction_ratio", "dead_band")
    shown = (*PARAMETERS, *EXTRA, "friction_ratio", "dynamic_ratio", "dead_band")
    rows = [
        [label(record, name), *cells(getattr(record, name))]
        for name in shown
        if name in always or getattr(record, name) is not None
    ]
    if (degrees := in_degrees(record, "dead_band")) is not None:
        rows.append(["The same in degrees [°]", *cells(degrees)])
    caption = "Viscous and Coulomb friction, the same in both directions"
    if record.holding_friction is not None:
        caption += "; ratio and dead band are those of the friction that holds the joint at rest"
    return table(["", "value", "std", "95 % interval"], rows, caption)


def _combinations(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate what is known where a parameter is not, and name the log that would show more."""
    if not record.combinations:
        return ()
    rows = [[label, *cells(estimate)] for label, estimate in record.combinations.items()]
    caption = "What this log tells; k is the motor strength, torque delivered over torque commanded"
    missing = record.diagnostics.get("strength", {}).get("missing")
    blocks = [table(["", "value", "std", "95 % interval"], rows, caption)]
    return (*blocks, paragraph(missing[0].upper() + missing[1:] + ".")) if missing else tuple(blocks)


def _setting(record: JointRecord) -> Markup:
    """Return the conditions under which the log was made."""
    position, torque = axis_units(record)
    gain = "N" if record.axis == "linear" else "N m"
    settings = {
        "kp": (record.kp, f"{gain}/{position}"),
        "kd": (record.kd, f"{gain} s/{position}"),
        "kp of the walk": (record.walking_kp, f"{gain}/{position}"),
        "torque limit": (record.torque_limit, gain if torque == "N m of command" else torque),
    }
    known = ", ".join(f"{name} {number(value)} {own}" for name, (value, own) in settings.items() if value is not None)
    return paragraph(
        f"Test condition: {CONDITIONS[record.test_condition]}. Torque: {SOURCES[record.torque_source]}. "
        f"Given: {known or 'no gains and no torque limit'}. Intervals come from resampling blocks of the log that are "
        "longer than the residual's memory, and admit what parts of the log say by themselves."
    )


def _law(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate the laws that were tried, and the parameters of the one that was chosen."""
    law = record.friction_law
    if not law:
        return ()
    rows = [
        [
            entry["law"],
            str(entry["parameters"]),
            f"{entry['held_out']:.2%}",
            "" if entry["law"] == "coulomb" else f"{entry['gain']:+.1%} ± {entry['gain_std']:.1%}",
            "" if entry["law"] == "coulomb" else f"{entry['evidence']:+.1f}",
            entry["verdict"],
        ]
        for entry in law["candidates"]
    ]
    header = ["law", "parameters", "torque not explained, unseen blocks", "squared error lower by", "evidence", ""]
    blocks = [paragraph(law["text"]), table(header, rows, "Laws that were tried; evidence is the drop of the BIC")]
    if law["law"] not in (None, "coulomb"):
        rows = [
            [label(record, name, " / k" if law["over_strength"] else ""), *cells(Estimate.from_dict(data, name))]
            for name, data in law["parameters"].items()
        ]
        how = {"output_error": "by output error", "torque_regression": "by torque regression"}
        caption = f"The law that was chosen, {how.get(law['method'], 'by regression')}"
        blocks.append(table(["", "value", "std", "95 % interval"], rows, caption))
    return tuple(blocks)


def _meaning(name: str, record: JointRecord) -> list[Section]:
    """Return what the verdict rests on, the rank among public robots with it."""
    details = record.diagnostics.get("verdict", {}).get("details", ())
    fine_print = fold("What the verdict rests on", [paragraph(text) for text in details])
    return [Section(f"{name}: what it means", (fine_print,))] if details else []


MOST_POINTS = 3000
"""Points drawn per curve; more makes the page heavy and nothing clearer."""

SHOWN = 5.0
"""Length of the stretch of signals that is drawn [s]."""


def cloud(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw friction, the torque less what inertia, gravity and offset take, against speed, and the law through it."""
    position, torque = axis_units(record)
    figure, (axis,) = new_figure(size=(8.0, 4.2), fixed=True)
    used = _used(fit)
    friction = fit.torque - fit.rigid_torque
    axis.plot(fit.velocity[used], friction[used], ".", markersize=2.5, alpha=0.35, label="measured")
    order = used[np.argsort(fit.velocity[used])]
    plain = _name(record) == "coulomb"
    # Each direction for itself: one line would join both levels across zero speed, where friction may take any value.
    for side in (order[fit.velocity[order] < 0], order[fit.velocity[order] > 0]):
        last = side is not None and len(side) and fit.velocity[side[0]] > 0
        if not plain:
            symmetric = (fit.fitted_torque - fit.rigid_torque)[side]
            named = "viscous and Coulomb friction" if last else None
            axis.plot(fit.velocity[side], symmetric, ":", color=COLORS[2], linewidth=1.2, label=named)
        law = (fit.law_torque - fit.rigid_torque)[side]
        style = "." if _name(record) in ("position", "load") else "-"
        named = f"{_name(record)} law" if last else None
        axis.plot(fit.velocity[side], law, style, color=COLORS[1], linewidth=2, markersize=2, label=named)
    axis.set(xlabel=f"speed [{position}/s]", ylabel=f"friction [{torque}]")
    legend(axis)
    return figure_block(
        figure,
        "Each dot is a sample that entered the fit. The step at zero speed is twice the dry friction, the slope is the "
        "viscous friction. Samples around reversals are left out: there friction may take any value.",
    )


def against_angle(record: JointRecord, fit: FitSignals) -> tuple[Markup, ...]:
    """Draw dry friction against the angle, where the law that was chosen depends on it; else nothing."""
    if _name(record) not in ("position", "load"):
        return ()
    position, torque = axis_units(record)
    law = record.friction_law or {}
    figure, (axis,) = new_figure(size=(8.0, 3.4), fixed=True)
    used = _used(fit)
    sign = np.sign(fit.velocity[used])
    slope = law["drawn"]["viscous_friction"]
    measured = sign * (fit.torque - fit.rigid_torque)[used] - slope * np.abs(fit.velocity[used])
    drawn = sign * (fit.law_torque - fit.rigid_torque)[used] - slope * np.abs(fit.velocity[used])
    order = np.argsort(fit.position[used])
    axis.plot(fit.position[used], measured, ".", markersize=2.5, alpha=0.35, label="measured")
    axis.plot(fit.position[used][order], drawn[order], ".", markersize=2, color=COLORS[1], label=f"{_name(record)} law")
    axis.axhline(law["drawn"]["symmetric"], linestyle=":", color=COLORS[2], label="one value for all angles")
    axis.set(xlabel=f"angle [{position}]", ylabel=f"dry friction [{torque}]")
    legend(axis)
    return (
        figure_block(
            figure,
            "Dry friction against the angle of the joint: what is left of the friction once the viscous part is off.",
        ),
    )


def signals(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw position and torque over a few seconds, measured and fitted."""
    position, torque = axis_units(record)
    start = 0.3 * float(fit.time[-1])
    end = start + min(SHOWN, 0.5 * float(fit.time[-1]))
    shown = np.flatnonzero((fit.time >= start) & (fit.time <= end))
    shown = shown[:: max(1, len(shown) // MOST_POINTS)]
    figure, (top, bottom) = new_figure(2, 1, (8.0, 5.0), fixed=True)
    time = fit.time[shown]
    if fit.target is not None:
        top.plot(time, fit.target[shown], label="target", linestyle=":", color=COLORS[2])
    top.plot(time, fit.position[shown], label="measured", color=COLORS[0])
    measured = "measured (filtered)" if record.torque_source else "from the controller's law (filtered)"
    bottom.plot(time, fit.torque[shown], label=measured, color=COLORS[0])
    bottom.plot(time, fit.law_torque[shown], label=f"regression, {_name(record)} law", color=COLORS[1])
    if fit.simulated_position is not None:
        top.plot(time, fit.simulated_position[shown], "--", label="simulated", color=COLORS[1])
    if fit.simulated_torque is not None:
        bottom.plot(time, fit.simulated_torque[shown], "--", label="simulated", color=COLORS[3])
    top.set_ylabel(f"position [{position}]")
    bottom.set_ylabel(f"torque [{torque}]" if record.axis != "linear" else f"force [{torque}]")
    bottom.set_xlabel("time [s]")
    legend(top)
    legend(bottom)
    return figure_block(
        figure, "A few seconds of the log. Simulated: the joint under its controller, from the target alone."
    )


def residuals(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw what the law does not explain."""
    figure, (axis,) = new_figure(size=(8.0, 2.6), fixed=True)
    used = _used(fit)
    if _name(record) != "coulomb":
        plain = (fit.torque - fit.fitted_torque)[used]
        axis.plot(fit.time[used], plain, ".", markersize=2, color=COLORS[2], alpha=0.5, label="viscous and Coulomb")
    axis.plot(fit.time[used], (fit.torque - fit.law_torque)[used], ".", markersize=2, label=f"{_name(record)} law")
    axis.set(xlabel="time [s]", ylabel=f"residual [{axis_units(record)[1]}]")
    legend(axis)
    return figure_block(
        figure, "Measured minus fitted torque, at the samples used. A pattern here is physics that the law lacks."
    )


def overview(records: dict[str, JointRecord]) -> Markup:
    """Draw the dry friction of all joints side by side, with intervals, and its share of the torque limit."""
    figure, axes = new_figure(1, 2, (8.0, 0.6 + 0.28 * len(records)))
    names = list(records)
    panels = (
        ("dry friction f, or f/k", lambda record: record.holding_friction or record.moving_friction, 1.0),
        ("f/τ_max [%]", lambda record: record.friction_ratio, 100.0),
    )
    for axis, (title, pick, factor) in zip(axes, panels, strict=True):
        for line, name in enumerate(names):
            estimate = pick(records[name])
            if estimate is not None:
                shown = estimate.scaled(factor)
                axis.plot(shown.interval95, [line, line], color=COLORS[0], alpha=0.5, linewidth=4)
                axis.plot([shown.value], [line], "o", color=COLORS[0], markersize=4)
        axis.set_yticks(range(len(names)), names)
        axis.set_ylim(len(names) - 0.5, -0.5)
        axis.set_xlim(left=0)
        axis.set_xlabel(title)
    return figure_block(figure, "Dry friction of each joint with its 95 % interval, at rest where that is more.")


def _name(record: JointRecord) -> str:
    """Return the name of the law that was chosen."""
    return (record.friction_law or {}).get("law") or "coulomb"


def _used(fit: FitSignals) -> np.ndarray:
    """Return indices of at most `MOST_POINTS` samples that entered the fit."""
    used = np.flatnonzero(fit.used > 0)
    return used[:: max(1, len(used) // MOST_POINTS)]
