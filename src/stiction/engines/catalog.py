"""Registry of engines, and lookup by name.

A custom engine is an `EngineSpec` in any module, found as `package.module:VARIABLE`. Looking it up runs that module, so
such a name is typed by a user and never taken from a file. No engine's package is imported before the engine is made.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

from stiction.core.errors import EngineError, StictionError, unknown_name
from stiction.core.extras import outdated, remedy
from stiction.core.plugins import find_named
from stiction.engines.engine import Body, Engine, Make
from stiction.engines.ground import Ground, flat
from stiction.robots.model import Robot

TIMESTEP = 0.002
"""Physics step of the comparison of engines [s]; the bounds of the conformance suite are for it."""


@dataclass(frozen=True)
class EngineSpec:
    """Engine, by its name and factory."""

    name: str
    """Name, also in results; a custom one has `package.module:VARIABLE` instead."""
    make: Make
    """Function that makes a robot in it, from body, ground and timestep; imports its packages."""
    cost: float = 5.0
    """Time of a walk of one robot over MuJoCo's: long walks go first, so that no core waits at the end."""
    batched: bool = False
    """True if the training's batched simulator has the same name."""
    timestep: float = TIMESTEP
    """Physics step of evaluations [s]; virtual robots have theirs."""
    extra: str = ""
    """Extra of this package that installs it."""
    binaries: Callable[[], dict[str, str | None]] = dict
    """Function that returns the libraries loaded from outside Python packages: name -> SHA-256, None if not
    installed."""

    @property
    def alone(self) -> str:
        """Name of one robot in the engine if a batch has the plain name, as in results.csv: `mujoco-alone`."""
        return f"{self.name}-alone" if self.batched else self.name


def _made(path: str, body: Body, ground: Ground, timestep: float) -> Engine:
    """Return a robot in the engine of a class of this room, `module:CLASS`, imported on call."""
    module, _, name = path.partition(":")
    engine: Engine = getattr(import_module(f"stiction.engines.{module}"), name)(body, ground, timestep)
    return engine


def _libode() -> dict[str, str | None]:
    from stiction.engines.ode.library import library_digest

    return {"libode": library_digest()}


ENGINES = {
    spec.name: spec
    for spec in (
        EngineSpec("mujoco", partial(_made, "mujoco_engine:MujocoEngine"), cost=1.0, batched=True, extra="sim"),
        EngineSpec("physx", partial(_made, "physx:PhysxEngine"), cost=2.0, extra="engines"),
        EngineSpec("ode", partial(_made, "ode.engine:OdeEngine"), cost=6.0, extra="engines", binaries=_libode),
        EngineSpec(
            "ode-webots", partial(_made, "ode.engine:webots_engine"), cost=4.0, extra="engines", binaries=_libode
        ),
    )
}
"""The shipped engines by name."""


def find_engine(name: str) -> EngineSpec:
    """Return the engine called `name`, a shipped one or `package.module:VARIABLE`; raise `StictionError` for others."""
    if name in ENGINES:
        return ENGINES[name]
    if ":" not in name:
        message = unknown_name("engine", name, ENGINES)
        raise EngineError(f"{message}; give a custom one as package.module:VARIABLE")
    target = find_named("engine", name)
    if not isinstance(target, EngineSpec):
        raise EngineError(f"engine {name!r} is not an EngineSpec")
    return replace(target, name=name, batched=False)


def make_engine(name: str, body: Body, ground: Ground, timestep: float) -> Engine:
    """Return a robot in the engine called `name`, with its base at the origin until it is reset.

    timestep: of the physics [s].

    Raises `StictionError`: the engine is unknown, its package is not installed, or the timestep is out of range.
    """
    spec = find_engine(name)
    if not 0 < timestep <= 0.02:
        raise EngineError(f"physics step {timestep} s; expected more than 0 and at most 0.02 s")
    if spec.extra and (old := outdated(spec.extra)) is not None:
        raise EngineError(f"the engine {name!r}: {old}")
    try:
        return spec.make(body, ground, timestep)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("stiction"):
            raise
        how = f"; {remedy(spec.extra)}" if spec.extra else ""
        raise EngineError(f"the engine {name!r} needs the package {error.name}, which is not installed{how}") from error


def binaries(name: str) -> dict[str, str | None]:
    """Return `EngineSpec.binaries` of an engine, with the module's file of a custom one; for keys of a cache.

    Raises `StictionError` for an unknown engine.
    """
    libraries = find_engine(name).binaries()
    module, colon, _ = name.partition(":")
    file = sys.modules[module].__file__ if colon else None
    return libraries if file is None else libraries | {module: hashlib.sha256(Path(file).read_bytes()).hexdigest()}


def missing_engine(name: str, robot: Robot) -> str | None:
    """Return why a robot cannot run in an engine here, with a remedy, in one line; None if it can."""
    try:
        make_engine(name, Body.nominal(robot), flat(), TIMESTEP)
    except StictionError as error:
        return str(error)
    return None
