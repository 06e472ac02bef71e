"""Verdicts and tables of the page of engines, from rows written by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction_experiments.engines.page import conformance_lines, distance, figure_table, judge, simulator_table
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


def lines(rows: list[WalkRow]) -> dict[str, dict[str, str]]:
    """Return simulator -> column -> cell."""
    header, found = simulator_table(rows)
    return {line[0]: dict(zip(header, line, strict=True)) for line in found}


def test_simulators_are_compared_with_mujoco_its_step_and_its_contacts() -> None:
    """What a coarse step or soft contacts make would be put down to another engine."""
    found = lines(walks(training=1.0, fine=1.04, coarse=1.06, mujoco=1.05, stiff=1.18, physx=1.2))
    assert found["physx"]["differs from mujoco by [1]"] == "0.150"
    assert found["physx"]["differs from mujoco (contacts of 4 ms) by [1]"] == "0.020"
    assert found[TRAINING]["differs from mujoco (training's step) by [1]"] == "0.060"
    assert found[FINE_TRAINING]["differs from mujoco by [1]"] == "0.010"
    assert found[MUJOCO]["differs from mujoco by [1]"] == "–"
    assert distance(walks(training=1.0, mujoco=1.0, physx=1.2), "physx", STIFF) is None


def test_commanded_speed_is_counted_by_simulator_without_friction() -> None:
    """A policy that friction slows down would count as one that misses its command."""
    free = walks(training=1.1, mujoco=1.0, ode=1.4)
    slow = [replace(row, friction_level=0.2) for row in walks(training=0.5, mujoco=0.6)]
    found = lines([*free, *slow])
    reached = [row["within ±10% of the command, no friction [walks]"] for row in found.values()]
    assert reached == ["0 of 1 (1 not decided)", "1 of 1 (0 not decided)", "0 of 1 (0 not decided)"]
    assert found[MUJOCO]["speed over training's, 20% friction [1]"] == "1.20 to 1.20"
    assert (
        found["ode"]["speed over training's, 20% friction [1]"] == "–" and found["ode"]["falls [episodes]"] == "0 of 3"
    )
