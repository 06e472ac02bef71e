"""Walks of robots whose joints have friction of their own: what they measured, and what adaptation made of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from stiction.formats.friction import has_coefficient
from stiction.formats.reproducibility import stream_seed
from stiction.locomotion.config import TaskCfg
from stiction.locomotion.env import LocomotionEnv
from stiction.locomotion.friction import FrictionCfg, FrictionMethod
from stiction.rma.config import TrainCfg
from stiction.rma.models import RMAActor
from stiction.transfer.command import SETTLE

Per = Literal["joint", "robot"]
"""Friction drawn for each joint by itself, or one level for all joints of a robot."""


@dataclass(frozen=True)
class WalkCfg:
    """Robots, time and friction of a walk. All else is drawn, and pushed, and noisy, as in the run's training."""

    robots: int = 384
    """Robots side by side; those that fall are left out."""
    seconds: float = 22.1
    """Length [s]; commands are drawn anew as in training, every 5 s. Beside what is left out, two windows of the wear
    monitor and the frame before the first of them."""
    settle: float = SETTLE
    """What is left out at its start [s]."""
    highest: float = 0.24
    """Friction is drawn from 0 to this fraction of the torque limit, uniformly: 1.2 times 0.2, as `deception` draws."""
    seed: int = 0
    """Seed of everything drawn. It names its own stream: no training run has met these robots."""


@dataclass(frozen=True)
class FrictionWalk:
    """What N robots that did not fall did in T control steps after settling."""

    frames: np.ndarray
    """o_prio, float32, shape (T, N, frame)."""
    latent: np.ndarray
    """z*, float32, shape (T, N, latent)."""
    explicit: np.ndarray
    """o_exp*, the estimate of base velocity and foot contacts, float32, shape (T, N, explicit)."""
    teacher: np.ndarray
    """z, which the teacher's encoder makes of o_priv, float32, shape (N, latent): constant over a walk."""
    friction: np.ndarray
    """Dry friction of every joint as a fraction of its torque limit, shape (N, joints)."""
    fallen: int
    """Robots that fell or became unstable and were left out."""


def probe_task(task: TaskCfg, per: Per, cfg: WalkCfg) -> TaskCfg:
    """Return the task of a walk: the run's own but for the joints' friction, on flat ground, in one long episode."""
    friction = task.friction
    level = cfg.highest if has_coefficient(friction.law) else friction.level or cfg.highest
    method: FrictionMethod = "compensation" if friction.method == "compensation" else "direct"
    drawn = FrictionCfg(method=method, level=level, per=per, range=(0.0, cfg.highest / level))
    ground = TaskCfg().terrain
    return replace(task, friction=drawn, terrain=ground, episode=cfg.seconds + task.control_period)


def walk_with_friction(
    train: TrainCfg,
    identified: dict[str, np.ndarray] | None,
    actor: RMAActor,
    per: Per,
    cfg: WalkCfg,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> FrictionWalk:
    """Let a student walk on its own z* with deterministic actions and keep what the probes need.

    Args:
        train: configuration of its run.
        identified: nominal joints of the run, see `nominal_joints`.
        actor: the student.
        per: see `Per`.
        cfg: robots and time.
        threads: threads of the simulator.
        progress: called with the share that is done [-].

    """
    env = LocomotionEnv(
        probe_task(train.task, per, cfg), cfg.robots, stream_seed(cfg.seed, f"probe {per}"), threads, identified
    )
    steps, skip = (round(time / env.cfg.control_period) for time in (cfg.seconds, cfg.settle))
    share = torch.from_numpy(env.randomizer.nominal.frictionloss / env.fleet.torque_limit)
    friction = (env.randomizer.draws.friction * share).numpy().copy()
    kept, parts = np.ones(cfg.robots, dtype=bool), []
    with torch.no_grad():
        teacher = actor.privileged_encoder(env.get_observations()["privileged"]).numpy()
        for step in range(steps):
            obs = env.get_observations()
            if step >= skip:
                seen = obs["proprioception"], actor.adaptation(obs["history"]), actor.estimator(obs["history"])
                parts.append([value.numpy() for value in seen])
            _, _, dones, _ = env.step(actor(obs))
            kept &= ~dones.numpy() | (step == steps - 1)
            progress((step + 1) / steps)
    frames, latent, explicit = (np.stack(values)[:, kept] for values in zip(*parts, strict=True))
    return FrictionWalk(frames, latent, explicit, teacher[kept], friction[kept], int((~kept).sum()))
