"""Slow means in the task: what the simulation does to them, and what a checkpoint must hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from stiction.deploy import observation
from stiction.task import observations as means
from stiction.task.config import NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg


def make(num_envs: int = 4, **changes: object) -> LocomotionEnv:
    """A small task with slow means over a second."""
    cfg = TaskCfg(robot="go1", slow_means=1.0, noise=NoiseCfg(0.0, 0.0, 0.0, 0.0))
    return LocomotionEnv(replace(cfg, **changes), num_envs, seed=1)


def test_they_tell_the_friction_of_single_joints() -> None:
    """Legs swing in the air; robot j has 8 % in joint j and 4 % in all others: kp x power over speed says just that.

    What kd and damping take of the power is the same in all robots, and in the last one, which has 4 % everywhere.
    """
    same = dict.fromkeys(("armature", "damping", "stiffness", "motor_strength", "ground_friction"), (1.0, 1.0))
    none = dict.fromkeys(("payload", "center_of_mass", "action_delay", "encoder_offset"), (0.0, 0.0))
    nominal = RandomizationCfg(**same, **none, push_interval=0.0)
    env = make(13, friction=FrictionCfg("direct", level=0.1), randomization=nominal, slow_means=4.0)
    fleet, level = env.fleet, np.full((13, 12), 0.04)
    level[np.arange(12), np.arange(12)] = 0.08
    fleet.reset(np.arange(13))
    env.host.law.set_level(level * fleet.torque_limit, ids=np.arange(13))
    fleet.simulation.expand("opt.gravity")[:] = 0.0
    fleet.base_position[:, 2] = 2.0
    for step in range(500):
        env.step(torch.full((13, 12), 1.5 * math.sin(math.pi * step * env.cfg.control_period)))
        env.episode_length_buf[:] = 1
    slow = env.get_observations()["proprioception"][:, 11 + 3 * 12 :].double().numpy()
    _, speed, power = np.split(slow / np.repeat([term.scale for term in env.layout.terms[-3:]], 12), 3, axis=1)
    share = fleet.nominal_kp * power / speed / fleet.torque_limit
    np.testing.assert_allclose(share[:12] - share[12], level[:12] - level[12], atol=0.004)


def test_they_are_those_of_the_robot_after_a_reading_that_no_walk_has() -> None:
    """In float32 a mean would go on from the rounding of 10,000 rad²/s, and a replay would differ from its export."""
    generator, fresh = np.random.default_rng(0), np.ones(1, bool)
    trained, deployed = means.SlowMeans(1, 12, math.exp(-0.02)), observation.SlowMeans((1, 12), math.exp(-0.02))
    for size in (100.0, 100.0, 0.1, 0.1, 0.1):
        error, velocity = (size * generator.standard_normal((1, 12)) for _ in range(2))
        seen = trained.push(torch.from_numpy(error), torch.from_numpy(velocity), torch.from_numpy(fresh))
        deployed.step(error, velocity, fresh)
        fresh = np.zeros(1, bool)
        for name, values in deployed.terms().items():
            assert seen[name].dtype == torch.float32
            np.testing.assert_array_equal(seen[name].numpy(), values.astype(np.float32))
