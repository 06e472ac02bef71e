"""Laws of friction in the batched simulator: formulas by hand, what a joint bears, and nothing forgotten or kept."""

import numpy as np
import pytest

from stiction.joints.friction import Law, stribeck_factor
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet, JointFriction, load_size

MEASURED = [Law("effort"), Law("load")]


def make(law: Law, num: int = 2, level: float = 0.1) -> Fleet:
    """Return standing robots under a law."""
    fleet = Fleet(find_robot("go1"), num, joint_sensors=True)
    JointFriction(fleet, law).set_level(np.full(fleet.friction.shape, level))
    return fleet


def test_formulas_by_hand() -> None:
    """Friction of 2 N m, half more at rest: 3 at rest, 2 + 1/e at v_s, 2 far above. |(3, 4, 0)| + |(0, 0, -2)| = 7."""
    bounds = 2.0 * stribeck_factor(np.array([0.0, -0.1, 5.0]), 1.5, 0.1)
    np.testing.assert_allclose(bounds, [3.0, 2.0 + np.exp(-1.0), 2.0])
    np.testing.assert_allclose(load_size(np.array([[[[3.0, 4.0, 0.0], [0.0, 0.0, -2.0]]]])), [[7.0]])


def test_the_bound_is_written_before_every_physics_step() -> None:
    """Stribeck friction of the speed at the start of the last of four steps, not of the first."""
    fleet = make(Law("stribeck", 1.5, 0.5), level=2.0)
    fleet.set_targets(fleet.standing + 0.3)
    for _ in range(fleet.decimation):
        before = fleet.joint_velocity.copy()
        fleet.substep()
        np.testing.assert_array_equal(fleet.friction, 2.0 * stribeck_factor(before, 1.5, 0.5))


def test_effort_is_a_share_of_the_motors_last_torque() -> None:
    """The law c |τ|, one physics step late."""
    fleet = make(Law("effort"))
    fleet.set_targets(fleet.standing + 0.2)
    fleet.substep()
    torque = fleet.torque.copy()
    fleet.substep()
    np.testing.assert_array_equal(fleet.friction, 0.1 * np.abs(torque))


def test_load_is_what_the_leg_weighs_and_what_the_ground_bears() -> None:
    """In the air, trunk held, a hip carries its leg; on the ground it bears its share of all else."""
    fleet = make(Law("load"))
    fleet.clamp(np.ones((2, 12), bool))
    fleet.simulation.expand("dof_armature")[1, :6] = 1e6
    fleet.set_const(np.arange(2))
    fleet.base_position[1, 2] += 1.0
    for _ in range(100):
        fleet.substep()
    force = np.linalg.norm(fleet.joint_load[:, :, 0], axis=-1)
    hip, thigh, calf = (link.mass for link in fleet.spec.links[:3])
    np.testing.assert_allclose(force[1, ::3], 9.81 * (hip + thigh + calf), rtol=1e-3)
    np.testing.assert_allclose(force[1, 2::3], 9.81 * calf, rtol=1e-3)
    np.testing.assert_allclose(force[0, ::3].sum(), 9.81 * fleet.spec.base.mass, rtol=0.02)
    np.testing.assert_allclose(fleet.friction, 0.1 * load_size(fleet.joint_load), rtol=0.01)


@pytest.mark.parametrize("law", MEASURED)
def test_a_robot_that_blew_up_has_finite_friction_again(law: Law) -> None:
    """A bound that is not finite would outlive the reset, for parameters are not reset."""
    fleet = make(law)
    fleet.joint_velocity[1, 0] = np.nan
    assert list(fleet.step()) == [1]
    assert np.isfinite(fleet.friction).all()
    assert len(fleet.step()) == 0 and (fleet.friction[1] > 0.0).all()


@pytest.mark.parametrize("laws", [*((law,) for law in MEASURED), (Law("stribeck"),), (Law(), Law("load"))])
@pytest.mark.parametrize("delay", [0.0, 0.015])
def test_a_redrawn_robot_has_the_friction_of_its_own_state_at_once(laws: tuple[Law, ...], delay: float) -> None:
    """Gives a redrawn robot the friction of its state before the next step, for disturbances proportional to it."""
    fleet = Fleet(find_robot("go1"), 3, joint_sensors=True)
    fleet.delay[:] = delay
    friction = JointFriction(fleet, *laws)
    friction.set_level(*(np.full((3, 12), 0.1) for _ in laws))
    fleet.set_targets(fleet.standing + 0.3)
    for _ in range(3):
        fleet.step()
    others, chosen = fleet.friction[:2].copy(), np.array([2])
    # In this order the task begins an episode.
    friction.set_level(*(np.full((1, 12), 0.4) for _ in laws), ids=chosen)
    fleet.reset(chosen)
    expected = sum(0.4 * friction.factor(law, chosen) * np.ones((1, 12)) for law in laws)
    np.testing.assert_allclose(fleet.friction[chosen], expected)
    np.testing.assert_array_equal(fleet.friction[:2], others)
    at_once = fleet.friction[chosen].copy()
    fleet.substep()
    np.testing.assert_allclose(fleet.friction[chosen], at_once)


@pytest.mark.parametrize("laws", [*((law,) for law in MEASURED), (Law("stribeck"),), (Law(), Law("load"))])
def test_state_restores_the_friction_bit_by_bit(laws: tuple[Law, ...]) -> None:
    """A checkpoint has neither sensors nor bounds; without them a resumed run would take another way."""
    targets = 0.2 * np.random.default_rng(0).standard_normal((20, 2, 12))
    fleet = Fleet(find_robot("go1"), 2, joint_sensors=True)
    friction = JointFriction(fleet, *laws)
    levels = [np.full((2, 12), 0.1) for _ in laws]
    friction.set_level(*levels)

    def walk(some: np.ndarray) -> np.ndarray:
        for target in some:
            fleet.set_targets(fleet.standing + target)
            fleet.step()
        return fleet.qpos.copy()

    walk(targets[:10])
    saved, kept, bounds = fleet.simulation.state(), friction.state(), fleet.friction.copy()
    first = walk(targets[10:])
    fleet.reset(np.arange(2))
    friction.set_level(*levels)
    fleet.simulation.load_state(saved)
    friction.load_state(kept)
    np.testing.assert_array_equal(fleet.friction, bounds)
    np.testing.assert_array_equal(walk(targets[10:]), first)
