"""Figures of the study of adaptation: what tells the friction, and what another latent does. Every seed is shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from stiction.report.page import COLORS, INK, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROWS = {"step": "one step", "walk": "whole walk"}
"""What a probe of the figure reads at once -> its words."""

LOWEST = -0.2
"""Left end of the axis of R² [-]: what is below is drawn there, it tells nothing either."""


def draw_probes(methods: dict[str, Any], inputs: dict[str, str], targets: dict[str, str]) -> Figure:
    """Return R² of every input, a panel for friction per joint and one for friction per robot.

    A dot is a seed, a bar the t-interval of their mean where there are several.

    Args:
        methods: training -> `probes`, as in the summary; those of a step and of whole walks are drawn.
        inputs: input -> its words, in the order from top to bottom.
        targets: `joint` and `robot` -> what a panel is called.

    """
    probes = {method: [p for p in found["probes"] if not p["shuffled"]] for method, found in methods.items()}
    there = {(probe["input"], probe["row"]) for found in probes.values() for probe in found}
    shown = [(name, row) for name in inputs for row in ROWS if (name, row) in there]
    figure, axes = new_figure(1, len(targets), size=(4.6 * len(targets) + 1.6, 0.42 * len(shown) + 1.6))
    heights = {key: height for height, key in enumerate(shown)}
    for axis, (per, title) in zip(axes, targets.items(), strict=True):
        for index, (method, found) in enumerate(probes.items()):
            shift = 0.12 * (index - (len(methods) - 1) / 2)
            for probe in (p for p in found if p["per"] == per and (p["input"], p["row"]) in heights):
                height = heights[probe["input"], probe["row"]]
                _mark(axis, probe, height + shift, COLORS[index % len(COLORS)], "" if height else method)
        axis.axvline(0.0, color=INK, linewidth=0.8)
        axis.set(title=title, xlabel="R² on unseen robots", xlim=(LOWEST, 1.02), ylim=(len(shown) - 0.5, -0.5))
        words = [f"{inputs[name]}, {ROWS[row]}" for name, row in shown]
        axis.set_yticks(range(len(shown)), words if axis is axes[0] else [""] * len(shown))
    legend(axes[0])
    return figure


def _mark(axis: Axes, probe: dict[str, Any], height: float, colour: str, label: str) -> None:
    """Draw one training's R² of one input."""
    interval = probe["interval95"]
    if interval is not None:
        axis.plot([max(end, LOWEST) for end in interval], [height, height], color=colour, linewidth=3, alpha=0.35)
    seeds = [max(value, LOWEST) for value in probe["each"]]
    axis.plot(seeds, [height] * len(seeds), "o", color=colour, markersize=4, label=label or None)


def draw_effects(methods: dict[str, Any], latents: dict[str, str]) -> Figure:
    """Return by how much another z* changes the speed ratio, over the friction level, a panel for each training.

    methods: training -> `effects`, as in the summary. A thin line is a seed, a thick one their mean.
    latents: where z* comes from -> its words.
    """
    figure, axes = new_figure(1, max(1, len(methods)), size=(3.8 * max(1, len(methods)), 3.2))
    for axis, (method, found) in zip(axes, methods.items(), strict=False):
        for colour, (latent, words) in zip(COLORS, latents.items(), strict=False):
            points = _sorted(found["effects"], latent)
            levels = [100 * point["level"] for point in points]
            for seed in range(len(points[0]["each"]) if points else 0):
                axis.plot(levels, [point["each"][seed] for point in points], color=colour, linewidth=0.7, alpha=0.5)
            axis.plot(levels, [p["difference"] for p in points], color=colour, marker="o", markersize=4, label=words)
        axis.axhline(0.0, color=INK, linewidth=0.8)
        axis.set(title=method, xlabel="friction, % of torque limit")
    ends = [end for axis in axes for end in axis.get_ylim()]
    for axis in axes:
        axis.set_ylim(min(ends), max(ends))  # the trainings are to be compared
    axes[0].set_ylabel("change of the speed ratio")
    legend(axes[0])
    return figure


def _sorted(effects: Sequence[dict[str, Any]], latent: str) -> list[dict[str, Any]]:
    """Return what one latent does to the speed ratio, from low friction to high."""
    found = [effect for effect in effects if (effect["latent"], effect["figure"]) == (latent, "speed_ratio")]
    return sorted(found, key=lambda effect: effect["level"])
