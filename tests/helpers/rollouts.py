"""One phase of training, built as a run builds it, and one rollout of it without the update."""

from __future__ import annotations

from pathlib import Path

import torch

from stiction.learning.boards import open_board
from stiction.learning.config import TrainCfg
from stiction.learning.phase import PhaseRunner
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.run import RunDirectory
from stiction.learning.runner import ppo_cfg, student_cfg
from stiction.task.env import LocomotionEnv


def phase_runner(
    cfg: TrainCfg, folder: Path, name: str = "teacher", env: LocomotionEnv | None = None, ranks: Ranks = ALONE
) -> PhaseRunner:
    """Return the runner of a phase, `teacher` or `student`, of four iterations; `env`: a new one by default."""
    torch.manual_seed(0)
    run = RunDirectory(folder)
    run.checkpoints.mkdir(parents=True, exist_ok=True)
    task = LocomotionEnv(cfg.task, cfg.num_envs, seed=0) if env is None else env
    settings = ppo_cfg(cfg) if name == "teacher" else student_cfg(cfg)
    return PhaseRunner(name, task, run, settings, 4, (100, 0), cfg.stop, open_board(folder, cfg), ranks=ranks)


def rollout(runner: PhaseRunner) -> None:
    """Fill the storage and compute the returns."""
    with torch.no_grad():
        obs = runner.env.get_observations()
        for _ in range(runner.cfg["num_steps_per_env"]):
            obs, reward, dones, extras = runner.env.step(runner.alg.act(obs))
            runner.alg.process_env_step(obs, reward, dones, extras)
        runner.alg.compute_returns(obs)


def check_ratio(runner: PhaseRunner) -> None:
    """Before the first gradient step, new and old log-probabilities of a rollout are equal."""
    storage, actor = runner.alg.storage, runner.alg.actor
    actor(storage.observations.flatten(0, 1), stochastic_output=True)
    again = actor.get_output_log_prob(storage.actions.flatten(0, 1))
    torch.testing.assert_close(again, storage.actions_log_prob.flatten(), atol=1e-5, rtol=0)
