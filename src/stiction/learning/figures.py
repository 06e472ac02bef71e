"""The figures of one iteration of training: means over a rollout, errors of adaptation and estimator, friction."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from statistics import mean
from typing import Any

import torch
from tensordict import TensorDict

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


LAST_EPISODES = 100
"""Finished episodes over which return and length are averaged, as in rsl_rl's `utils.logger.Logger`."""


class EpisodeMeans:
    """Mean return and length of the last finished episodes, under rsl_rl's names: curves overlay with its trainers'.

    An episode counts from its first step in this training: robots that begin at random ages have a shorter first one.
    """

    def __init__(self, num_envs: int, device: str) -> None:
        """Begin without a finished episode."""
        self._return = torch.zeros(num_envs, device=device)
        self._length = torch.zeros(num_envs, device=device)
        self._returns: deque[float] = deque(maxlen=LAST_EPISODES)
        self._lengths: deque[float] = deque(maxlen=LAST_EPISODES)

    def add(self, reward: torch.Tensor, dones: torch.Tensor) -> None:
        """Take one step: reward and end of the episode of every robot, both (N,)."""
        self._return += reward
        self._length += 1
        ended = dones.nonzero().flatten()
        self._returns.extend(self._return[ended].tolist())
        self._lengths.extend(self._length[ended].tolist())
        self._return[ended] = 0.0
        self._length[ended] = 0.0

    def means(self) -> dict[str, float]:
        """Return the mean sum of rewards and the mean length in control steps; empty before an episode has ended."""
        if not self._returns:
            return {}
        return {"Train/mean_reward": mean(self._returns), "Train/mean_episode_length": mean(self._lengths)}

    def state(self) -> dict[str, Any]:
        """Return the state, for a checkpoint."""
        running = {"return": self._return, "length": self._length}
        return running | {"returns": list(self._returns), "lengths": list(self._lengths)}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Continue from a checkpoint's state. Raises `ValueError` where it is of other shapes."""
        running, ended = (state["return"], state["length"]), (state["returns"], state["lengths"])
        if any(value.shape != self._return.shape for value in running) or len(ended[0]) != len(ended[1]):
            raise ValueError("sums over episodes are not one per robot")
        self._return, self._length = (value.to(self._return) for value in running)
        self._returns, self._lengths = (deque(map(float, values), LAST_EPISODES) for values in ended)


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
