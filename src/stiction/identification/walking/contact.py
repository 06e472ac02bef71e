"""Which feet may bear load: as logged, from the motors' torque, or from how high each foot is above the lowest one."""

from __future__ import annotations

import numpy as np

from stiction.core.errors import LogError
from stiction.files.walk import WalkLog
from stiction.identification.walking.body import foot_jacobians, foot_positions, legs, link_effort
from stiction.identification.walking.motion import WalkMotion, hann_weights, smooth
from stiction.identification.walking.setup import WalkSetup
from stiction.robots.model import GRAVITY, Robot

BEARING = 0.1
"""Share of the robot's weight from which on a foot is taken to bear load, by the motors' torque [1]."""

SOURCES = {
    "logged": "foot contact or force, as logged",
    "torque": f"the motors' torque: what it leaves for the ground is over {BEARING:.0%} of the robot's weight",
    "height": "kinematics: feet clear of the lowest one are taken to swing, as on flat ground",
}
"""Where contact comes from -> how that is said."""


def contact_source(log: WalkLog, setup: WalkSetup) -> str:
    """Return where contact comes from, a key of `SOURCES`; raise `LogError` where what was asked for is not there."""
    if setup.contact == "auto":
        return "height" if log.foot_contact is None else "logged"
    if setup.contact == "logged" and log.foot_contact is None:
        raise LogError("--contact logged: the log has no foot contact and no foot force; expected --contact height")
    return setup.contact


def feet_down(log: WalkLog, motion: WalkMotion, spec: Robot, setup: WalkSetup) -> np.ndarray:
    """Return whether each foot may bear load, bool, shape (T, L)."""
    source = contact_source(log, setup)
    if source == "logged":
        assert log.foot_contact is not None
        return log.foot_contact
    if source == "torque":
        return ground_force(motion, spec, setup) > BEARING * GRAVITY * spec.mass
    height = np.einsum("tli,ti->tl", foot_positions(spec, motion.joints.position), motion.upward)
    height -= [foot.radius for foot in spec.feet]
    return height - height.min(axis=1, keepdims=True) < setup.clearance


def ground_force(motion: WalkMotion, spec: Robot, setup: WalkSetup) -> np.ndarray:
    """Return the ground's upward force on each foot by the motors' torque, smoothed [N], shape (T, L).

    Jᵀ F = τ_links - τ; rotors and joint friction are left out, which is what limits it.
    """
    left = link_effort(spec, motion.joints, motion.base).torque - motion.torque
    upward = np.einsum("tlj,tj->tl", upward_map(motion, spec), left)
    return smooth(upward, hann_weights(setup.smoothing, motion.period))


def upward_map(motion: WalkMotion, spec: Robot) -> np.ndarray:
    """Return what a torque about each joint makes of the ground's upward force on each foot [1/m], shape (T, L, J)."""
    found = np.zeros((len(motion), len(spec.feet), spec.num_joints))
    for leg, jacobians in zip(legs(spec), foot_jacobians(spec, motion.joints.position), strict=True):
        count = len(leg.feet)
        stacked = jacobians[:, :, :3].reshape(len(motion), 3 * count, len(leg.joints))
        # A stretched leg hardly feels some direction: the force along it is taken as none, instead of as huge.
        inverse = np.linalg.pinv(np.swapaxes(stacked, 1, 2), rcond=1e-3).reshape(len(motion), count, 3, -1)
        up = np.einsum("tlij,ti->tlj", inverse, motion.upward)
        found[np.ix_(range(len(motion)), leg.feet, leg.joints)] = up
    return found
