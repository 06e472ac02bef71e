"""Why an episode ends. A new reason is a function here and a line in `TERMINATIONS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch

from stiction.task.rewards import Snapshot

LocomotionEnv = Any
"""A `task.env.LocomotionEnv`, whose module imports this one."""


@dataclass(frozen=True)
class Termination:
    """One reason."""

    ended: Callable[[LocomotionEnv, Snapshot], torch.Tensor]
    """Return which robots' episodes end for it, (N,) bool."""
    fails: bool
    """True: the robot failed, and nothing is worth having after it. False: time ran out, and the value of what would
    come next counts."""


def fallen(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """The trunk touches the ground, or leans too far."""
    return snapshot.fallen


def blown_up(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """The simulation of the robot diverged."""
    return snapshot.blown_up


def timed_out(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """The episode is as long as `TaskCfg.episode`."""
    return env.episode_length_buf >= env.max_episode_length


def crossed(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """The robot reached the end of its course."""
    if env.course is None:
        return torch.zeros_like(snapshot.fallen)
    return torch.from_numpy(env.course.crossed(env.fleet.base_position[:, :2]))


TERMINATIONS = (
    Termination(fallen, fails=True),
    Termination(blown_up, fails=True),
    Termination(timed_out, fails=False),
    Termination(crossed, fails=False),
)


def ended(env: LocomotionEnv, snapshot: Snapshot, fails: bool) -> torch.Tensor:
    """Return whose episodes end for a reason that is a failure, or for one that is not, (N,) bool."""
    return torch.stack([reason.ended(env, snapshot) for reason in TERMINATIONS if reason.fails is fails]).any(0)
