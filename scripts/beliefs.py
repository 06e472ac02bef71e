"""Ask policies of one phase what they believe of their velocity, beside what is true, on either simulation of friction.

    python scripts/beliefs.py runs/mine-s0 runs/mine-s1 --physics rows plastic --out beliefs.csv

The estimator of each run's student is asked in every step of walks of 10 s, on the nominal robot, at several friction
levels and both commands, eight walks each. The first two seconds do not count. One row for a policy, simulation, level
and command: the speed that was reached and the one that was believed, over the command. A bundle's estimator is the
part of its network that has that name; one without it does not tell what it believes.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import torch

from stiction.core.errors import StictionError
from stiction.deploy.check import robot_of
from stiction.deploy.control import Driver
from stiction.deploy.policy import INPUT, load_policy, open_session
from stiction.evaluation.export import TrainedPolicy, contract_of
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import read_bundle
from stiction.files.contract import Contract
from stiction.learning.run import RunDirectory
from stiction.learning.runner import load_actor
from stiction.robots.physics import EXACT, FAST, PhysicsCfg

LEVELS = [0.0, 0.05, 0.1, 0.15, 0.2, 0.24]
COLUMNS = ("policy", "iteration", "physics", "timestep", "friction_level", "command", "reached", "believed")
PHYSICS = {"rows": EXACT, "plastic": FAST}
SPEED, SECONDS, UNCOUNTED, WALKS = 0.5, 10.0, 2.0, 8

Answer = tuple[float, float, float, float | None]
"""Level, command [m/s], and speed reached and believed over the command."""


Estimator = Callable[[np.ndarray], np.ndarray]
"""From observations, shape (N, size), the velocities that are believed [m/s] and more, shape (N, V)."""


def estimator_in(model: bytes) -> Estimator | None:
    """Return the estimator that a network in ONNX, checked, has before its policy; None where it has none."""
    network = onnx.load_from_string(model)
    layers = [node for node in network.graph.node if any(name.startswith("estimator.") for name in node.input)]
    if not layers:
        return None
    # The nodes of a graph stand in the order of what they need, so its last layer is the last one.
    name = layers[-1].output[0]
    network.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ("batch", None)))
    session = open_session(network.SerializeToString())
    return lambda observation: np.asarray(session.run([name], {INPUT: observation})[0])


class Walks:
    """Walks on the nominal robot at several friction levels, both commands, `WALKS` of each with noise of their own."""

    def __init__(self, levels: list[float], contract: Contract) -> None:
        """Lay them out; levels: friction over the torque limit [-]."""
        self.contract, self.cells = contract, [(level, sign * SPEED) for level in levels for sign in (1.0, -1.0)]
        self.level, self._forward = (np.repeat(column, WALKS) for column in zip(*self.cells, strict=True))
        self.command = np.stack((self._forward, np.zeros_like(self._forward), np.zeros_like(self._forward)), -1)
        self.steps = round(SECONDS / contract.control_period)

    def rollout(self, driver: Driver, physics: PhysicsCfg, timestep: float | None = None) -> Rollout:
        """Return the robots at their start."""
        contract, generators = self.contract, [np.random.default_rng([0, number]) for number in range(WALKS)]
        robot, friction = robot_of(contract), friction_at(contract, self.level)
        return Rollout(contract, driver, robot, friction, generators, physics=physics, timestep=timestep)

    def share(self, speeds: list[np.ndarray]) -> list[float]:
        """Return the mean speed over the command of each cell [-]; speeds: of each step [m/s], shape (walks,)."""
        first = round(UNCOUNTED / self.contract.control_period)
        return (np.stack(speeds)[first:].mean(0) / self._forward).reshape(-1, WALKS).mean(-1).tolist()


class Asked:
    """A policy that walks and tells what it believes: the student of a run, or a bundle."""

    def __init__(self, path: Path, iteration: int | None) -> None:
        """Read it; `iteration`: of an earlier checkpoint of a run."""
        self.path, self.iteration, self.student, self.estimator = path, iteration, None, None
        if (path / "contract.json").exists():
            self.bundle = read_bundle(path)
            self.contract, self.estimator = self.bundle.contract, estimator_in(self.bundle.policy)
            return
        run = RunDirectory(path)
        self.contract = contract_of(run.config(), run.header())
        name = "student" if iteration is None else "teacher"
        checkpoint = None if iteration is None else run.checkpoints / f"teacher_{iteration:06d}.safetensors"
        self.student = load_actor(run, name, checkpoint).student().eval()

    def driver(self, level: np.ndarray) -> Driver:
        """Return what drives robots of these friction levels, which are told them where it observes friction."""
        known = np.repeat(level[:, None], len(self.contract.kinds), 1) if self.contract.observes_friction else None
        if self.student is None:
            return load_policy(self.contract, self.bundle.policy, (len(level),), known)
        return TrainedPolicy(self.student, self.contract, len(level), known)

    def walk(self, levels: list[float], physics: str, timestep: float | None) -> list[Answer]:
        """Return what came of every level and direction."""
        contract, believed = self.contract, []
        hook = None
        if self.student is not None:
            hook = self.student.estimator.register_forward_hook(
                lambda *call: believed.append(call[2][:, 0].detach().numpy().copy())
            )
        walks = Walks(levels, contract)
        rollout = walks.rollout(self.driver(walks.level), PHYSICS[physics], timestep)
        reached = []
        for _ in range(walks.steps):
            # Believed before the step, so the truth is that of before it too.
            reached.append(rollout.fleet.base_linear_velocity[:, 0].copy())
            step = rollout.step(walks.command)
            if self.estimator is not None:
                believed.append(self.estimator(step.policy.observation)[:, 0])
        if hook is not None:
            hook.remove()
        guesses = walks.share(believed) if believed else [None] * len(walks.cells)
        return [(*cell, *both) for cell, *both in zip(walks.cells, walks.share(reached), guesses, strict=True)]


def write_rows(path: Path | None, columns: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    """Write a table, where one is asked for."""
    if path is not None:
        with path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([columns, *rows])


def main() -> None:
    """Ask every policy, print a table, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policies", nargs="+", type=Path, help="folders of trainings of one phase, or bundles")
    parser.add_argument("--levels", nargs="+", type=float, default=LEVELS, help="shares of the torque limit")
    parser.add_argument(
        "--physics", nargs="+", choices=list(PHYSICS), default=["rows"], help="how friction is simulated"
    )
    parser.add_argument("--timestep", type=float, help="physics step [s], by default that of training")
    parser.add_argument("--iteration", type=int, help="of an earlier checkpoint, by default the student")
    parser.add_argument("--out", type=Path, help="CSV to write")
    options = parser.parse_args()
    torch.set_num_threads(1)
    rows = []
    for path in options.policies:
        asked = Asked(path, options.iteration)
        timestep = options.timestep or asked.contract.physics_timestep
        for physics in options.physics:
            answers = asked.walk(options.levels, physics, options.timestep)
            for level, command, reached, believed in answers:
                told = "" if believed is None else f"{believed:.3f}"
                where = (path.name, options.iteration or "last", physics, timestep, level, command)
                rows.append((*where, f"{reached:.3f}", told))
            worst = max((abs(reached - 1), reached) for _, _, reached, _ in answers)[1]
            mean = sum(abs(reached - 1) for _, _, reached, _ in answers) / len(answers)
            print(f"{path.name} on {physics}: mean deviation {mean:.3f}, worst {worst:.2f}", flush=True)
    write_rows(options.out, COLUMNS, rows)


if __name__ == "__main__":
    try:
        main()
    except StictionError as error:
        sys.exit(f"beliefs: {error}")
