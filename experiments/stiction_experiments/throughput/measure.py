"""Throughput, measured side by side in one run: the task against the bare simulator on the same states and threads.

The replay has the states and the controls of every step (joint targets; the last physics step's torques where an
Actuator Net gives them), and the robots' parameters (friction, masses, gains) of the end of the block. A robot that
ends an episode within the block has other parameters from then on, so its earlier steps are replayed with its later
ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch

from stiction.core.provenance import num_threads, stream_seed
from stiction.core.rotation import UPRIGHT
from stiction.core.scratch import scratch
from stiction.deploy.plausibility import command_range
from stiction.deploy.robot_policy import load_robot_policy
from stiction.files.bundle import read_bundle
from stiction.joints.net import ActuatorNet
from stiction.learning.begin import find_simulator
from stiction.learning.boards import open_board
from stiction.learning.config import TrainCfg
from stiction.learning.phase import PhaseRunner, one_torch_thread
from stiction.learning.run import RunDirectory
from stiction.learning.runner import multiply_adds, ppo_cfg
from stiction.robots.mjcf import build
from stiction.robots.model import Robot
from stiction.robots.physics import EXACT, FAST, PhysicsCfg
from stiction.robots.terrain import REACH, STEPS, half_sizes, stair_height
from stiction.sim.native import NativeSimulation
from stiction.task.env import LocomotionEnv


@dataclass(frozen=True)
class Timing:
    """Env-steps per second of the three things timed, one entry a block, all blocks in one run."""

    bare: tuple[float, ...]
    """`Batch.step` alone, replaying the block's states and controls; empty where MuJoCo Warp simulates."""
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
            ratios = {f"{name}_ratio": spread(rates[name] / rates["bare"]) for name in ("rollout", "iteration")}
        return {
            **{name: ratios[name]["median"] if ratios else None for name in ("rollout_ratio", "iteration_ratio")},
            "spread": ratios,
            "env_steps_per_second": {name: spread(values) for name, values in rates.items()},
        }


def _native(env: LocomotionEnv) -> NativeSimulation:
    simulation = env.fleet.simulation
    if not isinstance(simulation, NativeSimulation):
        raise TypeError(f"the bare simulator is MuJoCo's Batch; the task runs on {type(simulation).__name__}")
    return simulation


def _timed_rollout(
    env: LocomotionEnv, actions: torch.Tensor, replayed: bool
) -> tuple[float, list[dict[str, np.ndarray]]]:
    """Step the task with `actions`, (steps, N, joints); return the seconds of `step` alone and each state before it.

    Where nobody replays them there are no states; on a GPU the time is that until it has done all its work.
    """
    states: list[dict[str, Any]] = []
    seconds = 0.0
    with torch.no_grad(), one_torch_thread():
        for action in actions:
            before = env.robots.state() if replayed else {}
            start = time.perf_counter()
            env.step(action)
            seconds += time.perf_counter() - start
            if replayed:
                states.append(before | {"ctrl": env.fleet.simulation.bind("ctrl").copy()})
        start = time.perf_counter()
        # A copy to the host waits for all that the device was given.
        env.get_observations()["privileged"].cpu()
        seconds += time.perf_counter() - start
    return seconds, states


def _timed_replay(env: LocomotionEnv, states: list[dict[str, np.ndarray]]) -> float:
    """Replay the states through the bare batch; return the seconds of its `step` alone.

    The simulation's state is put back. Derived fields (torques, contacts) are those of the replay until the task's
    next step computes them anew; its stored observation does not change.
    """
    simulation, seconds = _native(env), 0.0
    after = simulation.state()
    for state in states:
        simulation.load_state(state)
        start = time.perf_counter()
        simulation.batch.step(nstep=env.fleet.decimation)
        seconds += time.perf_counter() - start
    simulation.load_state(after)
    return seconds


def _teacher_runner(cfg: TrainCfg, folder: Path, actuator: ActuatorNet | None) -> PhaseRunner:
    """Return a teacher's runner on a task of its own; nothing is written but what it logs, to `folder`."""
    torch.manual_seed(stream_seed(cfg.seed, "bench"))
    device, seed = find_simulator(cfg), stream_seed(cfg.seed, "environment")
    env = LocomotionEnv(cfg.task, cfg.num_envs, seed, num_threads(), device=device, actuator=actuator)
    board = open_board(folder, cfg)
    # No checkpoint and no clip comes due within a measurement.
    runner = PhaseRunner("teacher", env, RunDirectory(folder), ppo_cfg(cfg), 10**6, (10**6, 0), cfg.stop, board)
    runner.alg.train_mode()
    return runner


