"""Slow means in the task: what the simulation does to them, and what a checkpoint must hold."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from stiction.core.errors import StictionError
from stiction.deploy import observation
from stiction.learning.run import load_checkpoint, save_checkpoint
from stiction.task import observations as means
from stiction.task.config import NoiseCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg


def make(num_envs: int = 4, **changes: object) -> LocomotionEnv:
    """A small task with slow means over a second."""
    cfg = TaskCfg(robot="go1", slow_means=1.0, noise=NoiseCfg(0.0, 0.0, 0.0, 0.0))
    return LocomotionEnv(replace(cfg, **changes), num_envs, seed=1)


def test_the_layout_has_three_means_of_every_joint_and_their_time() -> None:
    """K = exp(−0.02/1); by default there are none, and the layout is the paper's."""
    layout = make().layout
    assert layout.frame_size == 11 + 3 * 12 + 3 * 12 and layout.slow_kept == pytest.approx(math.exp(-0.02))
    assert make(slow_means=None).layout.frame_size == 11 + 3 * 12
    for wrong in (0.0, 0.01, math.nan, 1000.0):
        with pytest.raises(StictionError, match="slow means over"):
            TaskCfg(slow_means=wrong)


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


def test_a_checkpoint_holds_them(tmp_path: Path) -> None:
    """A resumed run would show every robot a memory of another one."""
    env, other = make(), make()
    actions = 0.3 * torch.randn(4, 12, generator=torch.Generator().manual_seed(0))
    for _ in range(5):
        env.step(actions)
    save_checkpoint(tmp_path / "c.safetensors", env.state())
    other.load_state(load_checkpoint(tmp_path / "c.safetensors"))
    for one in (env, other):
        one.step(actions)
    assert torch.equal(env.get_observations()["history"], other.get_observations()["history"])
