"""Where training computes: the simulator, and the torch device beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import torch

from stiction.core.errors import EngineError
from stiction.sim.native import NativeSimulation
from stiction.sim.protocol import DeviceName, Simulation


@dataclass(frozen=True)
class Device:
    """A simulator, and the torch device beside it."""

    torch: str = "cpu"
    """Where observations are handed out and actions come from."""
    backend: Callable[[mujoco.MjModel, int, int], Simulation] = NativeSimulation
    """Makes the batched simulation from model, number and threads."""


CPU = Device()


def find_device(name: DeviceName, contacts: int, gpu: int = 0) -> Device:
    """Return a device by its name on the command line; `contacts`: room for them, a robot, where it must be fixed;
    `gpu`: its number.

    Raises `StictionError` where this machine has no such device, `ModuleNotFoundError` without the extra `gpu`.
    """
    if name == "cpu":
        return CPU
    from stiction.sim.warp import WarpSimulation, cuda_device

    if name == "warp-cpu":
        return Device("cpu", partial(WarpSimulation, contacts=contacts))
    device = cuda_device(gpu)
    if not torch.cuda.is_available():
        raise EngineError(
            f"torch {torch.__version__} finds no CUDA device, though MuJoCo Warp does; install a build of torch for "
            "your driver (https://pytorch.org), or train with --device cpu"
        )
    return Device("cuda", partial(WarpSimulation, device=device, contacts=contacts))
