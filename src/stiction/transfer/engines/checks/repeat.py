"""The same robot does the same thing twice, bit by bit: in an engine made anew, and after a reset."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from stiction.transfer.engines.checks.rig import Figure, Make, hold, record, robot
from stiction.transfer.engines.engine import Body, Engine, Motion
from stiction.transfer.engines.ground import course
from stiction.transfer.engines.rotation import UPRIGHT

STEPS = 200
"""Steps that are compared."""


def determinism(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A robot that stumbles onto rough ground, three times."""
    body = Body.nominal(robot())
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
    angles = spec.joint_values("standing")
    engine.reset(angles, np.array([0.0, 0.0, spec.standing_height + 0.15]), UPRIGHT)

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        torque, _ = hold(engine.body, angles + 0.3 * noise[number])(number, motion)
        return torque, np.abs(noise[number])

    return record(engine, STEPS, act)


def _difference(one: Motion, other: Motion) -> float:
    """Return the largest difference of anything, in whatever unit."""
    pairs = [(getattr(one, part.name).astype(float), getattr(other, part.name)) for part in fields(Motion)]
    return max(float(np.abs(a - b).max()) for a, b in pairs)
