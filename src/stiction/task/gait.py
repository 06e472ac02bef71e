"""Which feet stand together: the quantities of the paper's two gait rewards, of the contacts of N robots."""

from __future__ import annotations

import torch

from stiction.sim.chosen import put

UNSYNC_HORIZON = 100
"""H of r_unsync in control steps (2 s at 50 Hz)."""


def exactly_one_group(contact: torch.Tensor, group: torch.Tensor) -> torch.Tensor:
    """Return r_trot: whether the feet in contact are exactly one of the two groups, shape (N,), bool.

    `contact`: (N, legs) bool; `group`: (legs,) 0 or 1. Literal set equality: any overlap of the groups pays nothing.
    """
    first = group == 0
    return (contact == first).all(-1) | (contact == ~first).all(-1)


def group_imbalance(contact: torch.Tensor, group: torch.Tensor) -> torch.Tensor:
    """Return |C_0 ∩ C_t| - |C_1 ∩ C_t|, one step's summand of r_unsync, shape (N,). Arguments as above."""
    sign = 1.0 - 2.0 * group.to(torch.float32)
    return contact.to(torch.float32) @ sign


class UnsyncWindow:
    """Running sum of the imbalance over the last `horizon` steps: |sum| is r_unsync."""

    def __init__(
        self, num_envs: int, legs: int, horizon: int = UNSYNC_HORIZON, home: torch.device | None = None
    ) -> None:
        """Start with an empty window, at `home`."""
        self.window = torch.zeros(horizon, num_envs, device=home)
        self.cursor = 0
        self.largest = horizon * (legs / 2)

    def push(self, imbalance: torch.Tensor) -> torch.Tensor:
        """Add one step's imbalance, shape (N,); return r_unsync as a share of its largest value, shape (N,)."""
        self.window[self.cursor] = imbalance
        self.cursor = (self.cursor + 1) % len(self.window)
        return self.window.sum(0).abs() / self.largest

    def reset(self, which: torch.Tensor) -> None:
        """Forget the steps of the robots `which`, see `sim.chosen`."""
        put(self.window.T, which, 0.0)
