"""Velocity commands: drawn uniformly, small ones rounded to standing, a share of them standing."""

from __future__ import annotations

import torch

from stiction.locomotion.config import CommandCfg


class CommandSampler:
    """The command of every robot: vx, vy [m/s] and yaw rate [rad/s] in the base frame."""

    def __init__(self, cfg: CommandCfg, num_envs: int) -> None:
        """Start with every robot commanded to stand."""
        self.cfg = cfg
        self.value = torch.zeros(num_envs, 3)

    @property
    def moving(self) -> torch.Tensor:
        """Whether each robot is asked to move, (N,) bool."""
        return self.value.norm(dim=-1) > self.cfg.moving_above

    def override(self, mask: torch.Tensor, value: torch.Tensor) -> None:
        """Command `value`, (N, 3), to the robots in `mask`, (N,) bool. The tensor is replaced."""
        self.value = torch.where(mask[:, None], value, self.value)

    def draw(self, ids: torch.Tensor, generator: torch.Generator) -> None:
        """Draw new commands for the robots `ids`. The tensor is replaced: observations keep the old one."""
        if not len(ids):
            return
        spans = torch.tensor([self.cfg.forward, self.cfg.sideways, self.cfg.turn])
        new = spans[:, 0] + (spans[:, 1] - spans[:, 0]) * torch.rand(len(ids), 3, generator=generator)
        standing = torch.rand(len(ids), 1, generator=generator) < self.cfg.standing_share
        small = new.norm(dim=-1, keepdim=True) <= self.cfg.moving_above
        value = self.value.clone()
        value[ids] = torch.where(standing | small, 0.0, new)
        self.value = value
