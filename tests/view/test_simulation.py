"""The viewer's simulation without a browser: what a slider changes, what a fall does, what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.engines.catalog import make_engine
from stiction.engines.engine import Body, ContactSensing, Pushable
from stiction.engines.ground import flat
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction.files.contract import robot_of
from stiction.view.history import History, belief_text, believed, friction_text
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
    """Friction of 40 % slows the policy that never met it, and not the one that did."""
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
    """Sets the level as a share of each joint's torque limit, times the wear."""
    sim = simulation()
    limit = sim.spec.joint_values("torque_limit")
    shank = np.array([joint.kind == "shank" for joint in sim.spec.joints])
    sim.set_level("shank", 0.2)
    np.testing.assert_allclose(bounds(sim), np.where(shank, 0.2 * limit, 0.0))
    sim.set_wear(1.5)
    np.testing.assert_allclose(bounds(sim), np.where(shank, 0.3 * limit, 0.0))


@pytest.mark.parametrize("engine", ["mujoco", "physx", "ode"])
def test_a_push_changes_the_velocity_of_the_whole_robot(engine: str) -> None:
    """Adds the velocity of a push to the body in every engine, and leaves the joints."""
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
    """Puts a robot that fell back to the start after its time, alone."""
    sim = simulation("direct", "deception")
    sim.set_velocity((0.5, 0.0, 0.0))
    walked(sim, 1.0)
    first, second = sim.walkers
    standing, upside_down = first.policy.contract.array("standing"), np.array([0.0, 1.0, 0.0, 0.0])
    first._walk.robot.place(standing, np.array([1.0, 0.0, 0.2]), upside_down)
    sim.step()
    assert first.lies and first.falls == 1 and not second.lies
    before = second.seen.motion.base_position[0]
    for _ in range(round(LYING / sim.period) + 2):
        sim.step()
    assert not first.lies and abs(first.seen.motion.base_position[0]) < 0.1
    assert second.seen.motion.base_position[0] > before + 0.3 and second.falls == 0


def test_an_engine_that_there_is_not_leaves_the_world_as_it_was() -> None:
    """Refuses an unknown engine and stays in the old world."""
    sim = simulation()
    walkers = sim.walkers
    with pytest.raises(StictionError, match="unknown engine 'bullet'"):
        sim.set_world(WorldCfg("bullet"))
    assert sim.walkers is walkers and sim.cfg.engine == "mujoco"
    sim.step()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "0.2", None, True])
def test_what_is_no_number_is_refused_and_changes_nothing(value: object) -> None:
    """Refuses what is no finite number, and changes nothing."""
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
    """Records the speed along the command, the torque of the named joint and the true friction."""
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
    _, true, *estimates = history.friction.columns()
    assert true[-1] == pytest.approx(10.0) and np.isnan(estimates).all()
    assert "none: no estimate without a wear.json" in belief_text(sim.walkers)
    assert "**deception** has no estimate yet" in belief_text(sim.walkers)


def test_an_estimate_is_trusted_only_if_its_window_holds_one_friction() -> None:
    """A window with a change of friction, and an estimate from before a change, are doubted, with the reason."""
    sim = simulation("deception")
    (walker,) = sim.walkers
    window = walker.policy.wear.window

    def walk_windows(number: float) -> tuple[float, ...]:
        for _ in range(round(number * window)):
            sim.step()
        return believed(walker)

    assert walk_windows(1) == (pytest.approx(math.nan, nan_ok=True),) * 4 and walker.doubt is None
    sim.step()
    assert walker.doubt is None
    level, low, high, doubted = believed(walker)
    assert low <= level <= high < 8.0 and math.isnan(doubted)
    assert "estimates a friction of" in friction_text(walker)
    for kind in sim.kinds:
        sim.set_level(kind, sim.levels[kind])
    assert walker.doubt is None, "nothing changed"
    for kind in sim.kinds:
        sim.set_level(kind, 0.12)
    assert walker.doubt == "the friction changed after the window"
    assert math.isnan(believed(walker)[0]) and believed(walker)[3] == pytest.approx(level)
    level, _, _, doubted = walk_windows(1)
    assert walker.doubt is None and 8.0 < level < 16.0 and math.isnan(doubted)
    walk_windows(0.5)
    sim.set_wear(0.5)
    assert walker.doubt == "the friction changed after the window"
    walk_windows(0.5)
    assert walker.doubt == "the friction changed within the window"
    assert "not trusted (grey, dashed): the friction changed within the window" in friction_text(walker)
    level, _, _, doubted = walk_windows(1)
    assert walker.doubt is None and 3.0 < level < 9.0 and math.isnan(doubted)


def test_robots_start_at_once_and_friction_set_before_is_no_change() -> None:
    """Robots walk at 0.5 m/s unless told otherwise; a friction set before the first step leaves the window whole."""
    sim = simulation("deception")
    assert sim.velocity.tolist() == [0.5, 0.0, 0.0]
    sim.set_level("hip", 0.1)
    for _ in range(sim.walkers[0].policy.wear.window + 1):
        sim.step()
    assert not sim.walkers[0].belief.changed
    assert sim.walkers[0].seen.motion.base_position[0] > 1.0


@pytest.mark.parametrize("engine", ["mujoco", "physx"])
def test_contact_forces_of_a_standing_robot_carry_its_weight(engine: str) -> None:
    """Their sum is the weight, upwards, at the feet on the ground."""
    spec = robot_of(shown("none")[0].contract)
    try:
        made = make_engine(engine, Body.nominal(spec), flat(), 0.002)
    except StictionError as missing:
        pytest.skip(str(missing))
    assert isinstance(made, ContactSensing)
    standing = spec.joint_values("default_position")
    made.reset(standing, np.array([0.0, 0.0, spec.standing_height]), np.array([1.0, 0.0, 0.0, 0.0]))
    for _ in range(1000):
        motion = made.motion(loads=False)
        torque = -200.0 * (motion.joint_position - standing) - 2.0 * motion.joint_velocity
        made.step(torque, np.full(spec.num_joints, 0.5))
    forces = made.contact_forces()
    weight = 9.81 * (spec.base.mass + sum(link.mass for link in spec.links))
    np.testing.assert_allclose(sum(force for _, force in forces), [0.0, 0.0, weight], atol=0.01 * weight)
    assert len(forces) == len(spec.feet) and all(abs(point[2]) < 0.01 for point, _ in forces)
