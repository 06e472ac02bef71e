"""One rollout of a phase of training, without the update after it."""

from __future__ import annotations

import torch

from stiction.rma.phase import PhaseRunner


def rollout(runner: PhaseRunner) -> None:
    """Fill the storage and compute the returns."""
    with torch.no_grad():
        obs = runner.env.get_observations()
        for _ in range(runner.cfg["num_steps_per_env"]):
            obs, reward, dones, extras = runner.env.step(runner.alg.act(obs))
            runner.alg.process_env_step(obs, reward, dones, extras)
        runner.alg.compute_returns(obs)