def measure_training(cfg: TrainCfg, blocks: int, actuator: ActuatorNet | None = None) -> tuple[Timing, dict[str, int]]:
    """Time `blocks` paired blocks of one rollout each; return the timing and the networks' multiply-adds per env-step.

    Each block times the task, then, on the processor, the bare simulator on the states that the task went through, then
    one training iteration. `actuator`: gives the torque in the task; the bare simulator has none.
    """
    torch.set_num_threads(num_threads())
    with scratch() as folder:
        runner = _teacher_runner(cfg, folder, actuator)
        env, steps = runner.env, cfg.teacher.steps * cfg.num_envs
        seconds: dict[str, list[float]] = {"bare": [], "rollout": [], "iteration": []}
        runner.iterate()
        for _ in range(blocks):
            actions = cfg.network.initial_std * torch.randn(cfg.teacher.steps, cfg.num_envs, env.num_actions)
            rollout, states = _timed_rollout(env, actions, cfg.device == "cpu")
            seconds["rollout"].append(rollout)
            if cfg.device == "cpu":
                seconds["bare"].append(_timed_replay(env, states))
            start = time.perf_counter()
            runner.iterate()
            seconds["iteration"].append(time.perf_counter() - start)
        rates = {name: tuple(steps / value for value in values) for name, values in seconds.items()}
        return Timing(**rates), multiply_adds(runner)


def measure_runtime(bundle: Path) -> dict[str, float]:
    """Time the deployed policy, one robot, sensors in, checked, and joint targets out [ms].

    Returns the median, the 99th percentile and the worst.
    """
    data = read_bundle(bundle)
    contract = data.contract
    policy = load_robot_policy(data, contract.joint_names)
    rng = np.random.default_rng(0)
    joints, low, high = contract.num_joints, *command_range(contract)
    spent = []
    for number in range(3000):
        noise = 0.02 * rng.standard_normal((2, joints))
        reading = {
            "quaternion": UPRIGHT,
            "angular_velocity": noise[0, :3],
            "joint_position": contract.array("standing") + noise[0],
            "joint_velocity": noise[1],
            "command": (low + high) / 2,
        }
        start = time.perf_counter()
        policy.step(number * contract.control_period, **reading)
        spent.append(1e3 * (time.perf_counter() - start))
    warm = np.array(spent[100:])
    return {"p50": float(np.median(warm)), "p99": float(np.percentile(warm, 99)), "max": float(warm.max())}


STEP = 0.10
"""Height of a step [m]."""

CELL = 0.02
"""Cell of the height fields along x [m]: a riser leans by this much over its height."""

GROUNDS = ("plane", "boxes", "height field, wide cells", "height field, square cells")
"""Measured grounds; the others are compared with the first. Square cells fit any ground, wide ones steps along x."""


def ground_model(spec: Robot, ground: str) -> mujoco.MjModel:
    """Return a robot on one of `GROUNDS`; the steps go along x, and are as wide as the square stairs."""
    model = build(spec, 0.005)
    if ground == "boxes":
        for number, (half, _, thick) in enumerate(half_sizes("stairs")):
            top = STEP * (number + 1)
            kind = mujoco.mjtGeom.mjGEOM_BOX
            model.worldbody.add_geom(type=kind, size=[half, REACH, thick], pos=[0.0, 0.0, top - thick])
    elif ground != "plane":
        # MuJoCo stretches heights from the lowest to the highest: there must be ground at zero.
        half = REACH + CELL
        columns = round(2 * half / CELL) + 1
        rows = columns if "square" in ground else 2
        along = np.linspace(-half, half, columns)
        profile = stair_height(np.stack((along, np.zeros(columns)), -1)[None], np.array([[STEP]]))[0]
        top = STEP * STEPS
        model.add_hfield(
            name="stairs",
            size=[half, half, top, 0.1],
            nrow=rows,
            ncol=columns,
            userdata=np.tile(profile / top, rows).tolist(),
        )
        model.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="stairs")
    return model.compile()


