"""One of several processes of a training, for the tests: `python rank_process.py FOLDER...`, named by torchrun.

A folder holds rollout.pt, what robots of all processes went through, and networks.pt; here the share of this process is
updated with, and what came out is written to RANK.pt.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from rollouts import phase_runner
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.phase import PhaseRunner
from stiction.learning.ranks import Ranks, named_ranks
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

ROBOTS = 8

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.1)),
    network=NetworkCfg(actor=(8,), critic=(8,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=5, steps=4, epochs=1, mini_batches=1, adaptation_batches=1),
    student=StudentCfg(iterations=3, steps=4, epochs=1, mini_batches=1),
    num_envs=ROBOTS,
)
"""Updates of one mini-batch: how samples are shuffled does not matter."""

STORED = ("rewards", "dones", "values", "actions", "actions_log_prob")


def make(folder: Path, name: str, ranks: Ranks) -> PhaseRunner:
    """Return the runner of a phase over this process's share of the robots."""
    cfg = replace(CFG, num_envs=ranks.share(ROBOTS))
    return phase_runner(cfg, folder / f"run{ranks.number}", name, ranks=ranks)


def keep(runner: PhaseRunner, last: Any) -> dict[str, Any]:
    """Return what a rollout left in the storage, as plain tensors; last: the observations after it."""
    storage = runner.alg.storage
    kept: dict[str, Any] = {"observations": dict(storage.observations.items()), "last": dict(last.items())}
    if runner.phase == "student":
        return kept | {"privileged_actions": storage.privileged_actions}
    return kept | {name: getattr(storage, name) for name in STORED} | {"params": list(storage.distribution_params)}


def fill(runner: PhaseRunner, kept: dict[str, Any], rows: slice) -> Any:
    """Put the rows of some robots into the storage; return their observations after the rollout."""
    storage, last = runner.alg.storage, runner.env.get_observations()
    for name, values in kept["observations"].items():
        storage.observations[name] = values[:, rows].clone()
    if runner.phase == "student":
        storage.privileged_actions.copy_(kept["privileged_actions"][:, rows])
        return last
    for name in STORED:
        getattr(storage, name).copy_(kept[name][:, rows])
    storage.distribution_params = tuple(values[:, rows].clone() for values in kept["params"])
    return last.update({name: kept["last"][name][rows].clone() for name in last.keys()})  # noqa: SIM118


def update(runner: PhaseRunner, last: Any) -> dict[str, torch.Tensor]:
    """Take one update; return gradients and parameters that it left."""
    if runner.phase == "teacher":
        with torch.no_grad():
            runner.alg.compute_returns(last)
    runner.alg.update()
    policy = runner.alg.get_policy()
    tensors = {name: value.detach().clone() for name, value in policy.state_dict().items()}
    if runner.phase == "teacher":
        tensors |= {f"critic.{name}": value.clone() for name, value in runner.alg.critic.state_dict().items()}
        tensors["rate"] = torch.tensor(runner.alg.learning_rate)
    return tensors


def main(folder: Path, ranks: Ranks) -> None:
    """Update with this process's share."""
    kept = torch.load(folder / "rollout.pt", weights_only=True)
    runner = make(folder, kept.pop("phase"), ranks)
    networks = torch.load(folder / "networks.pt", weights_only=True)
    for name, state in networks.items():
        getattr(runner.alg, name).load_state_dict(state)
    share = ranks.share(ROBOTS)
    last = fill(runner, kept, slice(ranks.number * share, (ranks.number + 1) * share))
    results = {"update": update(runner, last)}
    own = {"walk/blown_up": float(ranks.number), "both": 1.0 + ranks.number} | ({"one": 3.0} if ranks.number else {})
    results["figures"] = ranks.figures(own)
    results["any"] = [ranks.any(ranks.number == 1), ranks.any(False)]
    # 0.3 of 8 robots are 4 %, which is healthy; of a process's own 4 they would be 8 %.
    runner.health.check(1, {"walk/blown_up": 0.3})
    results["suspicious"] = runner.health.suspicious
    results["standardized"] = ranks.standardized(torch.tensor([1.0, 2.0, 4.0]) * (1 + ranks.number))
    torch.save(results, folder / f"{ranks.number}.pt")


if __name__ == "__main__":
    torch.set_num_threads(1)
    among = named_ranks()
    among.join("cpu")
    among.begin()
    for path in sys.argv[1:]:
        main(Path(path), among)
