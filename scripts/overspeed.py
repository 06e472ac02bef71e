"""Take a student of two phases apart: which of the things that differ from its training makes it too fast, or too slow.

    python scripts/overspeed.py runs/mine-s0 runs/mine-s1 --out overspeed.csv

In its training a student walks with exploration noise; deployed it walks without. Its teacher walks on the true latent
z; the student on z*, and both on an estimate of velocity. Here each of these is put in the other's place, on the
nominal robot at several friction levels, both commands, eight walks of 10 s each, of which the first two seconds do not
count. One row for a run, what was replaced, level and command: the speed that was reached over the command.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from beliefs import Walks, write_rows
from torch import nn

from stiction.core.errors import StictionError
from stiction.deploy.check import robot_of
from stiction.evaluation.export import TrainedPolicy, contract_of
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.evaluation.trained import privileged_of
from stiction.learning.models import RMAActor
from stiction.learning.run import RunDirectory
from stiction.learning.runner import load_actor
from stiction.robots.physics import EXACT
from stiction.task.friction import friction_share

LEVELS = [0.0, 0.1, 0.2]
COLUMNS = ("policy", "walks", "friction_level", "command", "reached")

WALKERS: dict[str, tuple[str, frozenset[str]]] = {
    "the student": ("student", frozenset()),
    "with the noise of its training": ("student", frozenset({"noise"})),
    "with the true velocity": ("student", frozenset({"velocity"})),
    "with the true z": ("student", frozenset({"z"})),
    "with both": ("student", frozenset({"velocity", "z"})),
    "its teacher": ("teacher", frozenset({"z"})),
    "its teacher, with the true velocity": ("teacher", frozenset({"velocity", "z"})),
}
"""Name in the table -> whose networks walk, and what they are given."""


class Walker(nn.Module):
    """The action of an actor, some of whose inputs are the true ones: observations (N, size) -> actions (N, joints)."""

    def __init__(
        self,
        actor: RMAActor,
        latent: torch.Tensor | None,
        velocity: Callable[[], torch.Tensor] | None,
        noise: torch.Generator | None,
    ) -> None:
        """Choose what is true: z, (N, latent), the base's velocity, (N, 3); and what draws the exploration noise."""
        super().__init__()
        self.actor, self.latent, self.velocity, self.noise = actor, latent, velocity, noise

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the actions, (N, joints)."""
        actor = self.actor
        estimate = actor.estimator(observation)
        if self.velocity is not None:
            estimate = torch.cat((self.velocity(), estimate[:, 3:]), -1)
        latent = actor.adaptation(observation) if self.latent is None else self.latent
        current = observation[:, -actor.adaptation.frame :]
        action = actor.mlp(torch.cat((current, estimate, latent), -1))
        if self.noise is not None:
            action = action + actor.std * torch.randn(action.shape, generator=self.noise)
        return action


def walk(run: RunDirectory, who: str, given: frozenset[str], levels: list[float]) -> list[tuple[float, float, float]]:
    """Return level, command [m/s] and speed over the command of every level and direction."""
    contract = contract_of(run.config(), run.header())
    actor, walks, latent = load_actor(run, who), Walks(levels, contract), None
    if "z" in given:
        robot = robot_of(contract)
        share = friction_share(contract.friction_law, friction_at(contract, walks.level), robot)
        latent = actor.privileged_encoder(privileged_of(run, actor, contract, robot, share)).detach()
    noise = torch.Generator().manual_seed(0) if "noise" in given else None
    rollout: Rollout

    def velocity() -> torch.Tensor:
        return torch.from_numpy(rollout.fleet.base_linear_velocity.astype(np.float32))

    walker = Walker(actor, latent, velocity if "velocity" in given else None, noise)
    rollout = walks.rollout(TrainedPolicy(walker, contract, len(walks.level)), EXACT)
    reached = []
    for _ in range(walks.steps):
        rollout.step(walks.command)
        reached.append(rollout.fleet.base_linear_velocity[:, 0].copy())
    return [(*cell, speed) for cell, speed in zip(walks.cells, walks.share(reached), strict=True)]


def main() -> None:
    """Walk every run in every way, print the mean deviations, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, help="folders of trainings of two phases")
    parser.add_argument("--levels", nargs="+", type=float, default=LEVELS, help="shares of the torque limit")
    parser.add_argument("--out", type=Path, help="CSV to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for path in options.runs:
        for name, (who, given) in WALKERS.items():
            answers = walk(RunDirectory(path), who, given, options.levels)
            rows += [(path.name, name, level, command, f"{speed:.3f}") for level, command, speed in answers]
            mean = sum(abs(speed - 1) for *_, speed in answers) / len(answers)
            cells = "  ".join(f"{speed:.2f}" for *_, speed in answers)
            print(f"{path.name} {name}: mean deviation {mean:.3f}  {cells}", flush=True)
    write_rows(options.out, COLUMNS, rows)


if __name__ == "__main__":
    try:
        main()
    except StictionError as error:
        sys.exit(f"overspeed: {error}")
