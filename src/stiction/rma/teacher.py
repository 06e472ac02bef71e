"""The teacher's algorithm: rsl_rl's PPO, then a supervised pass for adaptation and estimator."""

from __future__ import annotations

from itertools import chain
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from torch import nn

from stiction.rma.models import RMAActor
from stiction.rma.symmetry import MirroredBatches


class TeacherPPO(PPO):
    """PPO whose actor walks on z and z* in turn.

    The latent source changes only between an update and the next rollout: log-probabilities of a rollout are always
    recomputed with the source, and with the estimator, that produced it, so the ratio is 1 before the first gradient
    step.
    """

    actor: RMAActor
    symmetry: MirroredBatches | None
    """What mirrors samples, if anything does; the runner sets it."""

    def __init__(
        self,
        *args: Any,
        alternate: int = 4,
        adaptation_learning_rate: float = 1e-3,
        adaptation_batches: int = 4,
        **kwargs: Any,
    ) -> None:
        """Add the supervised losses to `PPO`; arguments as in `TeacherCfg`."""
        super().__init__(*args, **kwargs)
        self.alternate, self.adaptation_batches = alternate, adaptation_batches
        self.iteration = 0
        self.kl = 0.0
        policy = chain(self.actor.policy_parameters(), self.critic.parameters())
        self.optimizer = torch.optim.Adam(policy, lr=self.learning_rate)
        self.adaptation_optimizer = torch.optim.Adam(self.actor.supervised_parameters(), lr=adaptation_learning_rate)
        self._choose_latent()

    def _choose_latent(self) -> None:
        """Set where the next rollout's latent comes from: z* in the last of every `alternate` iterations."""
        from_history = self.alternate > 0 and self.iteration % self.alternate == self.alternate - 1
        self.actor.latent_source = "history" if from_history else "privileged"

    def update(self) -> dict[str, float]:
        """Update the policy, then adaptation and estimator, then choose the next latent source."""
        losses = super().update()
        self.kl = self._divergence()
        losses |= self._supervise()
        self.iteration += 1
        self._choose_latent()
        return losses

    def _divergence(self) -> float:
        """Return KL(policy that walked || policy after the update), mean over the robots' last step.

        Nothing is sampled. Like `_supervise`, it reads the rollout that `PPO.update` has left in the storage.
        """
        storage, distribution = self.storage, self.actor.distribution
        with torch.no_grad():
            mean = self.actor(storage.observations[-1])
            std = distribution.std_param.clamp(*distribution.std_range).expand_as(mean)
            before = tuple(parameter[-1] for parameter in storage.distribution_params)
            return float(distribution.kl_divergence(before, (mean, std)).mean())

    def _supervise(self) -> dict[str, float]:
        """Take one pass of L_ada, L_est and, where there is terrain, L_hist over the rollout just used.

        `PPO.update` has rewound the storage's cursor; its contents stay until the next rollout overwrites them.
        """
        observations = self.storage.observations.flatten(0, 1)
        total: dict[str, float] = {}
        for ids in torch.randperm(observations.batch_size[0], device=self.device).chunk(self.adaptation_batches):
            batch = observations[ids]
            if self.symmetry is not None:
                batch, _ = self.symmetry.supervised(batch)
            losses = self.actor.supervised_losses(batch)
            self.adaptation_optimizer.zero_grad()
            sum(losses.values(), torch.zeros(())).backward()
            nn.utils.clip_grad_norm_(self.actor.supervised_parameters(), self.max_grad_norm)
            self.adaptation_optimizer.step()
            for name, value in losses.items():
                total[name] = total.get(name, 0.0) + value.item() / self.adaptation_batches
        # PPO clips the gradient norm of the whole actor and clears only what it trains: leave nothing behind for it.
        self.adaptation_optimizer.zero_grad()
        return total

    def save(self) -> dict:
        """Return every network, optimizer and counter."""
        return super().save() | {
            "adaptation_optimizer_state_dict": self.adaptation_optimizer.state_dict(),
            "algorithm_iteration": self.iteration,
        }

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore what `save` returned, the latent source included."""
        result = super().load(loaded_dict, load_cfg, strict)
        self.adaptation_optimizer.load_state_dict(loaded_dict["adaptation_optimizer_state_dict"])
        self.iteration = loaded_dict["algorithm_iteration"]
        self._choose_latent()
        return result
