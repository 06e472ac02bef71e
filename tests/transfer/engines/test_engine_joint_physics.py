"""Laws of friction for one robot: by hand, and bit for bit what a fleet of the training does."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from stiction.formats.friction import LAWS, Law
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.sim.friction import joint_friction
from stiction.transfer.engines.engine import Motion
from stiction.transfer.engines.joint_physics import JointFriction

NOTHING = Motion(**{part.name: np.zeros(2) for part in fields(Motion)})


def test_bounds_by_hand() -> None:
    """2 N m: half more at rest, 2 + 1/e at v_s; a coefficient of 0.5 on 4 N m of the motor, on 3 N + 1 N m borne."""
    level, torque = np.array([2.0, 2.0]), np.array([0.0, -4.0])
    moving = replace(NOTHING, joint_velocity=np.array([0.0, -0.1]))
    assert JointFriction(Law("coulomb"), level).bound(moving, torque).tolist() == [2.0, 2.0]
    stribeck = JointFriction(Law("stribeck", 1.5, 0.1), level).bound(moving, torque)
    np.testing.assert_allclose(stribeck, [3.0, 2.0 + np.exp(-1.0)])
    half = np.full(2, 0.5)
    assert JointFriction(Law("effort"), half).bound(moving, torque).tolist() == [0.0, 2.0]
    loaded = replace(NOTHING, joint_force=np.array([0.0, 3.0]), joint_torque=np.array([0.0, 1.0]))
    assert JointFriction(Law("load"), half).bound(loaded, torque).tolist() == [0.0, 2.0]


def test_load_keeps_half_of_the_old_bound_until_a_reset() -> None:
    """The next episode would begin with the friction of the last one."""
    friction = JointFriction(Law("load"), np.ones(2))
    loaded = replace(NOTHING, joint_force=np.full(2, 8.0))
    bounds = [friction.bound(motion, np.zeros(2))[0] for motion in (loaded, NOTHING, NOTHING)]
    assert bounds == [8.0, 4.0, 2.0]
    friction.reset()
    assert friction.bound(NOTHING, np.zeros(2)).tolist() == [0.0, 0.0]


def test_wear_acts_at_once_and_a_level_is_its_own() -> None:
    """Friction that grows over a run is a level that is written; what the caller keeps must not change with it."""
    given = np.ones(2)
    friction = JointFriction(Law("coulomb"), given)
    friction.level *= 3.0
    bound = friction.bound(NOTHING, np.zeros(2))
    bound[:] = 7.0
    assert given.tolist() == [1.0, 1.0] and friction.bound(NOTHING, np.zeros(2)).tolist() == [3.0, 3.0]


@pytest.mark.parametrize("law", LAWS)
def test_one_robot_has_the_friction_of_a_fleet(law: str) -> None:
    """A policy would be judged under another law than it was trained with."""
    fleet = Fleet(find_robot("go1"), 1, joint_sensors=True)
    level = np.linspace(0.1, 0.3, 12)
    joint_friction(fleet, Law(law)).set_level(level[None])
    friction = JointFriction(Law(law), level)
    generator = np.random.default_rng(0)
    for _ in range(30):
        fleet.set_targets(fleet.standing + 0.2 * generator.standard_normal((1, 12)))
        force, torque = np.sqrt(np.square(fleet.joint_load[0]).sum(-1)).T
        motion = replace(NOTHING, joint_velocity=fleet.joint_velocity[0].copy(), joint_force=force, joint_torque=torque)
        bound = friction.bound(motion, fleet.torque[0].copy())
        fleet.substep()
        np.testing.assert_array_equal(bound, fleet.friction[0])
