"""Whether an identification can be trusted: if its parts agree, if its estimators do, and what is left over."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from stiction.formats.joints import Estimate, JointRecord
from stiction.report.labels import LABELS, number, unit
from stiction.report.page import paragraph, table

COMPARED = ("inertia", "viscous_friction", "coulomb_friction")
"""Parameters that parts and estimators are compared in."""


def agreement(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate what the halves of the log, its slow and fast parts, and repeats say by themselves."""
    blocks = []
    how = "by torque regression" if record.diagnostics.get("closed_loop") else "by output error"
    for comparison in record.diagnostics.get("comparisons", ()):
        one, two = comparison["parts"]
        rows = []
        for name in COMPARED:
            a, b = (Estimate.from_dict(data, name) for data in comparison["values"][name])
            gap = f"{comparison['sigmas'][name]:.1f}"
            rows.append([LABELS[name][0], _plus_minus(a), _plus_minus(b), gap])
        a, b = (Estimate.from_dict(data, "friction") for data in comparison["friction"])
        gap = abs(a.value - b.value) / max((a.std**2 + b.std**2) ** 0.5, 1e-300)
        label = f"Friction at a speed of {number(comparison['speed'])}"
        rows.append([label, _plus_minus(a), _plus_minus(b), f"{gap:.1f}"])
        blocks.append(table(["", one, two, "apart, in combined std"], rows, _caption(comparison, how)))
    tried = [
        [entry["source"], f"{entry['torque_error']:.2%}", _errors(entry["simulation_errors"] or {}) or "not done"]
        for entry in record.diagnostics.get("predictions", ())
    ]
    if tried:
        header = ["log", "torque not explained", "simulation error"]
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
    """Return the caption of a comparison; repeats and moved torque are always by torque regression."""
    if comparison["alternative"]:
        return "Torque and angle at the same instant, or not"
    if comparison["label"].startswith("repeat"):
        how = "by torque regression"
    return f"The same again: {comparison['label']}, each {how}"


def estimators(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate regression against output error and instrumental variables, those that were done."""
    names = {"instrumental_variable": "instrumental variable", "output_error": "output error"}
    others = {label: data for key, label in names.items() if (data := record.diagnostics.get(key))}
    if not others:
        reason = record.diagnostics.get("closed_loop") or "gains and target are not known"
        return (paragraph(f"Only the torque regression was done: {reason}."),)
    seen = record.diagnostics["seen"]
    rows = []
    for name in (name for name in (*COMPARED, "offset") if name in seen):
        cells = [_plus_minus(Estimate.from_dict(seen[name], name))]
        for data in others.values():
            if name not in data:
                cells.append("")
                continue
            cells.append(_plus_minus(Estimate.from_dict(data[name], name)))
        rows.append([f"{LABELS[name][0]} [{unit(record, name)}]", *cells])
    caption = "Estimators that fail in different ways: where they agree, the number can be trusted"
    if not record.torque_source:
        caption += "; in units of k"
    blocks = [table(["", "regression", *others], rows, caption)]
    if "output error" in others:
        errors = others["output error"]["relative_errors"]
        law = record.diagnostics.get("output_error_law")
        text = f"Simulation error: {_errors(errors)} of the signal, with viscous and Coulomb friction"
        blocks.append(paragraph(text + (f"; {_errors(law['relative_errors'])} with the law chosen." if law else ".")))
    return tuple(blocks)


def _errors(errors: dict[str, float]) -> str:
    """Return simulation errors in words."""
    return ", ".join(f"{name} {value:.3%}" for name, value in errors.items() if value is not None)


def _plus_minus(estimate: Estimate) -> str:
    """Return value ± deviation."""
    return f"{number(estimate.value)} ± {number(estimate.std)}"


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
