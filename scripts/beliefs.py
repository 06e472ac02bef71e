"""What does a policy of one phase believe, and what is true? Velocity by velocity, on the robot of its evaluation.

    python scripts/beliefs.py runs/mine-s0 runs/mine-s1 --out beliefs.csv

The estimator of each run's student is asked in every step of walks of 10 s, on the nominal robot with the solver's rows,
at several friction levels and both commands, eight walks each. The first two seconds do not count. One row for a run,
level and command: the speed that was reached and the one that was believed, over the command.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
import torch

from stiction.core.errors import StictionError
from stiction.evaluate.export import TrainedPolicy, contract_of
from stiction.evaluate.rollout import Rollout, friction_at
from stiction.rma.run import RunDirectory
from stiction.rma.runner import load_actor
from stiction.robots.catalog import find_robot

COLUMNS = ("run", "iteration", "friction_level", "command", "reached", "believed")
SPEED, SECONDS, UNCOUNTED, WALKS = 0.5, 10.0, 2.0, 8


def ask(run: Path, levels: list[float], checkpoint: Path | None) -> list[tuple[float, float, float, float]]:
    """Return level, command [m/s], and speed reached and believed over the command, of every level and direction."""
    directory = RunDirectory(run)
    contract = contract_of(directory.config(), directory.header())
    actor = load_actor(directory, "student" if checkpoint is None else "teacher", checkpoint)
    actor.blind, actor.latent_source = True, "history"
    student = actor.student().eval()
    believed: list[np.ndarray] = []
    student.estimator.register_forward_hook(lambda *call: believed.append(call[2][:, 0].numpy().copy()))
    cells = [(level, sign * SPEED) for level in levels for sign in (1.0, -1.0)]
    level, forward = (np.repeat(column, WALKS) for column in zip(*cells, strict=True))
    command = np.stack((forward, np.zeros_like(forward), np.zeros_like(forward)), -1)
    known = None
    if contract.observes_friction:
        known = np.repeat(level[:, None], len(contract.known_friction_array), 1)
    policy = TrainedPolicy(student, contract, len(level), known)
    generators = [np.random.default_rng([0, number]) for number in range(WALKS)]
    rollout = Rollout(contract, policy, find_robot(directory.config().task.robot), friction_at(contract, level), generators)
    reached = []
    for _ in range(round(SECONDS / contract.control_period)):
        # Asked before the step, so the truth is that of before it too.
        reached.append(rollout.fleet.base_linear_velocity[:, 0].copy())
        rollout.step(command)
    first = round(UNCOUNTED / contract.control_period)
    means = [np.stack(values)[first:].mean(0) / forward for values in (reached, believed)]
    return [
        (*cell, float(true[0]), float(guess[0]))
        for cell, true, guess in zip(cells, *(mean.reshape(-1, WALKS).mean(1, keepdims=True) for mean in means), strict=True)
    ]


def main() -> None:
    """Ask every run, print a table, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, help="folders of trainings of one phase")
    parser.add_argument("--levels", nargs="+", type=float, default=[0.0, 0.1, 0.2], help="shares of the torque limit")
    parser.add_argument("--iteration", type=int, help="of an earlier checkpoint, by default the student")
    parser.add_argument("--out", type=Path, help="CSV to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for run in options.runs:
        iteration = options.iteration
        checkpoint = None if iteration is None else RunDirectory(run).checkpoints / f"teacher_{iteration:06d}.safetensors"
        for level, command, reached, believed in ask(run, options.levels, checkpoint):
            rows.append((run.name, iteration or "last", level, command, round(reached, 3), round(believed, 3)))
            print(f"{run.name} {level:4.0%} {command:+.1f} m/s: reached {reached:.2f}, believed {believed:.2f}")
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    try:
        main()
    except StictionError as error:
        sys.exit(f"beliefs: {error}")
