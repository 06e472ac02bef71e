"""The page of a designed log, drawn from `design.json` and `design.npz` alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from stiction.formats.design import DesignSignals, ExcitationDesign, load_design, percent, read_signals, two_digits
from stiction.report.page import (
    COLORS,
    INK,
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


UNITS = {
    "inertia": "kg m²",
    "viscous_friction": "N m s/rad",
    "(viscous_friction+k*kd)": "N m s/rad",
}
"""Quantity -> unit; every other parameter is a torque [N m]."""


def write_excitation_page(folder: Path) -> Path:
    """Write `report.html` beside the `design.json` and `design.npz` of `folder`; return its path."""
    design = load_design(folder / "design.json")
    signals = read_signals(folder / "design.npz")
    sections = [
        Section("How to run it", run_blocks(design)),
        Section("The motion, and its limits", (draw_motion(design, signals),)),
        Section("What the log will tell", (_predicted(design), *_meaning(design))),
        Section("Why one sine is not enough", (draw_sines(design), _sine_text(design))),
        Section("Why these gains", (draw_sweep(design), *_gain_blocks(design))),
    ]
    page = folder / "report.html"
    title = f"Excitation of joint {design.joint}"
    page.write_text(render_page(title, sections, lead(design), design.warnings), encoding="utf-8")
    return page


def lead(design: ExcitationDesign) -> str:
    """Return the answer in three sentences."""
    friction = next(row for row in design.predicted if row.name.startswith("coulomb_friction"))
    return (
        f"{design.advice} Play the trajectory back for {design.duration:g} s. White noise of the stated size alone "
        f"would leave the Coulomb friction uncertain by {percent(friction.relative)}, and the worst of inertia, "
        f"viscous and Coulomb friction by {percent(design.worst)}, whatever the joint is within a factor "
        f"of {design.setup['spread']:g} of the guesses."
    )


def run_blocks(design: ExcitationDesign) -> tuple[Markup, ...]:
    """Say how to run the log safely."""
    gains, limits = design.gains, design.limits
    start = design.setup["start"]
    steps = [
        [
            "1",
            f"Clear the range from {limits['low']:.3g} to {limits['high']:.3g} rad, and keep a hand on the stop. "
            "Fasten the base.",
        ],
        ["2", f"Set kp {gains['kp']:g} and kd {gains['kd']:g}, and let the driver cut off at the limits below."],
        [
            "3",
            f"Bring the joint to {start:.4g} rad slowly, and hold it there: the motion starts and ends there, at rest.",
        ],
        [
            "4",
            f"Send trajectory.csv at {design.setup['rate']:g} Hz, one row a sample. First play it at half the "
            "amplitude about the start pose, and listen.",
        ],
        [
            "5",
            f"Log time, angle{design.torque_too} and target at the same rate, with the time of the sample and not of "
            "the writing. Keep the sidecar trajectory.json beside the log, under the log's name.",
        ],
        ["6", f"Then: {design.next_command}"],
    ]
    reached = design.reached
    rows = [
        ["lowest angle [rad]", f"{limits['low']:.4g}", f"{reached['low']:.4g}"],
        ["highest angle [rad]", f"{limits['high']:.4g}", f"{reached['high']:.4g}"],
        ["speed [rad/s]", f"{limits['speed']:.4g}", f"{reached['speed']:.4g}"],
        ["torque [N m]", f"{limits['torque']:.4g}", f"{reached['torque']:.4g}"],
    ]
    caption = (
        "The furthest that any joint within the range of guesses goes, in simulation; the target counts as an angle"
    )
    return (table(["", "what to do"], steps), table(["", "limit", "reached"], rows, caption))


def _unit(name: str) -> str:
    """Return the unit of a parameter or of its combination with the motor strength, which has none."""
    return UNITS.get(name.removesuffix("/k"), "N m")


def _predicted(design: ExcitationDesign) -> Markup:
    """Tabulate the predicted deviations."""
    rows = [
        [
            f"{row.name} [{_unit(row.name)}]",
            f"{row.value:.4g}",
            f"{row.std:.2g}",
            percent(row.relative),
            percent(row.worst_relative),
        ]
        for row in design.predicted
    ]
    caption = "Smallest standard deviation that an estimator can reach (Cramér–Rao), for the whole log"
    return table(["", "guess", "std", "of the guess", "at worst in the range"], rows, caption)


def _meaning(design: ExcitationDesign) -> tuple[Markup, ...]:
    """Say what the prediction rests on, and how long a log must be."""
    setup, wanted = design.setup, design.wanted
    torque = "no torque" if setup["position_only"] else f"{setup['noise_torque']:g} N m of torque"
    return (
        paragraph(
            f"The correlation between viscous and Coulomb friction is {design.correlation:.2f}; ±1 would mean that the "
            f"log cannot tell them apart. For Coulomb friction to {percent(wanted['relative'])}, a log of "
            f"{wanted['duration']:g} s in whole patterns is enough even at worst, as far as white noise goes; the "
            "variance falls as one over the time."
        ),
        paragraph(
            f"This rests on white noise of {setup['noise_position']:g} rad of angle and {torque}, an encoder step of "
            f"{setup['resolution']:g} rad, gains and target that are known exactly, and friction that is Coulomb's. "
            "Noise that the controller feeds back into the joint, jitter of the clock, cogging and friction of another "
            "law are not in it: the intervals of the real log will be wider, 10 to 25 times in simulated logs with "
            "correlated noise in the loop, and stiction identify measures them."
        ),
    )


def _sine_text(design: ExcitationDesign) -> Markup:
    """Say what the figure shows, in the numbers of this joint."""
    if not design.sines:
        return paragraph("No single sine fits the limits and moves the joint.")
    best = min(design.sines, key=lambda sine: sine.worst)
    worst = max(design.sines, key=lambda sine: sine.worst)
    closest = min(design.sines, key=lambda sine: sine.correlation)
    ratio = best.worst / design.worst
    verdict = f"{two_digits(ratio)} times the design's worst deviation"
    if ratio > 1:
        verdict += f", so it takes {two_digits(ratio**2)} times as long to know as much"
    return paragraph(
        f"A slow sine shows dry friction and hardly any inertia or viscous friction; a fast one shows inertia, and dry "
        f"and viscous friction merge: at {closest.frequency:.2g} Hz their estimates have a correlation of "
        f"{closest.correlation:.3f}. Even the best frequency tried, {best.frequency:.2g} Hz, leaves {verdict}; "
        f"{worst.frequency:.2g} Hz leaves {two_digits(worst.worst / design.worst)} times. And a single sine, at nearly "
        "one speed, cannot show that friction changes with speed."
    )


def _gain_blocks(design: ExcitationDesign) -> tuple[Markup, ...]:
    """Say what gains do, and tabulate those that were compared."""
    crossing = (design.setup["noise_torque"] or 0.0) / np.hypot(
        design.setup["noise_position"], design.setup["resolution"] / 12**0.5
    )
    rows = [
        [
            f"{trial.kp:g}",
            f"{trial.kd:g}",
            percent(trial.worst) or "not known",
            f"{trial.reach:.0%}",
            "yes" if trial.tracks else "no",
        ]
        for trial in design.trials
    ]
    return (
        paragraph(
            "Friction makes the angle lag by f/kp: the stiffer the loop, the less of it an encoder sees, so with "
            "angles alone the deviation grows in proportion to kp. A logged torque is worth having once kp times the "
            f"noise of the angle exceeds the noise of the torque, here above kp {crossing:.3g}: from there on high "
            "gains cost nothing more. Under that, the angle and a loop whose gains are known exactly tell more of the "
            "torque than its sensor does. Gains that are not known exactly, or a motor that is not its command, move "
            "the crossing to lower kp."
        ),
        table(
            ["kp", "kd", "worst deviation", "reach", "tracks"],
            rows,
            "Gains compared before the search, by the best of six motions; reach is the range of the motion over "
            "that of its target, for the joint that follows worst",
        ),
    )
