"""Where training computes: the simulator, the torch device beside it, and whether the task is there too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import mujoco
import torch

from stiction.core.errors import EngineError
from stiction.files.method import find_method
from stiction.sim.native import NativeSimulation
from stiction.sim.protocol import DeviceName, Simulation
from stiction.task.config import TaskCfg
from stiction.task.task_fleet import TaskFleet


@dataclass(frozen=True)
class Device:
    """A simulator, and the torch device beside it."""

    torch: str = "cpu"
    """Where observations are handed out and actions come from."""
    backend: Callable[[mujoco.MjModel, int, int], Simulation] = NativeSimulation
    """Makes the batched simulation of a task on the host, from model, number and threads."""
    fleet: Callable[..., TaskFleet] | None = None
    """Makes the robots of a task on the device, from robot, number, physics step, decimation and `PhysicsCfg`; None:
    the task is on the host."""


CPU = Device()


def why_on_host(task: TaskCfg, netted: bool = False) -> str | None:
    """Return what of a task the fleet on a device does not have, for which the task stays on the host; None: nothing.

    `netted`: an Actuator Net gives the joints' torque.
    """
    method = find_method(task.friction.method)
    lacking = {
        f"terrain {task.terrain.kind!r}": task.terrain.kind != "flat",
        f"the friction law {task.friction.law!r}": bool(task.friction.joint_law.spec.reads),
        "friction that grows with load": task.friction.load is not None,
        "an Actuator Net": netted,
        f"the method {method.name!r}": method.acts_on_fleet,
    }
    return " and ".join(name for name, asked in lacking.items() if asked) or None


def find_device(name: DeviceName, contacts: int, gpu: int = 0, on_host: bool = True) -> Device:
    """Return a device by its name on the command line; `contacts`: room for them, a robot, where it must be fixed;
    `gpu`: its number; `on_host`: the task stays on the host, where only the simulator is on the device.

    Raises `StictionError` where this machine has no such device, `ModuleNotFoundError` without the extra `gpu`.
    """
    if name == "cpu":
        return CPU
    from stiction.sim.torch_fleet import TorchFleet
    from stiction.sim.warp import WarpSimulation
    from stiction.sim.worlds import cuda_device

    def computing(where: str, device: str) -> Device:
        fleet = None if on_host else partial(TorchFleet, device=device, contacts=contacts)
        return Device(where, partial(WarpSimulation, device=device, contacts=contacts), fleet)

    if name == "warp-cpu":
        return computing("cpu", "cpu")
    device = cuda_device(gpu)
    if not torch.cuda.is_available():
        raise EngineError(
            f"torch {torch.__version__} finds no CUDA device, though MuJoCo Warp does; install a build of torch for "
            "your driver (https://pytorch.org), or train with --device cpu"
        )
    return computing("cuda", device)
