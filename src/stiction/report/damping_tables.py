"""The tables of the study of damping: every difference, stability, whole robots, drawn joints, nets."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from stiction.formats.damping import LEVELS, DrawRow, NetRow, RobotRow, SwapRow
from stiction.report.page import table

NOISE = 1e-12
"""Difference up to which two motions count as the same, rounding apart [rad]."""


def swap_table(rows: Sequence[SwapRow]) -> Markup:
    """Return the differences as a table: robot, case and level down, swaps across."""
    names = list(dict.fromkeys(row.swap for row in rows))
    cells: dict[tuple[str, str, float], list[str]] = {}
    for row in rows:
        cells.setdefault((row.robot, row.case, row.level), []).append(size(row.position_difference, unit=False))
    lines = [[f"{robot}, {case}", f"{level:g}", *sizes] for (robot, case, level), sizes in cells.items()]
    caption = f"Largest difference of the angle [rad]. Levels: {'; '.join(f'{k}: {v}' for k, v in LEVELS.items())}."
    return table(["joint and case", "level", *names], lines, caption)


def stability_table(rows: Sequence[SwapRow]) -> Markup:
    """Return how the sampled loops grow, before and after all of k kd went to B."""
    lines = [
        [f"{row.robot}, {row.case}", f"{row.level:g}", f"{row.growth:.3f}", f"{row.growth_swapped:.3f}"]
        for row in rows
        if row.growth is not None and row.growth_swapped is not None and row.swap.startswith("all")
    ]
    return table(["joint and case", "period [s]", "with kd", "with B"], lines)


def robot_table(rows: Sequence[RobotRow]) -> Markup:
    """Return what whole robots did."""
    lines = [
        [
            row.policy,
            row.command,
            row.limits,
            f"{row.friction_level:.0%}",
            f"{row.saturated_share:.2%}",
            "–" if row.speed is None else f"{row.speed:.3f}",
            "–" if row.speed_swapped is None else f"{row.speed_swapped:.3f}",
            str(row.free_robots),
            "–" if row.free_difference is None else size(row.free_difference, unit=False),
            str(row.limited_robots),
            "–" if row.limited_difference is None else size(row.limited_difference, unit=False),
            size(row.twin_difference, unit=False),
        ]
        for row in rows
    ]
    header = ["driven by", "command or robot", "limits", "friction", "motors at limit", "speed [m/s]", "swapped [m/s]"]
    return table([*header, "under", "difference [rad]", "at limit", "difference [rad]", "twins"], lines)


def draw_table(rows: Sequence[DrawRow]) -> Markup:
    """Return what drawn damping does."""
    lines = [
        [
            f"{row.robot}, {row.situation}",
            row.way,
            f"{row.damping_std:.4f}",
            f"{row.spread:.6f}",
            "–" if row.pair_difference is None else size(row.pair_difference, unit=False),
        ]
        for row in rows
    ]
    return table(["joint and situation", "drawn", "std of B + k·kd [N m s/rad]", "spread [rad]", "pairs [rad]"], lines)


def net_table(rows: Sequence[NetRow]) -> Markup:
    """Return what nets in simulations do."""
    lines = [
        [
            f"{row.robot}, friction {row.friction_level:.2%}",
            row.log,
            row.simulated,
            f"{row.damping:.4f}",
            f"{row.total:.4f}",
            f"{row.true_total:.4f}",
            size(row.position_difference, unit=False),
        ]
        for row in rows
    ]
    header = ["logged joint", "torque", "B of the simulation", "w2", "w2 + B", "true B + k·kd"]
    return table([*header, "difference [rad]"], lines, "Damping in N m s/rad.")


def size(value: float, unit: bool = True) -> str:
    """Return an angle [rad] as text: nothing, one digit where it is rounding, else two."""
    if value == 0.0:
        return "exactly nothing" if unit else "0"
    text = f"{value:.0e}" if value < NOISE else f"{value:.2g}"
    return f"{text} rad" if unit else text
