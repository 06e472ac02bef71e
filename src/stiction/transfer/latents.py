"""What the actor is given in place of its own latent: the ablations that show what a latent is used for.

Robots are in the evaluation's order: by friction level, then by command, then by episode. Whoever lends its latent has
the same command; it lends at the same time step.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import torch

from stiction.formats.errors import StictionError

Latent = Literal["own", "mean", "swapped", "peer"]
"""Where the latent comes from: the robot's own; frozen at its mean over robots and time; that of a robot with another
friction level; that of another robot with the same level. The last is the control of the one before: it too breaks the
tie to the robot's own gait and noise, but the friction it tells is right."""

LATENTS: tuple[Latent, ...] = get_args(Latent)


def lenders(latent: Latent, levels: int, commands: int, episodes: int) -> np.ndarray:
    """Return whose latent each robot is given, shape (levels * commands * episodes,): a permutation.

    `swapped` moves on by half of the levels, in the same command and episode; `peer` by one episode, at the same level
    and command. Both leave no robot its own.

    Raises:
        StictionError: too few levels or episodes for that.

    """
    own = np.arange(levels * commands * episodes).reshape(levels, commands, episodes)
    if latent == "swapped" and levels < 2:
        raise StictionError("swapped latents need robots of two friction levels or more; name another level")
    if latent == "peer" and episodes < 2:
        raise StictionError("latents of peers need two episodes or more per level and command")
    if latent == "swapped":
        own = np.roll(own, -(levels // 2), axis=0)
    elif latent == "peer":
        own = np.roll(own, -1, axis=2)
    return own.ravel()


class LatentMean:
    """The mean of latents over robots and time, in float64: a thousand robots for a minute are millions of numbers."""

    def __init__(self, skip: int = 0) -> None:
        """Start with nothing seen; the first `skip` steps will not count."""
        self.skip, self.count, self.total = skip, 0, torch.zeros((), dtype=torch.float64)

    def __call__(self, latent: torch.Tensor) -> None:
        """Count the latents of one step, (N, latent)."""
        if self.skip > 0:
            self.skip -= 1
            return
        self.total = self.total + latent.double().sum(0)
        self.count += len(latent)

    @property
    def value(self) -> torch.Tensor:
        """The mean, shape (latent,), float32."""
        return (self.total / self.count).float()
