"""MuJoCo from outside is the simulation of the training, up to how it takes the controllers' damping."""

from __future__ import annotations

import numpy as np

from stiction.core.rotation import UPRIGHT
from stiction.engines.engine import Body, Motion
from stiction.engines.ground import flat
from stiction.engines.mujoco_engine import MujocoEngine
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction_experiments.engines.conformance.rig import record, still

SPEC = find_robot("go1")
SECONDS = 0.1


def apart(timestep: float) -> float:
    """Return how far joints of a fleet and of the engine are apart after a step of the targets, with friction [rad]."""
    target, friction = SPEC.joint_values("default_position") + 0.1, np.full(SPEC.num_joints, 1.0)
    fleet = Fleet(SPEC, 1, timestep, round(SECONDS / timestep))
    fleet.friction[:] = friction
    fleet.set_targets(target)
    fleet.step()
    kp, kd, limit = fleet.nominal_kp, fleet.nominal_kd, fleet.torque_limit

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        torque = kp * (target - motion.joint_position) - kd * motion.joint_velocity
        return np.clip(torque, -limit, limit), friction

    engine = MujocoEngine(Body.nominal(SPEC), flat(), timestep)
    engine.reset(SPEC.joint_values("default_position"), np.array([0.0, 0.0, SPEC.standing_height]), UPRIGHT)
    motion = record(engine, round(SECONDS / timestep), act)
    return float(np.abs(motion.joint_position[-1] - fleet.joint_position[0]).max())


def test_a_fleet_and_the_engine_come_to_the_same_with_finer_steps() -> None:
    """Rows of `mujoco` would be about another robot than the one trained, and no step would be fine enough."""
    coarse, fine = apart(2e-3), apart(2.5e-4)
    assert fine < 2e-4 and fine < 0.25 * coarse


def test_stiffer_contacts_give_way_less() -> None:
    """A study that asks what soft contacts change would compare the same contacts twice."""
    height = []
    for contact_time in (None, 0.004):
        engine = MujocoEngine(Body.nominal(SPEC), flat(), 0.002, contact_time)
        engine.reset(SPEC.joint_values("default_position"), np.array([0.0, 0.0, SPEC.standing_height]), UPRIGHT)
        height.append(record(engine, 200, still(engine.body)).base_position[-1, 2] - SPEC.standing_height)
    soft, stiff = height
    assert -2e-3 < soft < 3.0 * stiff < 0.0
