"""Throughput, measured side by side in one run: the task against the bare simulator on the same states and threads.

The replay has the states and the controls of every step (joint targets; the last physics step's torques where an
Actuator Net gives them), and the robots' parameters (friction, masses, gains) as
they are when the block ends: keeping every robot's parameters at every step would cost more than what is measured. A
robot that ends an episode within the block is drawn anew then, so its earlier steps are replayed with its later
parameters, and the step that ended the episode with standing targets.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from stiction.deploy.observation import Sensors
from stiction.deploy.policy import load_policy
from stiction.formats.actuator import ActuatorNet
from stiction.formats.bundle import read_bundle
from stiction.formats.reproducibility import num_threads, stream_seed
from stiction.locomotion.device import find_device
from stiction.locomotion.env import LocomotionEnv
from stiction.locomotion.friction import FrictionMethod
from stiction.rma.board import Board
from stiction.rma.config import TrainCfg
from stiction.rma.phase import PhaseRunner, torch_threads
from stiction.rma.run import RunDirectory
from stiction.rma.runner import multiply_adds, ppo_cfg
from stiction.sim.native import NativeSimulation
from stiction.transfer.engines.rotation import UPRIGHT


@dataclass(frozen=True)
class Timing:
    """Env-steps per second of the three things timed, one entry a block, all blocks in one run."""

    bare: tuple[float, ...]
    """`Batch.step` alone, replaying the block's states and controls with the parameters of its end; empty where
    MuJoCo Warp simulates: it has no counterpart on the same threads, and no ratio is given."""
    rollout: tuple[float, ...]
    """`LocomotionEnv.step`: observations, rewards, resets and randomisation on."""
    iteration: tuple[float, ...]
    """A whole teacher iteration: policy, rollout, update."""

    def summary(self) -> dict[str, Any]:
        """Return medians and the ratios of paired blocks, with their spread."""

        def spread(values: np.ndarray) -> dict[str, float]:
            return {"min": float(values.min()), "median": float(np.median(values)), "max": float(values.max())}

        rates = {name: np.array(values) for name, values in vars(self).items() if values}
        ratios = {}
        if self.bare:
            ratios = {f"{name}_ratio": rates[name] / rates["bare"] for name in ("rollout", "iteration")}
        return {
            **{
                name: float(np.median(ratios[name])) if ratios else None
                for name in ("rollout_ratio", "iteration_ratio")
            },
            "spread": {name: spread(ratio) for name, ratio in ratios.items()},
            "env_steps_per_second": {name: spread(values) for name, values in rates.items()},
        }


def _timed_rollout(env: LocomotionEnv, actions: torch.Tensor) -> tuple[float, list[dict[str, np.ndarray]]]:
    """Step the task with `actions`, (steps, N, joints); return the seconds of `step` alone and each state before it."""
    states, seconds = [], 0.0
    with torch.no_grad(), torch_threads(1):
        for action in actions:
            before, control = env.fleet.simulation.state(), env.fleet.simulation.bind("ctrl")
            start = time.perf_counter()
            env.step(action)
            seconds += time.perf_counter() - start
            states.append(before | {"ctrl": control.copy()})
    return seconds, states


def _timed_replay(env: LocomotionEnv, states: list[dict[str, np.ndarray]]) -> float:
    """Replay the states through the bare batch; return the seconds of its `step` alone.

    The simulation's state is put back. Derived fields (torques, contacts) are those of the replay until the task's
    next step computes them anew; its stored observation does not change.
    """
    simulation, seconds = env.fleet.simulation, 0.0
    if not isinstance(simulation, NativeSimulation):
        raise TypeError(f"the bare simulator is MuJoCo's Batch; the task runs on {type(simulation).__name__}")
    after = simulation.state()
    for state in states:
        simulation.load_state(state)
        start = time.perf_counter()
        simulation.batch.step(nstep=env.fleet.decimation)
        seconds += time.perf_counter() - start
    simulation.load_state(after)
    return seconds


def measure_training(cfg: TrainCfg, blocks: int, actuator: ActuatorNet | None = None) -> tuple[Timing, dict[str, int]]:
    """Time `blocks` paired blocks of one rollout each; return the timing and the networks' multiply-adds per env-step.

    Each block times the task, then, on the processor, the bare simulator on the states that the task went through, then
    one training iteration. `actuator`: gives the torque in the task; the bare simulator has none.
    """
    threads = num_threads()
    torch.set_num_threads(threads)
    torch.manual_seed(stream_seed(cfg.seed, "bench"))
    device, seed = find_device(cfg.device, cfg.contacts), stream_seed(cfg.seed, "environment")
    env = LocomotionEnv(cfg.task, cfg.num_envs, seed, threads, device=device, actuator=actuator)
    with tempfile.TemporaryDirectory() as folder:
        run, board = RunDirectory(Path(folder)), Board(Path(folder))
        runner = PhaseRunner("teacher", env, run, ppo_cfg(cfg), 10**6, (10**6, 0), cfg.stop, board)
        runner.alg.train_mode()
        steps = cfg.teacher.steps * cfg.num_envs
        seconds: dict[str, list[float]] = {"bare": [], "rollout": [], "iteration": []}
        runner.iterate()
        for _ in range(blocks):
            actions = cfg.network.initial_std * torch.randn(cfg.teacher.steps, cfg.num_envs, env.num_actions)
            rollout, states = _timed_rollout(env, actions)
            seconds["rollout"].append(rollout)
            if cfg.device == "cpu":
                seconds["bare"].append(_timed_replay(env, states))
            start = time.perf_counter()
            runner.iterate()
            seconds["iteration"].append(time.perf_counter() - start)
        rates = {name: tuple(steps / value for value in values) for name, values in seconds.items()}
        return Timing(**rates), multiply_adds(runner)


def measure_runtime(bundle: Path, steps: int = 3000) -> dict[str, float]:
    """Time the deployed policy, one robot, sensors in and joint targets out [ms]: median, 99th percentile, worst."""
    data = read_bundle(bundle)
    policy = load_policy(data.contract, data.policy)
    rng = np.random.default_rng(0)
    joints, command = data.contract.num_joints, np.array([0.5, 0.0, 0.0])
    spent = []
    for _ in range(steps):
        noise = 0.1 * rng.standard_normal((2, joints))
        sensors = Sensors(UPRIGHT, noise[0, :3], noise[0], noise[1])
        start = time.perf_counter()
        policy.step(sensors, command)
        spent.append(1e3 * (time.perf_counter() - start))
    warm = np.array(spent[100:])
    return {"p50": float(np.median(warm)), "p99": float(np.percentile(warm, 99)), "max": float(warm.max())}


def bench_cfg(cfg: TrainCfg, method: FrictionMethod, level: float) -> TrainCfg:
    """Return `cfg` with the friction that the bench runs under."""
    friction = replace(cfg.task.friction, method=method, level=level)
    return replace(cfg, task=replace(cfg.task, friction=friction))
