"""A joint by another method than the exact one: small steps, friction as a projection."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from stiction.joints.pd import PDGains
from stiction.joints.simulate import Gravity, Joint

STEP = 0.002
"""Time between samples [s]."""

PIECES = 200
"""Steps between two samples."""

Size = Callable[[float, float, float, float], float]
"""Direction, speed [rad/s], load [N m] and angle [rad] -> size of the friction [N m]."""


def small_steps(
    joint: Joint, gains: PDGains, target: np.ndarray, size: Size, load: np.ndarray | None = None
) -> np.ndarray:
    """Return q and q' by semi-implicit steps of 1e-5 s; shape (2, num_samples)."""
    step, gravity = STEP / PIECES, joint.gravity or Gravity(0.0)
    load = np.zeros_like(target) if load is None else load
    position = velocity = 0.0
    motion = [(position, velocity)]
    for (target_now, load_now), (target_next, load_next) in pairwise(zip(target, load, strict=True)):
        for piece in range(PIECES):
            share = (piece + 0.5) / PIECES
            goal = target_now + (target_next - target_now) * share
            torque = gains.kp * (goal - position) - gains.kd * velocity
            torque = min(max(torque, -gains.torque_limit), gains.torque_limit)
            outside = load_now + (load_next - load_now) * share
            outside -= gravity.sin * np.sin(position) + gravity.cos * np.cos(position)
            moved = velocity + step * (torque + outside - joint.offset - joint.viscous * velocity) / joint.inertia
            direction = 1.0 if moved > 0 else -1.0
            friction = size(direction, abs(velocity), outside, position)
            moved = direction * max(abs(moved) - step * friction / joint.inertia, 0.0)
            position += step * 0.5 * (velocity + moved)
            velocity = moved
        motion.append((position, velocity))
    return np.array(motion).T
