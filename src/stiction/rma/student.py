"""The student's algorithm: it walks, the teacher labels, and L_clone + w (L_ada + L_hist) + w' L_est is descended."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.algorithms import Distillation
from torch import nn

from stiction.rma.models import RMAActor
from stiction.rma.symmetry import MirroredBatches


class StudentDistillation(Distillation):
    """rsl_rl's distillation with the student's warm start and the paper's further losses, on terrain with L_hist.

    The student begins as a copy of the teacher that takes its latents from the history: estimator, adaptation and
    terrain history are fine-tuned, not learned anew. Here the cloning loss reaches them too.
    """

    student: RMAActor
    teacher: RMAActor
    symmetry: MirroredBatches | None = None
    """What mirrors samples, if anything does; the runner sets it."""

    def __init__(
        self,
        *args: Any,
        num_mini_batches: int = 4,
        adaptation_weight: float = 0.1,
        estimator_weight: float = 0.5,
        **kwargs: Any,
    ) -> None:
        """Set the weights beside L_clone; arguments as in `StudentCfg`."""
        super().__init__(*args, **kwargs)
        self.num_mini_batches = num_mini_batches
        self.adaptation_weight, self.estimator_weight = adaptation_weight, estimator_weight
        self.student.latent_source, self.teacher.latent_source = "history", "privileged"
        self.student.end_to_end = self.student.blind = True

    def warm_start(self, actor_state: dict[str, torch.Tensor]) -> None:
        """Load the trained teacher's actor into teacher and student."""
        self.teacher.load_state_dict(actor_state)
        self.student.load_state_dict(actor_state)
        self.teacher_loaded = True

    def update(self) -> dict[str, float]:
        """Descend L_clone and the weighted supervised losses over the rollout; return their means."""
        observations = self.storage.observations.flatten(0, 1)
        labels = self.storage.privileged_actions.flatten(0, 1)
        total: dict[str, float] = {}
        updates = self.num_learning_epochs * self.num_mini_batches
        for _ in range(self.num_learning_epochs):
            for ids in torch.randperm(len(labels), device=self.device).chunk(self.num_mini_batches):
                batch, wanted = observations[ids], labels[ids]
                if self.symmetry is not None:
                    batch, wanted = self.symmetry.supervised(batch, wanted)
                losses = {"clone": self.loss_fn(self.student(batch), wanted)}
                losses |= self.student.supervised_losses(batch)
                loss = losses["clone"] + self.adaptation_weight * losses["adaptation"]
                loss = loss + self.estimator_weight * losses["estimator"]
                if "terrain" in losses:
                    loss = loss + self.adaptation_weight * losses["terrain"]
                self.optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(self.student.parameters(), self.max_grad_norm or 1.0)
                self.optimizer.step()
                for name, value in losses.items():
                    total[name] = total.get(name, 0.0) + value.item() / updates
        self.num_updates += 1
        self.storage.clear()
        return total
