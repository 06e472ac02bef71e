"""Finds an engine by name, and says in one line what is missing and how to get it.

No engine's package is imported before one is asked for.
"""

from __future__ import annotations

import importlib
from typing import NamedTuple

from stiction.formats.errors import StictionError
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.engine import Body, Engine
from stiction.transfer.engines.ground import Ground, flat

TIMESTEP = 0.002
"""Physics step at which engines are compared [s]: the bounds of the conformance suite are made for it."""


class _Place(NamedTuple):
    """Where an engine is, and what installs what it needs."""

    module: str
    kind: str
    extra: str


ENGINES = {
    "mujoco": _Place("stiction.transfer.engines.mujoco_engine", "MujocoEngine", "sim"),
    "physx": _Place("stiction.transfer.engines.physx", "PhysxEngine", "engines"),
    "ode": _Place("stiction.transfer.engines.ode", "OdeEngine", "engines"),
    "ode-webots": _Place("stiction.transfer.engines.ode", "webots_engine", "engines"),
}
"""Name, as in results.csv -> module, what makes it of body, ground and timestep, extra."""


def make_engine(name: str, body: Body, ground: Ground, timestep: float) -> Engine:
    """Return a robot in the engine called `name`, standing at the origin's height zero until it is reset.

    timestep: of the physics [s].

    Raises:
        StictionError: there is no such engine, what it needs is not installed, or no physics takes such steps.

    """
    if name not in ENGINES:
        raise StictionError(f"engine {name!r} is unknown; expected one of {', '.join(ENGINES)}")
    if not 0 < timestep <= 0.02:
        raise StictionError(f"physics step {timestep} s; expected more than 0 and at most 0.02 s")
    place = ENGINES[name]
    try:
        return getattr(importlib.import_module(place.module), place.kind)(body, ground, timestep)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("stiction"):
            raise
        raise StictionError(
            f"the engine {name!r} needs the package {error.name}, which is not installed; "
            f"install it with: pip install 'stiction[{place.extra}]'"
        ) from error


def binaries(name: str) -> dict[str, str | None]:
    """Return what an engine loads that is part of no package: name -> SHA-256, None where it is not installed.

    What was walked is known by it, beside the code and the versions of packages.
    """
    if not name.startswith("ode"):
        return {}
    from stiction.transfer.engines.ode_library import library_digest

    return {"libode": library_digest()}


def what_is_missing(name: str, spec: RobotSpec) -> str | None:
    """Return why a robot cannot be had in an engine here and what to do, in one line; None where it can."""
    try:
        make_engine(name, Body.nominal(spec), flat(), TIMESTEP)
    except StictionError as error:
        return str(error)
    return None
