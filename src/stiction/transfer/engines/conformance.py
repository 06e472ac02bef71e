"""The suite that every engine passes before a result from it counts; public, for an engine of your own too.

Each check takes what makes an engine and a timestep, and returns figures: what was measured, and how large it may be.
Tolerances are the same for every engine. They are what an engine of first order in the timestep can reach at 2 ms, and
what soft contacts give way; they catch wrong inertias, axes, frames, orders and laws, which are off by far more. The
reference of free flight and of standing is MuJoCo with finer steps.

    for measured in conformance(partial(make_engine, "physx")):
        assert measured.figure.passed, f"{measured.check}: {measured.figure}"
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from stiction.formats.errors import StictionError
from stiction.transfer.engines.catalog import TIMESTEP
from stiction.transfer.engines.checks import contact, flight, joint, repeat, terrain
from stiction.transfer.engines.checks.rig import Figure, Make, hold, robot
from stiction.transfer.engines.engine import BlownUp, Body
from stiction.transfer.engines.ground import flat
from stiction.transfer.engines.rotation import UPRIGHT

CHECKS: dict[str, Callable[[Make, float], tuple[Figure, ...]]] = {
    "friction of one joint": joint.friction_of_one_joint,
    "friction under control": joint.friction_under_control,
    "changing friction": joint.changing_friction,
    "joint limit": joint.joint_limit,
    "joint order": flight.joint_order,
    "free flight": flight.free_flight,
    "base velocity": flight.base_velocity,
    "long fall": flight.long_fall,
    "hanging legs": flight.hanging_legs,
    "standing": contact.standing,
    "foot contact": contact.foot_contact,
    "on its back": contact.on_its_back,
    "terrain": terrain.terrain,
    "foot friction": terrain.foot_friction,
    "shank contact": terrain.shank_contact,
    "determinism": repeat.determinism,
}
"""Name -> what measures it."""


@dataclass(frozen=True)
class Measured:
    """A figure and the check that it belongs to."""

    check: str
    """Name of the check, one of `CHECKS`."""
    figure: Figure
    """What it measured."""


def conformance(make: Make, timestep: float = TIMESTEP) -> Iterator[Measured]:
    """Run every check on engines that `make(body, ground, timestep)` makes, and yield their figures one by one.

    A check in which the robot blows up yields one figure that is not a number, and so does not pass.

    Raises:
        StictionError: the checks cannot be run with such a timestep.

    """
    check_timestep(timestep)
    for name, check in CHECKS.items():
        try:
            figures = check(make, timestep)
        except BlownUp:
            figures = (Figure("robot that does not blow up", math.nan, "1", 0.0),)
        for figure in figures:
            yield Measured(name, figure)


def check_timestep(timestep: float) -> None:
    """Raise `StictionError` unless a tenth of a second has whole steps, and a step whole ones of the reference."""
    wholes = 0.1 / timestep if timestep > 0 else math.nan, timestep / flight.FINE
    if not all(math.isfinite(whole) and whole > 0.5 and abs(whole - round(whole)) < 1e-6 for whole in wholes):
        raise StictionError(
            f"conformance at a timestep of {timestep:g} s; expected a whole number of steps in 0.1 s, and of "
            f"{flight.FINE:g} s in a step: 0.001, 0.002, 0.005"
        )


def steps_per_second(make: Make, timestep: float = TIMESTEP, seconds: float = 2.0) -> float:
    """Return physics steps per second of processor time: the robot stands under its controllers, with dry friction.

    Motion is read at every step, as a controller does; `seconds`: simulated time.
    """
    spec = robot()
    body, angles = Body.nominal(spec), spec.joint_values("standing")
    engine = make(body, flat(), timestep)
    engine.reset(angles, np.array([0.0, 0.0, spec.standing_height]), UPRIGHT)
    act, friction = hold(body, angles), 0.1 * spec.joint_values("torque_limit")
    steps, start = round(seconds / timestep), time.process_time()
    for number in range(steps):
        engine.step(act(number, engine.motion())[0], friction)
    return steps / (time.process_time() - start)
