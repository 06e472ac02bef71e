"""Friction under load, from the whole robot in stance: what the six equations of the base still say.

A foot on the ground feels a force F that nobody measures. Its leg's three joint equations,

    J^T F = τ_links + A θ'' + B θ' + b sign(θ') + c |τ| sign(θ') - τ      (J: Jacobian of the contact point),

have three unknowns in F, so no leg in stance tells anything about its own friction. Solved for F, they leave the six
equations of the base, in which the joints' torques do not occur: what moves the whole robot, W, known from masses and
IMU, is the sum of the feet's forces and moments,

    W = Σ_legs G (τ_links + A θ'' + B θ' + b sign(θ') + c |τ| sign(θ') - τ),     G = [J^-T; p × J^-T],

linear in A, B, b and c. Gravity is by far the largest part of W, so masses and centre of mass must be known, and their
remaining errors are unknowns with priors. A joint that hardly moves has friction of unknown size and direction: that
torque is one more unknown, which is eliminated from the sample's equations. Legs in swing have F = 0; their own
equations (`swing.py`) join the fit and settle A, B and b where load is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.walk import WalkLog
from stiction.identify.walking.body import Trunk, foot_positions, link_effort, point_jacobians, trunk_wrench
from stiction.identify.walking.motion import WalkMotion, feet_down, grow, hann_weights, slow_samples, smooth
from stiction.identify.walking.setup import WalkSetup
from stiction.robots.model import JOINT_KINDS, JOINTS_PER_LEG, Robot

FRICTION = ("armature", "viscous_friction", "coulomb_friction", "load_coefficient")
"""Parameters of each kind, A, B, b and c: joints of one kind share their friction here."""

BODY = ("mass", "centre_x", "centre_y", "centre_z", "force_x", "force_y", "force_z")
"""Errors of the whole robot's mass [1], of the trunk's centre of mass [m], and of the specific force [m/s²]."""

MOST_STILL = 4
"""Joints of legs on the ground that may hardly move: of six equations at least two remain."""

LARGEST_CONDITION = 30.0
"""Condition number of a leg's Jacobian beyond which it is too straight: 4 in the standing pose."""

ARM = 0.3
"""Moments are divided by this length [m], about a leg's, so that all six equations are forces."""


@dataclass(frozen=True)
class StanceRows:
    """The base's equations, R rows: six for each sample used, smoothed."""

    regressor: np.ndarray
    """Columns A, B, b, c of hip, thigh and shank; of each motor's torque at no current; of the torques' lateness; of
    the body's errors, `BODY`; shape (R, 12 + J + 1 + 7)."""
    target: np.ndarray
    """What friction has to explain [N], shape (R,)."""
    links: np.ndarray
    """Change of the target by links heavier by `link_mass_error`, the trunk lighter by as much [N], shape (R,)."""
    sample: np.ndarray
    """Number of the sample in the log, shape (R,)."""


@dataclass(frozen=True)
class _Body:
    """The robot's six equations before anything is eliminated, T samples."""

    arms: np.ndarray
    """G: force and moment on the body per torque of each joint, zero for legs in swing, shape (T, 6, J)."""
    effort: np.ndarray
    """τ_links [N m], shape (T, J)."""
    trunk: np.ndarray
    """Force and moment that move the trunk, shape (T, 6)."""
    legs: np.ndarray
    """Force and moment that move the legs' links, shape (T, 6)."""
    stretched: np.ndarray
    """Where a leg that may be down is too straight to tell its force, bool, shape (T,)."""


def stance_rows(log: WalkLog, motion: WalkMotion, spec: Robot, trunk: Trunk, setup: WalkSetup) -> StanceRows:
    """Return the base's equations of a walk."""
    body = _body(log, motion, spec, trunk, setup)
    resting = [slow_samples(rate, setup, motion.period) for rate in motion.rate.T]
    still = np.stack(resting, axis=1) & (np.abs(body.arms).sum(axis=1) > 0)
    legs_mass = spec.mass - spec.base.mass
    heavier = body.legs - legs_mass / trunk.mass * body.trunk - np.einsum("tij,tj->ti", body.arms, body.effort)
    target = body.trunk + body.legs - np.einsum("tij,tj->ti", body.arms, body.effort - motion.torque)
    columns = (
        _friction_columns(motion, body.arms),
        body.arms,
        -np.einsum("tij,tj->ti", body.arms, np.gradient(motion.torque, motion.period, axis=0))[:, :, None],
        _body_columns(motion, trunk, legs_mass, body.trunk + body.legs),
        target[:, :, None],
        setup.link_mass_error * heavier[:, :, None],
    )
    table = np.concatenate(columns, axis=2)
    table[:, 3:] /= ARM
    unusable = body.stretched | (still.sum(axis=1) > MOST_STILL)
    rows, sample = _reduce(table, still, unusable, hann_weights(setup.smoothing, motion.period))
    return StanceRows(regressor=rows[:, :-2].copy(), target=rows[:, -2], links=rows[:, -1], sample=sample)


