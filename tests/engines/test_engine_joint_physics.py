"""Friction of one robot's joints: by hand, and bit for bit what a fleet of the training does."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.engines.engine import JointFriction, Motion, Term
from stiction.joints.friction import Law, simulated_laws
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.sim.fleet import JointFriction as FleetFriction

NOTHING = Motion(**{part.name: np.zeros(2) for part in fields(Motion)})
NONE, STEP = np.zeros(2), 0.005


def bearing(*load: float) -> Motion:
    """A robot whose joints transmit these [N]."""
    return replace(NOTHING, joint_force=np.array(load))


def test_bounds_by_hand() -> None:
    """2 N m: half more at rest, 2 + 1/e at v_s; a coefficient of 0.5 on 4 N m of the motor, on 3 N + 1 N m borne."""
    level, torque = np.array([2.0, 2.0]), np.array([0.0, -4.0])
    moving = replace(NOTHING, joint_velocity=np.array([0.0, -0.1]))
    assert JointFriction.under(Law("coulomb"), level, STEP).bound(moving, torque).tolist() == [2.0, 2.0]
    stribeck = JointFriction.under(Law("stribeck", 1.5, 0.1), level, STEP).bound(moving, torque)
    np.testing.assert_allclose(stribeck, [3.0, 2.0 + np.exp(-1.0)])
    half = np.full(2, 0.5)
    assert JointFriction.under(Law("effort"), half, STEP).bound(moving, torque).tolist() == [0.0, 2.0]
    loaded = replace(bearing(0.0, 3.0), joint_torque=np.array([0.0, 1.0]))
    assert JointFriction.under(Law("load"), half, STEP).bound(loaded, torque).tolist() == [0.0, 2.0]


def test_what_joints_have_of_their_own_adds_up() -> None:
    """0.4 N m at speed or 1.5 times that at rest, 0.01 of 100 N borne, a tenth of the motor's 3 N m."""
    stribeck = Term("stribeck", np.full(2, 0.4), {"static_ratio": np.array([1.5, 1.0]), "stribeck_velocity": 0.1})
    friction = JointFriction(STEP, stribeck, Term("load", np.array([0.0, 0.01])), Term("effort", 0.1))
    np.testing.assert_allclose(friction.bound(bearing(100.0, 100.0), np.array([0.0, -3.0])), [0.6, 0.4 + 1.0 + 0.3])


@pytest.mark.parametrize(("timestep", "steps"), [(0.005, 1), (0.0025, 2), (0.001, 5)])
def test_half_of_the_old_load_is_left_after_5_ms_whatever_the_step(timestep: float, steps: int) -> None:
    """An engine with shorter steps would have another law than the training: hardly any of the old load after 5 ms."""
    friction = JointFriction(timestep, Term("load", np.ones(2)))
    np.testing.assert_allclose(friction.bound(bearing(8.0, 0.0), NONE), [8.0, 0.0])
    for left in ([4.0, 0.0], [2.0, 0.0]):
        for _ in range(steps):
            bound = friction.bound(NOTHING, NONE)
        np.testing.assert_allclose(bound, left)


@pytest.mark.parametrize("law", simulated_laws())
def test_one_robot_has_the_friction_of_a_fleet(law: str) -> None:
    """A policy would be judged under another law than it was trained with."""
    fleet = Fleet(find_robot("go1"), 1, joint_sensors=True)
    level = np.linspace(0.1, 0.3, 12)
    FleetFriction(fleet, Law(law)).set_level(level[None])
    friction = JointFriction.under(Law(law), level, STEP)
    generator = np.random.default_rng(0)
    for _ in range(30):
        fleet.set_targets(fleet.standing + 0.2 * generator.standard_normal((1, 12)))
        force, torque = np.sqrt(np.square(fleet.joint_load[0]).sum(-1)).T
        motion = replace(NOTHING, joint_velocity=fleet.joint_velocity[0].copy(), joint_force=force, joint_torque=torque)
        bound = friction.bound(motion, fleet.torque[0].copy())
        fleet.substep()
        np.testing.assert_array_equal(bound, fleet.friction[0])
