"""Torques, wrenches and Jacobians of a walking robot's links, against what is worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to identify a walk")

from saturn_lite import BOXES

from stiction.identification.walking.body import (
    BaseMotion,
    JointMotion,
    Leg,
    foot_jacobians,
    foot_positions,
    legs,
    link_effort,
    trunk_wrench,
)
from stiction.robots.catalog import find_robot
from stiction.robots.hold import hold
from stiction.robots.model import Body

SPEC = find_robot("saturn_lite")

HIP, THIGH, SHANK = BOXES.hip_link.mass, BOXES.thigh_link.mass, BOXES.shank_link.mass

WIDTH, UPPER, LOWER = BOXES.hip_link.size[1], BOXES.thigh_link.size[2], BOXES.shank_link.size[2]
"""Sideways from hip to thigh, and lengths of thigh and shank [m]."""

G = 9.81

ANGLES = np.array([0.0, 0.4, -0.9])
"""Hip, thigh, shank of every leg [rad]."""


def joints(position: np.ndarray, velocity: float = 0.0, acceleration: np.ndarray | None = None) -> JointMotion:
    """Return one sample in which all legs do the same; position, acceleration: shape (3,)."""
    rows = [np.tile(row, (1, len(BOXES.legs))) for row in (position, np.full(3, velocity))]
    return JointMotion(*rows, np.tile(np.zeros(3) if acceleration is None else acceleration, (1, len(BOXES.legs))))


def base(force: tuple[float, ...] = (0, 0, 0), spin: tuple[float, ...] = (0, 0, 0)) -> BaseMotion:
    """Return one sample of a base that does not speed up its turning."""
    return BaseMotion(np.array([spin], float), np.zeros((1, 3)), np.array([force], float))


def test_links_are_held_against_their_weight() -> None:
    """The slope of the potential energy g Σ m z by each angle; an error here would be read as friction."""
    found = link_effort(SPEC, joints(ANGLES), base((0, 0, G)))
    knee, foot = np.sin(ANGLES[1]), np.sin(ANGLES[1] + ANGLES[2])
    torque = G * np.array(
        [
            WIDTH * (HIP / 2 + THIGH + SHANK),
            THIGH * UPPER / 2 * knee + SHANK * (UPPER * knee + LOWER / 2 * foot),
            SHANK * LOWER / 2 * foot,
        ]
    )
    np.testing.assert_allclose(found.torque, np.tile(torque, (1, len(BOXES.legs))), atol=1e-9)
    mass = len(BOXES.legs) * (HIP + THIGH + SHANK)
    np.testing.assert_allclose(found.wrench[0, :3], [0, 0, mass * G], atol=1e-9)


def test_a_shank_that_speeds_up_by_hand() -> None:
    """1 rad/s² of the shank alone: its inertia about the knee, and nothing of the rotor, of damping or of friction."""
    found = link_effort(SPEC, joints(np.zeros(3), acceleration=np.array([0.0, 0.0, 1.0])), base())
    x, _, z = BOXES.shank_link.size
    about_knee = SHANK * (x**2 + z**2) / 12 + SHANK * (LOWER / 2) ** 2
    np.testing.assert_allclose(found.torque[0, 2::3], about_knee, atol=1e-9)
    thigh = SHANK * (x**2 + z**2) / 12 + SHANK * LOWER / 2 * (UPPER + LOWER / 2)
    np.testing.assert_allclose(found.torque[0, 1::3], thigh, atol=1e-9)


def test_a_base_that_spins_pulls_the_legs_in() -> None:
    """2 rad/s about the vertical: the base holds the links with −ω² Σ m r, worked out from where they hang."""
    found = link_effort(SPEC, joints(np.zeros(3)), base(spin=(0, 0, 2)))
    expected = np.zeros(3)
    for leg in BOXES.legs:
        mount = np.array(leg.mount)
        for mass, across in ((HIP, 0.5), (THIGH, 1.0), (SHANK, 1.0)):
            expected[:2] -= 4 * mass * np.add(mount[:2], [0, across * leg.side * WIDTH])
    np.testing.assert_allclose(found.wrench[0, :3], expected, atol=1e-9)


def test_the_trunk_by_hand() -> None:
    """3 kg, 0.1 m before the origin: at rest 3 g upward, and a moment of −0.3 g about y; spun, −ω² m r."""
    trunk = Body(3.0, (0.1, 0.0, 0.0), (0.02, 0.03, 0.04, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(trunk_wrench(trunk, base((0, 0, G))), [[0, 0, 3 * G, 0, -0.3 * G, 0]], atol=1e-12)
    np.testing.assert_allclose(trunk_wrench(trunk, base(spin=(0, 0, 2))), [[-1.2, 0, 0, 0, 0, 0]], atol=1e-12)


def test_legs_are_chains_from_the_base_to_a_foot() -> None:
    """Three joints each on a hexapod, six on a humanoid, two where hips are held; feet that share a joint are one."""
    assert legs(SPEC)[1] == Leg((1,), (3, 4, 5))
    assert legs(find_robot("g1")) == (Leg((0,), tuple(range(6))), Leg((1,), tuple(range(6, 12))))
    go2 = find_robot("go2")
    fixed = hold(go2, {name: 0.0 for name in go2.joint_names if "hip" in name})
    assert [leg.joints for leg in legs(fixed)] == [(0, 1), (2, 3), (4, 5), (6, 7)]
    joined = replace(go2, links=(go2.links[0], *(replace(link, parent=max(link.parent, 0)) for link in go2.links[1:])))
    assert legs(joined) == (Leg((0, 1, 2, 3), tuple(range(12))),)


def test_feet_and_jacobians_of_straight_legs_by_hand() -> None:
    """The velocity is axis × arm: of the hip about ±x at the mount, of thigh and shank about y, above the foot."""
    position = np.zeros((1, SPEC.num_joints))
    feet = foot_positions(SPEC, position)
    jacobians = foot_jacobians(SPEC, position)
    for index, leg in enumerate(BOXES.legs):
        arm = np.array([0, leg.side * WIDTH, -UPPER - LOWER])
        np.testing.assert_allclose(feet[0, index], np.array(leg.mount) + arm, atol=1e-12)
        columns = [np.cross([leg.side, 0, 0], arm), [-UPPER - LOWER, 0, 0], [-LOWER, 0, 0]]
        np.testing.assert_allclose(jacobians[index][0, 0, :3], np.transpose(columns), atol=1e-9)
        np.testing.assert_allclose(jacobians[index][0, 0, 3:], [[leg.side, 0, 0], [0, 1, 1], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("name", ["saturn_lite", "go2", "g1"])
def test_jacobians_are_the_slopes_of_the_feet(name: str) -> None:
    """In the standing pose, a little turned: differences of the feet's positions over 2 µrad, joint by joint."""
    spec = find_robot(name)
    position = spec.joint_values("default_position")[None] + 0.1
    for leg, jacobian in zip(legs(spec), foot_jacobians(spec, position), strict=True):
        for column, joint in enumerate(leg.joints):
            step = 1e-6 * np.eye(spec.num_joints)[joint]
            slope = (foot_positions(spec, position + step) - foot_positions(spec, position - step)) / 2e-6
            np.testing.assert_allclose(jacobian[0, :, :3, column], slope[0, list(leg.feet)], atol=1e-9)
