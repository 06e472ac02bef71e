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

import numpy as np
import torch
from rsl_rl.extensions import Symmetry
from rsl_rl.models import MLPModel
from rsl_rl.modules import Distribution
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from stiction.core.errors import ConfigurationError
from stiction.learning.config import SymmetryName
from stiction.learning.models import HistoryEncoder, NoLatent, RMAActor, RMACritic
from stiction.task.env import LocomotionEnv
from stiction.task.symmetry import Rows, TaskMirror, VectorMirror, task_mirror


class EquivariantLinear(nn.Linear):
    """A linear layer averaged with its mirror image."""

    def __init__(self, layer: nn.Linear, into: Rows, out: Rows) -> None:
        """Take over a layer's parameters; `into`, `out`: the mirror of its inputs and outputs."""
        # On `meta`, where drawing first weights that are thrown away does not move torch's random numbers on.
        super().__init__(layer.in_features, layer.out_features, device="meta")
        self.weight, self.bias = layer.weight, layer.bias
        self.into, self.out = VectorMirror(into), VectorMirror(out)
        # Only now, for a parameter on `meta` has nothing that could be moved.
        self.to(layer.weight.device)
        with torch.no_grad():
            # The average of two independent weights has half their variance: restore it.
            self.weight.mul_(2**0.5)

    def averaged(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the averaged weight, shape (outputs, inputs), and bias, shape (outputs,)."""
        into, out = self.into, self.out
        # M_out takes row i from row index_i, times factor_i. M_in is its own inverse: it takes columns in the same way.
        image = self.weight.index_select(0, out.index).index_select(1, into.index)
        image = image * (out.factor[:, None] * into.factor[into.index])
        bias = self.bias if into.shift is None else self.bias + self.weight @ into.shift
        return 0.5 * (self.weight + image), 0.5 * (self.bias + bias.index_select(0, out.index) * out.factor)

    def forward(self, value: torch.Tensor) -> torch.Tensor:
        """Map (..., inputs) to (..., outputs)."""
        return nn.functional.linear(value, *self.averaged())


def make_equivariant(model: RMAActor | RMACritic, mirror: TaskMirror) -> None:
    """Make a network symmetric, in place. Raises `StictionError` for odd sizes, and layers without a rule here."""
    rows = mirror.rows
    if isinstance(model, RMAActor):
        _actor(model, rows)
    else:
        equivariant_mlp(model.mlp, Rows.joined([rows[name] for name in model.seen]), Rows.signed(np.ones(1)))
    for name, layer in model.named_modules():
        # A layer that was overlooked above would break the symmetry without a word.
        trained = any(True for _ in layer.parameters(recurse=False))
        if trained and not isinstance(layer, EquivariantLinear | Distribution):
            raise ConfigurationError(
                f"{type(model).__name__}: the layer {name!r} has no rule for --symmetry network; use batches or half"
            )


def make_dense(model: nn.Module) -> None:
    """Replace equivariant layers by ordinary ones with the averaged weights, in place: not to be trained."""
    for module in list(model.modules()):
        for name, layer in list(module.named_children()):
            if isinstance(layer, EquivariantLinear):
                # A new layer: `layer.weight` is the parameter of before the average, and may be shared with an
                # optimizer.
                dense = nn.Linear(layer.in_features, layer.out_features, device=layer.weight.device)
                with torch.no_grad():
                    for parameter, value in zip((dense.weight, dense.bias), layer.averaged(), strict=True):
                        parameter.copy_(value)
                setattr(module, name, dense)


def halves(size: int) -> Rows:
    """Return the mirror of `size` units in two halves, which are exchanged. Raises `StictionError` for odd sizes."""
    if size % 2:
        raise ConfigurationError(
            f"a layer of {size} units has no left and right half; --symmetry network needs even sizes"
        )
    return Rows.exchanged(np.roll(np.arange(size), size // 2))


def _adaptation(actor: RMAActor, rows: dict[str, Rows]) -> Rows:
    """Make encoders, estimator and adaptation symmetric; return the mirror of the actor's input."""
    equivariant_encoder(actor.estimator, rows, rows["explicit"])
    inputs = [rows["proprioception"], rows["explicit"]]
    if not isinstance(actor.adaptation, NoLatent):
        latent = halves(_last(actor.privileged_encoder).out_features)
        equivariant_mlp(actor.privileged_encoder, rows["privileged"], latent)
        equivariant_encoder(actor.adaptation, rows, latent)
        inputs.append(latent)
    if actor.sees_terrain:
        ground = halves(_last(actor.terrain_encoder[0]).out_features)
        equivariant_mlp(actor.terrain_encoder[0], rows["elevation"], ground)
        equivariant_encoder(actor.terrain_history[0], rows, ground)
        inputs.append(ground)
    return Rows.joined(inputs)


def _actor(actor: RMAActor, rows: dict[str, Rows]) -> None:
    """Make an actor symmetric, with the networks beside the policy's own."""
    inputs = actor.make_inputs_equivariant(rows)
    equivariant_mlp(actor.mlp, _adaptation(actor, rows) if inputs is None else inputs, rows["action"])
    exchanged = torch.as_tensor(rows["action"].index)
    std = actor.distribution.std_param
    # Left and right begin equal, and equal steps keep them so.
    std.register_hook(lambda gradient: 0.5 * (gradient + gradient[exchanged.to(gradient.device)]))


def equivariant_encoder(encoder: nn.Module, rows: dict[str, Rows], out: Rows) -> None:
    """Make an encoder of the history symmetric: every frame is mirrored for itself."""
    assert isinstance(encoder, HistoryEncoder)
    assert encoder.memory is None  # `TrainCfg` refuses it
    width = _last(encoder.embed).out_features
    frames = _first(encoder.mlp).in_features // width
    equivariant_mlp(encoder.embed, rows["proprioception"], halves(width))
    equivariant_mlp(encoder.mlp, Rows.joined([halves(width)] * frames), out)


def equivariant_mlp(mlp: nn.Module, into: Rows, out: Rows) -> None:
    """Make a chain of linear layers and activations symmetric."""
    layers = {name: layer for name, layer in mlp.named_children() if isinstance(layer, nn.Linear)}
    last = _last(mlp)
    for name, layer in layers.items():
        result = out if layer is last else halves(layer.out_features)
        setattr(mlp, name, EquivariantLinear(layer, into, result))
        into = result


def _first(mlp: nn.Module) -> nn.Linear:
    """Return the first linear layer of a chain."""
    return next(layer for layer in mlp.children() if isinstance(layer, nn.Linear))


def _last(mlp: nn.Module) -> nn.Linear:
    """Return the last linear layer of a chain."""
    return [layer for layer in mlp.children() if isinstance(layer, nn.Linear)][-1]


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
        """Return samples followed by their images; `remembered` computes what was stored beside observations."""
        image = obs.clone(recurse=False).update(self.mirror(obs.select(*self.observed)))
        image.update(self.remembered(image))
        return torch.cat([obs, image]), torch.cat([actions, self.mirror.action(actions)])

    def compute_loss(self, actor: MLPModel, batch: RolloutStorage.Batch, original_batch_size: int) -> torch.Tensor:
        """Return how far the policy is from symmetric, MSE(π(M o), M π(o)), from the batch that it has just seen."""
        with torch.no_grad():
            # `with_images` puts the images behind the originals.
            mean, image = actor.output_mean.split(original_batch_size)
            return torch.nn.functional.mse_loss(image, self.mirror.action(mean))

    def supervised(self, observations: TensorDict, actions: torch.Tensor | None = None) -> tuple[TensorDict, Any]:
        """Return a shuffled mini-batch with its images, or with the images of its first half in place of that half.

        `actions`: labels, if any. Of what is stored beside the observations, `targets` are mirrored, the rest is left
        out.
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
    """Give an algorithm mirrored samples or symmetric networks. Raises `StictionError` where there is no mirror."""
    algorithm.symmetry = MirroredBatches(env, symmetry) if symmetry in ("batches", "half") else None
    if symmetry == "network":
        mirror = task_mirror(env)
        for name in ("actor", "critic", "student", "teacher"):
            if hasattr(algorithm, name):
                make_equivariant(getattr(algorithm, name), mirror)
