"""Observations of policies that were trained elsewhere, against numbers worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.deploy.observation import ObservationBuilder, Sensors
from stiction.files.observation import GaitClock, HeightScan, ObservationLayout, Term

STANDING = np.array([0.5, -1.0])


def sensors(position: float = 0.0, **more: np.ndarray) -> Sensors:
    """One robot rolled by 0.2 rad, both joints at `position`."""
    tilted = np.array([np.cos(0.1), np.sin(0.1), 0.0, 0.0])
    return Sensors(tilted, np.array([1.0, 4.0, -2.0]), np.full(2, position), np.array([10.0, -10.0]), **more)


def layout(*terms: Term, **options) -> ObservationLayout:
    """Return a layout, of one frame where nothing else is said."""
    return ObservationLayout(terms, **({"history_length": 1} | options))


GRAVITY = Term("projected_gravity", 3, 1.0, 1e6, "base")
POSITION = Term("joint_position", 2, 1.0, 1e6, "joint", "standing")
TURN, LINEAR = (
    Term("command_turn", 1, 2.0, 1e6, "command"),
    Term("command_linear", 2, (1.0, 3.0), (1e6, 1.0), "command"),
)


def test_terms_of_others_by_hand() -> None:
    """A robot whose right side is 0.2 rad down has gravity on that side; parts of the command have their own scales."""
    builder = ObservationBuilder(layout(GRAVITY, TURN, LINEAR), STANDING)
    seen = builder.step(sensors(), np.array([0.5, 0.6, -0.2]), np.zeros(2))
    np.testing.assert_allclose(seen, [0.0, -np.sin(0.2), -np.cos(0.2), -0.4, 0.5, 1.0], atol=1e-7)


@pytest.mark.parametrize(
    ("stacking", "direction", "fill", "expected"),
    [
        ("frame_major", "oldest_first", "first", [[1, 1, 1, 1], [1, 1, 2, 2]]),
        ("frame_major", "oldest_first", "zero", [[0, 0, 1, 1], [1, 1, 2, 2]]),
        ("frame_major", "newest_first", "zero", [[1, 1, 0, 0], [2, 2, 1, 1]]),
    ],
)
def test_frames_are_stacked_as_said(stacking: str, direction: str, fill: str, expected: list[list[float]]) -> None:
    """A history the wrong way round is the most common way in which a public policy fails."""
    spec = layout(POSITION, history_length=2, layout=stacking, direction=direction, fill=fill)
    builder = ObservationBuilder(spec, np.zeros(2))
    assert [builder.step(sensors(p), np.zeros(3), np.zeros(2)).tolist() for p in (1.0, 2.0)] == expected


def test_terms_are_stacked_each_with_its_own_history() -> None:
    """All frames of each term, as Isaac Lab, mjlab and unitree_rl_lab stack: three of the angles, two of the action."""
    action = Term("last_action", 2, 1.0, 1e6, "joint", history_length=2)
    spec = layout(TURN, replace(POSITION, history_length=3), action, layout="term_major")
    builder = ObservationBuilder(spec, np.zeros(2))
    for step in (1.0, 2.0, 3.0):
        seen = builder.step(sensors(step), np.array([0.0, 0.0, step]), np.full(2, 10 * step))
    assert seen.tolist() == [6, 1, 1, 2, 2, 3, 3, 20, 20, 30, 30] and spec.size == 11
    newest = ObservationBuilder(replace(spec, direction="newest_first"), np.zeros(2))
    for step in (1.0, 2.0, 3.0):
        seen = newest.step(sensors(step), np.array([0.0, 0.0, step]), np.full(2, 10 * step))
    assert seen.tolist() == [6, 3, 3, 2, 2, 1, 1, 30, 30, 20, 20]


CLOCKED = layout(
    Term("phase_sin", 2, 1.0, 1e6, "clock"),
    Term("phase_cos", 2, 1.0, 1e6, "clock"),
    clock=GaitClock(0.08, (0.0, np.pi), first=1, standing=np.pi),
)


def test_a_gait_clock_by_hand() -> None:
    """A quarter of a turn each step, from the first one on; standing is π; walking on begins at the offsets."""
    builder = ObservationBuilder(CLOCKED, STANDING, control_period=0.02)
    walk, stand = np.array([0.5, 0.0, 0.0]), np.array([0.005, 0.0, -0.005])
    seen = [builder.step(sensors(), command, np.zeros(2)) for command in (walk, walk, stand, stand, walk, walk)]
    expected = [[1, -1, 0, 0], [0, 0, -1, 1], [0, 0, -1, -1], [0, 0, -1, -1], [0, 0, 1, -1], [1, -1, 0, 0]]
    np.testing.assert_allclose(seen, expected, atol=1e-6)
    builder.reset()
    np.testing.assert_allclose(builder.step(sensors(), walk, np.zeros(2)), expected[0], atol=1e-6)


def test_what_no_sensor_measures_is_never_made_up() -> None:
    """An unmeasured term is rejected, not replaced by zeros."""
    spec = layout(Term("base_linear_velocity", 3, 2.0, 1e6, "base"))
    with pytest.raises(StictionError, match="which no sensor of a robot measures"):
        ObservationBuilder(spec, STANDING).step(sensors(), np.zeros(3), np.zeros(2))
    known = sensors(base_linear_velocity=np.array([0.5, 0.0, 0.1]))
    seen = ObservationBuilder(spec, STANDING).step(known, np.zeros(3), np.zeros(2))
    np.testing.assert_allclose(seen, [1.0, 0.0, 0.2], rtol=1e-6)


def test_a_height_scan_by_hand() -> None:
    """Heights of the base over the ground, less the offset that its maker subtracts."""
    spec = layout(
        Term("height_scan", 2, 5.0, 1e6, "heading"), heights=HeightScan(((0.5, 0.0), (0.5, 0.2)), 0.5)
    )  # fmt: skip
    seen = ObservationBuilder(spec, STANDING).step(sensors(heights=np.array([0.6, 0.5])), np.zeros(3), np.zeros(2))
    np.testing.assert_allclose(seen, [0.5, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: layout(Term("phase", 2, 1.0, 1e6, "clock")),
        lambda: layout(GRAVITY, clock=GaitClock(1.0, (0.0,))),
        lambda: layout(GRAVITY, fill="last"),
        lambda: layout(GRAVITY, direction="random"),
        lambda: GaitClock(0.0, (0.0,)),
        lambda: GaitClock(1.0, (), 0),
        lambda: GaitClock(1.0, (0.0,), 7),
        lambda: HeightScan(((0.0, float("nan")),)),
        lambda: layout(replace(GRAVITY, size=2)).check(2, 1),
        lambda: layout(replace(LINEAR, scale=(1.0, 1.0, 1.0))).check(2, 1),
        lambda: layout(replace(GRAVITY, frame="joint")).check(2, 1),
    ],
)
def test_a_layout_that_no_runtime_can_build_is_refused(wrong) -> None:
    """Rejects an impossible layout before anything moves."""
    with pytest.raises(StictionError):
        wrong()
