"""Joints that are held: the rigid robot moves, and weighs, as the jointed one does with these joints locked."""

from __future__ import annotations

import g1
import mujoco
import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.robots.hold import hold, merge
from stiction.robots.mjcf import build_model
from stiction.robots.model import Body, link_poses


def test_two_points_by_hand() -> None:
    """1 kg at x = 0 and 3 kg at x = 0.4 m: centre at 0.3 m, moment about y and z 1 · 0.3² + 3 · 0.1² = 0.12 kg m²."""
    point = Body(1.0, (0.0, 0.0, 0.0), (0.0,) * 6)
    heavy = Body(3.0, (0.1, 0.0, 0.0), (0.0,) * 6)
    whole = merge([(point, (np.zeros(3), np.eye(3))), (heavy, (np.array([0.3, 0.0, 0.0]), np.eye(3)))])
    assert whole.mass == 4.0 and whole.com == pytest.approx((0.3, 0.0, 0.0))
    assert whole.inertia == pytest.approx((0.0, 0.12, 0.12, 0.0, 0.0, 0.0))


def test_held_arms_move_as_locked_ones() -> None:
    """Masses, centres and the legs' inertia are those of 29 joints with waist and arms at their angles."""
    whole, legs = g1.whole(), g1.ROBOT
    assert legs.num_joints == 12 and len(legs.held) == 17 and legs.mass == pytest.approx(whole.mass)
    angles = dict(zip(whole.joint_names, whole.joint_values("default_position"), strict=True))
    angles |= dict(zip(legs.joint_names, np.random.default_rng(1).uniform(-0.5, 0.5, 12), strict=True))
    matrices = []
    for robot in (whole, legs):
        model = build_model(robot)
        data = mujoco.MjData(model)
        data.qpos[:7] = [0, 0, 1, 1, 0, 0, 0]
        data.qpos[7:] = [angles[name] for name in robot.joint_names]
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        matrices.append(matrix[:18, :18])
    # Legs are the first twelve joints of both; the base's six and theirs make the block that must agree.
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-9)
    np.testing.assert_allclose(
        link_poses(legs, np.array([angles[name] for name in legs.joint_names]))[0],
        link_poses(whole, np.array([angles[name] for name in whole.joint_names]))[0][:12],
        atol=1e-12,
    )


def test_what_cannot_be_held_is_refused() -> None:
    """A misspelt joint, and a leg that would be part of the trunk."""
    with pytest.raises(StictionError, match="did you mean 'left_knee_joint'"):
        hold(g1.ROBOT, {"left_knee": 0.0})
    with pytest.raises(StictionError, match="no driven joint moves the foot 'left_foot'"):
        hold(g1.ROBOT, dict.fromkeys(g1.ROBOT.joint_names[:6], 0.0))
