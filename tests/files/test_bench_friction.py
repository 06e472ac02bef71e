"""Friction of each kind of joint from a bench, with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.names import kinds_of
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.known_friction import bench_friction, known_friction_text

NAMES = ("FL_hip", "FL_shank", "FR_hip", "FR_shank")
LIMITS = np.array([20.0, 40.0, 20.0, 40.0])
NOMINAL = np.array([0.2, 0.3])


def joint(friction: float | None, **fields: object) -> JointRecord:
    """A joint of which the friction is known [N m], or nothing."""
    estimate = None if friction is None else Estimate(friction, 0.1, (friction - 0.2, friction + 0.2))
    return JointRecord(coulomb_friction=estimate, **fields)


def bench_of(**records: JointRecord):
    """Return the friction of a bench with these records."""
    return bench_friction(JointsFile(records), NAMES, kinds_of(NAMES), LIMITS, NOMINAL)


def test_each_kind_gets_the_mean_of_its_joints_over_their_limits() -> None:
    """1 and 3 N m of 20 are 10 %; 2 and 2 N m of 40 are 5 %."""
    friction = bench_of(FL_hip=joint(1.0), FR_hip=joint(3.0), FL_shank=joint(2.0), FR_shank=joint(2.0))
    assert friction.share == pytest.approx({"hip": 0.1, "shank": 0.05}) and friction.notes == friction.missing == ()
    np.testing.assert_allclose(friction.array, [0.1, 0.05])
    assert known_friction_text(friction.share) == "hip 10 %, shank 5 % of the torque limit"


def test_a_record_of_a_kind_stands_for_its_joints_and_a_ratio_for_a_torque() -> None:
    """One leg's log is what most people have; below zero there is no friction."""
    ratio = Estimate(0.03, 0.001, (0.028, 0.032))
    friction = bench_of(hip=joint(-0.5), shank=joint(None, friction_ratio=ratio))
    assert friction.share == pytest.approx({"hip": 0.0, "shank": 0.03}) and friction.missing == ()


def test_a_joint_that_was_not_identified_is_named_and_the_others_of_its_kind_stand_for_it() -> None:
    """The mean of the hips is FR_hip's 3 N m of 20; of no shank anything is known: training's 30 %."""
    friction = bench_of(FL_hip=joint(None), FR_hip=joint(3.0), shank=joint(None))
    assert friction.share == pytest.approx({"hip": 0.15, "shank": 0.3})
    assert friction.missing == ("FL_hip", "FL_shank", "FR_shank")
    hips, shanks = friction.notes
    assert "FL_hip was not identified" in hips and "mean of the other joints" in hips and "15 %" in hips
    assert "FL_shank, FR_shank" in shanks and "nominal friction of training" in shanks and "30 %" in shanks
