"""Friction under load, from the whole robot in stance: what the six equations of the base still say.

A foot on the ground feels an effort F that nobody measures: of a ball a force, of a sole a force and a moment. The
joint equations of its leg,

    J^T F = τ_links + A θ'' + B θ' + b sign(θ') + c |τ| sign(θ') - τ      (J: Jacobian of the contact point),

have as many unknowns in F as a leg has joints, three for a ball and six for a sole, so no such leg in stance tells
anything about its own friction. Solved for F, they leave the six equations of the base, in which the joints' torques do
not occur: what moves the whole robot, W, known from masses and IMU, is the sum of the feet's forces and moments,

    W = Σ_legs G (τ_links + A θ'' + B θ' + b sign(θ') + c |τ| sign(θ') - τ),     G = P (J^T)^+,

linear in A, B, b and c; P turns F into force and moment on the base, [1; p×] for a ball. Where a leg has more joints,
what its own equations say beyond F is left unused. Where it has fewer, or is stretched, its joints do not feel F in
some directions: those parts of F are unknowns of the base's equations and are eliminated.

Gravity is by far the largest part of W, so masses and centre of mass must be known, and their remaining errors are
unknowns with priors. A joint that hardly moves has friction of unknown size and direction: that torque is eliminated
too. Legs in swing have F = 0; their own equations (`swing.py`) join the fit and settle A, B and b where load is small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.files.walk import WalkLog
from stiction.identification.walking.body import foot_jacobians, foot_positions, legs, link_effort, trunk_wrench
from stiction.identification.walking.contact import feet_down
from stiction.identification.walking.motion import WalkMotion, grow, hann_weights, slow_samples, smooth
from stiction.identification.walking.setup import WalkSetup
from stiction.robots.model import Body, Foot, Robot

FRICTION = ("armature", "viscous_friction", "coulomb_friction", "load_coefficient")
"""Parameters of each kind, A, B, b and c: joints of one kind share their friction here."""

BODY = ("mass", "centre_x", "centre_y", "centre_z", "force_x", "force_y", "force_z")
"""Errors of the whole robot's mass [1], of the trunk's centre of mass [m], and of the specific force [m/s²]."""

MOST_UNKNOWN = 4
"""Unknowns of a sample, joints of legs on the ground that hardly move and efforts that no joint feels: of six equations
at least two remain."""

LARGEST_CONDITION = 30.0
"""Largest singular value of a leg's Jacobian over one at which its joints no longer feel that effort of the foot: 4 in
the standing pose."""

ARM = 0.3
"""Moments are divided by this length [m], about a leg's, so that all six equations are forces."""


@dataclass(frozen=True)
class StanceRows:
    """The base's equations, R rows: six for each sample used, smoothed."""

    regressor: np.ndarray
    """Columns A, B, b, c of each kind of joint; of each motor's torque at no current; of the torques' lateness; of the
    body's errors, `BODY`; shape (R, 4 K + J + 1 + 7)."""
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
    hidden: np.ndarray
    """Force and moment on the body of efforts that no joint feels, shape (T, 6, U)."""
    effort: np.ndarray
    """τ_links [N m], shape (T, J)."""
    trunk: np.ndarray
    """Force and moment that move the trunk, shape (T, 6)."""
    legs: np.ndarray
    """Force and moment that move the legs' links, shape (T, 6)."""


def stance_rows(log: WalkLog, motion: WalkMotion, spec: Robot, trunk: Body, setup: WalkSetup) -> StanceRows:
    """Return the base's equations of a walk."""
    body = _body(log, motion, spec, trunk, setup)
    resting = [slow_samples(rate, setup, motion.period) for rate in motion.rate.T]
    still = np.stack(resting, axis=1) & (np.abs(body.arms).sum(axis=1) > 0)
    legs_mass = spec.mass - spec.base.mass
    heavier = body.legs - legs_mass / trunk.mass * body.trunk - np.einsum("tij,tj->ti", body.arms, body.effort)
    target = body.trunk + body.legs - np.einsum("tij,tj->ti", body.arms, body.effort - motion.torque)
    # Target and its change go along, to be eliminated from and smoothed as the columns are.
    columns = (
        _friction_columns(motion, spec, body.arms),
        body.arms,
        -np.einsum("tij,tj->ti", body.arms, np.gradient(motion.torque, motion.period, axis=0))[:, :, None],
        _body_columns(motion, trunk, legs_mass, body.trunk + body.legs),
        target[:, :, None],
        setup.link_mass_error * heavier[:, :, None],
    )
    table, unknown = np.concatenate(columns, axis=2), np.concatenate([body.arms * still[:, None], body.hidden], axis=2)
    # Views: the moments of both tables are scaled in place.
    for moments in (table[:, 3:], unknown[:, 3:]):
        moments /= ARM
    unusable = still.sum(axis=1) + body.hidden.any(axis=1).sum(axis=1) > MOST_UNKNOWN
    rows, sample = _reduce(table, unknown, unusable, hann_weights(setup.smoothing, motion.period))
    return StanceRows(regressor=rows[:, :-2].copy(), target=rows[:, -2], links=rows[:, -1], sample=sample)


