"""Ask policies of one phase what they believe of their velocity, beside what is true, on either simulation of friction.

    python scripts/beliefs.py runs/mine-s0 runs/mine-s1 --physics rows plastic --out beliefs.csv

The estimator of each run's student is asked in every step of walks of 10 s, on the nominal robot, at several friction
levels and both commands, eight walks each. The first two seconds do not count. One row for a run, simulation, level and
command: the speed that was reached and the one that was believed, over the command.
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
from stiction.rma.models import StudentPolicy
from stiction.rma.run import RunDirectory
from stiction.rma.runner import load_actor
from stiction.robots.catalog import find_robot
from stiction.robots.physics import EXACT, FAST

COLUMNS = ("run", "iteration", "physics", "timestep", "friction_level", "command", "reached", "believed")
PHYSICS = {"rows": EXACT, "plastic": FAST}
SPEED, SECONDS, UNCOUNTED, WALKS = 0.5, 10.0, 2.0, 8


def student_of(run: RunDirectory, iteration: int | None) -> StudentPolicy:
    """Return the policy of a run, or what it was after an earlier iteration whose checkpoint is still there."""
    if iteration is None:
        return load_actor(run, "student").student().eval()
    return load_actor(run, "teacher", run.checkpoints / f"teacher_{iteration:06d}.safetensors").student().eval()


def ask(
    run: RunDirectory, student: StudentPolicy, levels: list[float], physics: str, timestep: float | None
) -> list[tuple[float, float, float, float]]:
    """Return level, command [m/s], and speed reached and believed over the command, of every level and direction."""
    contract = contract_of(run.config(), run.header())
    believed: list[np.ndarray] = []
    hook = student.estimator.register_forward_hook(lambda *call: believed.append(call[2][:, 0].detach().numpy().copy()))
    cells = [(level, sign * SPEED) for level in levels for sign in (1.0, -1.0)]
    level, forward = (np.repeat(column, WALKS) for column in zip(*cells, strict=True))
    command = np.stack((forward, np.zeros_like(forward), np.zeros_like(forward)), -1)
    known = np.repeat(level[:, None], len(contract.kinds), 1) if contract.observes_friction else None
    rollout = Rollout(
        contract,
        TrainedPolicy(student, contract, len(level), known),
        find_robot(run.config().task.robot),
        friction_at(contract, level),
        [np.random.default_rng([0, number]) for number in range(WALKS)],
        physics=PHYSICS[physics],
        timestep=timestep,
    )
    reached = []
    for _ in range(round(SECONDS / contract.control_period)):
        # Believed before the step, so the truth is that of before it too.
        reached.append(rollout.fleet.base_linear_velocity[:, 0].copy())
        rollout.step(command)
    hook.remove()
    first = round(UNCOUNTED / contract.control_period)
    shares = np.stack([np.stack(values)[first:].mean(0) / forward for values in (reached, believed)])
    means = shares.reshape(2, -1, WALKS).mean(-1)
    return [(*cell, float(true), float(guess)) for cell, true, guess in zip(cells, *means, strict=True)]


def main() -> None:
    """Ask every run, print a table, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path, help="folders of trainings of one phase")
    parser.add_argument("--levels", nargs="+", type=float, default=[0.0, 0.1, 0.2, 0.24], help="of the torque limit")
    parser.add_argument(
        "--physics", nargs="+", choices=list(PHYSICS), default=["rows"], help="how friction is simulated"
    )
    parser.add_argument("--timestep", type=float, help="physics step [s], by default that of training")
    parser.add_argument("--iteration", type=int, help="of an earlier checkpoint, by default the student")
    parser.add_argument("--out", type=Path, help="CSV to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for run in map(RunDirectory, options.runs):
        student, timestep = student_of(run, options.iteration), options.timestep or run.config().task.timestep
        for physics in options.physics:
            for level, command, reached, believed in ask(run, student, options.levels, physics, options.timestep):
                where = (run.path.name, options.iteration or "last", physics, timestep, level, command)
                rows.append((*where, round(reached, 3), round(believed, 3)))
                print(
                    f"{run.path.name} {physics} {level:4.0%} {command:+.1f} m/s: {reached:.2f}, believed {believed:.2f}"
                )
    if options.out is not None:
        with options.out.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    try:
        main()
    except StictionError as error:
        sys.exit(f"beliefs: {error}")
