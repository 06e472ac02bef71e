"""Where the time of a training iteration goes, part by part, for each way to simulate joint friction, side by side.

Process CPU time, all threads together, so that a busy machine costs little accuracy. One runner for each physics, all
with the same seed; in every block each makes one iteration in turn. The bare physics is `Batch.step` within those very
iterations, on the states that the training walks through.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from stiction.formats.actuator import ActuatorNet
from stiction.formats.reproducibility import num_threads, stream_seed
from stiction.locomotion.env import LocomotionEnv
from stiction.rma.board import Board
from stiction.rma.config import TrainCfg
from stiction.rma.phase import PhaseRunner
from stiction.rma.run import RunDirectory
from stiction.rma.runner import ppo_cfg
from stiction.robots.physics import EXACT, FAST, PhysicsCfg
from stiction.sim.native import NativeSimulation

PHYSICS = {
    "rows": EXACT,
    "rows, impedance 0.9": PhysicsCfg(impedance=0.9),
    "plastic, Newton": PhysicsCfg("plastic", solver="newton"),
    "plastic": FAST,
}
"""What is compared, the physics of every evaluation first."""

PARTS = ("physics", "task", "inference", "ppo", "supervised", "other")
"""What an iteration consists of."""


class Meter:
    """Adds up the CPU time of methods while one iteration runs."""

    def __init__(self, clock: Callable[[], float] = time.process_time) -> None:
        """`clock`: time spent so far [s]."""
        self.clock = clock
        self.spent: dict[str, float] = {}

    def watch(self, owner: Any, method: str, name: str) -> None:
        """Count every call of `owner.method` under `name`."""
        watched = getattr(owner, method)

        def timed(*args: Any, **kwargs: Any) -> Any:
            start = self.clock()
            try:
                return watched(*args, **kwargs)
            finally:
                self.spent[name] = self.spent.get(name, 0.0) + self.clock() - start

        setattr(owner, method, timed)

    def take(self) -> dict[str, float]:
        """Return the parts of what has run since the last call [s], and their sum, `iteration`."""
        spent, self.spent = self.spent, {}
        inference = spent["act"] + spent["store"] + spent["returns"]
        return {
            "physics": spent["bare"],
            "task": spent["step"] - spent["bare"],
            "inference": inference,
            "ppo": spent["update"] - spent["supervise"],
            "supervised": spent["supervise"],
            "other": spent["iterate"] - spent["step"] - inference - spent["update"],
            "iteration": spent["iterate"],
        }


def watched_runner(cfg: TrainCfg, folder: Path, actuator: ActuatorNet | None) -> tuple[PhaseRunner, Meter]:
    """Return a teacher's runner and the meter of its parts."""
    torch.manual_seed(stream_seed(cfg.seed, "bench"))
    env = LocomotionEnv(cfg.task, cfg.num_envs, stream_seed(cfg.seed, "environment"), num_threads(), actuator=actuator)
    runner = PhaseRunner("teacher", env, RunDirectory(folder), ppo_cfg(cfg), 10**6, (10**6, 0), cfg.stop, Board(folder))
    runner.alg.train_mode()
    simulation, meter = env.fleet.simulation, Meter()
    if not isinstance(simulation, NativeSimulation):
        raise TypeError(f"the bare simulator is MuJoCo's Batch; the task runs on {type(simulation).__name__}")
    meter.watch(simulation.batch, "step", "bare")
    meter.watch(env, "step", "step")
    for method, name in {
        "act": "act",
        "process_env_step": "store",
        "compute_returns": "returns",
        "update": "update",
        "_supervise": "supervise",
    }.items():
        meter.watch(runner.alg, method, name)
    meter.watch(runner, "iterate", "iterate")
    return runner, meter


def measure_parts(
    cfg: TrainCfg, blocks: int, actuator: ActuatorNet | None = None, physics: Mapping[str, PhysicsCfg] = PHYSICS
) -> dict[str, dict[str, list[float]]]:
    """Return the CPU seconds of an iteration's parts, name of the physics -> part -> one number a block.

    cfg: the training; its physics is replaced. actuator: gives the joints' torque in place of the PD law.
    """
    torch.set_num_threads(num_threads())
    with tempfile.TemporaryDirectory() as folder:
        runners = {
            name: watched_runner(replace(cfg, task=replace(cfg.task, physics=option)), Path(folder), actuator)
            for name, option in physics.items()
        }
        found: dict[str, dict[str, list[float]]] = {name: {} for name in runners}
        for block in range(blocks + 1):
            for name, (runner, meter) in runners.items():
                runner.iterate()
                for part, seconds in meter.take().items():
                    if block:  # the first warms up
                        found[name].setdefault(part, []).append(seconds)
    return found


def parts_summary(found: Mapping[str, Mapping[str, list[float]]]) -> dict[str, dict[str, float]]:
    """Return the medians over the blocks, and ratios of paired blocks.

    `rollout_over_bare`, `iteration_over_bare`: what bare physics of the same kind takes, over what the rollout without
    its inference and the whole iteration take; `speedup`: the first physics' iteration over this one's.
    """
    summary = {}
    first = np.array(next(iter(found.values()))["iteration"])
    for name, parts in found.items():
        bare, task, whole = (np.array(parts[part]) for part in ("physics", "task", "iteration"))
        ratios = {
            "rollout_over_bare": bare / (bare + task),
            "iteration_over_bare": bare / whole,
            "speedup": first / whole,
        }
        medians = {part: float(np.median(seconds)) for part, seconds in parts.items()}
        summary[name] = medians | {ratio: float(np.median(values)) for ratio, values in ratios.items()}
    return summary
