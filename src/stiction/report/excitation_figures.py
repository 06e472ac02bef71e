"""The figures of a designed log's page: the motion against its limits, one sine instead, and other gains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from stiction.formats.design import DesignSignals, ExcitationDesign
from stiction.report.page import COLORS, INK, figure_uri, legend, new_figure, picture

MOST_POINTS = 4000
"""Points drawn per curve; more makes the page heavy and nothing clearer."""

SINES = (0.3, 0.5, 1.0, 2.0, 5.0)
"""Frequencies that are marked [Hz]."""


def draw_motion(design: ExcitationDesign, signals: DesignSignals) -> Markup:
    """Draw angle, speed and torque of one pattern against their limits."""
    shown = np.flatnonzero(signals.time <= design.pattern_duration)
    shown = shown[:: max(1, len(shown) // MOST_POINTS)]
    time = signals.time[shown]
    limits = design.limits
    figure, axes = new_figure(3, 1, (8.0, 6.4))
    rows = (
        ("position", "angle [rad]", (limits["low"], limits["high"])),
        ("velocity", "speed [rad/s]", (-limits["speed"], limits["speed"])),
        ("torque", "torque [N m]", (-limits["torque"], limits["torque"])),
    )
    for axis, (name, label, bounds) in zip(axes, rows, strict=True):
        values, low, high = (getattr(signals, name + end)[shown] for end in ("", "_low", "_high"))
        axis.fill_between(time, low, high, color=COLORS[0], alpha=0.25, linewidth=0, label="range of guesses")
        axis.plot(time, values, color=COLORS[0], linewidth=1.2, label="at the guess")
        if name == "position":
            axis.plot(time, signals.target[shown], color=COLORS[2], linewidth=1.0, linestyle=":", label="target")
        span = max(float(np.abs(low).max()), float(np.abs(high).max()))
        for bound in bounds:
            near = name != "torque" or abs(bound) < 4 * span
            if near:
                axis.axhline(bound, color=COLORS[1], linewidth=1.0, linestyle="--")
        axis.set_ylabel(label)
    axes[-1].set_xlabel("time [s]")
    legend(axes[0])
    far = limits["torque"] >= 4 * float(max(-signals.torque_low.min(), signals.torque_high.max()))
    note = f" The torque limit, {limits['torque']:g} N m, is far outside the picture." if far else ""
    return picture(
        figure_uri(figure),
        f"One of {design.repeats} equal patterns: a slow swing, whose torque is nearly all dry friction, and a fast "
        f"part, which brings speed and acceleration. Dashed: the limits.{note}",
    )


def draw_sines(design: ExcitationDesign) -> Markup:
    """Draw what one sine tells against its frequency, and the correlation of the two kinds of friction."""
    figure, (left, right) = new_figure(1, 2, (9.0, 4.2))
    frequency = [sine.frequency for sine in design.sines]
    for index, name in enumerate(("inertia", "viscous friction", "Coulomb friction")):
        left.loglog(frequency, [100 * sine.relative[index] for sine in design.sines], marker="o", ms=3, label=name)
    left.loglog(
        frequency, [100 * sine.worst for sine in design.sines], color=INK, marker="o", ms=3, label="worst in the range"
    )
    left.axhline(100 * design.worst, color=INK, linestyle="--", linewidth=1.2, label="the design, worst in the range")
    left.set_xlabel("frequency of the one sine [Hz]")
    left.set_ylabel("standard deviation [% of the value]")
    left.set_ylim(top=20 * left.get_ylim()[1])  # Room for the legend.
    legend(left)
    _plain(left, SINES)
    right.semilogx(frequency, [sine.correlation for sine in design.sines], marker="o", ms=3, label="one sine")
    right.axhline(design.correlation, color=INK, linestyle="--", linewidth=1.2, label="the design")
    right.set_ylim(-1.02, 0.02)
    right.set_xlabel("frequency of the one sine [Hz]")
    right.set_ylabel("correlation of B and f")
    legend(right)
    _plain(right, SINES)
    return picture(
        figure_uri(figure),
        "One sine of the same duration within the same limits, at each frequency, against the design.",
    )


def draw_sweep(design: ExcitationDesign) -> Markup:
    """Draw the deviation of Coulomb friction against the gain."""
    figure, (axis,) = new_figure(size=(8.0, 3.4))
    gains = [point.kp for point in design.sweep]
    for name, label, mark in (("position_only", "angle alone", "o"), ("with_torque", "angle and torque", "s")):
        values = [np.nan if (value := getattr(point, name)) is None else 100 * value for point in design.sweep]
        axis.loglog(gains, values, marker=mark, ms=4, label=label)
    axis.axvline(design.gains["kp"], color=INK, linestyle="--", linewidth=1.0, label="kp to run at")
    if design.setup["kp"] != design.gains["kp"]:
        axis.axvline(design.setup["kp"], color=INK, linestyle=":", linewidth=1.0, label="kp given")
    axis.set_xlabel("kp [N m/rad], kd with its root")
    axis.set_ylabel("std of f [% of the value]")
    legend(axis)
    _plain(axis, [point.kp for point in design.sweep])
    return picture(figure_uri(figure), "What the same trajectory tells of Coulomb friction at other gains.")


def _plain(axis, marks: Sequence[float]) -> None:
    """Label a logarithmic abscissa with plain numbers, the `marks` within its range."""
    low, high = axis.get_xlim()
    axis.set_xticks([mark for mark in marks if low <= mark <= high])
    axis.set_xticks([], minor=True)
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
