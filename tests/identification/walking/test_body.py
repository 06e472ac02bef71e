"""Torques, wrenches and Jacobians of a walking robot's links, against values worked out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to identify a walk")

from saturn_lite import BOXES

from stiction.identification.limb.dynamics import (
    Motion,
    base_motion,
    link_motions,
    motions_at_rest,
    parameters,
    whole_effort,
    wrench,
)
from stiction.identification.walking.walk import foot_jacobian, foot_positions, legs
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


def effort(
    base: Motion, position: np.ndarray, acceleration: tuple[float, ...] = (0, 0, 0)
) -> tuple[np.ndarray, np.ndarray]:
    """Return torques and wrench of one sample in which all legs do the same; position, acceleration: shape (3,)."""
    rows = [np.tile(row, (1, len(BOXES.legs))) for row in (position, np.zeros(3), np.array(acceleration, float))]
    return whole_effort(SPEC.links, link_motions(SPEC.links, base, *rows))


def base(force: tuple[float, ...] = (0, 0, 0), spin: tuple[float, ...] = (0, 0, 0)) -> Motion:
    """Return one sample of a base that does not speed up its turning."""
    return base_motion(np.array([force], float), np.array([spin], float))


def test_links_are_held_against_their_weight() -> None:
    """The holding torque is the slope of the potential energy g Σ m z by each angle."""
    torques, whole = effort(base((0, 0, G)), ANGLES)
    knee, foot = np.sin(ANGLES[1]), np.sin(ANGLES[1] + ANGLES[2])
    torque = G * np.array(
        [
            WIDTH * (HIP / 2 + THIGH + SHANK),
            THIGH * UPPER / 2 * knee + SHANK * (UPPER * knee + LOWER / 2 * foot),
            SHANK * LOWER / 2 * foot,
        ]
    )
    np.testing.assert_allclose(torques, np.tile(torque, (1, len(BOXES.legs))), atol=1e-9)
    mass = len(BOXES.legs) * (HIP + THIGH + SHANK)
    np.testing.assert_allclose(whole[0, :3], [0, 0, mass * G], atol=1e-9)


def test_a_shank_that_speeds_up_by_hand() -> None:
    """1 rad/s² of the shank alone: its inertia about the knee, and nothing of the rotor, of damping or of friction."""
    torques, _ = effort(base(), np.zeros(3), (0.0, 0.0, 1.0))
    x, _, z = BOXES.shank_link.size
    about_knee = SHANK * (x**2 + z**2) / 12 + SHANK * (LOWER / 2) ** 2
    np.testing.assert_allclose(torques[0, 2::3], about_knee, atol=1e-9)
    thigh = SHANK * (x**2 + z**2) / 12 + SHANK * LOWER / 2 * (UPPER + LOWER / 2)
    np.testing.assert_allclose(torques[0, 1::3], thigh, atol=1e-9)


def test_a_base_that_spins_pulls_the_legs_in() -> None:
    """2 rad/s about the vertical: the base holds the links with −ω² Σ m r, worked out from where they hang."""
    _, torques = effort(base(spin=(0, 0, 2)), np.zeros(3))
    expected = np.zeros(3)
    for leg in BOXES.legs:
        mount = np.array(leg.mount)
        for mass, across in ((HIP, 0.5), (THIGH, 1.0), (SHANK, 1.0)):
            expected[:2] -= 4 * mass * np.add(mount[:2], [0, across * leg.side * WIDTH])
    np.testing.assert_allclose(torques[0, :3], expected, atol=1e-9)


def test_the_trunk_by_hand() -> None:
    """3 kg, 0.1 m before the origin: at rest 3 g upward, and a moment of −0.3 g about y; spun, −ω² m r."""
    trunk = Body(3.0, (0.1, 0.0, 0.0), (0.02, 0.03, 0.04, 0.0, 0.0, 0.0))
    for motion, expected in (
        (base((0, 0, G)), [0, 0, 3 * G, 0, -0.3 * G, 0]),
        (base(spin=(0, 0, 2)), [-1.2] + [0] * 5),
    ):
        np.testing.assert_allclose(np.concatenate(wrench(motion, parameters(trunk)), axis=1)[0], expected, atol=1e-12)


def test_legs_are_chains_from_the_base_to_a_foot() -> None:
    """Three joints each on a hexapod, six on a humanoid, two where hips are held; feet that share a joint are one."""
    assert legs(SPEC)[1] == ((1,), (3, 4, 5))
    assert legs(find_robot("g1")) == (((0,), tuple(range(6))), ((1,), tuple(range(6, 12))))
    go2 = find_robot("go2")
    fixed = hold(go2, {name: 0.0 for name in go2.joint_names if "hip" in name})
    assert [joints for _, joints in legs(fixed)] == [(0, 1), (2, 3), (4, 5), (6, 7)]
    joined = replace(go2, links=(go2.links[0], *(replace(link, parent=max(link.parent, 0)) for link in go2.links[1:])))
    assert legs(joined) == (((0, 1, 2, 3), tuple(range(12))),)


def test_feet_and_jacobians_of_straight_legs_by_hand() -> None:
    """The velocity is axis × arm: of the hip about ±x at the mount, of thigh and shank about y, above the foot."""
    links = motions_at_rest(SPEC.links, np.zeros((1, SPEC.num_joints)))
    feet = foot_positions(SPEC, links)
    for index, leg in enumerate(BOXES.legs):
        (jacobian,) = foot_jacobian(SPEC, links, index, legs(SPEC)[index][1])
        arm = np.array([0, leg.side * WIDTH, -UPPER - LOWER])
        np.testing.assert_allclose(feet[0, index], np.array(leg.mount) + arm, atol=1e-12)
        columns = [np.cross([leg.side, 0, 0], arm), [-UPPER - LOWER, 0, 0], [-LOWER, 0, 0]]
        np.testing.assert_allclose(jacobian[:3], np.transpose(columns), atol=1e-9)
        np.testing.assert_allclose(jacobian[3:], [[leg.side, 0, 0], [0, 1, 1], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("name", ["saturn_lite", "go2", "g1"])
def test_jacobians_are_the_slopes_of_the_feet(name: str) -> None:
    """In the standing pose, a little turned: differences of the feet's positions over 2 µrad, joint by joint."""
    spec = find_robot(name)
    position = spec.joint_values("default_position")[None] + 0.1
    links, joints = motions_at_rest(spec.links, position), range(spec.num_joints)
    jacobians = [foot_jacobian(spec, links, foot, joints)[0, :3] for foot in range(len(spec.feet))]
    for joint in joints:
        step = 1e-6 * np.eye(spec.num_joints)[joint]
        after, before = (foot_positions(spec, motions_at_rest(spec.links, position + s)) for s in (step, -step))
        np.testing.assert_allclose(np.array(jacobians)[:, :, joint], (after - before)[0] / 2e-6, atol=1e-9)
