"""Rewards of the report: tracking that pays nothing for standing (kernels of width 0.006 in place of 0.1 and 0.25), and
the paper's two gait rewards as printed, whatever is commanded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

    from stiction.task.rewards import Snapshot

WIDTH = 0.006
"""Width of both kernels [m²/s², rad²/s²]: standing at a command of 0.5 m/s pays 1e-18, an error of 0.05 m/s 66 %."""


def sharp_linear(s: Snapshot) -> torch.Tensor:
    """Return exp(-|v_xy - v*_xy|² / 0.006), shape (N,)."""
    return (-(s.command[:, :2] - s.linear_velocity[:, :2]).square().sum(-1) / WIDTH).exp()


def sharp_angular(s: Snapshot) -> torch.Tensor:
    """Return exp(-(ω_z - ω*_z)² / 0.006), shape (N,)."""
    return (-(s.command[:, 2] - s.angular_velocity[:, 2]).square() / WIDTH).exp()


def printed_trot(s: Snapshot) -> torch.Tensor:
    """Return r_trot, also while standing is commanded, shape (N,)."""
    return s.one_group.float()


def printed_unsync(s: Snapshot) -> torch.Tensor:
    """Return r_unsync as a share of its maximum, also while standing is commanded, shape (N,)."""
    return s.unsync
