"""The plan of the report fits its budget."""

import pytest

from stiction_experiments.paper.cost import plan_seconds, training_seconds
from stiction_experiments.paper.plan import TRAININGS


def test_the_plan_takes_at_most_sixty_hours():
    """The criteria name the budget; every kind of work is counted."""
    cost = plan_seconds()
    assert sum(cost.values()) <= 60 * 3600
    assert all(seconds > 0 for seconds in cost.values())


def test_a_training_costs_its_control_steps():
    """440 iterations of 512 robots and 24 steps at 0.15 ms are 811 s; four times the budget four times that."""
    each = {training.name: training for training in TRAININGS}
    assert training_seconds(each["mean-kept"]) == pytest.approx(440 * 512 * 24 * 1.5e-4)
    assert training_seconds(each["iterative"]) == pytest.approx(4 * 440 * 512 * 24 * 1.5e-4)
    assert training_seconds(each["net"]) == training_seconds(each["mean-kept"])
