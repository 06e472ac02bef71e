"""An Actuator Net of ours drives joints in mjlab: its own class loads the file, and gives the torque of the net."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import numpy as np
import torch
from mjlab.entity import EntityArticulationInfoCfg

from actuators import pd_net
from mjlab_leg import LIMITS, PERIOD, leg_cfg, made
from stiction.joints.net import ActuatorMemory, ActuatorNet
from stiction.learning.actuator_script import actuator_files

NAMES = ("hip_joint", "shank_joint")


def leg_net() -> ActuatorNet:
    """Return a net of two joints with random weights, of mild torque."""
    rng = np.random.default_rng(0)

    def layers() -> tuple:
        sizes = [(6, 8), (1, 6)]
        return tuple((0.3 * rng.normal(size=size).astype(np.float32), np.zeros(size[0], np.float32)) for size in sizes)

    groups = tuple((name,) for name in NAMES)
    return replace(
        pd_net(),
        joint_names=NAMES,
        torque_limit=tuple(LIMITS.values()),
        groups=groups,
        layers=(layers(), layers()),
        period=PERIOD,
    )


def test_mjlab_computes_the_torque_of_the_net(tmp_path: Path) -> None:
    """Step by step over twenty physics steps, from a reset on."""
    net = leg_net()
    for name, content in actuator_files(net, "mjlab").items():
        (tmp_path / name).write_bytes(content)
    cfg = leg_cfg(num_envs=3, decimation=1)
    groups = runpy.run_path(str(tmp_path / "actuators.py"))["actuators"](cfg.sim.mujoco.timestep)
    robot = cfg.scene.entities["robot"]
    cfg.scene.entities["robot"] = replace(robot, articulation=EntityArticulationInfoCfg(tuple(groups.values())))
    env = made(cfg)
    data, memory = env.scene["robot"].data, ActuatorMemory(net, 3)
    # mjlab asks its actuators once at the reset.
    memory.torque(*(tensor.numpy().copy() for tensor in (data.joint_pos_target, data.joint_pos, data.joint_vel)))
    rng = torch.Generator().manual_seed(0)
    moved = 0.0
    for _ in range(20):
        position, velocity = data.joint_pos.numpy().copy(), data.joint_vel.numpy().copy()
        env.step(torch.rand(3, 2, generator=rng) - 0.5)
        target = data.joint_pos_target.numpy().copy()
        limits = np.array(net.torque_limit)
        expected = np.clip(memory.torque(target, position, velocity), -limits, limits)
        np.testing.assert_allclose(data.qfrc_actuator.numpy(), expected, atol=2e-4)
        moved = max(moved, float(np.abs(data.joint_pos.numpy()).max()))
    assert moved > 0.01
