"""The page of a designed log, drawn from `design.json` and `design.npz` alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from stiction.core.files import write_text
from stiction.core.records import two_digits
from stiction.files.design import DesignSignals, ExcitationDesign, load_design, percent, read_signals
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
    row_table,
    table,
)

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
    figure, axes = new_figure(3, 1, (9.0, 4.4))
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
            # A torque limit far outside would press the curves into a line.
            if name != "torque" or abs(bound) < 4 * span:
                axis.axhline(bound, color=COLORS[1], linewidth=1.0, linestyle="--", label="limit")
        axis.set_ylabel(label)
    axes[-1].set_xlabel("time [s]")
    legend(figure, labelled(axes[0]), loc="outside upper center", ncols=4)
    return figure_block(
        figure,
        f"One of {design.repeats} equal patterns: a slow swing, whose torque is nearly all dry friction, and a fast "
        "part, which brings speed and acceleration. A torque limit that is far outside is left out.",
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
    left.set(xlabel="frequency of the one sine [Hz]", ylabel="standard deviation [% of the value]")
    left.set_ylim(top=20 * left.get_ylim()[1])  # Room for the legend.
    legend(left)
    _plain(left, SINES)
    right.semilogx(frequency, [sine.correlation for sine in design.sines], marker="o", ms=3, label="one sine")
    right.axhline(design.correlation, color=INK, linestyle="--", linewidth=1.2, label="the design")
    right.set_ylim(-1.02, 0.02)
    right.set(xlabel="frequency of the one sine [Hz]", ylabel="correlation of B and f")
    legend(right)
    _plain(right, SINES)
    return figure_block(
        figure, "One sine of the same duration within the same limits, at each frequency, against the design."
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
    axis.set(xlabel="kp [N m/rad], kd with its root", ylabel="std of f [% of the value]")
    legend(axis)
    _plain(axis, [point.kp for point in design.sweep])
    return figure_block(figure, "What the same trajectory tells of Coulomb friction at other gains.")


def _plain(axis, marks: Sequence[float]) -> None:
    """Label a logarithmic abscissa with plain numbers, the `marks` within its range."""
    low, high = axis.get_xlim()
    axis.set_xticks([mark for mark in marks if low <= mark <= high])
    # On a logarithmic axis matplotlib labels minor ticks too.
    axis.set_xticks([], minor=True)
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def write_excitation_page(folder: Path) -> Path:
    """Write `report.html` beside the `design.json` and `design.npz` of `folder`; return its path."""
    design = load_design(folder / "design.json")
    signals = read_signals(folder / "design.npz")
    sections = [
        Section("How to run it", run_blocks(design)),
        Section(
            "What the log will tell", (row_table(design.predicted, PREDICTED), _assumptions(design), paragraph(WHITE))
        ),
        Section("Why one sine is not enough", (draw_sines(design), _sines(design), paragraph(ONE_SINE))),
        Section("Why these gains", (draw_sweep(design), paragraph(GAINS), row_table(design.trials, TRIALS))),
    ]
    page = folder / "report.html"
    title, drawn = f"Excitation of joint {design.joint}", draw_motion(design, signals)
    write_text(page, render_page(title, sections, lead(design), design.warnings, design.command, figure=drawn))
    return page


def lead(design: ExcitationDesign) -> str:
    """Return how to run the log and what it tells."""
    return (
        f"{design.advice} Play the trajectory back for {design.duration:g} s. White noise alone would leave the worst "
        f"of inertia, viscous and Coulomb friction uncertain by {percent(design.worst)}, whatever the joint is within "
        f"a factor of {design.setup['spread']:g} of the guesses."
    )


PREDICTED = "Smallest standard deviation that an estimator can reach (Cramér–Rao), for the whole log"

WHITE = (
    "The prediction is for white noise, gains and target that are known exactly, and Coulomb's friction. Noise that "
    "the controller feeds back into the joint, jitter of the clock, cogging and friction of another law are not in it: "
    "the intervals of the real log will be wider, and stiction identify measures them."
)

ONE_SINE = (
    "A slow sine shows dry friction and hardly any inertia or viscous friction. A fast one shows inertia; dry and "
    "viscous friction merge, a correlation of ±1 means that the log cannot tell them apart. At nearly one speed, no "
    "single sine shows that friction changes with speed. The time that a log takes grows with the square of the ratio."
)

GAINS = (
    "Friction makes the angle lag by f/kp: the stiffer the loop, the less of it an encoder sees. A logged torque is "
    "worth having once kp times the noise of the angle exceeds the noise of the torque: from there on high gains cost "
    "nothing more. Gains that are not known exactly, or a motor that is not its command, move that to lower kp."
)

TRIALS = (
    "Gains compared before the search, by the best of six motions; reach is the range of the motion over that of its "
    "target, for the joint that follows worst"
)


def run_blocks(design: ExcitationDesign) -> tuple[Markup, ...]:
    """Return instructions to run the motion safely."""
    gains, limits, reached = design.gains, design.limits, design.reached
    steps = (
        f"Clear the range from {limits['low']:.3g} to {limits['high']:.3g} rad, and keep a hand on the stop. Fasten "
        "the base.",
        f"Set kp {gains['kp']:g} and kd {gains['kd']:g}, and let the driver cut off at the limits below.",
        f"Bring the joint to {design.setup['start']:.4g} rad slowly, and hold it there: the motion starts and ends "
        "there, at rest.",
        f"Send trajectory.csv at {design.setup['rate']:g} Hz, one row a sample. First play it at half the amplitude "
        "about the start pose, and listen.",
        f"Log time, angle{design.torque_too} and target at the same rate, with the time of the sample and not of the "
        "writing. Keep the sidecar trajectory.json beside the log, under the log's name.",
        f"Then: {design.next_command}",
    )
    names = {"low": "lowest angle [rad]", "high": "highest angle [rad]", "speed": "speed [rad/s]"}
    names |= {"torque": "torque [N m]"}
    rows = [[label, f"{limits[name]:.4g}", f"{reached[name]:.4g}"] for name, label in names.items()]
    caption = (
        "The furthest that any joint within the range of guesses goes, in simulation; the target counts as an angle"
    )
    numbered = ([str(number), step] for number, step in enumerate(steps, 1))
    return table(["", "what to do"], numbered), table(["", "limit", "reached"], rows, caption)


def _assumptions(design: ExcitationDesign) -> Markup:
    """Tabulate what the prediction rests on, and how long a log must be."""
    setup, wanted = design.setup, design.wanted
    torque = "not logged" if setup["position_only"] else f"{setup['noise_torque']:g} N m"
    crossing = (setup["noise_torque"] or 0.0) / np.hypot(setup["noise_position"], setup["resolution"] / 12**0.5)
    rows = [
        ["white noise of the angle", f"{setup['noise_position']:g} rad"],
        ["white noise of the torque", torque],
        ["step of the encoder", f"{setup['resolution']:g} rad"],
        ["kp from which on a logged torque is worth having", f"{crossing:.3g} N m/rad"],
        ["correlation of viscous and Coulomb friction", f"{design.correlation:.2f}"],
        [f"log for Coulomb friction to {percent(wanted['relative'])}, at worst", f"{wanted['duration']:g} s"],
    ]
    return table(["", "value"], rows)


def _sines(design: ExcitationDesign) -> Markup:
    """Tabulate what single sines leave, against the design."""
    if not design.sines:
        return paragraph("No single sine fits the limits and moves the joint.")
    rows = [
        [f"{sine.frequency:.2g}", percent(sine.worst), two_digits(sine.worst / design.worst), f"{sine.correlation:.3f}"]
        for sine in design.sines
    ]
    header = ["frequency [Hz]", "worst deviation", "over the design's", "correlation of B and f"]
    return table(header, rows, "One sine instead")
