"""Dry friction as a yielding spring: what it holds, how it slides, and that it forgets and remembers as it should."""

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.learning.config import TrainCfg
from stiction.robots.catalog import find_robot
from stiction.robots.physics import PhysicsCfg
from stiction.sim.fleet import BASE_DOFS, Fleet
from stiction.task.config import TaskCfg

LEVEL = 0.2
PLASTIC = PhysicsCfg("plastic", stiffness=1500.0)


def hung(physics: PhysicsCfg = PLASTIC, robots: int = 1, timestep: float = 0.005) -> Fleet:
    """Robots in the air, motors off, every joint held but the first, friction at LEVEL."""
    fleet = Fleet(find_robot("saturn_lite"), robots, timestep, decimation=1, physics=physics)
    fleet.set_gravity((0.0, 0.0, 0.0))
    fleet.base_position[:, 2] += 1.0
    zero = np.zeros((robots, fleet.spec.num_joints))
    fleet.set_gains(zero, zero)
    fleet.friction[:] = LEVEL * fleet.torque_limit
    held = np.ones((robots, fleet.spec.num_joints), bool)
    held[:, 0] = False
    fleet.clamp(held, base=range(6))
    return fleet


def pull(fleet: Fleet, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Load the first joint with a torque a step, (steps,) or (steps, N); return its angle and speed, (steps, N)."""
    applied = fleet.simulation.bind("qfrc_applied")
    angle, speed = [], []
    for now in torque:
        applied[:, BASE_DOFS] = now
        fleet.step()
        angle.append(fleet.joint_position[:, 0] - fleet.standing[0])
        speed.append(fleet.joint_velocity[:, 0].copy())
    return np.array(angle), np.array(speed)


def bound(fleet: Fleet) -> float:
    """Friction of the first joint [N m]."""
    return float(LEVEL * fleet.torque_limit[0])


def test_below_its_bound_a_joint_gives_way_by_load_over_stiffness_and_comes_back() -> None:
    """Pre-sliding is a spring: τ/k, nothing extended; if it crept, a standing robot would sink."""
    fleet = hung()
    fleet.damping[:, 0] = 5.0
    load = 0.9 * bound(fleet)
    angle, _ = pull(fleet, np.concatenate((np.linspace(0, load, 200), np.full(200, load), np.linspace(load, 0, 200))))
    assert angle[399, 0] == pytest.approx(load / PLASTIC.stiffness, rel=1e-3)
    assert angle[399, 0] - angle[299, 0] == pytest.approx(0.0, abs=1e-9)
    assert angle[-1, 0] == pytest.approx(0.0, abs=2e-5)


def test_a_joint_breaks_away_at_its_bound() -> None:
    """The spring yields between 98 and 102 % of f: the angle at which it is slack tells."""
    for share, yields in ((0.98, False), (1.02, True)):
        fleet = hung()
        fleet.damping[:, 0] = 5.0
        pull(fleet, np.linspace(0, share * bound(fleet), 400))
        moved = fleet.simulation.bind("plastic")[0, 0] - fleet.standing[0]
        assert (abs(moved) > 1e-6) == yields


def test_a_sliding_joint_feels_exactly_its_friction() -> None:
    """I q'' + B q' = τ - f: the speed of a later moment follows from that of an earlier one."""
    fleet = hung()
    load = 1.1 * bound(fleet)
    angle, speed = pull(fleet, np.full(40, load))
    inertia = fleet.link_inertia()[0] + fleet.spec.joint_values("armature")[0]
    damping = fleet.spec.joint_values("damping")[0]
    final, decay = (load - bound(fleet)) / damping, np.exp(-damping / inertia * 20 * fleet.timestep)
    assert speed[39, 0] == pytest.approx(final + (speed[19, 0] - final) * decay, rel=2e-3)
    slack = fleet.simulation.bind("plastic")[0, 0] - fleet.standing[0]
    assert PLASTIC.stiffness * (angle[-1, 0] - slack) == pytest.approx(bound(fleet), rel=1e-9)


def test_friction_differs_by_robot_and_none_is_none() -> None:
    """Under one load v' = (τ - f)/I: each robot gains speed by its own excess, and level 0 is a free joint."""
    fleet = hung(robots=3)
    load = 1.2 * bound(fleet)
    fleet.friction[:, 0] = bound(fleet) * np.array([0.0, 0.5, 1.0])
    fleet.damping[:] = 0.0
    _, speed = pull(fleet, np.full(14, load))
    gained = (speed[13] - speed[5]) / (8 * fleet.timestep)
    inertia = fleet.link_inertia()[0] + fleet.spec.joint_values("armature")[0]
    np.testing.assert_allclose(gained, bound(fleet) * np.array([1.2, 0.7, 0.2]) / inertia, rtol=5e-3)


def test_a_reset_robot_has_slack_springs_wherever_its_joints_are_put() -> None:
    """A spring that remembered the last episode would throw the robot; the others keep theirs."""
    fleet = hung(robots=2)
    pull(fleet, np.full(60, 2.0 * bound(fleet)))
    kept = fleet.simulation.bind("plastic")[1].copy()
    start = fleet.standing + 0.1
    fleet.reset(np.array([0]), joint_position=start[None])
    fleet.base_position[0, 2] += 1.0
    np.testing.assert_array_equal(fleet.simulation.bind("plastic")[0], start)
    np.testing.assert_array_equal(fleet.simulation.bind("plastic")[1], kept)
    pull(fleet, np.zeros((20, 2)))
    np.testing.assert_allclose(fleet.joint_position[0, 0], start[0], atol=1e-9)


def test_a_restored_simulation_goes_on_bit_for_bit() -> None:
    """A checkpoint without the springs' state would begin with joints that stick elsewhere."""
    torque = 1.5 * LEVEL * 25.0 * np.sin(np.arange(120) / 7.0)
    fleet, other = hung(), hung()
    pull(fleet, torque[:60])
    state = fleet.simulation.state()
    other.simulation.load_state(state)
    np.testing.assert_array_equal(pull(fleet, torque[60:]), pull(other, torque[60:]))
    other.simulation.load_state({name: value for name, value in state.items() if name != "plastic"})
    assert np.abs(other.simulation.bind("plastic") - state["plastic"]).max() > 1e-3


def test_rows_take_the_place_of_sliders() -> None:
    """To the last bit a fleet that had rows from the beginning, with the friction that the sliders had."""
    fleets = [Fleet(find_robot("go1"), 2, 0.005, decimation=4, physics=one) for one in (PhysicsCfg(), PLASTIC)]
    for fleet in fleets:
        fleet.friction[:] = np.array([[0.05], [0.2]]) * fleet.torque_limit
    fleets[1].use_rows()
    for fleet in fleets:
        for step in range(25):
            fleet.set_targets(fleet.standing + 0.3 * np.sin(0.4 * step))
            fleet.step()
    np.testing.assert_array_equal(fleets[0].qpos, fleets[1].qpos)
    fleets[1].friction[:] = 0.0
    fleets[1].step()
    assert (fleets[1].simulation.materialize(1)[0].dof_frictionloss == 0.0).all()


def test_what_has_no_meaning_is_refused_in_one_line() -> None:
    """On a GPU springs would not yield at all, and PGS does not converge on rows."""
    with pytest.raises(StictionError, match="--physics plastic needs them; use --device cpu"):
        TrainCfg(task=TaskCfg(physics=PLASTIC), device="warp-cpu")
    for wrong, word in (
        ({"friction": "glue"}, "rows, plastic, plastic-first"),
        ({"solver": "cg"}, "newton, pgs"),
        ({"solver": "pgs"}, "--physics plastic"),
        ({"impedance": 1.0}, "impedance"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"stiffness": 1e-300}, r"stiffness 1e-300 N m/rad, 100 iterations; expected a stiffness in \[1, 1e\+06\]"),
        ({"stiffness": 1e7}, "stiffness"),
        ({"stiffness": float("nan")}, "stiffness"),
        ({"iterations": 0}, "iteration"),
        ({"iterations": 10**9}, "1 to 10000 iterations"),
    ):
        with pytest.raises(StictionError, match=word) as error:
            PhysicsCfg(**wrong)
        assert "\n" not in str(error.value)
