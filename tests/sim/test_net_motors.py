"""An Actuator Net drives a fleet as the PD law does where it is that law, and keeps or drops friction by its side."""

import mujoco
import numpy as np
import pytest

import walks
from actuators import pd_net
from stiction.evaluation.walk_logs import FrictionMeter
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import BASE_DOFS, Fleet
from stiction.task.task_fleet import NetMotors

SPEC = find_robot("saturn_lite")


def test_a_net_that_is_the_p_law_moves_as_the_p_law() -> None:
    """Without kd, which MuJoCo takes at the end of a step, both are the same law: 40 steps of tracking, contacts
    included, agree to single precision.
    """
    fleets = [Fleet(SPEC, 2) for _ in range(2)]
    fleets[0].set_gains(SPEC.joint_values("kp"), 0.0 * SPEC.joint_values("kd"))
    NetMotors(fleets[1], pd_net(kd=0.0))
    generator = np.random.default_rng(0)
    for _ in range(10):
        targets = fleets[0].standing + 0.1 * generator.standard_normal((2, 18))
        for fleet in fleets:
            fleet.set_targets(targets)
            assert not len(fleet.step())
    np.testing.assert_allclose(fleets[1].joint_position, fleets[0].joint_position, atol=2e-5)
    np.testing.assert_array_equal(fleets[1].targets, targets)


@pytest.mark.parametrize(("side", "left"), [("motor_side", 1.0), ("output_side", 0.0)])
def test_friction_is_kept_or_dropped_by_side(side: str, left: float) -> None:
    """Friction that is in the net and in the simulation would count twice; in neither, not at all."""
    fleet = Fleet(SPEC, 1)
    fleet.friction[:], damping = 2.0, fleet.damping.copy()
    NetMotors(fleet, pd_net(torque_source=side))
    np.testing.assert_array_equal(fleet.friction, 2.0 * left)
    np.testing.assert_array_equal(fleet.damping, left * damping)


def test_a_reset_forgets_the_past() -> None:
    """Otherwise a robot's first steps would depend on how it fell before."""
    fleets = [Fleet(SPEC, 1) for _ in range(2)]
    motors = [NetMotors(fleet, pd_net()) for fleet in fleets]
    for _ in range(3):
        fleets[0].set_targets(fleets[0].standing[None] + 0.3)
        fleets[0].step()
    fleets[0].reset(np.array([0]))
    np.testing.assert_array_equal(fleets[0].targets, fleets[0].standing[None])
    for fleet in fleets:
        fleet.step()
    np.testing.assert_array_equal(fleets[0].qpos, fleets[1].qpos)
    np.testing.assert_array_equal(motors[0].memory.past, motors[1].memory.past)


def test_what_has_a_net_has_no_gains() -> None:
    """A randomiser that set kp would turn a torque motor into a spring, and nothing would say so."""
    fleet = Fleet(SPEC, 1)
    NetMotors(fleet, pd_net())
    with pytest.raises(ValueError, match="no gains"):
        fleet.set_gains(np.ones(18), np.ones(18))


def test_output_side_torque_balances_the_equation_of_motion() -> None:
    """M Δθ'/Δt + bias = τ_out + contacts, to rounding: what the log calls output-side is all of the joint but its
    rotor. Contact forces come from the solver's other rows, as the meter's friction does.
    """
    rollout = walks.start(0.1 * np.tile(walks.LIMITS, (1, 1)))
    fleet, kd = rollout.fleet, walks.walking_bundle().contract.array("kd")
    for _ in range(30):
        rollout.step(np.array([walks.FORWARD]))
    state, velocity = fleet.simulation.state(), fleet.qvel.copy()
    meter = FrictionMeter(fleet)
    meter(fleet)
    model, data = fleet.data(0)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    others = data.qfrc_constraint[BASE_DOFS:] - meter.torque[0]
    fleet.simulation.step(1)
    change = fleet.qvel[0] - velocity[0]
    free = np.abs(fleet.torque) < fleet.torque_limit * (1 - 1e-9)
    torque = fleet.torque - free * kd * change[BASE_DOFS:]
    output = torque + meter.torque - fleet.damping * fleet.joint_velocity
    expected = (inertia @ change / fleet.timestep + data.qfrc_bias)[BASE_DOFS:] - others
    np.testing.assert_allclose(output[0], expected, atol=1e-9)
    assert np.abs(meter.torque).max() == pytest.approx(0.1 * walks.LIMITS[np.abs(meter.torque[0]).argmax()], rel=1e-3)
    assert (meter.torque * state["qvel"][:, BASE_DOFS:])[np.abs(state["qvel"][:, BASE_DOFS:]) > 0.5].max() < 0
