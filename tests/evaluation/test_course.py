"""Courses of an evaluation: names, who may cross them, and what counts as crossed."""

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.course import PATIENCE, Course, parse_course
from stiction.files.velocity import parse_command
from stiction.robots.terrain import LANDING, REACH, STEPS, TREAD
from stiction.task.terrain import FINISH_MARGIN, LENGTH


@pytest.mark.parametrize("text", ["flat", "stairs=0.1", "slope=0.2", "rough=0.05"])
def test_a_course_is_called_what_it_was_typed_as(text: str) -> None:
    """Rows of results.csv are found by this name."""
    assert parse_course(text).label == text


@pytest.mark.parametrize("text", ["stairs", "stairs=0.5", "stairs=-0.1", "stairs=high", "flat=0.1", "ice=0.1", ""])
def test_what_nobody_built_is_refused(text: str) -> None:
    """Rejects unknown courses and sizes beyond the steepest, such as stairs of half a metre."""
    with pytest.raises(StictionError, match=r"expected flat, slope=SIZE|unknown terrain .*known: flat|has no size"):
        parse_course(text)


def test_the_time_for_a_crossing_follows_the_commanded_speed() -> None:
    """0.7 m before, 4.8 m of course, 0.6 m behind it, at 0.4 m/s, and once more as long."""
    assert pytest.approx(0.7 + 2 * REACH + 0.6) == LENGTH
    assert Course("stairs", 0.1).seconds(parse_command("vx=0.4"), 10.0) == pytest.approx(PATIENCE * LENGTH / 0.4)
    assert Course().seconds(parse_command("vx=0.4"), 10.0) == 10.0


def test_who_walks_around_the_landing_has_crossed_a_slope_but_no_stairs() -> None:
    """Robot 0 passes over the landing, robot 1 around it; robot 2 passes over it and falls before the end."""
    along = np.array([-REACH - 0.1, -REACH + TREAD + 0.1, 0.0, LANDING + TREAD + 0.1, REACH + FINISH_MARGIN + 0.1])
    position, upright = np.zeros((5, 3, 2)), np.ones((5, 3), bool)
    position[..., 0] = along[:, None]
    position[1:4, 1, 1] = REACH + 0.1
    upright[4, 2] = False
    passed, crossed = Course("stairs", 0.1).judge(position, upright)
    assert passed == pytest.approx((2 * STEPS + 0 + STEPS + 1) / 3)
    assert crossed == pytest.approx(1 / 3)
    assert Course("slope", 0.2).judge(position, upright) == (None, pytest.approx(2 / 3))
    assert Course().judge(position, upright) == (None, None)


def test_all_robots_stand_before_the_same_rough_ground() -> None:
    """All policies and engines of one seed meet the same slabs."""
    from stiction.engines.ground import course

    terrain = Course("rough", 0.1).terrain(3, seed=5)
    assert (terrain.position == terrain.position[:1]).all()
    np.testing.assert_allclose(terrain.position[0], course("rough", 0.1, 5).positions, atol=1e-12)
    assert Course().terrain(3) is None