def measure_grounds(spec: Robot, num: int, blocks: int, threads: int) -> dict[str, Any]:
    """Return control steps a second on every ground, by block and as medians, and their ratios to the plane's.

    The robots stand all over the stairs and follow the same random targets; each block goes through all grounds in
    turn, so that a busy machine slows all of them.
    """
    rng = np.random.default_rng(0)
    position = rng.uniform(-REACH, REACH, (num, 2)) * (1.0, 0.5)
    batches = {name: Batch(ground_model(spec, name), nsim=num, nthread=threads) for name in GROUNDS}
    for name, batch in batches.items():
        _stand(batch, name, position)
    rates: dict[str, list[float]] = {name: [] for name in GROUNDS}
    for _ in range(blocks):
        noise = rng.standard_normal((20, num, spec.num_joints))
        for name, batch in batches.items():
            targets, standing = batch.bind("ctrl"), spec.joint_values("default_position")
            start = time.perf_counter()
            for step in noise:
                targets[:] = standing + 0.5 * spec.action_scale * step
                batch.step(nstep=4)
            rates[name].append(len(noise) * num / (time.perf_counter() - start))
    medians = {name: float(np.median(values)) for name, values in rates.items()}
    paired = {name: np.array(rates[name]) / np.array(rates["plane"]) for name in GROUNDS}
    return {
        "control_steps_per_second": medians,
        "over_plane": {name: float(np.median(ratio)) for name, ratio in paired.items()},
        "spread": {name: [float(ratio.min()), float(ratio.max())] for name, ratio in paired.items()},
    }


def _stand(batch: Batch, ground: str, position: np.ndarray) -> None:
    """Put every robot onto the highest ground under its trunk, standing; position: x, y [m], shape (N, 2)."""
    batch.reset(np.arange(len(position)), keyframe=0)
    pose = batch.bind("qpos")
    pose[:, :2] = position
    if ground != "plane":
        along = position[:, :1] + np.array([-0.4, -0.2, 0.0, 0.2, 0.4])
        under = np.stack((along, np.zeros_like(along)), -1)
        pose[:, 2] += stair_height(under, np.full((len(position), 1), STEP)).max(axis=1) + 0.01


PHYSICS = {
    "rows": EXACT,
    "rows, impedance 0.9": PhysicsCfg(impedance=0.9),
    "plastic, Newton": PhysicsCfg("plastic", solver="newton"),
    "plastic": FAST,
}
"""Compared physics, that of every evaluation first."""


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
    runner, meter = _teacher_runner(cfg, folder, actuator), Meter()
    for owner, method, name in (
        (_native(runner.env).batch, "step", "bare"),
        (runner.env, "step", "step"),
        (runner.alg, "act", "act"),
        (runner.alg, "process_env_step", "store"),
        (runner.alg, "compute_returns", "returns"),
        (runner.alg, "update", "update"),
        (runner.alg, "_supervise", "supervise"),
        (runner, "iterate", "iterate"),
    ):
        meter.watch(owner, method, name)
    return runner, meter


def measure_parts(cfg: TrainCfg, blocks: int, actuator: ActuatorNet | None = None) -> dict[str, dict[str, list[float]]]:
    """Return the CPU seconds of an iteration's parts, name in `PHYSICS` -> part -> one number a block.

    cfg: the training; its physics is replaced. actuator: gives the joints' torque in place of the PD law.
    """
    torch.set_num_threads(num_threads())
    with scratch() as folder:
        runners = {
            name: watched_runner(replace(cfg, task=replace(cfg.task, physics=option)), folder, actuator)
            for name, option in PHYSICS.items()
        }
        seconds_by_runner: dict[str, dict[str, list[float]]] = {name: {} for name in runners}
        for block in range(blocks + 1):
            for name, (runner, meter) in runners.items():
                runner.iterate()
                for part, seconds in meter.take().items():
                    if block:  # the first warms up
                        seconds_by_runner[name].setdefault(part, []).append(seconds)
    return seconds_by_runner


def parts_summary(measured: Mapping[str, Mapping[str, list[float]]]) -> dict[str, dict[str, float]]:
    """Return the medians over the blocks, and ratios of paired blocks.

    `rollout_over_bare`, `iteration_over_bare`: what bare physics of the same kind takes, over what the rollout without
    its inference and the whole iteration take; `speedup`: the first physics' iteration over this one's.
    """
    summary = {}
    first = np.array(next(iter(measured.values()))["iteration"])
    for name, parts in measured.items():
        bare, task, whole = (np.array(parts[part]) for part in ("physics", "task", "iteration"))
        ratios = {
            "rollout_over_bare": bare / (bare + task),
            "iteration_over_bare": bare / whole,
            "speedup": first / whole,
        }
        medians = {part: float(np.median(seconds)) for part, seconds in parts.items()}
        summary[name] = medians | {ratio: float(np.median(values)) for ratio, values in ratios.items()}
    return summary
