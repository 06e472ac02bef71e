"""A training run's teacher or student as a network over the deployed observation, its latent from a chosen source.

`TrainedPolicy` makes a `Driver` of it, so that a teacher is evaluated by the same code as a bundle. What only training
knows, o_priv, is known in an evaluation too: it sets the robots itself, and o_priv is a constant of each.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import torch
from torch import nn

from stiction.formats.errors import StictionError
from stiction.rma.models import RMAActor, StudentPolicy

Who = Literal["teacher", "student"]
"""Which of a run's two policies: the teacher walks on z = f_ada_tea(o_priv), the student on z* = f_ada_stu(o_H)."""


class LatentPolicy(nn.Module):
    """The mean action of an actor: observations (N, size), flattened histories, to actions (N, joints)."""

    def __init__(
        self,
        actor: RMAActor,
        privileged: torch.Tensor | None = None,
        lenders: torch.Tensor | None = None,
        frozen: torch.Tensor | None = None,
        watch: Callable[[torch.Tensor], None] = lambda latent: None,
    ) -> None:
        """Choose where the latent comes from.

        Args:
            actor: teacher or student.
            privileged: o_priv of each robot, (N, size): the latent is z. None: it is z*, from the history.
            lenders: number of the robot whose latent each robot is given, (N,); None: its own.
            frozen: one latent for all robots and all time, (latent,), in place of z or z*.
            watch: called with z or z* of every robot at every step, (N, latent), before they are lent or frozen.

        """
        super().__init__()
        self.policy, self.lenders, self.frozen, self.watch = StudentPolicy(actor), lenders, frozen, watch
        self.constant = None if privileged is None else actor.privileged_encoder(privileged).detach()

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the mean actions, (N, joints)."""
        latent = self.policy.adaptation(observation) if self.constant is None else self.constant
        if len(latent) != len(observation):
            raise StictionError(f"o_priv of {len(latent)} robots for {len(observation)} observations; expected as many")
        self.watch(latent)
        if self.frozen is not None:
            latent = self.frozen.expand_as(latent)
        elif self.lenders is not None:
            latent = latent[self.lenders]
        return self.policy.act(observation, latent)
