"""Left-right symmetry in training: mirrored samples in every mini-batch of teacher and student, or symmetric networks.

A mirrored transition is one of the mirrored robot (`stiction.task.symmetry`): reward, return, advantage and old
log-probability are those of the original (Mittal et al., "Symmetry Considerations for Learning Task Symmetric Robot
Policies", ICRA 2024). The KL divergence is over the originals alone: while a policy is not symmetric, that to its own
mirror image would say nothing about the size of a step.

    batches  every sample, beside itself: twice the samples in every gradient step, twice its cost
    half     as many samples as without: PPO makes half as many passes of twice as many steps, each over half as many
             originals and their images; in the supervised losses a random half is replaced by its images
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from rsl_rl.extensions import Symmetry
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from stiction.learning.config import SymmetryName
from stiction.learning.equivariant import make_equivariant
from stiction.task.env import LocomotionEnv
from stiction.task.symmetry import task_mirror


class MirroredBatches(Symmetry):
    """rsl_rl's augmentation of PPO's mini-batches, and the same for supervised losses."""

    def __init__(self, env: LocomotionEnv, share: SymmetryName) -> None:
        """Find the mirror of a task; `share`: `batches` or `half`. Raises `StictionError` where it has none."""
        self.mirror, self.share = task_mirror(env).to(env.device), share
        self.observed = list(env.get_observations().keys())
        self.remembered: Callable[[TensorDict], dict[str, torch.Tensor]] = lambda obs: {}
        self.targets: Mapping[str, str | None] = {}
        super().__init__(env, self.with_images, use_data_augmentation=True)

    def with_images(
        self, env: LocomotionEnv, obs: TensorDict, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor]:
        """Return samples followed by their images, as rsl_rl wants them.

        What the algorithm stored beside the observations is of the original; `remembered` computes that of the image,
        from its observations and the draws of the original.
        """
        image = obs.clone(recurse=False).update(self.mirror(obs.select(*self.observed)))
        image.update(self.remembered(image))
        return torch.cat([obs, image]), torch.cat([actions, self.mirror.action(actions)])

    def compute_loss(self, actor: MLPModel, batch: RolloutStorage.Batch, original_batch_size: int) -> torch.Tensor:
        """Return how far the policy is from symmetric, MSE(π(M o), M π(o)), for the log.

        rsl_rl would run the actor again for it; the mini-batch that the actor has just seen holds both.
        """
        with torch.no_grad():
            # `with_images` puts the images behind the originals.
            mean, image = actor.output_mean.split(original_batch_size)
            return torch.nn.functional.mse_loss(image, self.mirror.action(mean))

    def supervised(self, observations: TensorDict, actions: torch.Tensor | None = None) -> tuple[TensorDict, Any]:
        """Return a shuffled mini-batch with its images, or with the images of its first half in place of that half.

        `actions`: labels of the samples, if there are any. Of what is stored beside the observations, `targets` are
        mirrored too, and the rest is left out.
        """
        size = len(observations)
        images, first_plain = (size // 2, size // 2) if self.share == "half" else (size, 0)
        seen = observations.select(*self.observed, *self.targets)
        image = self.mirror(seen[:images].select(*self.observed))
        for name, rule in self.targets.items():
            value = seen[name][:images]
            image[name] = value if rule is None else self.mirror.group(rule)(value)
        mixed = torch.cat([image, seen[first_plain:]])
        if actions is None:
            return mixed, None
        return mixed, torch.cat([self.mirror.action(actions[:images]), actions[first_plain:]])


def make_symmetric(algorithm: Any, symmetry: SymmetryName, env: LocomotionEnv) -> None:
    """Give an algorithm its mirrored samples or its symmetric networks.

    Raises `StictionError` where robot or task has no mirror image.
    """
    algorithm.symmetry = MirroredBatches(env, symmetry) if symmetry in ("batches", "half") else None
    if symmetry == "network":
        mirror = task_mirror(env)
        for name in ("actor", "critic", "student", "teacher"):
            if hasattr(algorithm, name):
                make_equivariant(getattr(algorithm, name), mirror)
