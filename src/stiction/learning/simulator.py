"""What a training simulates with: MuJoCo's batch on some device, or robots of another engine one after the other."""

from __future__ import annotations

from functools import partial

from stiction.core.errors import EngineError
from stiction.engines.batch import EngineBatch
from stiction.engines.catalog import what_is_missing
from stiction.learning.config import TrainCfg
from stiction.robots.catalog import find_robot
from stiction.task.device import Device, find_device, why_on_host


def why_task_on_host(cfg: TrainCfg) -> str | None:
    """Return what keeps the task of a training on the host, see `why_on_host`; None where nothing does."""
    return why_on_host(cfg.task, cfg.actuator is not None)


def find_simulator(cfg: TrainCfg, gpu: int = 0) -> Device:
    """Return the simulator of a training, and where its tensors are; `gpu`: number of the one to use, if any.

    Raises `StictionError` where this machine has no such device or engine, `ModuleNotFoundError` without the extra of
    the device.
    """
    if cfg.engine == "mujoco":
        return find_device(cfg.device, cfg.contacts, gpu, on_host=why_task_on_host(cfg) is not None)
    robot = find_robot(cfg.task.robot)
    if why := what_is_missing(cfg.engine, robot):
        raise EngineError(why)
    return Device("cpu", partial(EngineBatch, cfg.engine, robot))
