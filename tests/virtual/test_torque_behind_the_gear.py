"""A torque sensor behind the gear: what dry friction did in an engine, and what such a sensor then reads."""

from __future__ import annotations

import numpy as np
import pytest

from stiction.core.rotation import UPRIGHT
from stiction.deploy.control import JointCommand, Reading
from stiction.engines.catalog import make_engine, missing_engine
from stiction.engines.engine import Body, Engine, FrictionSensing, JointFriction
from stiction.engines.ground import flat
from stiction.joints.friction import Law
from stiction.joints.net import TorqueSource
from stiction.robots.catalog import find_robot
from stiction.virtual.hidden import Hidden
from stiction.virtual.robot import VirtualRobot

mujoco = pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', has the inverse dynamics")

SPEC = find_robot("saturn_lite")
STANDING, UP = SPEC.joint_values("default_position"), np.array([0.0, 0.0, 3 * SPEC.standing_height])
BOUND, STEP = 3.0, 0.001


def on_stand(name: str) -> Engine:
    """Return the robot on a stand, its legs in the air."""
    if why := missing_engine(name, SPEC):
        pytest.skip(why)
    engine = make_engine(name, Body.nominal(SPEC, fixed=True), flat(), STEP)
    engine.reset(STANDING, UP, UPRIGHT)
    return engine


def needed(position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Return the joint torques that a motion takes, by MuJoCo's inverse dynamics, without friction [N m]."""
    engine = make_engine("mujoco", Body.nominal(SPEC, fixed=True), flat(), STEP)
    engine.reset(position, UP, UPRIGHT)
    model, data = engine._model, engine._data  # type: ignore[attr-defined]
    model.dof_damping[:] = 0.0
    data.qvel[:], data.qacc[:] = velocity, acceleration
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()


@pytest.mark.parametrize("name", ["mujoco", "physx"])
def test_an_engine_says_what_its_friction_did(name: str) -> None:
    """Equals the torque of the motion less motor and B q': 3 N m for a sliding joint, less for one at rest."""
    engine = on_stand(name)
    assert isinstance(engine, FrictionSensing)
    np.testing.assert_array_equal(engine.friction_torque(), np.zeros(18))
    motion, sliding, resting = engine.motion(False), 0, 0
    for step in range(300):
        target = STANDING + 0.3 * np.sin(2 * np.pi * STEP * step + np.arange(18))
        torque = np.clip(100 * (target - motion.joint_position) - 2.5 * motion.joint_velocity, -25, 25)
        before, _ = motion, engine.step(torque, np.full(18, BOUND))
        motion, friction = engine.motion(False), engine.friction_torque()
        if step < 20 or step % 20:
            continue
        change = (motion.joint_velocity - before.joint_velocity) / STEP
        damped = motion if name == "mujoco" else before
        friction_torque = needed(before.joint_position, before.joint_velocity, change)
        friction_torque = friction_torque - torque + engine.body.damping * damped.joint_velocity
        np.testing.assert_allclose(friction, friction_torque, atol=0.05)
        fast = np.abs(motion.joint_velocity) > 0.1
        np.testing.assert_allclose(friction[fast], -BOUND * np.sign(motion.joint_velocity[fast]), rtol=1e-6)
        sliding, resting = sliding + fast.sum(), resting + (np.abs(friction) < 0.9 * BOUND).sum()
    assert sliding > 50 and resting > 10
    engine.reset(STANDING, UP, UPRIGHT)
    np.testing.assert_array_equal(engine.friction_torque(), np.zeros(18))


def held(engine: Engine, side: TorqueSource, target: np.ndarray) -> Reading:
    """Return what a robot says that was told to hold a pose, and has come to rest."""
    hidden = Hidden.perfect(18)
    friction = JointFriction.under(Law("coulomb"), np.full(18, BOUND), STEP)
    robot = VirtualRobot(engine, hidden, friction, np.random.default_rng(0), torque_source=side)
    robot.place(STANDING, UP, UPRIGHT)
    gains = np.full(18, 40.0), np.full(18, 2.0)
    command = JointCommand(target, *gains, np.zeros(18))
    return [robot.handle.exchange(command) for _ in range(50)][-1]


@pytest.mark.parametrize("name", ["mujoco", "physx"])
def test_a_joint_that_is_stuck_shows_its_load_and_not_its_motor(name: str) -> None:
    """Targets 0.02 rad apart are 0.8 N m at the motor; behind the gear there is the weight of the legs, both times."""
    engine = on_stand(name)
    weight = needed(STANDING, np.zeros(18), np.zeros(18))
    assert np.abs(weight).max() + 0.8 < BOUND
    targets = STANDING, STANDING + 0.02
    behind = [held(engine, "output_side", target).joint_torque for target in targets]
    motor = [held(engine, "motor_side", target).joint_torque for target in targets]
    np.testing.assert_allclose(behind, [weight, weight], atol=0.02)
    np.testing.assert_allclose(motor, [np.zeros(18), np.full(18, 0.8)], atol=0.02)
