"""Verdicts and tables of the page of engines, from rows written by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction_experiments.engines.page import conformance_lines, figure_table, judge
from stiction_experiments.engines.run import FigureRow
from stiction_experiments.engines.walks import COARSE, FINE_TRAINING, MUJOCO, STIFF, TRAINING, WalkRow

ROW = FigureRow("mujoco", 0.002, "standing", "tilt", 0.01, "rad", 0.02, True)

WALK = WalkRow("p", TRAINING, 0.005, 0.0, "vx=0.5", 3, 1.0, 0.98, 1.02, 0, 0.0, 0.56, None, None, None)


def walks(**speeds: float) -> list[WalkRow]:
    """Return a walk in each simulator at these speeds, intervals of ±0.01."""
    names = {"training": TRAINING, "mujoco": MUJOCO, "stiff": STIFF, "coarse": COARSE, "fine": FINE_TRAINING}
    base = speeds["training"]
    return [
        replace(
            WALK,
            simulator=names.get(name, name),
            speed_ratio=speed,
            speed_low=speed - 0.01,
            speed_high=speed + 0.01,
            to_training=None if name == "training" else speed / base,
            to_training_low=None if name == "training" else speed / base - 0.01,
            to_training_high=None if name == "training" else speed / base + 0.01,
        )
        for name, speed in speeds.items()
    ]


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [
        (0.9, 1.1, "within"),
        (0.89, 1.05, "not decided"),
        (0.5, 1.5, "not decided"),
        (0.5, 0.89, "outside"),
        (1.11, 1.3, "outside"),
        (None, None, "not decided"),
    ],
)
def test_a_verdict_asks_the_whole_interval(low: float | None, high: float | None, verdict: str) -> None:
    """A mean that happens to be near one would count as reached, whatever its error."""
    assert judge(low, high) == verdict


def test_who_passes_and_what_fails() -> None:
    """An engine with a figure out of bounds would stand among those that pass."""
    rows = [ROW, replace(ROW, engine="ode"), replace(ROW, engine="ode", figure="drift", value=None, passed=False)]
    assert conformance_lines(rows) == [
        "mujoco passes 1 of 1 figures at steps of 2 ms.",
        "ode passes 1 of 2 figures at steps of 2 ms, not standing: drift.",
    ]


def test_a_failed_figure_cannot_be_read_as_a_pass() -> None:
    """A number in a table of numbers is easily overlooked; one engine that fails fails the line."""
    rows = [ROW, replace(ROW, engine="ode", value=0.03, passed=False)]
    header, (line,) = figure_table([*rows, replace(ROW, timestep=0.005)], 0.002)
    assert header == ["check", "figure", "bound", "mujoco", "ode", "verdict"]
    assert line == ["standing", "tilt", "0.02 rad", "0.01", "0.03 FAIL", "FAIL"]
    _, (_, alone) = figure_table([ROW, replace(ROW, engine="ode"), replace(ROW, figure="drift")], 0.002)
    assert alone[-2:] == ["–", "FAIL"]
