"""Distillation of the student: it walks, the teacher labels; the loss is L_clone + w (L_ada + L_hist) + w' L_est."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.algorithms import Distillation
from tensordict import TensorDict
from torch import nn

from stiction.learning.config import StudentCfg
from stiction.learning.models import RMAActor
from stiction.learning.quick import take_rows
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.symmetry import MirroredBatches


class StudentDistillation(Distillation):
    """rsl_rl's distillation with the student's warm start and the paper's further losses, on terrain with L_hist.

    The student begins as a copy of the teacher that takes its latents from the history: estimator, adaptation and
    terrain history are fine-tuned, not learned anew. Here the cloning loss reaches them too.
    """

    student: RMAActor
    teacher: RMAActor
    symmetry: MirroredBatches | None = None
    """What mirrors samples, if anything does; `make_symmetric` sets it."""
    ranks: Ranks = ALONE
    """The processes that take the same steps; the runner sets them."""

    def __init__(self, *args: Any, settings: StudentCfg, velocity_weight: float = 1.0, **kwargs: Any) -> None:
        """Add the supervised losses to `Distillation`, whose other arguments are `args` and `kwargs`.

        `settings`: of the phase; `velocity_weight`: as in `TeacherCfg`.
        """
        super().__init__(*args, **kwargs)
        self.settings, self.velocity_weight = settings, velocity_weight
        self.noise_share = self._draw_noise(self.storage.num_envs)
        self.student.latent_source, self.teacher.latent_source = "history", "privileged"
        self.student.end_to_end = self.student.blind = True

    def _draw_noise(self, num: int) -> torch.Tensor:
        """Return the share of the exploration noise with which each robot walks, (num, 1)."""
        shares = {"all": torch.ones(num), "none": torch.zeros(num), "half": torch.arange(num) % 2.0}
        share = torch.rand(num) if self.settings.noise == "drawn" else shares[self.settings.noise]
        return share[:, None].to(self.device)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Let the student walk with each robot's share of the noise; store the teacher's actions."""
        noisy = super().act(obs)
        # Scaled after the draw: the stream of random numbers is the same for any share.
        mean = self.student.output_mean.detach()
        self.transition.actions = mean + self.noise_share * (noisy - mean)
        return self.transition.actions

    def warm_start(self, actor: dict[str, torch.Tensor], critic: dict[str, torch.Tensor]) -> None:
        """Load the trained teacher's actor into teacher and student; there is no critic here."""
        self.teacher.load_state_dict(actor)
        self.student.load_state_dict(actor)
        self.teacher_loaded = True

    def update(self) -> dict[str, float]:
        """Descend L_clone and the weighted supervised losses over the rollout; return their means."""
        observations, settings = self.storage.observations.flatten(0, 1), self.settings
        labels = self.storage.privileged_actions.flatten(0, 1)
        total: dict[str, float] = {}
        updates = settings.epochs * settings.mini_batches
        for _ in range(settings.epochs):
            for ids in torch.randperm(len(labels), device=self.device).chunk(settings.mini_batches):
                batch, wanted = take_rows(observations, ids), labels[ids]
                if self.symmetry is not None:
                    batch, wanted = self.symmetry.supervised(batch, wanted)
                losses = {"clone": self.loss_fn(self.student(batch), wanted)}
                losses |= self.student.supervised_losses(batch, self.velocity_weight)
                loss = losses["clone"] + settings.adaptation_weight * losses["adaptation"]
                loss = loss + settings.estimator_weight * losses["estimator"]
                if "terrain" in losses:
                    loss = loss + settings.adaptation_weight * losses["terrain"]
                self.optimizer.zero_grad()
                loss.backward()
                self.ranks.average(self.student.parameters())
                if self.max_grad_norm is not None:
                    nn.utils.clip_grad_norm_(self.student.parameters(), self.max_grad_norm)
                self.optimizer.step()
                for name, value in losses.items():
                    total[name] = total.get(name, 0.0) + value.item() / updates
        self.num_updates += 1
        self.storage.clear()
        return total
