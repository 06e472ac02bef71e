"""Randomised values that act, and friction that holds, on arrays worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction import StictionError, check_draws, check_hold
from stiction.core.draws import judge_draw

NAN = float("nan")


@pytest.mark.parametrize(
    ("values", "declared", "seen", "still", "verdict"),
    [
        # Two resets of two worlds with two joints.
        ([[[1, 2], [3, 4]], [[5, 6], [7, 8]]], (1, 8), (1, 8), (), "acts"),
        ([[[1, 2], [3, 4]], [[1, 2], [3, 4]]], (0, 9), (1, 4), (), "acts"),  # drawn once
        ([[[1, 2], [3, 4]], [[1, 2], [3, 4]]], None, (1, 4), (), "acts"),
        ([[[1, 2], [3, 9]], [[1, 2], [3, 4]]], (1, 8), (1, 9), (), "does not act: outside its range"),
        (
            [[[1, 2], [1, 2]], [[1, 2], [1, 2]]],
            (1, 2),
            (1, 2),
            (0, 1),
            "does not act: the same in all worlds and resets",
        ),
        ([[[1, 2], [1, 3]], [[1, 2], [1, 2]]], (1, 3), (1, 3), (0,), "does not act in 1 of 2"),
        ([[[1, 2], [1, 2]], [[3, 4], [3, 4]]], (1, 4), (1, 4), (), "does not act: one value for all worlds"),
        ([[[1, 2]], [[3, 4]]], (1, 4), (1, 4), (), "acts"),  # there is one world
        ([[[1, NAN], [2, NAN]], [[3, NAN], [4, NAN]]], (1, 4), (1, 4), (1,), "does not act in 1 of 2"),
        ([[[NAN], [NAN]]], (1, 4), None, (0,), "does not act: the same in all worlds and resets"),
        ([[[2], [2]], [[2], [2]]], (2, 2), (2, 2), (0,), "constant, as declared"),
        ([[[2], [3]], [[2], [2]]], (2, 2), (2, 3), (), "does not act: outside its range"),
    ],
)
def test_verdicts(
    values: list, declared: tuple | None, seen: tuple | None, still: tuple[int, ...], verdict: str
) -> None:
    """Each entry must change, worlds must differ, and all must be in range."""
    draw = judge_draw("x", np.array(values, float), declared)
    assert (draw.seen, draw.still, draw.verdict) == (seen, still, verdict)
    assert draw.ok == (verdict in ("acts", "constant, as declared"))


@pytest.mark.parametrize(
    ("values", "declared", "still", "verdict"),
    [
        # Six resets of one world with two joints.
        (np.linspace(0, 1e-6, 6), (0, 0.24), (0, 1), "does not act: covers 0.00042 % of its range"),
        (np.linspace(0, 0.24, 6), (0, 0.24), (1,), "does not act in 1 of 2: covers 0.042 % of its range"),
        (np.linspace(0.1, 0.112, 6), (0.1, 0.34), (), "acts"),  # exactly 5 %
        (np.geomspace(1e-3, 2e-3, 6), (1e-3, 1), (), "acts"),  # 0.1 % linear, 10 % logarithmic
        (np.linspace(0, 1e-6, 6), None, (), "acts"),
        (np.linspace(0, 1e-6, 5), (0, 0.24), (), "acts"),  # five draws tell too little
    ],
)
def test_a_small_part_of_the_range_does_not_act(
    values: np.ndarray, declared: tuple | None, still: tuple[int, ...], verdict: str
) -> None:
    """The second joint has the first one's values, or those within 1e-4 of 0.05."""
    second = 0.05 + 1e-4 * np.linspace(0, 1, len(values)) if still == (1,) else values
    draw = judge_draw("x", np.stack([values, second], axis=1)[:, None], declared)
    assert (draw.still, draw.verdict, draw.ok) == (still, verdict, verdict == "acts")


def test_single_precision_is_inside_its_range() -> None:
    """0.1 of single precision is 1.5e-9 above 0.1."""
    values = np.array([[[np.float32(0.05)], [np.float32(0.1)]]])
    assert judge_draw("x", values, (0.05, 0.1)).ok and not judge_draw("x", values, (0.05, 0.0999)).ok


