"""The printed estimator has no estimate, or the same one for every motor; the mended one has the true joint."""

import numpy as np
import pytest

from stiction_experiments.paper.estimator import (
    DRAWS,
    FACTORS,
    MENDED,
    MODELLED,
    OURS,
    SAMPLED,
    TABLE,
    EstimateRow,
    curvature,
    draw_motor,
    estimate_rows,
    lowest,
    profile_rows,
)

TRUTH = np.array([0.01, 0.05, 0.4])


def test_an_objective_that_is_the_same_everywhere_has_no_estimate():
    """Two signals that are both data differ by the same at every joint, and the curvature is zero."""
    same = np.full(4, 0.1)
    assert lowest(lambda joint: same, [TRUTH, 3 * TRUTH], (TRUTH / 10, 10 * TRUTH)) is None
    assert curvature(lambda joint: same, TRUTH, TRUTH, 0) == 0.0
    assert EstimateRow(0, "", SAMPLED, "I", 0.01, None, False, 0.1, 0.0).error == np.inf


def test_a_quadratic_objective_is_minimised_and_its_curvature_known():
    """The curvature of mean (p - c)² of three parameters, over a relative change of p, is 2 truth² / 3."""
    centre = np.array([0.02, 0.03, 0.5])
    edges = (TRUTH / 10, 10 * TRUTH)
    joint = lowest(lambda p: p - centre, [TRUTH, TRUTH / 3], edges)
    assert joint == pytest.approx(centre, rel=1e-4)
    for index in range(3):
        expected = 2 * TRUTH[index] ** 2 / 3
        assert curvature(lambda p: p - centre, joint, TRUTH, index) == pytest.approx(expected, rel=1e-6)
        assert curvature(lambda p: p - centre, np.zeros(3), TRUTH, index) == pytest.approx(expected, rel=1e-6)


def test_motors_are_drawn_about_the_columns_of_the_table():
    """Five of each; a number is the same motor and the same log every time."""
    names = [draw_motor(number).name for number in (0, DRAWS - 1, DRAWS, 2 * DRAWS - 1)]
    assert names == ["Saturn Lite", "Saturn Lite", "Go1", "Go1"]
    first, again = draw_motor(3), draw_motor(3)
    assert (first.log.joints["shank"].position == again.log.joints["shank"].position).all()
    table = TABLE["Saturn Lite"]
    assert (np.abs(first.truth - table.means) < 5 * np.array(table.stds)).all() and (first.truth > 0).all()


def test_printed_estimator_finds_nothing_and_the_mended_one_the_motor():
    """Sampled angles: no estimate; the model's: each parameter at the lower edge; simulated − measured: the truth."""
    rows = estimate_rows(draw_motor(DRAWS))
    of = {name: [row for row in rows if row.estimator == name] for name in (SAMPLED, MODELLED, MENDED, OURS)}
    assert [row.estimate for row in of[SAMPLED]] == [None] * 3
    assert all(row.at_edge and row.error > 0.99 for row in of[MODELLED])
    assert all(row.error < 0.1 and not row.at_edge and row.curvature > 0 for row in of[MENDED])
    assert all(row.error < 0.1 and row.rms is None for row in of[OURS])


def test_profile_falls_to_the_edge_where_nothing_is_measured():
    """The model follows its target better with less of each; the mended objective is least at the true one."""
    rows = profile_rows(draw_motor(0))
    for parameter in "IBb":
        roots = {
            name: [row.rms for row in rows if (row.estimator, row.parameter) == (name, parameter)]
            for name in (SAMPLED, MODELLED, MENDED)
        }
        assert len(set(roots[SAMPLED])) == 1
        assert roots[MODELLED][0] == min(roots[MODELLED]) < roots[MODELLED][FACTORS.index(1.0)]
        assert roots[MENDED].index(min(roots[MENDED])) == FACTORS.index(1.0)
