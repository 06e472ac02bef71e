"""A motor from the bench, as `stiction convert` writes it for a joint."""

from __future__ import annotations

from typing import Any

from stiction.exchange.physics import JointPhysics, joint_physics
from stiction.files.joints import Estimate, JointRecord


def number(value: float) -> Estimate:
    """Return an estimate that is almost certain."""
    return Estimate(value, 1e-9, (value, value))


def motor(**changes: Any) -> JointRecord:
    """Return the record of a motor on the bench."""
    values = {"inertia": number(0.03), "viscous_friction": number(0.07), "coulomb_friction": number(0.4)}
    setting = {"test_condition": "bare_motor", "kp": 20.0, "kd": 0.5}
    return JointRecord(**(values | setting | changes))


def joint(name: str, **changes: Any) -> JointPhysics:
    """Return that motor for the joint `name`."""
    return joint_physics("motor", motor(**changes), name)