def _body(log: WalkLog, motion: WalkMotion, spec: Robot, trunk: Body, setup: WalkSetup) -> _Body:
    """Return what the legs and the trunk need, and how the joints of legs that may be down act on the body."""
    margin = round(setup.swing_margin / motion.period)
    down = np.stack([grow(foot, margin) for foot in feet_down(log, motion, spec, setup).T], axis=1)
    positions = foot_positions(spec, motion.joints.position)
    arms, hidden = np.zeros((len(motion), 6, spec.num_joints)), []
    for leg, jacobians in zip(legs(spec), foot_jacobians(spec, motion.joints.position), strict=True):
        parts = []
        for index, foot in enumerate(leg.feet):
            contact = _contact(spec.feet[foot], positions[:, foot], jacobians[:, index], motion.upward)
            parts.append([part * down[:, foot, None, None] for part in contact])
        torques, push = (np.concatenate(blocks, axis=2) for blocks in zip(*parts, strict=True))
        arms[:, :, leg.joints], rest = _solve(torques, push)
        hidden.append(rest)
    left = np.concatenate(hidden, axis=2)
    links = link_effort(spec, motion.joints, motion.base)
    return _Body(
        arms=arms,
        hidden=left[:, :, left.any(axis=(0, 1))],
        effort=links.torque,
        trunk=trunk_wrench(trunk, motion.base),
        legs=links.wrench,
    )


def _contact(foot: Foot, middle: np.ndarray, jacobian: np.ndarray, upward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what the ground's effort on a foot does to the leg's joints, (T, joints, D), and to the base, (T, 6, D).

    An effort is a force [N], D = 3, where the foot is a ball; else also a moment over `ARM` [N], D = 6. The ground is
    taken as level: it touches straight under the middle. middle: in the base frame [m], shape (T, 3); jacobian: of that
    point, shape (T, 6, joints); upward: shape (T, 3).
    """
    below = -foot.radius * upward
    torques = np.concatenate(
        [jacobian[:, :3] + np.cross(jacobian[:, 3:], below[:, :, None], axis=1), ARM * jacobian[:, 3:]], axis=1
    )
    push = np.tile(np.diag([1.0, 1.0, 1.0, ARM, ARM, ARM]), (len(middle), 1, 1))
    push[:, 3:, :3] = np.cross((middle + below)[:, :, None], np.eye(3), axis=1)
    count = 3 if foot.is_ball else 6
    return np.swapaxes(torques[:, :count], 1, 2), push[:, :, :count]


def _solve(torques: np.ndarray, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment on the base per torque of a leg's joints, (T, 6, joints), of hidden efforts, (T, 6, D).

    torques, push: of the efforts on its feet, as `_contact` has them, zero for feet in swing.
    """
    left, size, right = np.linalg.svd(torques)
    count = size.shape[1]
    solved = size > size[:, :1] / LARGEST_CONDITION
    turned = push @ np.swapaxes(right, 1, 2)
    over = np.divide(1.0, size, out=np.zeros_like(size), where=solved)
    arms = (turned[:, :, :count] * over[:, None]) @ np.swapaxes(left, 1, 2)[:, :count]
    turned[:, :, :count] *= ~solved[:, None]
    return arms, turned


def _friction_columns(motion: WalkMotion, spec: Robot, arms: np.ndarray) -> np.ndarray:
    """Return the columns A, B, b, c of each kind of joint, shape (T, 6, 4 K)."""
    direction = np.sign(motion.rate)
    signals = (motion.joints.acceleration, motion.rate, direction, np.abs(motion.torque) * direction)
    columns = [
        np.einsum("tij,tj->ti", arms[:, :, joints], signal[:, joints])
        for joints in map(spec.joints_of, spec.joint_kinds)
        for signal in signals
    ]
    return np.stack(columns, axis=2)


def _body_columns(motion: WalkMotion, trunk: Body, legs_mass: float, wrench: np.ndarray) -> np.ndarray:
    """Return the columns of `BODY`, shape (T, 6, 7): what stands on the other side of the equation, hence the sign.

    wrench: that moves the whole robot, shape (T, 6). An error of the specific force acts on the whole mass at the
    common centre of mass; the legs', which changes little, is taken at the base's origin.
    """
    whole, lever = trunk.mass + legs_mass, trunk.mass * np.array(trunk.com)
    none = np.zeros_like(motion.base.specific_force)
    shifts = [
        np.concatenate([none, trunk.mass * np.cross(axis, motion.base.specific_force)], axis=1) for axis in np.eye(3)
    ]
    pushes = [
        np.broadcast_to(np.concatenate([whole * axis, np.cross(lever, axis)]), wrench.shape) for axis in np.eye(3)
    ]
    return -np.stack([wrench, *shifts, *pushes], axis=2)


def _reduce(
    table: np.ndarray, unknown: np.ndarray, unusable: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Eliminate what is unknown, smooth, and keep a row in half a window.

    table: the columns of the regressor, target and its change, shape (T, 6, columns); unknown: force and moment on the
    body of each unknown, shape (T, 6, U); unusable: samples to leave out, shape (T,). Returns rows, shape (R, columns),
    and the sample of each, shape (R,).
    """
    # What is left is orthogonal to all unknowns, so that no value of theirs explains any of it.
    table = table - unknown @ (np.linalg.pinv(unknown, rcond=1e-9) @ table)
    half = len(weights) // 2
    used = np.arange(half, len(table) - half, max(1, half))
    # By half a window, for a smoothed equation has its neighbours in it.
    used = used[~grow(unusable, half)[used]]
    return smooth(table, weights)[used].reshape(-1, table.shape[2]), np.repeat(used, 6)
