"""Tasks of mjlab with friction in the joints, which `import mjlab` finds by the entry point of this package."""

from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import torch
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.registry import list_tasks, load_env_cfg

from stiction.exchange.mjlab.motors import limits_of, motors_of
from stiction.mjlab import audit_hold

PROJECT = Path(__file__).parents[3] / "pyproject.toml"


def test_the_entry_point_registers_both_tasks() -> None:
    """Registration works at mjlab's import and a second time."""
    (value,) = tomllib.loads(PROJECT.read_text())["project"]["entry-points"]["mjlab.tasks"].values()
    import_module(value)
    assert {"Stiction-Velocity-Flat-Unitree-Go1", "Stiction-Velocity-Flat-Unitree-G1"} <= set(list_tasks())


@pytest.mark.parametrize("robot", ["Go1", "G1"])
def test_robots_have_one_share_that_holds_and_the_critic_is_told(robot: str) -> None:
    """Two steps of four robots; the policy's observations are as before."""
    import_module("stiction.exchange.mjlab.tasks")
    cfg, theirs = (load_env_cfg(f"{maker}-Velocity-Flat-Unitree-{robot}") for maker in ("Stiction", "Mjlab"))
    joints = 12 if robot == "Go1" else 29
    assert cfg.sim.njmax - theirs.sim.njmax >= joints
    cfg.scene.num_envs = 4
    env = ManagerBasedRlEnv(cfg, device="cpu")
    observed, _ = env.reset()
    for _ in range(2):
        env.step(torch.zeros(4, env.action_manager.total_action_dim))
    limits = torch.tensor(limits_of(motors_of(env, env.scene["robot"])))
    if robot == "Go1":
        assert limits.tolist() == pytest.approx([23.7, 23.7, 35.55] * 4)
    share = env.sim.model.dof_frictionloss[:, 6:] / limits
    assert share.shape == (4, joints) and (share.std(dim=1) < 1e-6).all()
    assert share.max() <= 0.2401 and share[:, 0].unique().numel() == 4
    plain = ManagerBasedRlEnv(theirs, device="cpu").observation_manager
    shapes = env.observation_manager.group_obs_dim
    assert shapes["actor"] == plain.group_obs_dim["actor"]
    assert shapes["critic"][0] == plain.group_obs_dim["critic"][0] + joints
    torch.testing.assert_close(observed["critic"][:, -joints:], share)
    assert [row.joint for row in audit_hold(env) if row.verdict != "holds"] == []
