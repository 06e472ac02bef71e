"""The suite that every engine must pass; public, for an engine of your own too.

Tolerances are the same for every engine: what an engine of first order in the timestep reaches at 2 ms, and the
softness of contacts. They catch wrong inertias, axes, frames, orders and laws, which are off by far more.

    for measured in conformance(partial(make_engine, "physx"), find_robot("go1")):
        assert measured.figure.passed, f"{measured.check}: {measured.figure}"
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from stiction.core.errors import ConfigurationError, RobotError
from stiction.core.rotation import UPRIGHT
from stiction.engines.catalog import TIMESTEP
from stiction.engines.engine import BlownUp, Body, Engine, Make, Motion
from stiction.engines.ground import course, flat
from stiction.robots.model import Robot
from stiction_experiments.engines.conformance import contact, flight, joint
from stiction_experiments.engines.conformance.rig import Check, Figure, hold, record

STEPS = 200
"""Steps that are compared."""


def determinism(make: Make, spec: Robot, timestep: float) -> tuple[Figure, ...]:
    """A robot that stumbles onto rough ground, three times."""
    body = Body.nominal(spec)
    ground = course("rough", 0.1)
    engine = make(body, ground, timestep)
    first, again = _stumble(engine), _stumble(engine)
    anew = _stumble(make(body, ground, timestep))
    return (
        Figure("after a reset", _difference(first, again), "1", 0.0),
        Figure("in an engine made anew", _difference(first, anew), "1", 0.0),
    )


def _stumble(engine: Engine) -> Motion:
    """Return the motion of a robot that falls onto the ground, follows noise, and has friction that changes."""
    spec = engine.body.spec
    noise = np.random.default_rng(0).standard_normal((STEPS, spec.num_joints))
    angles = spec.joint_values("default_position")
    engine.reset(angles, np.array([0.0, 0.0, spec.standing_height + 0.15]), UPRIGHT)

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        torque, _ = hold(engine.body, angles + 0.3 * noise[number])(number, motion)
        return torque, np.abs(noise[number])

    return record(engine, STEPS, act)


def _difference(one: Motion, other: Motion) -> float:
    """Return the largest difference of anything, in whatever unit."""
    pairs = [(getattr(one, part.name).astype(float), getattr(other, part.name)) for part in fields(Motion)]
    return max(float(np.abs(a - b).max()) for a, b in pairs)


CHECKS: dict[str, Check] = {
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
    "terrain": contact.terrain,
    "foot friction": contact.foot_friction,
    "shank contact": contact.shank_contact,
    "determinism": determinism,
}
"""Name -> what measures it."""


@dataclass(frozen=True)
class Measured:
    """A figure of a check."""

    check: str
    """Name of the check, one of `CHECKS`."""
    figure: Figure


def conformance(make: Make, spec: Robot, timestep: float = TIMESTEP) -> Iterator[Measured]:
    """Run every check on a robot in engines that `make(body, ground, timestep)` makes; yield the figures one by one.

    A check in which the robot blows up yields one figure that is NaN, and so does not pass. Raises `StictionError`
    where the checks cannot be run with such a timestep or robot.
    """
    check_timestep(timestep)
    if len(spec.feet) <= contact.CARRIERS and not contact.has_soles(spec):
        raise RobotError(
            f"conformance with the robot {spec.name!r}: it has {len(spec.feet)} feet; expected at least "
            f"{contact.CARRIERS + 1}, or two with soles: it stands on all but one"
        )
    for name, check in CHECKS.items():
        try:
            figures = check(make, spec, timestep)
        except BlownUp:
            figures = (Figure("robot that does not blow up", math.nan, "1", 0.0),)
        for figure in figures:
            yield Measured(name, figure)


def check_timestep(timestep: float) -> None:
    """Raise `StictionError` unless a tenth of a second has whole steps, and a step whole ones of the reference."""
    wholes = 0.1 / timestep if timestep > 0 else math.nan, timestep / flight.FINE
    if not all(math.isfinite(whole) and whole > 0.5 and abs(whole - round(whole)) < 1e-6 for whole in wholes):
        raise ConfigurationError(
            f"conformance at a timestep of {timestep:g} s; expected a whole number of steps in 0.1 s, and of "
            f"{flight.FINE:g} s in a step: 0.001, 0.002, 0.005"
        )


def steps_per_second(make: Make, spec: Robot, timestep: float = TIMESTEP, seconds: float = 2.0) -> float:
    """Return physics steps, each with a reading of the motion, per second of processor time of a standing robot.

    seconds: simulated time.
    """
    body, angles = Body.nominal(spec), spec.joint_values("default_position")
    engine = make(body, flat(), timestep)
    engine.reset(angles, np.array([0.0, 0.0, spec.standing_height]), UPRIGHT)
    act, friction = hold(body, angles), 0.1 * spec.joint_values("torque_limit")
    steps, start = round(seconds / timestep), time.process_time()
    for number in range(steps):
        engine.step(act(number, engine.motion())[0], friction)
    return steps / (time.process_time() - start)
