"""Evaluates a training run's teacher and student as bundles are evaluated, without exporting them first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from stiction.formats.errors import StictionError
from stiction.formats.results import ResultRow
from stiction.locomotion.friction import FrictionCfg, friction_share
from stiction.locomotion.privileged import nominal_privileged
from stiction.rma.run import RunDirectory
from stiction.rma.runner import load_actor
from stiction.transfer.evaluate import Evaluation, EvaluationCfg, drive, judge
from stiction.transfer.export import contract_of
from stiction.transfer.known_friction import parse_told, told_in_batch
from stiction.transfer.latents import Latent, LatentMean, lenders
from stiction.transfer.rollout import friction_at, robot_of
from stiction.transfer.teacher import LatentPolicy, Who
from stiction.transfer.twin import TrainedPolicy

CALIBRATION_SEED = 1_000_003
"""Added to the evaluation's seed for the walk from which the mean latent is taken: other noise, same conditions."""

Progress = Callable[[float], None]
"""Called with the share that is done [-]."""


def evaluate_run(
    run: Path,
    who: Who,
    cfg: EvaluationCfg,
    latent: Latent = "own",
    threads: int = 1,
    progress: Progress = lambda share: None,
) -> list[ResultRow]:
    """Evaluate a run's teacher or student; return a row per level and command, as `evaluate_bundle` does.

    The policy is called `RUN/teacher` or `RUN/student`, with `+LATENT` behind it where the latent is not its own.

    Args:
        run: directory of the run, as `stiction train` made it.
        who: `teacher` (z from o_priv, which the evaluation knows) or `student` (z* from the history).
        cfg: levels, commands, episodes.
        latent: what the actor is given, see `Latent`.
        threads: threads of the simulator; they do not change the result.
        progress: called with the share that is done [-].

    Raises:
        StictionError: not a run, a phase that is not finished, a teacher that sees the ground, or too few levels or
            episodes to swap latents.

    """
    return list(walk_run(run, who, cfg, latent, threads, progress).rows)


def walk_run(
    run: Path,
    who: Who,
    cfg: EvaluationCfg,
    latent: Latent = "own",
    threads: int = 1,
    progress: Progress = lambda share: None,
) -> Evaluation:
    """Return all that `evaluate_run` measures: rows, and each episode. Arguments and errors are the same.

    `mean` takes z or z* frozen at its mean over all robots and all measured steps of the same evaluation with another
    seed, walked on the policy's own latents.
    """
    directory = RunDirectory(run)
    header, train = directory.header(), directory.config()
    directory.check_finished(who)
    if who == "teacher" and train.teacher.latent == "history":
        raise StictionError(
            f"{run} has one phase and no teacher; evaluate its student, or train with --preset two-phase"
        )
    contract = contract_of(train, header)
    spec, actor = robot_of(contract, contract.robot), load_actor(directory, who)
    privileged, friction = None, friction_at(contract, cfg.robot_levels, cfg.law)
    known = told_in_batch(contract, spec, parse_told(cfg.known_friction), cfg.law, friction)
    if who == "teacher" and actor.sees_terrain:
        raise StictionError(f"{run}: its teacher sees the ground, which is flat here; evaluate its student")
    if who == "teacher":
        nominal = friction_share(contract.friction_law, contract.array("friction"), spec)
        present = friction_share(cfg.law.name, friction, spec)
        privileged = nominal_privileged(told_friction(train.task.friction, nominal, present))

    def walk(module: LatentPolicy, name: str, cfg: EvaluationCfg, progress: Progress) -> Evaluation:
        driver = TrainedPolicy(module, contract, cfg.num_robots, known)
        return judge(drive(driver, contract, spec, cfg, threads, progress), contract, name, cfg)

    name = f"{run.resolve().name}/{who}" + ("" if latent == "own" else f"+{latent}")
    if latent == "mean":
        mean = LatentMean(skip=round(cfg.settle / contract.control_period))
        other = replace(cfg, seed=cfg.seed + CALIBRATION_SEED)
        walk(LatentPolicy(actor, privileged, watch=mean), name, other, lambda share: progress(share / 2))
        frozen = LatentPolicy(actor, privileged, frozen=mean.value)
        return walk(frozen, name, cfg, lambda share: progress((1 + share) / 2))
    lent = lenders(latent, len(cfg.friction_levels), len(cfg.commands), cfg.episodes)
    return walk(LatentPolicy(actor, privileged, torch.from_numpy(lent)), name, cfg, progress)


def told_friction(friction: FrictionCfg, nominal: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the dry friction that o_priv tells a teacher, fractions of the torque limit, shape (N, joints).

    It is the true one, unless training never varied it (`none`, or a range without width): the weights of an entry that
    never moved are those of initialisation, and what they make of another value is chance. The entry then stays where
    training had it.

    Args:
        friction: friction in the run's training.
        nominal: nominal friction of its joints, fractions of the torque limit, shape (joints,).
        present: friction of the robots to evaluate, in the same unit, shape (N, joints).

    """
    ends = [end for stage in friction.schedule for end in stage.range]
    if min(ends) == max(ends):
        return np.tile(ends[0] * nominal, (len(present), 1))
    return present
