"""Makes an update of the networks cheaper: mini-batches gathered once for all epochs, bit for bit, and a quicker ELU.

torch's ELU takes `expm1`; `exp` on the fast path (`core.gemm`) is many times faster. ELU(x) = max(x, exp(min(x, 0)) -
1) is off by 6e-8 at most.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from stiction.core.gemm import gemm_path


def take_rows(values: TensorDict, ids: torch.Tensor) -> TensorDict:
    """Return the rows `ids` of every group, (len(ids), ...), copied a row at a time."""
    return values.apply(lambda group: group.index_select(0, ids), batch_size=[len(ids)])


def gathered_batches(storage: RolloutStorage, batches: int, epochs: int = 8) -> Iterator[RolloutStorage.Batch]:
    """Yield what `RolloutStorage.mini_batch_generator` yields, `batches` an epoch, each in a container of its own."""
    size = storage.num_envs * storage.num_transitions_per_env // batches
    ids = torch.randperm(batches * size, device=storage.device)
    observations = storage.observations.flatten(0, 1)
    stored = (storage.actions, storage.values, storage.advantages, storage.returns, storage.actions_log_prob)
    distribution = storage.distribution_params or ()
    gathered: list[tuple[TensorDict, list[torch.Tensor]]] = []
    for epoch in range(epochs):
        for number in range(batches):
            if not epoch:
                rows = ids[number * size : (number + 1) * size]
                tensors = [tensor.flatten(0, 1).index_select(0, rows) for tensor in (*stored, *distribution)]
                gathered.append((take_rows(observations, rows), tensors))
            seen, (actions, values, advantages, returns, log_prob, *parameters) = gathered[number]
            yield RolloutStorage.Batch(seen, actions, values, advantages, returns, log_prob, tuple(parameters))


class QuickELU(nn.Module):
    """ELU with `exp` in place of `expm1`."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return max(x, exp(min(x, 0)) - 1), any shape."""
        return _Elu.apply(x)


class _Elu(torch.autograd.Function):
    """The function with the gradient that torch has for ELU."""

    @staticmethod
    def forward(context: Any, x: torch.Tensor) -> torch.Tensor:
        """Compute the value in one buffer."""
        # The minimum comes before the exponential: of a large x that would be infinite, and its gradient no number.
        value = x.clamp(max=0.0).exp_().sub_(1.0)
        torch.maximum(x, value, out=value)
        context.save_for_backward(value)
        return value

    @staticmethod
    def backward(context: Any, *gradients: torch.Tensor) -> torch.Tensor:
        """Return the gradient from the value alone: 1 above zero, value + 1 below."""
        return torch.ops.aten.elu_backward(gradients[0], 1.0, 1.0, 1.0, True, context.saved_tensors[0])


def _replace_elu(module: nn.Module) -> None:
    """Put `QuickELU` in the place of every ELU of a network."""
    for name, child in module.named_children():
        if isinstance(child, nn.ELU) and child.alpha == 1.0:
            setattr(module, name, QuickELU())
        else:
            _replace_elu(child)


def quicken(algorithm: Any) -> None:
    """Give an algorithm of rsl_rl these mini-batches, and where the fast path is open its networks this ELU."""
    if isinstance(algorithm, PPO):
        algorithm.storage.mini_batch_generator = partial(gathered_batches, algorithm.storage)
    if gemm_path() == "fast":
        for network in vars(algorithm).values():
            if isinstance(network, nn.Module):
                _replace_elu(network)
