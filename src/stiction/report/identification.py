"""The page of an identification, drawn from `joints.json` and `fit.npz` alone."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from stiction.core.files import write_text
from stiction.core.parallel import spread
from stiction.core.provenance import num_threads
from stiction.files.joints import (
    ARMATURE,
    PARAMETERS,
    Estimate,
    FitSignals,
    JointRecord,
    JointsFile,
    load_joints,
    read_fit,
)
from stiction.identification.consistency import COMPARED, REPEAT
from stiction.report.joint_figures import against_angle, cloud, overview, residuals, signals
from stiction.report.page import (
    CONDITIONS,
    SOURCES,
    Section,
    axis_units,
    bullets,
    cells,
    fold,
    label,
    number,
    paragraph,
    render_page,
    table,
    unit,
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

EXTRA = ("static_friction", "gravity_sin", "gravity_cos", "motor_strength", "encoder_bias", "delay")
"""Quantities that are shown only where they were found."""


def write_identification_page(folder: Path, command: str = "") -> Path:
    """Write `report.html` beside the `joints.json` and `fit.npz` of `folder`; return its path.

    command: that identified, if it was one.
    """
    joints = load_joints(folder / "joints.json")
    found = {name: record for name, record in joints.joints.items() if record.diagnostics}
    if len(joints.joints) == 1:
        sections = [section for name in found for section in _sections(folder, name)]
    else:
        tasks = [(folder, name) for name in found]
        drawn = dict(spread(_sections, tasks, num_threads() if len(tasks) >= MANY else 1))
        sections = _many(joints, {name: drawn[number] for number, name in enumerate(found)})
    page = folder / "report.html"
    named = ", ".join(joints.joints) if len(joints.joints) <= MOST_NAMES else f"{len(joints.joints)} joints"
    title = f"Joint identification: {named}"
    write_text(page, render_page(title, sections, lead_lines(joints, folder), remaining_warnings(joints), command))
    return page


def lead_lines(joints: JointsFile, folder: Path | None = None) -> tuple[str, ...]:
    """Return the verdict as the page and the terminal begin with it. folder: where training.json lies, to be named.

    Of one joint its three lines; of several how many there are, what to do first about those that are not valid, a line
    for all with the same reason, and the lines of the one with the most friction for its motor.
    """
    found = {name: record for name, record in joints.joints.items() if record.diagnostics}
    file = "training.json" if folder is None else shlex.quote(str(folder / "training.json"))
    lines = {
        name: tuple(line.replace("--friction-from training.json", f"--friction-from {file}") for line in said)
        for name, record in found.items()
        if (said := record.diagnostics.get("verdict", {}).get("lines")) is not None
    }
    if len(joints.joints) == 1:
        return next(iter(lines.values()), ())
    bad = [name for name, record in found.items() if record.objections]
    first = [_do_first(found, names) for names in _alike(found, bad)]
    valid = {name: record for name, record in found.items() if name not in bad}
    ratios = {name: record.friction_ratio for name, record in valid.items() if record.friction_ratio is not None}
    count = f"{len(found)} of {len(joints.joints)} joints were identified"
    none = "any" if len(bad) == len(found) else ", ".join(bad)
    count += f", {len(bad)} of them not validly: no friction is stated for {none}." if bad else "."
    if not valid:
        return (count, *first)
    if not ratios:
        return (count, *first, "Without torque limits their friction cannot be judged: --torque-limit.")
    # By the upper end: a joint whose friction is badly known may be the worst.
    worst = max(ratios, key=lambda name: ratios[name].interval95[1])
    return (count, *first, f"{worst} has the most dry friction for its motor:", *lines.get(worst, ()))


def _alike(found: Mapping[str, JointRecord], bad: Sequence[str]) -> list[list[str]]:
    """Return the joints that are not valid, those together that have the same first reason and the same to do."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in bad:
        first = found[name].objections[0]
        groups.setdefault((first.reason, first.remedy), []).append(name)
    return list(groups.values())


