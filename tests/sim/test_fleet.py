"""The batched simulation: friction holds and slips as it should, controllers act, nothing blows up unseen."""

import numpy as np
import pytest

from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet

LEVEL = 0.3
ROBOTS = ["saturn_lite", "go1"]


def bench(robot: str, timestep: float = 0.005) -> Fleet:
    """One robot per joint: that joint free, all else held, in the air, motors off, friction at LEVEL."""
    spec = find_robot(robot)
    fleet = Fleet(spec, spec.num_joints, timestep=timestep, decimation=1)
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.base_position[:, 2] += 1.0
    zero = np.zeros((spec.num_joints, spec.num_joints))
    fleet.set_gains(zero, zero)
    fleet.friction[:] = LEVEL * fleet.torque_limit
    fleet.clamp(~np.eye(spec.num_joints, dtype=bool), base=range(6))
    return fleet


def load(fleet: Fleet, share: float, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Load each free joint with `share` of its friction; return its angle moved and its speed."""
    joints = np.arange(fleet.num_envs)
    fleet.simulation.bind("qfrc_applied")[joints, 6 + joints] = share * LEVEL * fleet.torque_limit
    for _ in range(round(seconds / fleet.timestep)):
        fleet.simulation.step(1)
    return (
        fleet.joint_position[joints, joints] - fleet.standing,
        fleet.joint_velocity[joints, joints].copy(),
    )


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("timestep", [0.005, 0.01])
def test_a_joint_loaded_below_its_friction_holds(robot: str, timestep: float) -> None:
    """Were the friction constraint soft, a standing robot would sink through its own friction."""
    moved, _ = load(bench(robot, timestep), 0.9, 1.0)
    assert np.abs(moved).max() < 0.01


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize(("timestep", "tolerance"), [(0.005, 0.01), (0.01, 0.02)])
def test_a_joint_loaded_above_its_friction_moves_as_the_formula_says(
    robot: str, timestep: float, tolerance: float
) -> None:
    """I q'' + B q' = 1.1 f - f: speed and angle after 0.1 s are analytic. A step of 10 ms costs accuracy (1.3 %)."""
    fleet = bench(robot, timestep)
    inertia = fleet.link_inertia() + fleet.spec.joint_values("armature")
    damping = fleet.spec.joint_values("damping")
    final, decay = 0.1 * LEVEL * fleet.torque_limit / damping, np.exp(-damping / inertia * 0.1)
    moved, speed = load(fleet, 1.1, 0.1)
    np.testing.assert_allclose(speed, final * (1 - decay), rtol=tolerance)
    # The integrator moves the angle with the speed at the end of each step: half a step ahead of the formula.
    ahead = 0.5 * timestep * speed
    np.testing.assert_allclose(moved - ahead, final * (0.1 - inertia / damping * (1 - decay)), rtol=tolerance)


def test_friction_stops_a_moving_joint_and_does_not_turn_it_back() -> None:
    """Dry friction takes energy out: after v0 / (f/I) the joint rests, and stays."""
    fleet = bench("saturn_lite")
    joints = np.arange(fleet.num_envs)
    fleet.joint_velocity[joints, joints] = 5.0
    _, speed = load(fleet, 0.0, 0.5)
    assert np.abs(speed).max() < 1e-3


def test_torque_is_pd_and_limited() -> None:
    """The motor gives kp (a - q) - kd q', and no more than its limit."""
    fleet = Fleet(find_robot("go1"), 2)
    fleet.set_targets(fleet.standing + np.array([[0.05], [5.0]]))
    fleet.simulation.step(1)
    np.testing.assert_allclose(fleet.torque[0], 0.05 * fleet.nominal_kp, rtol=1e-6)
    np.testing.assert_allclose(fleet.torque[1], fleet.torque_limit)


def test_delayed_command_reaches_the_motor_late() -> None:
    """A delay of two physics steps: the third step is the first to see the new target."""
    fleet = Fleet(find_robot("go1"), 1)
    fleet.delay[:] = 0.01
    fleet.reset(np.array([0]))
    fleet.set_targets(fleet.standing[None] + 0.1)
    seen = []
    for _ in range(3):
        fleet.simulation.step(1)
        seen.append(fleet.torque[0, 0])
    assert abs(seen[0]) < 0.1 and abs(seen[1]) < 1.0
    assert seen[2] > 2.0


@pytest.mark.parametrize("ids", [[0, 1, 2], [0, 2]])
def test_a_fresh_robot_with_a_delay_measures_what_it_would_without(ids: list[int]) -> None:
    """Its delay line is empty: motors would seem to pull towards angle 0, at their limit, and the feet to be loaded."""
    spec = find_robot("saturn_lite")
    fleets = [Fleet(spec, 3, joint_sensors=True) for _ in range(2)]
    delay = np.array([0.005, 0.01, 0.015])
    fleets[1].delay[:] = delay[:, None]
    for fleet in fleets:
        fleet.set_targets(fleet.standing + np.full((3, 1), 0.1))
        fleet.step()
        fleet.reset(np.array(ids))
    at_once, late = fleets
    for name in ("torque", "foot_force", "joint_load"):
        assert np.array_equal(getattr(late, name)[ids], getattr(at_once, name)[ids])
    assert np.abs(late.torque[ids]).max() < 1e-9
    weight = late.foot_force[ids].sum(axis=1)
    np.testing.assert_array_less(weight, 2.0 * spec.weight)
    assert np.array_equal(late.delay, np.broadcast_to(delay[:, None], late.delay.shape))
    assert len(ids) == 3 or np.abs(late.torque[1]).max() > 0.1


def test_a_robot_that_blows_up_is_named_counted_and_reset() -> None:
    """NaN in one robot must neither pass unnoticed nor reach the others."""
    fleet = Fleet(find_robot("go1"), 4, threads=2)
    fleet.joint_velocity[2, 0] = np.nan
    fleet.qpos[3, 2] = np.inf
    assert list(fleet.step()) == [2, 3]
    assert list(fleet.blown_up) == [0, 0, 1, 1]
    assert np.isfinite(fleet.qpos).all() and np.isfinite(fleet.qvel).all()
    assert len(fleet.step()) == 0


def test_a_model_that_resets_itself_is_refused() -> None:
    """MuJoCo's own reset on NaN would hide a blow-up."""
    import mujoco

    from stiction.robots.mjcf import build
    from stiction.sim.native import NativeSimulation

    spec = build(find_robot("go1"))
    spec.option.disableflags = 0
    with pytest.raises(ValueError, match="mjDSBL_AUTORESET"):
        NativeSimulation(spec.compile(), 1, 1)
    assert mujoco.mjtDisableBit.mjDSBL_AUTORESET


def test_state_restores_bit_by_bit() -> None:
    """A checkpoint that lost the warm start or the delay line would resume on another trajectory."""
    rng = np.random.default_rng(0)
    fleet = Fleet(find_robot("go1"), 3)
    fleet.friction[:] = 2.0
    fleet.delay[:] = 0.015
    targets = fleet.standing + 0.2 * rng.standard_normal((20, 3, 12))
    for target in targets[:10]:
        fleet.set_targets(target)
        fleet.step()
    saved = fleet.simulation.state()

    def finish() -> np.ndarray:
        for target in targets[10:]:
            fleet.set_targets(target)
            fleet.step()
        return fleet.qpos.copy()

    first = finish()
    fleet.reset(np.arange(3))
    fleet.simulation.load_state(saved)
    assert np.array_equal(first, finish())
