"""A test stand for randomised robots: one joint at a time in the air, the whole robot standing or sliding.

Robots are randomised through the same `Randomizer` as in training; the formulas beside the measurements know only what
was drawn and what the specification says.
"""

from __future__ import annotations

import numpy as np
import torch

from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate
from stiction.locomotion.config import TaskCfg
from stiction.locomotion.randomization import Randomizer, nominal_joints
from stiction.robots.spec import RobotSpec
from stiction.sim.fleet import Fleet
from stiction.sim.friction import needs_sensors

STEP = 0.15
"""Step of the joint target on the stand [rad]."""

BENCH_SECONDS = 0.3
"""Length of a run on the stand [s]."""


class Stand:
    """One robot of a task on a stand, at the task's own physics step."""

    def __init__(self, spec: RobotSpec, cfg: TaskCfg) -> None:
        """`cfg`: the task; dry friction is the nominal one of its level."""
        self.spec, self.cfg = spec, cfg

    def fleet(self, num: int, **draws: float | np.ndarray) -> tuple[Fleet, Randomizer]:
        """Return `num` robots, nominal but for `draws`, without gravity."""
        cfg = self.cfg
        fleet = Fleet(self.spec, num, cfg.timestep, cfg.decimation, joint_sensors=needs_sensors(cfg.friction.joint_law))
        randomizer = Randomizer(fleet, cfg.randomization, cfg.friction, nominal_joints(fleet, cfg.friction))
        for name in ("armature", "damping", "stiffness", "motor_strength", "ground_friction"):
            getattr(randomizer.draws, name)[:] = 1.0
        for name, value in draws.items():
            getattr(randomizer.draws, name)[:] = torch.as_tensor(value, dtype=torch.float32)
        randomizer.apply(torch.arange(num))
        return fleet, randomizer

    def joint_motion(self, **draws: float) -> np.ndarray:
        """Return each joint's angle after a step of its target, all else held, (joints, samples)."""
        joints = self.spec.num_joints
        fleet, _ = self.fleet(joints, **draws)
        fleet.set_gravity((0.0, 0.0, 0.0))
        fleet.base_position[:, 2] += 1.0
        fleet.clamp(~np.eye(joints, dtype=bool), base=True)
        everyone = np.arange(joints)
        fleet.set_targets(fleet.standing + STEP * np.eye(joints))
        motion = [fleet.joint_position[everyone, everyone] - fleet.standing]
        for _ in range(round(BENCH_SECONDS / fleet.timestep)):
            fleet.substep()
            motion.append(fleet.joint_position[everyone, everyone] - fleet.standing)
        return np.array(motion).T

    def joint_formula(
        self,
        armature: float = 1.0,
        damping: float = 1.0,
        friction: float = 0.0,
        stiffness: float = 1.0,
        motor_strength: float = 1.0,
        action_delay: float = 0.0,
    ) -> np.ndarray:
        """Return what I q'' + B q' = τ + f gives for the same step, (joints, samples)."""
        fleet = Fleet(self.spec, 1, self.cfg.timestep, self.cfg.decimation)
        # The reference joins its targets by straight lines: a grid ten times finer makes the step a step.
        fine = 10
        links, step = fleet.link_inertia(), fleet.timestep / fine
        nominal = nominal_joints(fleet, self.cfg.friction)
        target = np.full(round(BENCH_SECONDS / step) + 1, STEP)
        target[: round(action_delay / step)] = 0.0
        motion = []
        for j in range(self.spec.num_joints):
            joint = Joint(
                inertia=links[j] + armature * nominal.armature[j],
                viscous=damping * nominal.damping[j],
                friction=Coulomb(friction * nominal.frictionloss[j]),
            )
            gains = PDGains(
                kp=stiffness * fleet.nominal_kp[j],
                kd=fleet.nominal_kd[j],
                torque_limit=fleet.torque_limit[j],
                strength=motor_strength,
            )
            motion.append(simulate(joint, gains, step, target).position[::fine])
        return np.array(motion)

    def standing_feet(
        self, gravity: tuple[float, float, float], **draws: float | np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return the weight on the feet [N] and its centre on the ground [m], (2,), joints held, under `gravity`."""
        fleet, _ = self.fleet(1, **draws)
        fleet.set_gravity(gravity)
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=False)
        for _ in range(round(1.0 / fleet.control_period)):
            fleet.step()
        force = fleet.foot_force[0]
        return float(force.sum()), force @ (fleet.foot_position(0)[:, :2] - fleet.base_position[0, :2]) / force.sum()

    def slide(self, **draws: float) -> float:
        """Return the deceleration [m/s²] of a robot that slides on its feet, joints held, over half a second."""
        fleet, _ = self.fleet(1, **draws)
        fleet.clamp(np.ones((1, self.spec.num_joints), bool), base=False)
        half_second = round(0.5 / fleet.control_period)
        for _ in range(half_second):
            fleet.step()
        fleet.qvel[:, 0] = start = 3.0
        for _ in range(half_second):
            fleet.step()
        return float(start - fleet.qvel[0, 0]) / (half_second * fleet.control_period)
