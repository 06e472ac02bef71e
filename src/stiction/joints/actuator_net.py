"""Fits an Actuator Net: a multilayer perceptron on windows of a joint's past, by mean squared error. Needs torch.

L_actuator = MSE(τ^motor, τ^motor*) of the paper, here of torque over the joint's limit: in newton metres the strongest
motor would count most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch

from stiction.formats.actuator import Layers
from stiction.joints.actuator import ActuatorCfg, seen

STD_FLOOR = 1e-6
"""An input that deviates by less in the training runs never changes there, tells nothing, and is left out: divided by
next to nothing, its first change in use would swamp the net."""


@dataclass(frozen=True)
class Fit:
    """What was fitted to one group of joints."""

    layers: Layers
    """Weights for inputs in SI units; see `ActuatorNet.layers`."""
    training: tuple[float, ...]
    """Mean squared error of torque over limit on the training samples, while it was fitted, one entry an epoch [-]."""
    validation: tuple[float, ...]
    """... on the validation samples after each epoch [-]. The last weights are kept, not the best: a choice by this
    number would make it too good."""


def fit_net(
    training: tuple[np.ndarray, np.ndarray],
    validation: tuple[np.ndarray, np.ndarray],
    cfg: ActuatorCfg,
    seed: int,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit one net.

    Args:
        training: inputs, shape (M, 2 (H + 1)), in the order of `windows`, and torques over their limits, shape (M,).
        validation: the same of the runs that were kept out.
        cfg: sizes and schedule.
        seed: of weights and order; torch's own generator is left alone.
        progress: called with the share of the epochs that is done.

    """
    inputs, torque = (torch.from_numpy(np.ascontiguousarray(part, np.float32)) for part in training)
    unseen, expected = (torch.from_numpy(np.ascontiguousarray(part, np.float32)) for part in validation)
    mean, deviation = inputs.mean(0), inputs.std(0).numpy()
    used = seen(cfg.inputs, cfg.history) & (deviation > STD_FLOOR)
    scale = np.where(used, 1.0 / np.maximum(deviation, STD_FLOOR), 0.0)
    factor = torch.from_numpy(scale.astype(np.float32))
    inputs, unseen = (inputs - mean) * factor, (unseen - mean) * factor
    generator = torch.Generator().manual_seed(seed)
    parameters = _start((inputs.shape[1], *cfg.hidden, 1), generator)
    optimizer = torch.optim.Adam(parameters, lr=cfg.learning_rate)
    batches = -(-len(inputs) // cfg.batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, cfg.epochs * batches)
    history: tuple[list[float], list[float]] = ([], [])
    for epoch in range(cfg.epochs):
        total = 0.0
        for rows in torch.randperm(len(inputs), generator=generator).split(cfg.batch):
            loss = torch.nn.functional.mse_loss(_forward(parameters, inputs[rows]), torque[rows])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach()) * len(rows)
        with torch.no_grad():
            error = torch.nn.functional.mse_loss(_forward(parameters, unseen), expected)
        history[0].append(total / len(inputs))
        history[1].append(float(error))
        progress((epoch + 1) / cfg.epochs)
    return Fit(_in_si(parameters, mean.numpy(), scale), tuple(history[0]), tuple(history[1]))


def _start(widths: tuple[int, ...], generator: torch.Generator) -> list[torch.Tensor]:
    """Return weights and biases in turn, uniform in ±1/sqrt(inputs)."""
    parameters = []
    for width, outputs in pairwise(widths):
        for shape in ((outputs, width), (outputs,)):
            value = (2 * torch.rand(shape, generator=generator) - 1) / width**0.5
            parameters.append(value.requires_grad_())
    return parameters


def _forward(parameters: list[torch.Tensor], inputs: torch.Tensor) -> torch.Tensor:
    """Return the outputs, shape (rows,), for inputs (rows, width)."""
    x = inputs
    for index in range(0, len(parameters), 2):
        x = torch.nn.functional.linear(x, parameters[index], parameters[index + 1])
        if index + 2 < len(parameters):
            x = torch.nn.functional.softsign(x)
    return x[:, 0]


def _in_si(parameters: list[torch.Tensor], mean: np.ndarray, scale: np.ndarray) -> Layers:
    """Return the layers with the inputs' centring and scaling moved into the first of them."""
    arrays = [parameter.detach().double().numpy() for parameter in parameters]
    arrays[0] = arrays[0] * scale
    arrays[1] = arrays[1] - arrays[0] @ mean.astype(float)
    single = [array.astype(np.float32) for array in arrays]
    return tuple(zip(single[::2], single[1::2], strict=True))
