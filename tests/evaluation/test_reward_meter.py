"""The reward terms of one robot against those of the training, on the same robot."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra train")

import torch

from stiction.engines.engine import Motion
from stiction.evaluation.reward_meter import RewardMeter
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.rewards import Snapshot


def motion_of(env: LocomotionEnv) -> Motion:
    """Return the motion of the environment's only robot."""
    fleet, nothing = env.robots, np.zeros(env.spec.num_joints)
    state = (fleet.base_quaternion, fleet.base_linear_velocity, fleet.base_angular_velocity)
    quaternion, velocity, rate, angle, speed = (
        value[0].double().numpy() for value in (*state, fleet.joint_position, fleet.joint_velocity)
    )
    position = np.array([0.0, 0.0, float(fleet.height[0])])
    contact = fleet.foot_contact[0].numpy()
    return Motion(position, quaternion, velocity, rate, angle, speed, contact, nothing, nothing)


class Watched(LocomotionEnv):
    """The task, which keeps motion and torque as its rewards see them."""

    def _snapshot(self, actions: torch.Tensor, blown_up: torch.Tensor) -> Snapshot:
        snapshot = super()._snapshot(actions, blown_up)
        self.motion, self.torque = motion_of(self), self.robots.torque[0].numpy().copy()
        return snapshot


@pytest.mark.parametrize("robot", ["saturn_lite", "go1"])
def test_the_terms_are_those_of_the_training(robot: str) -> None:
    """Every weighted term of 40 steps of a robot that moves, falls not, and lands on its feet, is the training's."""
    env = Watched(TaskCfg(robot=robot), 1, seed=3)
    meter = RewardMeter(env.cfg, env.spec)
    generator, landed = torch.Generator().manual_seed(1), False
    for _ in range(40):
        action = 0.4 * torch.randn(1, env.spec.num_joints, generator=generator)
        command = env.commands.value[0].numpy().copy()
        *_, dones, extras = env.step(action)
        if dones.any():
            break
        meter.add(env.motion, env.torque, action[0].numpy(), command)
        for name, value in meter.values.items():
            assert value == pytest.approx(float(extras["log"][f"reward/{name}"]), rel=1e-3, abs=1e-4), name
        landed = landed or meter.values["air_time"] != 0.0
    assert landed and len(meter.values) > 12
