"""Whether randomised values act, on arrays that were worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction import StictionError, check_draws
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
    ("ranges", "read", "resets", "said"),
    [
        ({"mas": (0, 1)}, {"mass": np.zeros((2, 1))}, 2, r"unknown value 'mas'; did you mean 'mass'"),
        ({"mass": (1, 0)}, {"mass": np.zeros((2, 1))}, 2, r"got \(1, 0\) for 'mass', expected \(lowest, highest\)"),
        ({"mass": (0, NAN)}, {"mass": np.zeros((2, 1))}, 2, r"expected \(lowest, highest\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros(())}, 2, r"got 'mass' of shape \(\), expected \(worlds, ...\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros((0, 1))}, 2, r"got 'mass' of shape \(0, 1\)"),
        ({"mass": (0, 1)}, {"mass": np.zeros((2, 1))}, 0, r"got 0 resets, expected 1 or more"),
    ],
)
def test_what_cannot_be_judged_is_refused(ranges: dict, read: dict, resets: int, said: str) -> None:
    """In a line that names it."""
    with pytest.raises(StictionError, match=said):
        check_draws(lambda: None, lambda: read, ranges, resets=resets)
