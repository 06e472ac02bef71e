"""The viewer's simulation without a browser: what a slider changes, what a fall does, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.engines.catalog import make_engine
from stiction.engines.engine import Body, Pushable
from stiction.engines.ground import flat
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.view.history import History, belief_text
from stiction.view.simulation import LYING, Simulation, ViewedPolicy, WorldCfg

pytest.importorskip("mujoco", reason="the viewer needs the extra sim")


def shown(*methods: str) -> list[ViewedPolicy]:
    """Return shipped policies for flat ground."""
    bundles = [read_bundle(shipped_bundles()[f"saturn_lite-flat-{method}-0.2"]) for method in methods]
    return [ViewedPolicy.of_bundle(bundle) for bundle in bundles]


def simulation(*methods: str, **world) -> Simulation:
    """Return a simulation of them."""
    policies = shown(*(methods or ("none",)))
    return Simulation(policies, robot_of(policies[0].contract), WorldCfg(**world))


def walked(sim: Simulation, seconds: float) -> np.ndarray:
    """Return how far each robot comes along x in so many seconds [m]."""
    before = [walker.seen.motion.base_position[0] for walker in sim.walkers]
    for _ in range(round(seconds / sim.period)):
        sim.step()
    return np.array([walker.seen.motion.base_position[0] for walker in sim.walkers]) - before


def bounds(sim: Simulation) -> np.ndarray:
    """Return the bounds of friction in the first robot after a step [N m], shape (J,)."""
    sim.step()
    return sim.walkers[0].seen.friction


def test_friction_slows_the_policy_that_never_met_it_and_not_the_other() -> None:
    """If this failed, the viewer would not show what it is for: friction through which one policy walks."""
    sim = simulation("none", "deception")
    sim.set_velocity((0.5, 0.0, 0.0))
    free = walked(sim, 3.0)
    for kind in sim.kinds:
        sim.set_level(kind, 0.4)
    walked(sim, 1.0)
    rubbed = walked(sim, 2.0)
    assert (free > 0.9).all()
    assert rubbed[0] < 0.45 < 0.6 < rubbed[1]
    assert [walker.falls for walker in sim.walkers] == [0, 0]


def test_levels_are_shares_of_each_joints_limit_and_wear_multiplies_them() -> None:
    """If this failed, a slider would say one friction and the robot have another."""
    sim = simulation()
    limit = sim.spec.joint_values("torque_limit")
    shank = np.array([joint.kind == "shank" for joint in sim.spec.joints])
    sim.set_level("shank", 0.2)
    np.testing.assert_allclose(bounds(sim), np.where(shank, 0.2 * limit, 0.0))
    sim.set_wear(1.5)
    np.testing.assert_allclose(bounds(sim), np.where(shank, 0.3 * limit, 0.0))


@pytest.mark.parametrize("engine", ["mujoco", "physx", "ode"])
def test_a_push_changes_the_velocity_of_the_whole_robot(engine: str) -> None:
    """If this failed, a push would do nothing in one engine, or turn the joints."""
    spec = robot_of(shown("none")[0].contract)
    try:
        made = make_engine(engine, Body.nominal(spec), flat(), 0.002)
    except StictionError as missing:
        pytest.skip(str(missing))
    assert isinstance(made, Pushable)
    height = np.array([0.0, 0.0, 2.0])  # in the air, where nothing else pushes
    made.reset(spec.joint_values("default_position"), height, np.array([1.0, 0.0, 0.0, 0.0]))
    made.push(np.array([0.6, -0.4]))
    made.step(np.zeros(spec.num_joints), np.full(spec.num_joints, 50.0))
    motion = made.motion()
    np.testing.assert_allclose(motion.base_linear_velocity[:2], [0.6, -0.4], atol=2e-3)
    np.testing.assert_allclose(motion.joint_velocity, 0.0, atol=2e-2)


def test_a_robot_that_falls_lies_and_starts_again_alone() -> None:
    """If this failed, a fall would end the show, or put the others back too."""
    sim = simulation("direct", "deception")
    sim.set_velocity((0.5, 0.0, 0.0))
    walked(sim, 1.0)
    first, second = sim.walkers
    standing, upside_down = first.policy.contract.array("standing"), np.array([0.0, 1.0, 0.0, 0.0])
    first._walk.robot.place(standing, np.array([1.0, 0.0, 0.2]), upside_down)
    sim.step()
    assert first.lies and first.falls == 1 and not second.lies
    there = second.seen.motion.base_position[0]
    for _ in range(round(LYING / sim.period) + 2):
        sim.step()
    assert not first.lies and abs(first.seen.motion.base_position[0]) < 0.1
    assert second.seen.motion.base_position[0] > there + 0.3 and second.falls == 0


def test_an_engine_that_there_is_not_leaves_the_world_as_it_was() -> None:
    """If this failed, a wrong choice in one browser would end the simulation of all."""
    sim = simulation()
    walkers = sim.walkers
    with pytest.raises(StictionError, match="unknown engine 'bullet'"):
        sim.set_world(WorldCfg("bullet"))
    assert sim.walkers is walkers and sim.cfg.engine == "mujoco"
    sim.step()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "0.2", None, True])
def test_what_is_no_number_is_refused_and_changes_nothing(value: object) -> None:
    """If this failed, a browser that sends garbage would put NaN into the physics of all."""
    sim = simulation()
    for act in (
        lambda: sim.set_level("hip", value),
        lambda: sim.set_wear(value),
        lambda: sim.set_velocity((value, 0.0, 0.0)),
        lambda: sim.push((value, 0.0)),
    ):
        with pytest.raises(StictionError, match=r"expected a finite number"):
            act()
    assert not bounds(sim).any() and np.isfinite(sim.walkers[0].seen.motion.base_position).all()


def test_the_history_shows_speed_torque_and_both_frictions() -> None:
    """If this failed, a plot would show another quantity than its title says."""
    sim = simulation("none", "deception")
    history = History(sim)
    sim.set_velocity((0.5, 0.0, 0.0))
    for kind in sim.kinds:
        sim.set_level(kind, 0.1)
    for _ in range(round(2.0 / sim.period)):
        sim.step()
        history.add()
    time, commanded, *speeds = history.speed.columns()
    assert time[-1] == pytest.approx(2.0, abs=0.11) and commanded[-1] == 0.5
    motion = sim.walkers[1].seen.motion
    assert speeds[1][-1] == pytest.approx(motion.base_linear_velocity[0], abs=0.25)
    number = sim.spec.joint_names.index(history.joint)
    assert history.torque.columns()[1][-1] == sim.walkers[0].seen.torque[number]
    _, true, *told = history.friction.columns()
    assert true[-1] == pytest.approx(10.0) and np.isnan(told).all()
    assert "none: no wear.json" in belief_text(sim.walkers)
    assert "**deception** has not told" in belief_text(sim.walkers)
