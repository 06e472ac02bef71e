"""The torque that a small change of a parameter amounts to, for every parameter of a model and of its loop.

A change of the inertia by one acts on the moving joint like the torque −θ'', one of the viscous friction like −θ', and
so on; `joints.variation` turns such torques into what the joint would have done.
"""

from __future__ import annotations

import numpy as np

from stiction.identify.model import Model
from stiction.joints.friction import KNOTS, SECANTS
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint
from stiction.joints.variation import Course


def parameter_torques(model: Model, values: dict[str, float], joint: Joint, cut: Course) -> dict[str, np.ndarray]:
    """Return for each of the model's parameters the torque of a unit change at both ends of each step.

    values: the model's parameters; joint: what was simulated; cut: its motion. Arrays of shape (2, num_steps).
    """
    ones = np.ones_like(cut.position)
    sign, forward, backward = cut.sign * ones, (cut.sign > 0) * ones, (cut.sign < 0) * ones
    torques = {
        "inertia": -cut.acceleration,
        "viscous_friction": -cut.velocity,
        "viscous_friction_forward": -cut.velocity * forward,
        "viscous_friction_backward": -cut.velocity * backward,
        "coulomb_friction": -sign,
        "coulomb_friction_forward": -forward,
        "coulomb_friction_backward": backward,
        "offset": -ones,
        "load_coefficient": -sign * np.abs(cut.load),
    }
    if model.law == "stribeck":
        torques |= _stribeck(values, sign, cut)
    if model.law == "position":
        torques |= _at_angle(values, sign, cut, joint, model.middle)
    if joint.gravity is not None:
        felt = 1.0 - sign * joint.friction.load_coefficient * np.sign(cut.load)
        torques |= {"gravity_sin": -np.sin(cut.position) * felt, "gravity_cos": -np.cos(cut.position) * felt}
    return {name: torques[name] for name in model.names}


def _stribeck(values: dict[str, float], sign: np.ndarray, cut: Course) -> dict[str, np.ndarray]:
    """Return the torques of the three parameters of the chain of secants."""
    knots, heights = np.array(KNOTS), np.array(SECANTS)
    slopes = np.append(np.diff(heights) / np.diff(knots), 0.0)
    speed = np.abs(cut.velocity) / values["stribeck_velocity"]
    height = heights[cut.piece] + slopes[cut.piece] * (speed - knots[cut.piece])
    fall = (values["static_friction"] - values["coulomb_friction"]) / values["stribeck_velocity"]
    return {
        "coulomb_friction": -sign * (1.0 - height),
        "static_friction": -sign * height,
        "stribeck_velocity": sign * fall * slopes[cut.piece] * speed,
    }


def _at_angle(
    values: dict[str, float], sign: np.ndarray, cut: Course, joint: Joint, middle: float
) -> dict[str, np.ndarray]:
    """Return the torques of the three parameters of friction over the angle: none where it is cut off at zero."""
    away, there = cut.position - middle, joint.friction.at_angle(cut.position) > -values["coulomb_friction"]
    return {
        "coulomb_friction": -sign * there,
        "position_slope": -sign * there * away,
        "position_curvature": -sign * there * away**2,
    }


def strength_torque(gains: PDGains, cut: Course) -> np.ndarray:
    """Return the torque of a unit change of the motor's strength, shape (2, num_steps); none at the torque limit."""
    return (cut.side == 0) * (gains.kp * (cut.target - cut.position) - gains.kd * cut.velocity)
