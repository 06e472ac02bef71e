"""The figures of one identified joint, drawn from its record and its signals alone."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from stiction.files.joints import FitSignals, JointRecord
from stiction.report.page import COLORS, axis_units, figure_block, legend, new_figure

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
            label = "viscous and Coulomb friction" if last else None
            axis.plot(fit.velocity[side], symmetric, ":", color=COLORS[2], linewidth=1.2, label=label)
        law = (fit.law_torque - fit.rigid_torque)[side]
        style = "." if _name(record) in ("position", "load") else "-"
        label = f"{_name(record)} law" if last else None
        axis.plot(fit.velocity[side], law, style, color=COLORS[1], linewidth=2, markersize=2, label=label)
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
    for axis, (label, pick, factor) in zip(axes, panels, strict=True):
        for line, name in enumerate(names):
            estimate = pick(records[name])
            if estimate is not None:
                shown = estimate.scaled(factor)
                axis.plot(shown.interval95, [line, line], color=COLORS[0], alpha=0.5, linewidth=4)
                axis.plot([shown.value], [line], "o", color=COLORS[0], markersize=4)
        axis.set_yticks(range(len(names)), names)
        axis.set_ylim(len(names) - 0.5, -0.5)
        axis.set_xlim(left=0)
        axis.set_xlabel(label)
    return figure_block(figure, "Dry friction of each joint with its 95 % interval, at rest where that is more.")


def _name(record: JointRecord) -> str:
    """Return the name of the law that was chosen."""
    return (record.friction_law or {}).get("law") or "coulomb"


def _used(fit: FitSignals) -> np.ndarray:
    """Return indices of at most `MOST_POINTS` samples that entered the fit."""
    used = np.flatnonzero(fit.used > 0)
    return used[:: max(1, len(used) // MOST_POINTS)]