def _do_first(found: Mapping[str, JointRecord], names: Sequence[str]) -> str:
    """Return what to do first about joints that are alike, and what was seen: of the first one, where each differs."""
    first = [found[name].objections[0] for name in names]
    who = "all joints" if 1 < len(names) == len(found) else ", ".join(names)
    whose = f"{names[0]}, and the others alike: " if len({one.seen for one in first}) > 1 else ""
    return f"{who}: do first: {first[0].remedy}. {whose}{first[0].seen}."


def remaining_warnings(joints: JointsFile) -> list[str]:
    """Return `shared_warnings` without what the verdict says already: page and terminal have them below it."""
    said = " ".join(lead_lines(joints))
    return [text for text in shared_warnings(joints) if text not in said]


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
    found = {name: joints.joints[name] for name in drawn}
    rows = [[name, *joint_row(record)] for name, record in joints.joints.items()]
    over = all(record.coulomb_friction is None for record in found.values())
    caption = "In units of the motor strength k" if over else ""
    blocks = []
    shared = gather_warnings(joints)
    for name, record in found.items():
        parts = [block for section in drawn[name] for block in section.blocks]
        verdict = map(paragraph, record.diagnostics.get("verdict", {}).get("lines", ()))
        own = [text for text in record.warnings if len(shared[text]) == 1]
        title = f"{name}: not valid" if record.objections else name
        blocks.append(fold(title, [*verdict, *([bullets(own)] if own else []), *parts]))
    return [
        Section("All joints", (table(["joint", *joint_columns(found)], rows, caption), overview(found))),
        Section("Joint by joint", tuple(blocks)),
    ]


def joint_columns(found: Mapping[str, JointRecord]) -> list[str]:
    """Return the headings of `joint_row`, with the units of the joints, or of each kind of axis among them."""

    def units(quantity: str) -> str:
        return " or ".join(dict.fromkeys(unit(record, quantity) for record in found.values())) or "1"

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
    return [friction, interval, *numbers, ratio, band, (record.friction_law or {}).get("law") or ""]


def shared_warnings(joints: JointsFile) -> list[str]:
    """Return the warnings of a single joint; else those that several share, and why joints were refused."""
    said = gather_warnings(joints)
    if len(joints.joints) == 1:
        return list(said)
    refused = {name for name, record in joints.joints.items() if not record.diagnostics}
    return [
        f"{', '.join(names) if len(names) < len(joints.joints) else 'all'}: {text}"
        for text, names in said.items()
        if len(names) > 1 or set(names) & refused
    ]


def own_warnings(joints: JointsFile) -> list[tuple[str, str]]:
    """Return the warnings that one joint of several has alone, with its name; those of a refused one are shared."""
    if len(joints.joints) == 1:
        return []
    return [
        (names[0], text)
        for text, names in gather_warnings(joints).items()
        if len(names) == 1 and joints.joints[names[0]].diagnostics
    ]


def gather_warnings(joints: JointsFile) -> dict[str, list[str]]:
    """Return every warning once, with the joints that it concerns."""
    said: dict[str, list[str]] = {}
    for name, record in joints.joints.items():
        for text in record.warnings:
            said.setdefault(text, []).append(name)
    return said


def _values(record: JointRecord) -> Markup:
    """Tabulate the parameters."""
    always = (*PARAMETERS, "friction_ratio", "dead_band")
    shown = (*PARAMETERS, *EXTRA, "friction_ratio", "dynamic_ratio", "dead_band")
    rows = [
        [label(record, name), *cells(getattr(record, name))]
        for name in shown
        if name in always or getattr(record, name) is not None
    ]
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
    """Say how the log was made."""
    position, torque = axis_units(record)
    gain = "N" if record.axis == "linear" else "N m"
    given = {
        "kp": (record.kp, f"{gain}/{position}"),
        "kd": (record.kd, f"{gain} s/{position}"),
        "torque limit": (record.torque_limit, gain if torque == "N m of command" else torque),
    }
    known = ", ".join(f"{name} {number(value)} {own}" for name, (value, own) in given.items() if value is not None)
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
