"""Disturbances from outside act as Newton says, are bounded, and are gone afterwards."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from stiction.robots.catalog import find_robot
from stiction.robots.physics import FAST
from stiction.sim.fleet import HELD, Fleet
from stiction_experiments.methods.disturbance import Disturbance, bounded, intensity

GO1 = find_robot("go1")


def in_free_fall(num: int = 3) -> Fleet:
    """Robots in mid-air, limp and at rest, without gravity."""
    fleet = Fleet(GO1, num)
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.base_position[:, 2] = 5.0
    fleet.set_gains(np.zeros_like(fleet.targets), np.zeros_like(fleet.targets))
    return fleet


def momentum(fleet: Fleet) -> np.ndarray:
    """Linear momentum of every robot [kg m/s], (N, 3)."""
    momenta = []
    for env in range(fleet.num_envs):
        model, data = fleet.data(env)
        mujoco.mj_subtreeVel(model, data)
        base = model.body("base").id
        momenta.append(model.body_subtreemass[base] * data.subtree_linvel[base])
    return np.array(momenta)


def test_a_force_changes_the_momentum_by_itself_times_its_time() -> None:
    """Newton's second law: F t, in the world, for one control period, and then nothing any more."""
    fleet = in_free_fall()
    force = np.array([[10.0, 0.0, 0.0], [0.0, -20.0, 5.0], [0.0, 0.0, 0.0]])
    fleet.disturb(force=force)
    fleet.step()
    pushed = momentum(fleet)
    np.testing.assert_allclose(pushed, force * fleet.control_period, atol=1e-4)
    fleet.step()
    np.testing.assert_allclose(momentum(fleet), pushed, atol=1e-4)
    assert not fleet.simulation.bind("xfrc_applied").any()


@pytest.mark.parametrize("physics", [None, FAST], ids=["rows", "plastic"])
def test_a_torque_turns_a_held_joint_by_itself_over_its_inertia(physics: object) -> None:
    """Angular acceleration is τ / I, I being a huge inertia, for one control period; no motor's limit bounds it."""
    fleet = Fleet(GO1, 2, **({} if physics is None else {"physics": physics}))
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.base_position[:, 2] = 5.0
    zero = np.zeros_like(fleet.targets)
    fleet.set_gains(zero, zero)
    fleet.damping[:] = 0.0
    fleet.clamp(np.ones_like(zero, bool), range(6))
    torque = np.zeros_like(zero)
    torque[0] = np.linspace(-3.0, 3.0, 12) * fleet.torque_limit
    fleet.disturb(torque=torque)
    fleet.step()
    np.testing.assert_allclose(fleet.joint_velocity, torque / HELD * fleet.control_period, rtol=1e-5, atol=1e-12)
    before = fleet.joint_velocity.copy()
    fleet.step()
    np.testing.assert_allclose(fleet.joint_velocity, before, rtol=1e-5, atol=1e-12)


def test_a_disturbance_is_gone_after_a_reset() -> None:
    """A robot that begins anew between the order and the step is not pushed; the others are."""
    fleet = in_free_fall(2)
    fleet.disturb(np.full((2, 3), 10.0), np.ones((2, 12)))
    fleet.reset(np.array([0]))
    fleet.base_position[:, 2] = 5.0
    state = fleet.simulation.state()
    assert not state["xfrc_applied"][0].any() and not state["qfrc_applied"][0].any()
    assert state["xfrc_applied"][1].any() and state["qfrc_applied"][1].any()


def test_who_is_not_disturbed_pays_nothing_and_steps_the_same() -> None:
    """The seam leaves a fleet that does not use it bit for bit as it was."""
    fleets = [Fleet(GO1, 2) for _ in range(2)]
    fleets[1].disturb(np.zeros((2, 3)), np.zeros((2, 12)))
    for fleet in fleets:
        fleet.step()
    assert np.array_equal(fleets[0].qpos, fleets[1].qpos) and np.array_equal(fleets[0].qvel, fleets[1].qvel)
    assert not fleets[0]._disturbed and not fleets[1]._disturbed


def test_bounds_worked_out_by_hand() -> None:
    """(3, 4, 0) is five long: (0.6, 0.8, 0). Torques are cut one by one; |d| is their root mean square."""
    raw = torch.tensor([[3.0, 4.0, 0.0], [0.3, 0.0, 0.4]])
    torch.testing.assert_close(bounded(raw, False), torch.tensor([[0.6, 0.8, 0.0], [0.3, 0.0, 0.4]]))
    torch.testing.assert_close(bounded(raw, True), torch.tensor([[1.0, 1.0, 0.0], [0.3, 0.0, 0.4]]))
    torch.testing.assert_close(intensity(bounded(raw, False), False), torch.tensor([1.0, 0.5]))
    torch.testing.assert_close(intensity(bounded(-raw, True), True), torch.tensor([2.0, 0.25]).div(3).sqrt())


def test_a_force_is_given_in_the_frame_of_the_heading() -> None:
    """Forward is where the robot looks, +y at a quarter turn; 0.5 is half of its weight."""
    fleet = in_free_fall(2)
    fleet.reset(np.arange(2), heading=np.array([0.0, np.pi / 2]))
    Disturbance(fleet, False, 0.5).apply(torch.tensor([[1.0, 0.0, 0.0], [0.6, 0.0, -0.8]]))
    half = 0.5 * GO1.weight
    applied = fleet.simulation.bind("xfrc_applied")[:, fleet.model.body("base").id, :3]
    np.testing.assert_allclose(applied, [[half, 0.0, 0.0], [0.0, 0.6 * half, -0.8 * half]], rtol=1e-6, atol=1e-9)


def test_a_torque_is_never_stronger_than_the_friction_of_its_joint() -> None:
    """As drawn for that robot: one without friction is left alone."""
    fleet = in_free_fall(2)
    fleet.friction[1] = np.linspace(0.1, 1.2, 12)
    disturbance = Disturbance(fleet, True, 1.0)
    disturbance.apply(bounded(torch.tensor([[9.0] * 12, [9.0, -9.0] * 6]), True))
    applied = fleet.simulation.bind("qfrc_applied")[:, 6:]
    assert not applied[0].any()
    np.testing.assert_allclose(applied[1], fleet.friction[1] * np.array([1.0, -1.0] * 6))
