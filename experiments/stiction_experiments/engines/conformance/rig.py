"""Common to the checks: figures with tolerances, a robot that is driven and recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from stiction.core.rotation import UPRIGHT
from stiction.engines.engine import Body, Engine, Make, Motion
from stiction.engines.ground import Ground, flat
from stiction.robots.model import Robot

Act = Callable[[int, Motion], tuple[np.ndarray, np.ndarray]]
"""Number of a step and the motion before it -> torques and bounds of friction [N m], shape (J,)."""

HELD = 1e4
"""Bound of friction of a locked joint [N m]."""


@dataclass(frozen=True)
class Figure:
    """One measured number and its tolerance."""

    name: str
    value: float
    """Measured error; zero is perfect."""
    unit: str
    """Its unit, `1` for a ratio."""
    tolerance: float

    @property
    def passed(self) -> bool:
        """Return whether the figure is within its tolerance; NaN is not."""
        return bool(abs(self.value) <= self.tolerance)

    def __str__(self) -> str:
        """Return the figure as people read it."""
        verdict = "" if self.passed else "  FAILED"
        return f"{self.name}: {self.value:.3g} {self.unit} (within {self.tolerance:g}){verdict}"


Check = Callable[[Make, Robot, float], tuple[Figure, ...]]
"""Measures one thing of an engine: what makes it, the robot, timestep [s] -> figures."""


DAMPING = 0.05
"""Viscous friction of joints that have none by the data sheet [N m s/rad]: what decays has an exact solution then."""


def outermost(spec: Robot) -> int:
    """Return the number of the last joint that carries no other: the one that is tested alone."""
    carriers = {link.parent for link in spec.links}
    return max(number for number in range(spec.num_joints) if number not in carriers)


def test_friction(spec: Robot) -> float:
    """Return the dry friction that joints are tested with [N m]: the outermost's, or 1 % of its torque limit."""
    joint = spec.joints[outermost(spec)]
    return joint.frictionloss or 0.01 * joint.torque_limit


def on_stand(spec: Robot) -> Body:
    """Return the robot bolted to a stand."""
    body = Body.nominal(spec, fixed=True)
    return replace(body, damping=np.where(body.damping > 0, body.damping, DAMPING))


def record(engine: Engine, steps: int, act: Act) -> Motion:
    """Drive an engine and return its motion before, between and after the steps, stacked: shapes (steps + 1, ...)."""
    motions = [engine.motion()]
    for number in range(steps):
        engine.step(*act(number, motions[-1]))
        motions.append(engine.motion())
    return Motion(**{part.name: np.stack([getattr(m, part.name) for m in motions]) for part in fields(Motion)})


def drive(
    make: Make,
    body: Body,
    timestep: float,
    seconds: float,
    act: Act,
    position: float | np.ndarray,
    quaternion: np.ndarray = UPRIGHT,
    angles: np.ndarray | None = None,
    ground: Ground | None = None,
) -> Motion:
    """Drive a robot in an engine of its own; return its motion as `record` does.

    position: of its base [m], or the height alone; angles: of its joints [rad], by default of the standing pose;
    ground: by default the plane.
    """
    engine = make(body, flat() if ground is None else ground, timestep)
    start = np.array([0.0, 0.0, position]) if np.ndim(position) == 0 else np.asarray(position)
    engine.reset(body.spec.joint_values("default_position") if angles is None else angles, start, quaternion)
    return record(engine, round(seconds / timestep), act)


def hold(body: Body, target: np.ndarray) -> Act:
    """Return joint controllers with the robot's gains and no friction, that hold joint angles [rad], shape (J,)."""
    kp, kd, limit = (body.spec.joint_values(name) for name in ("kp", "kd", "torque_limit"))

    def act(number: int, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
        torque = kp * (target - motion.joint_position) - kd * motion.joint_velocity
        return np.clip(torque, -limit, limit), np.zeros(len(target))

    return act


def still(body: Body) -> Act:
    """Return locked joints: no torque, and friction that nothing overcomes."""
    count = body.spec.num_joints
    return lambda number, motion: (np.zeros(count), np.full(count, HELD))
