"""The figures of one iteration of training: means over a rollout, errors of adaptation and estimator, friction."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from tensordict import TensorDict
from torch.utils.tensorboard import SummaryWriter

from stiction.learning.models import VELOCITY, RMAActor
from stiction.task.env import LocomotionEnv
from stiction.task.randomization import FRICTION_UNIT


class RolloutFigures:
    """Collects what a rollout logs, step by step, whatever the names are, and the lengths of its episodes."""

    def __init__(self, control_period: float) -> None:
        """Start empty. `control_period` [s] turns steps into seconds."""
        self.control_period = control_period
        self._sums: dict[str, torch.Tensor] = {}
        self._counts: dict[str, int] = {}
        self._length = torch.zeros((), dtype=torch.long)
        self._ended = torch.zeros((), dtype=torch.long)

    def add(self, values: Mapping[str, torch.Tensor | float]) -> None:
        """Take the scalars of one step; a name may be missing in some steps."""
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, torch.zeros(())) + value
            self._counts[name] = self._counts.get(name, 0) + 1

    def end(self, age: torch.Tensor, dones: torch.Tensor) -> None:
        """Count the episodes that ended in a step. `age`: steps before it, (N,); `dones`: (N,)."""
        self._length = self._length + ((age + 1) * dones).sum()
        self._ended = self._ended + dones.sum()

    def means(self) -> dict[str, float]:
        """Return means over the steps that had each name.

        `episode/length` [s] of episodes that ended, where any did.
        """
        figures = {name: float(total) / self._counts[name] for name, total in self._sums.items()}
        if "walk/blown_up" in figures:
            # A count over the whole rollout, not a mean over its steps.
            figures["walk/blown_up"] *= self._counts["walk/blown_up"]
        if self._ended:
            figures["episode/length"] = float(self._length) / float(self._ended) * self.control_period
        return figures


def adaptation_figures(actor: RMAActor, obs: TensorDict, feet: int) -> dict[str, float]:
    """Return how well the history predicts privileged quantities, over one step of all robots with `feet` feet.

    `latent/explained`: 1 - MSE(z, z*) / Var(z), where z varies and PPO does not train z*; `estimator/velocity_error`
    [m/s], `contact_error`: share of feet, `friction_error` [fraction of the torque limit], of those that are estimated.
    """
    figures = {}
    with torch.no_grad():
        z, star = actor.latents(obs)
        variance = float(z.var(0, correction=0).sum()) if z.numel() else 0.0
        if variance > 0 and not actor.adapts:
            figures["latent/explained"] = 1.0 - float((z - star).square().mean(0).sum()) / variance
        guess = actor.estimator(obs["history"])
        # Some estimators guess the velocity alone.
        truth = obs["explicit"][:, : guess.shape[-1]]
        figures["estimator/velocity_error"] = float((guess - truth)[:, :VELOCITY].norm(dim=-1).mean())
        contact, friction = slice(VELOCITY, VELOCITY + feet), slice(VELOCITY + feet, None)
        if truth[:, contact].numel():
            wrong = (guess[:, contact] > 0.5) != (truth[:, contact] > 0.5)
            figures["estimator/contact_error"] = float(wrong.float().mean())
        if truth[:, friction].numel():
            error = FRICTION_UNIT * (guess - truth)[:, friction].abs()
            figures["estimator/friction_error"] = float(error.mean())
    return figures


def friction_figures(env: LocomotionEnv) -> dict[str, float]:
    """Return stage, range and drawn mean of the friction, multipliers of the nominal one [-]."""
    low, high = env.cfg.friction.schedule[env.stage].range
    mean = float(env.randomizer.draws.friction.mean())
    return {"friction/stage": float(env.stage), "friction/low": low, "friction/high": high, "friction/mean": mean}


class Board:
    """Writes into one folder, which TensorBoard shows as one run; figures without a group go under `training`."""

    def __init__(self, folder: Path) -> None:
        """Name the folder; a file is begun with the first figures."""
        self.folder = folder
        self._writer: SummaryWriter | None = None

    def add(self, iteration: int, figures: Mapping[str, float]) -> None:
        """Write one iteration. The first one makes TensorBoard drop its values from this iteration on."""
        if self._writer is None:
            self._writer = SummaryWriter(str(self.folder), purge_step=iteration)
        for name, value in figures.items():
            self._writer.add_scalar(name if "/" in name else f"training/{name}", value, iteration)

    def flush(self) -> None:
        """Bring everything to the disk: what comes before a checkpoint must not be lost with a killed run."""
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """End the file."""
        if self._writer is not None:
            self._writer.close()
