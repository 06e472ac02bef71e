"""Measure control steps a second on MuJoCo Warp: the bare simulator, with its arrays on the host, and the whole task.

    python tools/gpu_throughput.py cuda 512,2048,4096 > results/gpu/report/throughput.jsonl

One JSON line a number of robots: control steps of all robots a second, and milliseconds a control step, of `bare`
physics; of `simulator`, the same with its arrays brought to the host and back; of the task on the host (`host_task`);
and of that on the device (`task`). The first number pays for the compilation of kernels (`first_seconds`). The thread
count is that of `STICTION_THREADS`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import torch
import warp as wp

from stiction.core.provenance import num_threads
from stiction.learning.config import TrainCfg
from stiction.sim.warp import WarpSimulation
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.task_fleet import find_device


def seconds(work: Callable[[], object], times: int) -> float:
    """Return the mean wall time of `work` [s], with the device's work finished."""
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(times):
        work()
    wp.synchronize()
    return (time.perf_counter() - start) / times


def rate(name: str, robots: int, work: Callable[[], object], times: int) -> dict[str, float]:
    """Return control steps of all robots a second, and milliseconds a control step, of some work."""
    each = seconds(work, times)
    return {f"{name}_per_second": round(robots / each), f"{name}_ms": round(1e3 * each, 2)}


def make_robots(device: str, robots: int, on_host: bool, seed: int = 0) -> LocomotionEnv:
    """Return robots on flat ground with friction up to 24 % of the torque limit; `on_host`: their task."""
    task = TaskCfg(friction=FrictionCfg(method="deception", level=0.2))
    chosen_device = find_device(device, TrainCfg().contacts, on_host=on_host)
    return LocomotionEnv(task, robots, seed, num_threads(), None, chosen_device)


def walking(device: str, robots: int, on_host: bool) -> tuple[LocomotionEnv, Callable[[], object]]:
    """Return those robots, warmed up, and a control step."""
    env = make_robots(device, robots, on_host)
    actions = 0.3 * torch.randn(robots, env.num_actions, device=env.device)

    def step() -> object:
        return env.step(actions)

    for _ in range(4):
        step()
    return env, step


def measure(device: str, robots: int, times: int = 48) -> dict[str, float]:
    """Return the figures of a number of robots."""
    start = time.perf_counter()
    env, step = walking(device, robots, on_host=True)
    measured: dict[str, float] = {"robots": robots, "threads": num_threads()}
    measured["first_seconds"] = round(time.perf_counter() - start, 1)
    simulation, steps = env.fleet.simulation, env.cfg.decimation
    assert isinstance(simulation, WarpSimulation)
    measured |= rate("bare", robots, lambda: simulation._launch(steps, lambda: simulation._advance(steps)), times)
    measured |= rate("simulator", robots, lambda: simulation.step(steps), times // 4)
    measured |= rate("host_task", robots, step, times // 4)
    return measured | rate("task", robots, walking(device, robots, on_host=False)[1], times)


def numbers(text: str) -> list[int]:
    """Return whole numbers between commas."""
    return [int(part) for part in text.split(",")]


def main() -> None:
    """Print a line for each number of robots."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("device", help="of MuJoCo Warp and torch, such as cuda")
    parser.add_argument("robots", type=numbers, help="numbers of robots, such as 512,2048")
    asked = parser.parse_args()
    for count in asked.robots:
        print(json.dumps(measure(asked.device, count)), flush=True)


if __name__ == "__main__":
    main()
