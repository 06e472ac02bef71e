"""Friction drawn and told in mjlab: one number a robot over all its joints, and it brakes."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mjlab", reason="the package mjlab is not installed here; `make test-mjlab` makes its environment")

import torch
from mjlab.managers.observation_manager import ObservationGroupCfg, ObservationTermCfg

from mjlab_leg import LIMITS, leg_cfg, made
from stiction.core.errors import StictionError
from stiction.files.joints import write_training
from stiction.mjlab import audit_draws, friction_events, friction_told

TRAINING = {"friction": {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}, "range": [0.1, 0.24]}


def drawn(folder: Path, per: str) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return friction over the limit of 32 robots as it was told, as it is, and as it is after a reset of two."""
    proposal = TRAINING | {"friction": TRAINING["friction"] | {"per": per}}
    write_training(folder / "training.json", proposal)
    cfg = leg_cfg(num_envs=32)
    cfg.events |= friction_events(folder / "training.json", "robot")
    cfg.observations["critic"] = ObservationGroupCfg({"friction": ObservationTermCfg(func=friction_told)})
    env = made(cfg)
    limits = torch.tensor(list(LIMITS.values()))
    told, before = env.obs_buf["critic"].clone(), (env.sim.model.dof_frictionloss[:] / limits).clone()
    env.reset(env_ids=torch.tensor([3, 5]))
    after = env.sim.model.dof_frictionloss[:] / limits
    assert env.sim.model.dof_solimp[3, 1, 0] == pytest.approx(0.999)
    for _ in range(10):
        env.step(torch.full((32, 2), 0.4))
    # 0.4 rad of 20 N m/rad are 8 N m; the shank has from 4.5 to 10.8 N m of friction.
    moved = env.scene["robot"].data.joint_pos[:, 1] > 1e-3
    torch.testing.assert_close(moved, after[:, 1] * 45.0 < 8.0)
    assert moved.any() and not moved.all()
    return told, before, after


def test_all_joints_of_a_robot_get_the_same_share(tmp_path: Path) -> None:
    """Joints with different limits get the same share; robots differ, and a reset draws again."""
    told, before, after = drawn(tmp_path, "robot")
    torch.testing.assert_close(told, before)
    torch.testing.assert_close(before[:, 0], before[:, 1])
    assert before.min() >= 0.1 and before.max() <= 0.2401 and before[:, 0].unique().numel() == 32
    assert (before != after).any(dim=1).nonzero().ravel().tolist() == [3, 5]


def test_each_joint_gets_its_own_where_that_is_proposed(tmp_path: Path) -> None:
    """Friction per joint."""
    _, before, _ = drawn(tmp_path, "joint")
    assert (before[:, 0] - before[:, 1]).abs().max() > 0.05


@pytest.mark.filterwarnings("ignore:sim.mujoco")
def test_a_ratio_of_rest_and_motion_is_drawn_too(tmp_path: Path) -> None:
    """10 to 12 % at rest over 1.25 to 2 are 5 to 9.6 % in motion; at rest alone they stay 10 to 12 %."""
    friction = TRAINING["friction"] | {"law": "stribeck", "static_ratio": [1.25, 2.0], "stribeck_velocity": [0.1, 0.2]}
    write_training(tmp_path / "training.json", TRAINING | {"friction": friction, "range": [0.1, 0.12]})
    limits, seen = torch.tensor(list(LIMITS.values())), {}
    for which, told in (("moving", "that in motion is drawn"), ("static", "that at rest is drawn")):
        cfg = leg_cfg(num_envs=64)
        with pytest.warns(UserWarning, match=f"^training.json has more friction at rest than in motion, .*{told}"):
            cfg.events |= friction_events(tmp_path / "training.json", friction=which)
        env = made(cfg)
        shares = env.sim.model.dof_frictionloss[:] / limits
        torch.testing.assert_close(shares[:, 0], shares[:, 1])
        seen[which] = (float(shares.min()), float(shares.max()))
        (row,) = audit_draws(env, resets=1)
        assert row.ok
    assert row.declared == (0.1, 0.12)
    assert 0.05 <= seen["moving"][0] < 0.055 and 0.09 < seen["moving"][1] <= 0.096
    assert 0.1 <= seen["static"][0] < seen["static"][1] <= 0.1201


def test_a_proposal_without_friction_is_refused(tmp_path: Path) -> None:
    """Rejects a range of zero, which erases the joints' friction."""
    write_training(tmp_path / "training.json", {"friction": {"method": "none", "level": 0.0}, "range": [0.0, 0.0]})
    with pytest.raises(StictionError, match=r"method none proposes no friction to draw"):
        friction_events(tmp_path / "training.json")


def test_a_joint_without_a_torque_limit_is_refused(tmp_path: Path) -> None:
    """Friction is drawn as a share of it."""
    write_training(tmp_path / "training.json", TRAINING)
    cfg = leg_cfg()
    cfg.events |= friction_events(tmp_path / "training.json")
    cfg.scene.entities["robot"].articulation.actuators[1].effort_limit = None
    with pytest.raises(StictionError, match=r"joint 'shank_joint': got no torque limit, .*; set effort_limit"):
        made(cfg)
