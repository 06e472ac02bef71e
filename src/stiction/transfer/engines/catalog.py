"""Finds an engine by name, and says in one line what is missing and how to get it."""

from __future__ import annotations

import importlib

from stiction.formats.errors import StictionError
from stiction.transfer.engines.engine import Body, Engine
from stiction.transfer.engines.ground import Ground

ENGINES = {
    "mujoco": ("stiction.transfer.engines.mujoco_engine", "MujocoEngine"),
    "physx": ("stiction.transfer.engines.physx", "PhysxEngine"),
    "ode": ("stiction.transfer.engines.ode", "OdeEngine"),
}
"""Name, as in results.csv -> module and class."""


def make_engine(name: str, body: Body, ground: Ground, timestep: float) -> Engine:
    module, kind = ENGINES[name]
    return getattr(importlib.import_module(module), kind)(body, ground, timestep)
