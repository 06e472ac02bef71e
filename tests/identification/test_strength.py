"""A known payload on the joint tells how much of its command the motor gives, and with it newton metres."""

from __future__ import annotations

import pytest

from carried import carrying_log, weak_log
from counts import count
from stiction.identification.example import SATURN_LITE
from stiction.identification.pipeline import identify_joint

STRENGTH = 0.8


@pytest.mark.parametrize("together", [False, True], ids=["one_log", "with_and_without"])
def test_intervals_of_strength_and_friction_hold_the_truth(together: bool) -> None:
    """One log, by output error with k unknown; two, by regression, whose interval admits what its noise does to k."""
    joint = SATURN_LITE.joint
    truth = {"inertia": joint.inertia, "viscous_friction": joint.viscous, "coulomb_friction": joint.friction.level}
    inside = dict.fromkeys((*truth, "motor_strength"), 0)
    logs = count(4, 8)
    for seed in range(logs):
        repeats = [weak_log(SATURN_LITE, STRENGTH, 100 + seed)] if together else []
        record = identify_joint(carrying_log(SATURN_LITE, STRENGTH, 1.0, 0.2, 0.3, seed), repeats=repeats).record
        for name, true in (truth | {"motor_strength": STRENGTH}).items():
            estimate = getattr(record, name)
            inside[name] += estimate.interval95[0] <= true <= estimate.interval95[1]
            assert estimate.value == pytest.approx(true, rel=0.04), name
    assert min(inside.values()) >= 0.75 * logs and sum(inside.values()) >= 3.5 * logs, inside
