"""Friction under load, from the whole robot in stance: the six equations of its base.

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

from dataclasses import dataclass, replace

import numpy as np

from stiction.identification.limb.dynamics import parameters, wrench
from stiction.identification.walking.walk import Walk, foot_jacobian, foot_positions, grow, legs, smooth
from stiction.robots.model import Body, Foot

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

NOTHING = 1e-9
"""Force and moment on the body of a unit effort below which they are rounding."""

ARM = 0.3
"""Length that divides moments [m], about a leg's, so that all six equations are forces."""


@dataclass(frozen=True)
class StanceRows:
    """Equations of the base, R rows: six for each sample used, smoothed."""

    regressor: np.ndarray
    """Columns A, B, b, c of each kind of joint; of each motor's torque at no current; of the torques' lateness; of the
    body's errors, `BODY`; shape (R, 4 K + J + 1 + 7)."""
    target: np.ndarray
    """Force for friction to explain [N], shape (R,)."""
    links: np.ndarray
    """Change of the target by links heavier by `link_mass_error`, the trunk lighter by as much [N], shape (R,)."""
    sample: np.ndarray
    """Number of the sample in the log, shape (R,)."""


def loaded_trunk(walk: Walk) -> Body:
    """Return the trunk with the declared payload, spread like its own mass, and the declared centre of mass."""
    base, setup = walk.spec.base, walk.setup
    loaded = base.scaled(1 + setup.payload / base.mass)
    return loaded if setup.centre_of_mass is None else replace(loaded, com=setup.centre_of_mass)


def stance_rows(walk: Walk) -> StanceRows:
    """Return the base's equations of a walk."""
    trunk, (effort, legs_wrench) = loaded_trunk(walk), walk.effort
    trunk_wrench = np.concatenate(wrench(walk.base, parameters(trunk)), axis=1)
    arms, hidden = ground_arms(walk)
    legs_mass, whole = walk.spec.mass - walk.spec.base.mass, trunk_wrench + legs_wrench

    def on_base(torque: np.ndarray) -> np.ndarray:
        return np.einsum("tij,tj->ti", arms, torque)

    heavier = legs_wrench - legs_mass / trunk.mass * trunk_wrench - on_base(effort)
    # Target and its change go along, to be eliminated from and smoothed as the columns are.
    columns = (
        _friction_columns(walk, arms),
        arms,
        -on_base(walk.slope)[:, :, None],
        _body_columns(walk, trunk, legs_mass, whole),
        (whole - on_base(effort - walk.torque))[:, :, None],
        walk.setup.link_mass_error * heavier[:, :, None],
    )
    still = walk.resting & (np.abs(arms).sum(axis=1) > 0)
    table, unknown = np.concatenate(columns, axis=2), np.concatenate([arms * still[:, None], hidden], axis=2)
    # Views: the moments of both tables are scaled in place.
    for moments in (table[:, 3:], unknown[:, 3:]):
        moments /= ARM
    # What is left is orthogonal to all unknowns, so that no value of theirs explains any of it.
    table -= unknown @ (np.linalg.pinv(unknown, rcond=1e-9) @ table)
    unusable = still.sum(axis=1) + hidden.any(axis=1).sum(axis=1) > MOST_UNKNOWN
    # A row in half a window, and none within half a window of what is unusable, which would be smoothed into it.
    half = len(walk.weights) // 2
    used = np.arange(half, len(table) - half, max(1, half))
    used = used[~grow(unusable, half)[used]]
    rows = smooth(table, walk.weights)[used].reshape(-1, table.shape[2])
    return StanceRows(rows[:, :-2].copy(), rows[:, -2], rows[:, -1], np.repeat(used, 6))


def ground_arms(walk: Walk) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of legs that may be down on the body: per torque of a joint, G, and per effort that none feels.

    Force and moment on the body, shapes (T, 6, J), zero for legs in swing, and (T, 6, U).
    """
    margin = round(walk.setup.swing_margin / walk.period)
    down = np.stack([grow(foot, margin) for foot in walk.down.T], axis=1)
    positions = foot_positions(walk.spec, walk.links)
    arms, hidden = np.zeros((len(walk), 6, walk.spec.num_joints)), []
    for feet, joints in legs(walk.spec):
        efforts = []
        for foot in feet:
            jacobian = foot_jacobian(walk.spec, walk.links, foot, joints)
            contact = _contact(walk.spec.feet[foot], positions[:, foot], jacobian, walk.upward)
            efforts.append([part * down[:, foot, None, None] for part in contact])
        torques, push = (np.concatenate(parts, axis=2) for parts in zip(*efforts, strict=True))
        arms[:, :, joints], rest = _solve(torques, push)
        hidden.append(rest)
    left = np.concatenate(hidden, axis=2)
    # Rounding is no effort: as an unknown it would take an equation of any direction with it.
    left[np.abs(left) < NOTHING] = 0.0
    return arms, left[:, :, left.any(axis=(0, 1))]


def _contact(foot: Foot, middle: np.ndarray, jacobian: np.ndarray, upward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the effect of the ground's effort on a foot: on the leg's joints, (T, joints, D), and the base, (T, 6, D).

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


def _friction_columns(walk: Walk, arms: np.ndarray) -> np.ndarray:
    """Return the columns A, B, b, c of each kind of joint, shape (T, 6, 4 K)."""
    direction = np.sign(walk.rate)
    signals = (walk.acceleration, walk.rate, direction, np.abs(walk.torque) * direction)
    columns = [
        np.einsum("tij,tj->ti", arms[:, :, joints], signal[:, joints])
        for joints in map(walk.spec.joints_of, walk.spec.joint_kinds)
        for signal in signals
    ]
    return np.stack(columns, axis=2)


def _body_columns(walk: Walk, trunk: Body, legs_mass: float, whole: np.ndarray) -> np.ndarray:
    """Return the columns of `BODY`, shape (T, 6, 7), negative, for they stand on the other side of the equation.

    whole: wrench that moves the robot, shape (T, 6). An error of the specific force acts on the whole mass at the
    common centre of mass; the legs', which changes little, is taken at the base's origin.
    """
    mass, lever, pull = trunk.mass + legs_mass, trunk.mass * np.array(trunk.com), walk.base.pull
    none = np.zeros_like(pull)
    shifts = [np.concatenate([none, trunk.mass * np.cross(axis, pull)], axis=1) for axis in np.eye(3)]
    pushes = [np.broadcast_to(np.concatenate([mass * axis, np.cross(lever, axis)]), whole.shape) for axis in np.eye(3)]
    return -np.stack([whole, *shifts, *pushes], axis=2)