def _body(log: WalkLog, motion: WalkMotion, spec: Robot, trunk: Trunk, setup: WalkSetup) -> _Body:
    """Return what the legs and the trunk need, and how the joints of legs that may be down act on the body."""
    margin = round(setup.swing_margin / motion.period)
    down = np.stack([grow(foot, margin) for foot in feet_down(log, motion, spec, setup).T], axis=1)
    # The foot is a ball on ground taken as level: it touches straight under its centre.
    contacts = foot_positions(spec, motion.joints.position) - spec.foot_radius * motion.upward[:, None]
    jacobians = point_jacobians(spec, motion.joints.position, contacts)
    straight = ~(np.linalg.cond(jacobians) < LARGEST_CONDITION)
    forces = np.linalg.inv(np.where(straight[..., None, None], np.eye(3), np.swapaxes(jacobians, 2, 3)))
    wrenches = np.concatenate([forces, np.cross(contacts[..., None], forces, axis=2)], axis=2)
    arms = down[..., None, None] * wrenches
    links = link_effort(spec, motion.joints, motion.base)
    return _Body(
        arms=np.moveaxis(arms, 1, 2).reshape(len(motion), 6, spec.num_joints),
        effort=links.torque,
        trunk=trunk_wrench(trunk, motion.base),
        legs=links.wrench,
        stretched=(straight & down).any(axis=1),
    )


def _friction_columns(motion: WalkMotion, arms: np.ndarray) -> np.ndarray:
    """Return the columns A, B, b, c of each kind of joint, shape (T, 6, 12)."""
    direction = np.sign(motion.rate)
    signals = (motion.joints.acceleration, motion.rate, direction, np.abs(motion.torque) * direction)
    columns = [
        np.einsum("tij,tj->ti", arms[:, :, kind::JOINTS_PER_LEG], signal[:, kind::JOINTS_PER_LEG])
        for kind in range(len(JOINT_KINDS))
        for signal in signals
    ]
    return np.stack(columns, axis=2)


def _body_columns(motion: WalkMotion, trunk: Trunk, legs_mass: float, wrench: np.ndarray) -> np.ndarray:
    """Return the columns of `BODY`, shape (T, 6, 7): what stands on the other side of the equation, hence the sign.

    wrench: that moves the whole robot, shape (T, 6). An error of the specific force acts on the whole mass at the
    common centre of mass; the legs', which changes little, is taken at the base's origin.
    """
    whole, lever = trunk.mass + legs_mass, trunk.mass * np.array(trunk.centre)
    none = np.zeros_like(motion.base.specific_force)
    shifts = [
        np.concatenate([none, trunk.mass * np.cross(axis, motion.base.specific_force)], axis=1) for axis in np.eye(3)
    ]
    pushes = [
        np.broadcast_to(np.concatenate([whole * axis, np.cross(lever, axis)]), wrench.shape) for axis in np.eye(3)
    ]
    return -np.stack([wrench, *shifts, *pushes], axis=2)


def _reduce(
    table: np.ndarray, still: np.ndarray, unusable: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Eliminate the joints that hardly move, smooth, and keep a row in half a window.

    table: friction, arms, lateness, body, target and its change as columns, shape (T, 6, 12 + J + 1 + 7 + 2);
    still: shape (T, J); unusable: samples to leave out, shape (T,). Returns rows, shape (R, columns), and the sample of
    each, shape (R,).
    """
    first = len(JOINT_KINDS) * len(FRICTION)
    unknown = table[:, :, first : first + still.shape[1]] * still[:, None]
    table = table - unknown @ (np.linalg.pinv(unknown, rcond=1e-9) @ table)
    half = len(weights) // 2
    used = np.arange(half, len(table) - half, max(1, half))
    used = used[~grow(unusable, half)[used]]
    return smooth(table, weights)[used].reshape(-1, table.shape[2]), np.repeat(used, 6)