def test_views_that_are_overwritten_are_copied() -> None:
    """An environment hands out the memory that its next reset writes to; three resets give 1, 2 and 3."""
    memory = np.zeros((1, 1))
    (draw,) = check_draws(
        lambda: np.add(memory, 1, out=memory), lambda: {"x": memory, "y": memory}, {"x": (1, 3)}, resets=3
    )
    assert draw.ok and draw.seen == (1, 3)


@pytest.mark.parametrize(
    ("ranges", "read", "resets", "message"),
    [
        ({"mas": (0, 1)}, {"mass": np.zeros((2, 1))}, 2, r"unknown value 'mas'; did you mean 'mass'"),
        ({"mass": (1, 0)}, {"mass": np.zeros((2, 1))}, 2, r"got \(1, 0\) for 'mass', expected \(lowest, highest\)"),
        ({"mass": (0, NAN)}, {"mass": np.zeros((2, 1))}, 2, r"expected \(lowest, highest\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros(())}, 2, r"got 'mass' of shape \(\), expected \(worlds, ...\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros((0, 1))}, 2, r"got 'mass' of shape \(0, 1\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros((2, 1))}, 0, r"got 0 resets, expected 1 or more"),
    ],
)
def test_what_cannot_be_judged_is_refused(ranges: dict, read: dict, resets: int, message: str) -> None:
    """In a line that names it."""
    with pytest.raises(StictionError, match=message):
        check_draws(lambda: None, lambda: read, ranges, resets=resets)


class Slide:
    """Two worlds with two joints of 0.5 N m and 2 N m, of 1 kg m², which a torque above friction moves by 2 mrad."""

    def __init__(self) -> None:
        self.position, self.torques = np.ones((2, 2)), []

    def step(self, torque: np.ndarray) -> None:
        """Move what is under more torque than its friction."""
        self.torques.append(torque)
        self.position += 2e-3 * (torque > np.array([0.5, 2.0]))


def test_joints_hold_under_a_share_of_their_friction() -> None:
    """0.8 of the friction holds for ten steps; 0.8 of four times as much moves 20 mrad, in one world."""
    slide = Slide()
    assert [
        joint.verdict for joint in check_hold(slide.step, lambda: slide.position, {"a": 0.5, "b": 2}, steps=10)
    ] == [
        "holds",
        "holds",
    ]
    np.testing.assert_allclose(slide.torques[-1], [[0.4, 1.6], [0.4, 1.6]])
    a, b = check_hold(slide.step, lambda: slide.position, {"a": [0.0, 2.0], "b": 0.0}, steps=10)
    assert (a.ok, a.verdict, a.friction, a.moved) == (False, "does not hold", 2.0, pytest.approx(0.02))
    assert b.ok and b.moved == 0.0
    assert not any(
        joint.ok for joint in check_hold(slide.step, lambda: slide.position, {"a": 0.5, "b": 2}, steps=10, share=1.2)
    )


def test_a_position_that_is_no_number_does_not_hold() -> None:
    """A simulation that diverges has no place."""
    positions = iter([np.zeros((1, 1)), np.full((1, 1), NAN)])
    (joint,) = check_hold(lambda torque: None, lambda: next(positions), {"a": 1.0}, steps=1)
    assert not joint.ok and joint.moved == np.inf


@pytest.mark.parametrize(
    ("friction", "steps", "message"),
    [
        ({"a": 1.0}, 1, r"got positions of shape \(2, 2\), expected \(worlds, 1\)"),
        (
            {"a": 1.0, "b": [1.0]},
            1,
            r"got friction of 'b' of shape \(1,\), lowest 1, expected a number or 2, 0 or more",
        ),
        ({"a": 1.0, "b": -1.0}, 1, r"got friction of 'b' of shape \(\), lowest -1"),
        ({"a": 1.0, "b": NAN}, 1, r"got friction of 'b' of shape \(\), lowest nan"),
        ({"a": 1.0, "b": 1.0}, 0, r"got 0 steps, expected 1 or more"),
    ],
)
def test_a_hold_that_cannot_be_measured_is_refused(friction: dict, steps: int, message: str) -> None:
    """In a line that names it."""
    with pytest.raises(StictionError, match=message):
        check_hold(lambda torque: None, lambda: np.zeros((2, 2)), friction, steps=steps)
