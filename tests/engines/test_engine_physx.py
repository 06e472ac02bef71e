"""PhysX beyond the conformance suite: what trunk and shanks rub on, and what it cannot take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stiction.core.rotation import matrix
from stiction.engines.catalog import make_engine, missing_engine
from stiction.engines.engine import Body
from stiction.engines.ground import course
from stiction.robots.catalog import find_robot
from stiction.robots.terrain import LANDING, RAMP
from stiction_experiments.engines.conformance.rig import record, still

SPEC = find_robot("saturn_lite")

_missing = missing_engine("physx", SPEC)
pytestmark = pytest.mark.skipif(_missing is not None, reason=_missing or "")


def test_a_trunk_has_friction_of_its_own() -> None:
    """On its back on a slope of 0.3 rad, whose tangent is 0.31: it stays though its feet would slip at 0.2.

    PhysX averages coefficients, so what feet and trunk get depends on the ground's.
    """
    angle = 0.3
    body = replace(Body.nominal(SPEC), ground_friction=0.2)
    engine = make_engine("physx", body, course("slope", angle), 0.002)
    # Half a turn about x, then nose down by the slope as seen from the robot on its back.
    turn = np.array([0.0, np.cos(angle / 2), 0.0, np.sin(angle / 2)])
    away = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    np.testing.assert_allclose(matrix(turn)[:, 2], -away, atol=1e-12)
    middle = np.array([-LANDING - RAMP / 2 * np.cos(angle), 0.0, RAMP / 2 * np.sin(angle)])
    engine.reset(SPEC.joint_values("default_position"), middle + SPEC.base.size[2] / 2 * away, turn)
    motion = record(engine, 250, still(body))
    assert np.linalg.norm(motion.base_position[-1] - motion.base_position[0]) < 1e-3
