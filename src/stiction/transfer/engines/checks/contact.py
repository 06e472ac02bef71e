"""The robot on its feet: where it stands, which feet touch, and what the ground bears.

Locked joints make it a rigid table, whose height is known; under its controllers it is compared with fine MuJoCo.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from stiction.transfer.engines.checks.rig import Act, Figure, Make, hold, record, robot, still
from stiction.transfer.engines.engine import Body, Motion
from stiction.transfer.engines.ground import flat
from stiction.transfer.engines.mujoco_engine import MujocoEngine
from stiction.transfer.engines.rotation import UPRIGHT, about, angle_between

FINE = 5e-4
"""Timestep of the reference [s]."""

SECONDS = 1.0
"""How long the robot stands [s]."""

LANDED = 0.2
"""From then on contacts are judged [s]: before, the robot settles."""

RAISED = (0.5, -0.8)
"""What bends thigh and knee of a leg that is lifted [rad]."""


def stand(make: Make, timestep: float, act: Act, angles: np.ndarray) -> Motion:
    """Return the robot put down on the plane with these joint angles [rad], (J,), step by step."""
    spec = robot()
    engine = make(Body.nominal(spec), flat(), timestep)
    engine.reset(angles, np.array([0.0, 0.0, spec.standing_height]), UPRIGHT)
    return record(engine, round(SECONDS / timestep), act)


@cache
def reference() -> Motion:
    """Return how fine MuJoCo stands under its controllers."""
    spec = robot()
    angles = spec.joint_values("standing")
    return stand(MujocoEngine, FINE, hold(Body.nominal(spec), angles), angles)


def standing(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A table of six legs, then the robot under its controllers."""
    spec = robot()
    body, angles = Body.nominal(spec), spec.joint_values("standing")
    table = stand(make, timestep, still(body), angles)
    motion, truth = stand(make, timestep, hold(body, angles), angles), reference()
    down = round(LANDED / timestep)
    return (
        Figure("height, joints locked", float(table.base_position[-1, 2] - spec.standing_height), "m", 3e-3),
        Figure("drift, joints locked", float(np.linalg.norm(table.base_position[-1, :2])), "m", 3e-3),
        Figure("creep of locked joints in 1 s", float(np.abs(table.joint_position[-1] - angles).max()), "rad", 5e-3),
        Figure("height, against MuJoCo", float(motion.base_position[-1, 2] - truth.base_position[-1, 2]), "m", 5e-3),
        Figure("tilt", angle_between(motion.base_quaternion[-1], UPRIGHT), "rad", 0.02),
        Figure("joint angles, against MuJoCo", _largest(motion, truth, "joint_position"), "rad", 0.03),
        Figure("mean force at the joints", _ratio(motion, truth, "joint_force"), "1", 0.05),
        Figure("feet that lose the ground", float((~motion.foot_contact[down:]).sum()), "1", 0.0),
    )


def _largest(motion: Motion, truth: Motion, name: str) -> float:
    """Return the largest difference of one field at the end."""
    return float(np.abs(getattr(motion, name)[-1] - getattr(truth, name)[-1]).max())


def _ratio(motion: Motion, truth: Motion, name: str) -> float:
    """Return by how much the mean of one field at the end is off."""
    return float(getattr(motion, name)[-1].mean() / getattr(truth, name)[-1].mean() - 1.0)


def foot_contact(make: Make, timestep: float) -> tuple[Figure, ...]:
    """One tripod carries a robot with locked joints, then the other: exactly its feet touch."""
    spec = robot()
    wrong = 0
    for group in (0, 1):
        lifted = spec.groups() != group
        angles = spec.joint_values("standing").reshape(-1, 3)
        angles[lifted, 1:] += RAISED
        motion = stand(make, timestep, still(Body.nominal(spec)), angles.ravel())
        wrong += int((motion.foot_contact[round(LANDED / timestep) :] == lifted).sum())
    return (Figure("feet that read wrong", float(wrong), "1", 0.0),)


def on_its_back(make: Make, timestep: float) -> tuple[Figure, ...]:
    """A robot that lies on its back rests on the box of its trunk, and no foot touches."""
    spec = robot()
    body = Body.nominal(spec)
    engine = make(body, flat(), timestep)
    half = spec.base.size[2] / 2
    engine.reset(spec.joint_values("standing"), np.array([0.0, 0.0, half + 0.01]), about(0, np.pi))
    motion = record(engine, round(SECONDS / timestep), still(body))
    return (
        Figure("height of the trunk", float(motion.base_position[-1, 2] - half), "m", 3e-3),
        Figure("feet that read wrong", float(motion.foot_contact.sum()), "1", 0.0),
    )
