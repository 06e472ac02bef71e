"""The page of one identification, drawn from `joints.json` and `fit.npz` alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup

from stiction.formats.fit import FitSignals, read_fit
from stiction.formats.joints import PARAMETERS, Estimate, JointRecord, load_joints
from stiction.report.page import (
    COLORS,
    Section,
    figure_uri,
    legend,
    new_figure,
    paragraph,
    picture,
    render_page,
    table,
)

MOST_POINTS = 4000
"""Points drawn per curve; more makes the page heavy and nothing clearer."""

LABELS = {
    "inertia": ("Inertia I", "kg m²", "kg"),
    "viscous_friction": ("Viscous friction B", "N m s/rad", "N s/m"),
    "coulomb_friction": ("Dry (Coulomb) friction f", "N m", "N"),
    "offset": ("Offset", "N m", "N"),
    "friction_ratio": ("Friction over torque limit f/τ_max", "1", "1"),
    "dead_band": ("Dead band f/kp", "rad", "m"),
}
"""Quantity -> label, unit of a rotary joint, unit of a linear axis."""

CONDITIONS = {"bare_motor": "bare motor", "in_air": "leg in the air", "loaded": "under load", None: "not stated"}
SOURCES = {"motor_side": "on the motor's side (current or command)", "output_side": "behind the gear", None: "none"}


def write_identification_page(folder: Path) -> Path:
    """Write `report.html` beside the `joints.json` and `fit.npz` of `folder`; return its path."""
    joints = load_joints(folder / "joints.json")
    sections: list[Section] = []
    leads = []
    for name, record in joints.joints.items():
        fit = read_fit(folder / "fit.npz", name)
        leads.append(record.diagnostics.get("verdict", {}).get("text", ""))
        sections += joint_sections(name, record, fit)
    title = "Joint identification: " + ", ".join(joints.joints)
    page = folder / "report.html"
    page.write_text(render_page(title, sections, " ".join(leads), joints.warnings), encoding="utf-8")
    return page


def joint_sections(name: str, record: JointRecord, fit: FitSignals) -> list[Section]:
    """Return the sections of one joint."""
    return [
        Section(f"{name}: what was found", (_values(record), _setting(record))),
        Section(f"{name}: friction against speed", (_cloud(record, fit),)),
        Section(f"{name}: signals and fit", (_signals(record, fit), _residuals(record, fit))),
        Section(f"{name}: can it be trusted?", (*_comparison(record), _diagnostics(record))),
    ]


def unit(record: JointRecord, quantity: str) -> str:
    """Return the unit of a quantity on this kind of axis."""
    return LABELS[quantity][2 if record.axis == "linear" else 1]


def _axis_units(record: JointRecord) -> tuple[str, str]:
    """Return the units of position and torque."""
    return ("m", "N") if record.axis == "linear" else ("rad", "N m")


def _number(value: float) -> str:
    """Return a number with four digits."""
    return f"{value:.4g}"


def _cells(estimate: Estimate | None) -> list[str]:
    """Return value, deviation and interval as table cells."""
    if estimate is None:
        return ["not known", "", ""]
    low, high = estimate.interval95
    return [_number(estimate.value), _number(estimate.std), f"{_number(low)} to {_number(high)}"]


def _values(record: JointRecord) -> Markup:
    """Tabulate the parameters."""
    rows = [
        [f"{LABELS[name][0]} [{unit(record, name)}]", *_cells(getattr(record, name))]
        for name in (*PARAMETERS, "friction_ratio", "dead_band")
    ]
    return table(
        ["", "value", "std", "95 % interval"], rows, "Symmetric viscous and Coulomb friction, by torque regression"
    )


def _setting(record: JointRecord) -> Markup:
    """Say how the log was made."""
    given = {"kp": record.kp, "kd": record.kd, "torque limit": record.torque_limit}
    known = ", ".join(f"{name} {_number(value)}" for name, value in given.items() if value is not None)
    return paragraph(
        f"Test condition: {CONDITIONS[record.test_condition]}. Torque: {SOURCES[record.torque_source]}. "
        f"Given: {known or 'no gains and no torque limit'}. Intervals come from blocks of the log that are longer than "
        "the residual's memory, so that correlated residuals do not make them too narrow."
    )


def _thin(fit: FitSignals, low: float = 0.0, high: float = np.inf) -> np.ndarray:
    """Return indices of at most `MOST_POINTS` samples between two times."""
    chosen = np.flatnonzero((fit.time >= low) & (fit.time <= high))
    return chosen[:: max(1, len(chosen) // MOST_POINTS)]


def _law(record: JointRecord, speed: np.ndarray) -> np.ndarray:
    """Return the friction torque and offset of the fitted law at a speed."""
    values = [estimate.value if estimate else 0.0 for estimate in (record.viscous_friction, record.coulomb_friction)]
    return values[0] * speed + values[1] * np.sign(speed) + (record.offset.value if record.offset else 0.0)


def _cloud(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw torque without its inertial part against speed, and the fitted law through it."""
    position, torque = _axis_units(record)
    figure, (axis,) = new_figure(size=(8.0, 4.2))
    inertia = record.inertia.value if record.inertia else 0.0
    rest = fit.torque - inertia * fit.acceleration
    used = np.flatnonzero(fit.used > 0)
    used = used[:: max(1, len(used) // MOST_POINTS)]
    axis.plot(fit.velocity[used], rest[used], ".", markersize=2.5, alpha=0.35, label="torque − I × acceleration")
    top = float(np.abs(fit.velocity).max())
    for side in (-1.0, 1.0):
        speed = side * np.linspace(1e-6 * top, top, 50)
        axis.plot(speed, _law(record, speed), color=COLORS[1], linewidth=2, label="fitted law" if side > 0 else None)
    axis.set_xlabel(f"speed [{position}/s]")
    axis.set_ylabel(f"friction and offset [{torque}]")
    legend(axis)
    return picture(
        figure_uri(figure),
        "Each dot is a sample that entered the fit. The step at zero speed is twice the dry friction, the slope is the "
        "viscous friction. Samples around reversals are left out: there friction may take any value.",
    )


def _signals(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw position and torque over a few seconds, measured and fitted."""
    position, torque = _axis_units(record)
    start = 0.3 * float(fit.time[-1])
    shown = _thin(fit, start, start + min(5.0, 0.5 * float(fit.time[-1])))
    figure, (top, bottom) = new_figure(2, 1, (8.0, 5.0))
    time = fit.time[shown]
    if fit.target is not None:
        top.plot(time, fit.target[shown], label="target", linestyle=":", color=COLORS[2])
    top.plot(time, fit.position[shown], label="measured", color=COLORS[0])
    bottom.plot(time, fit.torque[shown], label="measured (filtered)", color=COLORS[0])
    bottom.plot(time, fit.fitted_torque[shown], label="regression", color=COLORS[1])
    if fit.simulated_position is not None and fit.simulated_torque is not None:
        top.plot(time, fit.simulated_position[shown], "--", label="simulated", color=COLORS[1])
        bottom.plot(time, fit.simulated_torque[shown], "--", label="simulated", color=COLORS[3])
    top.set_ylabel(f"position [{position}]")
    bottom.set_ylabel(f"torque [{torque}]" if record.axis != "linear" else f"force [{torque}]")
    bottom.set_xlabel("time [s]")
    legend(top)
    legend(bottom)
    return picture(
        figure_uri(figure),
        "A few seconds of the log. Simulated: the joint under its controller, from the target alone.",
    )


def _residuals(record: JointRecord, fit: FitSignals) -> Markup:
    """Draw what the regression does not explain."""
    figure, (axis,) = new_figure(size=(8.0, 2.6))
    used = np.flatnonzero(fit.used > 0)
    used = used[:: max(1, len(used) // MOST_POINTS)]
    axis.plot(fit.time[used], (fit.torque - fit.fitted_torque)[used], ".", markersize=2)
    axis.set_xlabel("time [s]")
    axis.set_ylabel(f"residual [{_axis_units(record)[1]}]")
    return picture(
        figure_uri(figure),
        "Measured minus fitted torque, at the samples used. A pattern here is physics that the law lacks.",
    )


def _comparison(record: JointRecord) -> tuple[Markup, ...]:
    """Tabulate regression against output error, if both were done."""
    other, gaps = record.diagnostics.get("output_error"), record.diagnostics.get("disagreement")
    if not other or not gaps:
        return (
            paragraph(
                "Only the torque regression was done: output error needs kp, kd, the target, and torque that fits them."
            ),
        )
    rows = []
    for name in PARAMETERS:
        found = Estimate.from_dict(other[name], f"output_error.{name}")
        estimate = getattr(record, name)
        sigmas, relative = gaps[name]["sigmas"], gaps[name]["relative"]
        own = f"{_number(estimate.value)} ± {_number(estimate.std)}" if estimate else "not known"
        theirs = f"{_number(found.value)} ± {_number(found.std)}"
        rows.append([f"{LABELS[name][0]} [{unit(record, name)}]", own, theirs, f"{relative:.1%}", f"{sigmas:.1f}"])
    header = ["", "torque regression", "output error", "difference", "in combined std"]
    errors = other["relative_errors"]
    return (
        table(header, rows, "Two estimators that fail in different ways: where they agree, the number can be trusted"),
        paragraph(f"Simulation error: position {errors['position']:.3%}, torque {errors['torque']:.2%} of the signal."),
    )


def _diagnostics(record: JointRecord) -> Markup:
    """Tabulate the numbers behind the fit."""
    shown = {
        "samples": ("samples in the log", "{:.0f}"),
        "samples_used": ("samples used", "{:.0f}"),
        "duration": ("duration [s]", "{:.3g}"),
        "sampling_rate": ("sampling rate [Hz]", "{:.4g}"),
        "cutoff": ("corner of the filter [Hz]", "{:.3g}"),
        "condition_number": ("condition number of the regressor", "{:.4g}"),
        "relative_torque_error": ("torque not explained", "{:.2%}"),
        "blocks": ("blocks behind the intervals", "{:.0f}"),
        "controller_mismatch": ("declared gains against logged torque", "{:.1%}"),
    }
    values = record.diagnostics
    return table(
        ["", "value"],
        [[label, form.format(values[key])] for key, (label, form) in shown.items() if values.get(key) is not None],
        "Diagnostics",
    )
