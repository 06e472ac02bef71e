"""Walks with a wrong flag: no level, and the faulty flag in its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to have a robot walk")

from stiction.files.joints import JointRecord, JointsFile
from stiction.identification.verdict import propose
from stiction_experiments.flags import walks as wrong
from stiction_experiments.flags.study import outcome
from stiction_experiments.flags.walks import walk_cases

QUICK = ("degrees", "sign of the torque", "half the rate", "no IMU", "a Go1 for a Go2", "left and right exchanged")
"""Mistakes of the study that are made here too; all of them are in results/identification."""


@pytest.mark.parametrize(
    ("walk", "mistake", "reason", "seen"),
    [
        (wrong.trotting, wrong.scaled("torque", 1.2), "weight", r"hold 1\.1\d .* times the robot's weight, 15\.2 kg"),
        (wrong.trotting, wrong.heavier(0.5), "weight", r"1\.8\d .* 7\.6 kg: the torques"),
        (wrong.by_targets, wrong.gains(2.0), "weight", "the gains, the masses"),
        (wrong.trotting, wrong.late("foot_force", 0.03), "swing_load", "of the robot's weight where it is said to"),
        (wrong.trotting, wrong.late("torque", 0.006), "late_torque", r"3\.\d ms late against the angles"),
        (wrong.without_orientation, wrong.stamps(2.0), "rates", "2 times the rates of their angles"),
        (wrong.without_orientation, wrong.scaled("gyroscope", 0.5), "turns", r"2\.\d+ .* times as fast"),
    ],
    ids=["scale", "masses", "gains", "contact", "torque", "rate", "gyroscope"],
)
def test_no_level_comes_out_of_a_wrong_walk(
    walk: Callable[[], Any], mistake: Callable[[Any], Any], reason: str, seen: str
) -> None:
    """A log that contradicts the robot, or itself, is identified all the same, and a level proposed."""
    records = mistake(walk()).identified()
    assert records
    for _, _, record in records:
        assert reason in [one.reason for one in record.objections]
        verdict = record.diagnostics["verdict"]
        assert verdict["friction_level"] is None and verdict["lines"][0].startswith("Do first: ")
        assert record.warnings[0] == record.objections[0].seen
        assert JointRecord.from_dict(record.to_dict(), "x").objections == record.objections
    (statement,) = {one.seen for *_, record in records for one in record.objections if one.reason == reason}
    assert re.search(seen, statement), statement
    assert propose(JointsFile({name: record for name, _, record in records}))["friction"] is None


@pytest.mark.parametrize("walk", [wrong.trotting, wrong.without_feet, wrong.by_targets, wrong.without_orientation])
def test_a_right_walk_has_no_objection(walk: Callable[[], Any]) -> None:
    """A right walk has no objection; the verdict names the source of the torque's scale."""
    records = walk().identified()
    assert len(records) >= 4
    for _, friction, record in records:
        low, high = record.diagnostics["torque_by_weight"]["interval95"]
        assert 0.9 < low < high < 1.1
        assert record.objections == ()
        known = record.coulomb_friction or record.combinations["f/k"]
        assert known.interval95[0] <= friction <= known.interval95[1] or abs(known.value / friction - 1) < 0.1
        verdict = record.diagnostics["verdict"]
        assert verdict["assumes"][0] == ("--kp" if record.coulomb_friction is None else "--torque-scale")
        assert (
            record.coulomb_friction is None
            or "the robot's weight says so of all joints together" in verdict["lines"][0]
        )


@pytest.mark.parametrize("case", [one for one in walk_cases() if one.mistake in QUICK and "hexapod" not in one.record])
def test_no_mistake_ends_in_a_confident_wrong_level(case: Any) -> None:
    """The study's own judgement, of a part of its cases."""
    row = outcome(case)
    assert not row.confident and not row.false_alarm and np.isfinite(row.right)
