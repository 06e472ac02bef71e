"""The torque equation: a friction law, with or without gravity, and the names of its parameters.

I θ'' + B θ' + f(θ') sign(θ') + offset + gravity_sin sin θ + gravity_cos cos θ = k τ + d, where τ is the motor's torque,
k its strength (1 where the torque is in N m), and d a known torque from outside. The laws are

    coulomb      f = b_c                                               b_c at rest
    asymmetric   f = b_c and B for each direction; the offset is the difference of the two b_c
    stribeck     f = b_c + (b_s - b_c) exp(-(θ'/v_s)²)                 b_s > b_c at rest
    breakaway    f = b_c                                               b_s > b_c at rest
    load         f = b_c + c |load|, the load being gravity and d      the same at rest
    effort       f = b_c + c |τ|                                       the same at rest
    position     f = b_c + slope (θ - θ_m) + curvature (θ - θ_m)²      the same at rest; θ_m is mid-range
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.joints.friction import KNOTS, SECANTS, candidate_laws, find_law
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint
from stiction.joints.variation import Segments

Law = str
"""Name of a law, one of `LAWS`."""

LAWS: tuple[Law, ...] = candidate_laws()
"""Friction laws of the table that identification tries, the simplest first."""

GRAVITY_TERMS = ("gravity_sin", "gravity_cos")
"""Torque that holds the link: gravity_sin sin θ + gravity_cos cos θ [N m]."""


NOT_NEGATIVE = ("coulomb_friction", "static_friction", "load_coefficient", "effort_coefficient")
"""Parameters that no joint has below zero. Estimates may be below: without friction they scatter about zero."""


def nearest_joint(values: Mapping[str, float]) -> dict[str, float]:
    """Return estimates by name, with friction parameters below zero set to zero."""
    return {name: max(0.0, value) if name in NOT_NEGATIVE else value for name, value in values.items()}


@dataclass(frozen=True)
class Model:
    """A torque equation."""

    law: Law = "coulomb"
    """Friction law."""
    gravity: bool = False
    """True if gravity pulls on the link."""
    middle: float = 0.0
    """θ_m of the position law [rad]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order in which estimators hold them."""
        return ("inertia", *find_law(self.law).parameters, *(GRAVITY_TERMS if self.gravity else ()))

    def joint(self, values: Sequence[float]) -> Joint:
        """Return the joint with these parameter values, in the order of `names`, motor strength apart.

        Raises `StictionError` where no joint has them: inertia not positive, or friction that would drive it.
        """
        if len(values) != len(self.names):
            raise ConfigurationError(f"{len(values)} values for {', '.join(self.names)}: expected {len(self.names)}")
        by_name = {name: float(value) for name, value in zip(self.names, values)}
        offset = by_name.get("offset", 0.0)
        if "coulomb_friction_forward" in by_name:
            offset = 0.5 * (by_name["coulomb_friction_forward"] - by_name["coulomb_friction_backward"])
        pieces = find_law(self.law).joint
        assert pieces is not None
        friction = pieces(by_name | {"position_middle": self.middle})
        gravity = Gravity(by_name["gravity_sin"], by_name["gravity_cos"]) if self.gravity else None
        return Joint(by_name["inertia"], by_name.get("viscous_friction", 0.0), friction, offset, gravity)


def parameter_torques(
    model: Model, values: dict[str, float], joint: Joint, motion: Segments, effort: np.ndarray
) -> dict[str, np.ndarray]:
    """Return for each of the model's parameters the torque of a unit change at both ends of each step.

    values: the model's parameters; joint: the simulated joint; motion: its motion, cut at its events; effort: torque
    of the motor [N m]. Arrays of shape (2, num_steps).
    """
    ones = np.ones_like(motion.position)
    sign, forward, backward = motion.sign * ones, (motion.sign > 0) * ones, (motion.sign < 0) * ones
    # Signs are those of what pushes the joint: a larger parameter on the left of the equation pushes it back, and more
    # friction backward pushes it forward.
    torques = {
        "inertia": -motion.acceleration,
        "viscous_friction": -motion.velocity,
        "viscous_friction_forward": -motion.velocity * forward,
        "viscous_friction_backward": -motion.velocity * backward,
        "coulomb_friction": -sign,
        "coulomb_friction_forward": -forward,
        "coulomb_friction_backward": backward,
        "offset": -ones,
        "load_coefficient": -sign * np.abs(motion.load),
        # At rest alone, against the direction in which the joint breaks away at the end of the step.
        "static_friction": -np.append(motion.sign[1:], 0) * (motion.sign == 0) * ones,
    }
    if "effort_coefficient" in model.names:
        torques["effort_coefficient"] = -sign * np.abs(effort)
    if "stribeck_velocity" in model.names:
        torques |= _stribeck(values, sign, motion)
    if "position_slope" in model.names:
        torques |= _at_angle(values, sign, motion, joint, model.middle)
    if joint.gravity is not None:
        share = 1.0 - sign * joint.friction.load_coefficient * np.sign(motion.load)
        torques |= {"gravity_sin": -np.sin(motion.position) * share, "gravity_cos": -np.cos(motion.position) * share}
    return {name: torques[name] for name in model.names}


def _stribeck(values: dict[str, float], sign: np.ndarray, motion: Segments) -> dict[str, np.ndarray]:
    """Return the torques of the three parameters of the chain of secants."""
    knots, heights = np.array(KNOTS), np.array(SECANTS)
    slopes = np.append(np.diff(heights) / np.diff(knots), 0.0)
    speed = np.abs(motion.velocity) / values["stribeck_velocity"]
    height = heights[motion.piece] + slopes[motion.piece] * (speed - knots[motion.piece])
    fall = (values["static_friction"] - values["coulomb_friction"]) / values["stribeck_velocity"]
    return {
        "coulomb_friction": -sign * (1.0 - height),
        "static_friction": -sign * height,
        "stribeck_velocity": sign * fall * slopes[motion.piece] * speed,
    }


def _at_angle(
    values: dict[str, float], sign: np.ndarray, motion: Segments, joint: Joint, middle: float
) -> dict[str, np.ndarray]:
    """Return the torques of the three parameters of friction over the angle: zero where friction is cut off at zero."""
    away, active = motion.position - middle, joint.friction.at_angle(motion.position) > -values["coulomb_friction"]
    return {
        "coulomb_friction": -sign * active,
        "position_slope": -sign * active * away,
        "position_curvature": -sign * active * away**2,
    }


def strength_torque(gains: PDGains, motion: Segments, effort_coefficient: float = 0.0) -> np.ndarray:
    """Return the torque of a unit change of the motor's strength, shape (2, num_steps); none at the torque limit.

    effort_coefficient: friction per torque of the motor, which takes its share of the change [1].
    """
    asked = gains.kp * (motion.target - motion.position) - gains.kd * motion.velocity
    return (motion.side == 0) * (asked - effort_coefficient * motion.sign * np.abs(asked))
