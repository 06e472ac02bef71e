"""Measure control steps a second on MuJoCo Warp: the bare simulator, with its arrays on the host, and the whole task.

    python scripts/gpu_throughput.py cuda 512,2048,4096 >> results/gpu/throughput.jsonl

One JSON line a number of robots: control steps of all robots a second, and milliseconds a control step. The first
number pays for the compilation of kernels (`first_seconds`). The thread count is that of `STICTION_THREADS`.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable

import torch
import warp as wp

from stiction.core.provenance import num_threads
from stiction.locomotion.config import TaskCfg
from stiction.locomotion.device import find_device
from stiction.locomotion.env import LocomotionEnv
from stiction.locomotion.friction import FrictionCfg
from stiction.rma.config import TrainCfg


def seconds(work: Callable[[], object], times: int) -> float:
    """Return the mean wall time of `work` [s], with the device's work finished."""
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(times):
        work()
    wp.synchronize()
    return (time.perf_counter() - start) / times


def measure(device: str, robots: int, times: int = 50) -> dict[str, float]:
    """Return the figures of a fleet of `robots` on flat ground with friction up to 24 % of the torque limit."""
    task = TaskCfg(friction=FrictionCfg(method="deception", level=0.2))
    env = LocomotionEnv(task, robots, 0, num_threads(), None, find_device(device, TrainCfg().contacts))
    simulation, steps = env.fleet.simulation, task.decimation
    start = time.perf_counter()
    for _ in range(4):
        env.step(torch.randn(robots, env.num_actions))
    first = time.perf_counter() - start
    parts = {
        "bare": lambda: simulation._launch(steps, lambda: simulation._advance(steps)),
        "simulator": lambda: simulation.step(steps),
        "task": lambda: env.step(0.3 * torch.randn(robots, env.num_actions)),
    }
    found: dict[str, float] = {"robots": robots, "threads": num_threads(), "first_seconds": round(first, 1)}
    for name, work in parts.items():
        each = seconds(work, times if name == "bare" else times // 4)
        found |= {f"{name}_per_second": round(robots / each), f"{name}_ms": round(1e3 * each, 2)}
    return found


if __name__ == "__main__":
    for count in sys.argv[2].split(","):
        print(json.dumps(measure(sys.argv[1], int(count))), flush=True)
