"""Events of robots at the begin of an episode and after every interval of it, and its terminations.

An event is a function of the task and of its robots, `which` as of `sim.indexing`. A new one is a function here and a
line in `RESET` or `INTERVALS`, a new termination one in `TERMINATIONS`. The order of events is that of the random
numbers: a resumed training draws the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from stiction.sim.indexing import assign
from stiction.task.config import TaskCfg
from stiction.task.rewards import Snapshot

LocomotionEnv = Any
"""`task.env.LocomotionEnv`, whose module imports this one."""

RESET_NOISE = (0.1, 0.3)
"""Half-width of the initial joint angles about standing [rad] and of the base's initial velocity [m/s, rad/s]."""

Event = Callable[[LocomotionEnv, torch.Tensor], None]


def draw_robot(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Draw masses, gains, delays, friction and ground, see `RandomizationCfg`."""
    env.randomizer.draw(which, env.generator)


def place_robot(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Place robots about their standing pose, anywhere on flat ground or at the begin of a course."""
    num, (angle, speed) = len(which), RESET_NOISE
    offset, heading = angle * env.uniform(num, env.num_actions), np.pi * env.uniform(num, 1)[:, 0]
    velocity = speed * env.uniform(num, 6)
    if share := env.cfg.randomization.standing_start:
        exact = env.uniform(num, 1) < 2 * share - 1
        offset, velocity = (torch.where(exact, 0.0, value) for value in (offset, velocity))
    if env.course:
        ids = which.numpy()
        difficulty, uniform, env.host.start, course = env.course.begin(ids)
        env.fleet.place_terrain(ids, difficulty, uniform)
        heading = torch.from_numpy(course)
    env.robots.reset(which, offset, heading, velocity)


def draw_command(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Draw a command, see `CommandCfg`."""
    env.commands.draw(which, env.generator)


def draw_bench_error(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Draw the error of the friction that a policy observes, if it does."""
    if env.cfg.known_friction:
        low, high = env.cfg.randomization.known_friction
        size = (len(which), env.bench_error.shape[1])
        assign(
            env.bench_error,
            which,
            low + (high - low) * torch.rand(size, generator=env.generator, device=env.task_device),
        )


def draw_first_side(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Draw the side that begins, if the policy observes it."""
    if env.cfg.first_side:
        assign(env.first_side, which, env.uniform(len(which), 1).sign())


def forget(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Clear the buffers of the last episode."""
    env.unsync.reset(which)
    for buffer in (env.episode_length_buf, env.last_action, env.last_velocity, env.air_time):
        assign(buffer, which, 0)


def push(env: LocomotionEnv, which: torch.Tensor) -> None:
    """Add a horizontal velocity to the base, up to `RandomizationCfg.push_velocity` along each axis."""
    env.robots.push(env.cfg.randomization.push_velocity * env.uniform(len(which), 2), which)


RESET: tuple[Event, ...] = (draw_robot, place_robot, draw_command, draw_bench_error, draw_first_side, forget)

INTERVALS: tuple[tuple[Event, Callable[[TaskCfg], float]], ...] = (
    (push, lambda cfg: cfg.randomization.push_interval),
    (draw_command, lambda cfg: cfg.commands.interval),
)
"""Repeated events of an episode, and the time between two of them [s]; 0: never."""


@dataclass(frozen=True)
class Termination:
    """Reason why an episode ends."""

    ended: Callable[[LocomotionEnv, Snapshot], torch.Tensor]
    """Function that returns the robots whose episodes end, (N,) bool."""
    fails: bool
    """True: the robot failed, with no value afterwards. False: time ran out, and the value of the next state counts."""


def fallen(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """Return the robots whose trunk touches the ground, or leans too far."""
    return snapshot.fallen


def blown_up(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """Return the robots whose simulation diverged."""
    return snapshot.blown_up


def timed_out(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """Return the robots whose episode is as long as `TaskCfg.episode`."""
    return env.episode_length_buf >= env.max_episode_length


def crossed(env: LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
    """Return the robots at the end of their course."""
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
    """Return the robots whose episodes end by a failure, and those that end otherwise, (N,) bool."""
    return torch.stack([reason.ended(env, snapshot) for reason in TERMINATIONS if reason.fails is fails]).any(0)
