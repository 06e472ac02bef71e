"""Evaluates a training run's teacher and student as bundles are evaluated, without exporting them first.

A teacher needs o_priv, which only training knows; an evaluation sets its robots itself, so that o_priv is a known
constant of each robot.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch

from stiction.core.errors import ConfigurationError
from stiction.evaluation.evaluate import Evaluation, EvaluationCfg, drive, judge
from stiction.evaluation.export import TrainedPolicy, contract_of
from stiction.evaluation.newest import LatentPolicy, privileged_of
from stiction.evaluation.policies import known_to, parse_source
from stiction.files.contract import robot_of
from stiction.learning.run import RunDirectory
from stiction.learning.runner import load_actor
from stiction.task.friction import friction_share

Latent = Literal["own", "mean", "swapped", "peer"]
"""Where the latent comes from: the robot's own; frozen at its mean over robots and time; that of a robot with another
friction level; that of another robot with the same level. The last is the control of the one before: it is not of the
robot's own gait and noise either, but of the right friction."""

LATENTS: tuple[Latent, ...] = get_args(Latent)


def latent_sources(latent: Latent, levels: int, commands: int, episodes: int) -> np.ndarray:
    """Return the robot whose latent each robot is given, shape (levels * commands * episodes,): a permutation.

    Robots are ordered by level, then by command, then by episode. `swapped` moves on by half of the levels, `peer` by
    one episode. Raises `StictionError` where there are too few of them to leave no robot its own.
    """
    own = np.arange(levels * commands * episodes).reshape(levels, commands, episodes)
    if latent == "swapped" and levels < 2:
        raise ConfigurationError("swapped latents need robots of two friction levels or more; name another level")
    if latent == "peer" and episodes < 2:
        raise ConfigurationError("latents of peers need two episodes or more per level and command")
    if latent == "swapped":
        own = np.roll(own, -(levels // 2), axis=0)
    elif latent == "peer":
        own = np.roll(own, -1, axis=2)
    return own.ravel()


class LatentMean:
    """The mean of latents over robots and time, in float64."""

    def __init__(self, skip: int = 0) -> None:
        """Start empty; the first `skip` steps will not count."""
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


Who = Literal["teacher", "student"]
"""One of a run's two policies: the teacher walks on z = f_ada_tea(o_priv), the student on z* = f_ada_stu(o_H)."""


CALIBRATION_SEED = 1_000_003
"""Added to the evaluation's seed for the walk from which the mean latent is taken: other noise, same conditions."""


def walk_run(
    run: Path,
    who: Who,
    cfg: EvaluationCfg,
    latent: Latent = "own",
    threads: int = 1,
) -> Evaluation:
    """Evaluate a run's teacher or student as `evaluate_bundle` does a bundle.

    Its rows call the policy `RUN/teacher` or `RUN/student`, with `+LATENT` behind it where the latent is not its own.

    Args:
        run: directory of the run, as `stiction train` made it.
        who: see `Who`.
        cfg: levels, commands, episodes.
        latent: what the actor is given. `mean` is the mean over all robots and all measured steps of the same
            evaluation with another seed, walked on the policy's own latents.
        threads: threads of the simulator; they do not change the result.

    Raises:
        StictionError: not a run, a phase that is not finished, a teacher that sees the ground, or too few levels or
            episodes to swap latents.

    """
    directory = RunDirectory(run)
    header, train = directory.header(), directory.config()
    directory.check_finished(who)
    if who == "teacher" and train.teacher.latent == "history":
        raise ConfigurationError(
            f"{run} has one phase and no teacher; evaluate its student, or train with --preset two-phase"
        )
    contract = contract_of(train, header)
    spec, actor = robot_of(contract), load_actor(directory, who)
    privileged, friction = None, cfg.friction(contract)
    known = known_to(contract, spec, parse_source(cfg.known_friction), cfg.law, friction)
    if who == "teacher":
        privileged = privileged_of(directory, actor, contract, spec, friction_share(cfg.law.name, friction, spec))

    def walk(module: LatentPolicy, name: str, cfg: EvaluationCfg) -> Evaluation:
        driver = TrainedPolicy(module, contract, cfg.num_robots, known)
        return judge(drive(driver, contract, spec, cfg, threads), contract, name, cfg)

    name = f"{run.resolve().name}/{who}" + ("" if latent == "own" else f"+{latent}")
    if latent == "mean":
        mean = LatentMean(skip=round(cfg.settle / contract.control_period))
        other = replace(cfg, seed=cfg.seed + CALIBRATION_SEED)
        walk(LatentPolicy(actor, privileged, watch=mean), name, other)
        frozen = LatentPolicy(actor, privileged, frozen=mean.value)
        return walk(frozen, name, cfg)
    sources = latent_sources(latent, len(cfg.friction_levels), len(cfg.commands), cfg.episodes)
    return walk(LatentPolicy(actor, privileged, torch.from_numpy(sources)), name, cfg)
