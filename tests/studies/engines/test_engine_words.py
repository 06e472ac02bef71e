"""What the page of engines says, from rows written by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction.studies.engines.page import conformance_words, distance, figure_table, judge, walk_words
from stiction.studies.engines.walks import COARSE, FINE_TRAINING, MUJOCO, STIFF, TRAINING, FigureRow, WalkRow

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
    assert conformance_words(rows) == [
        "At steps of 2 ms, of 2 figures: mujoco passes all figures; ode fails 1 of 2 (standing: drift)."
    ]


def test_a_failed_figure_cannot_be_read_as_a_pass() -> None:
    """A number in a table of numbers is easily overlooked; one engine that fails fails the line."""
    rows = [ROW, replace(ROW, engine="ode", value=0.03, passed=False)]
    header, (line,) = figure_table([*rows, replace(ROW, timestep=0.005)], 0.002)
    assert header == ["check", "figure", "bound", "mujoco", "ode", "verdict"]
    assert line == ["standing", "tilt", "0.02 rad", "0.01", "0.03 FAIL", "FAIL"]
    _, (_, alone) = figure_table([ROW, replace(ROW, engine="ode"), replace(ROW, figure="drift")], 0.002)
    assert alone[-2:] == ["–", "FAIL"]


def test_contacts_explain_what_they_take_away_and_no_more() -> None:
    """The sentence about contacts would be the same whatever was measured."""
    explained = walk_words(walks(training=1.05, mujoco=1.0, stiff=1.18, physx=1.2))
    assert any("from mujoco (contacts of 4 ms) by 0.020: stiffer contacts take away 90%" in text for text in explained)
    open_one = walk_words(walks(training=1.05, mujoco=1.0, stiff=1.05, physx=1.2))
    assert any("do not explain most of the difference: 75% of it is left" in text for text in open_one)
    assert distance(walks(training=1.0, mujoco=1.0, physx=1.2), "physx", STIFF) is None


def test_the_step_of_the_training_is_told_from_its_engine() -> None:
    """What a coarse step makes would be put down to another engine."""
    words = walk_words(walks(training=1.0, fine=1.04, coarse=1.06, mujoco=1.05))
    assert any("by 0.060 at the same step" in text and text.endswith("of its own, by 0.010.") for text in words)
    assert not any("of its own, by" in text for text in walk_words(walks(training=1.0, mujoco=1.05)))


def test_engines_that_agree_exactly_leave_nothing_to_explain() -> None:
    """A difference of zero has no share."""
    words = walk_words(walks(training=1.0, mujoco=1.0, stiff=1.0, ode=1.0))
    assert any("ode does not differ from mujoco" in text for text in words)


def test_commanded_speed_is_counted_by_simulator() -> None:
    """1.15 misses the command, and is what the policy does in training's simulator too; 1.4 is not."""
    words = " ".join(walk_words(walks(training=1.1, mujoco=1.0, physx=1.15, ode=1.4)))
    assert "training 0 of 1 (1 not decided), mujoco 1 of 1, physx 0 of 1, ode 0 of 1" in words
    assert "policies reach 1.10 to 1.10" in words
    assert "Of the 2 walks in the engines that miss it, 1 is within" in words
    assert "0 of 12 robots fell" in words


def test_walks_with_friction_alone_say_nothing_of_the_command() -> None:
    """A policy that friction slows down would count as one that misses its command."""
    words = " ".join(walk_words([replace(row, friction_level=0.2) for row in walks(training=0.5, mujoco=0.6)]))
    assert "commanded speed is reached" not in words and "at 20% friction: mujoco 1.20 to 1.20" in words
    assert walk_words([]) == []
