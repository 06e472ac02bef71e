"""Derivatives of a simulated motion with respect to the joint's parameters.

Between two events the change s of the angle obeys the joint's own equation, linearised about the motion, I s'' + D s' +
K s = φ(t), with φ the torque equivalent to the parameter's change. Events move with the parameter: where the joint
comes to rest s' ends; where it reverses without resting, s' is multiplied by the ratio of the accelerations after and
before; where it breaks away inside a sample, or friction passes to its next piece, the acceleration is continuous and
nothing changes, and where friction at rest is more than in motion s' jumps, by the acceleration of the break-away times
the change of that instant. All samples and events together are one banded linear system.

This is exact where φ is straight within a step: for Coulomb friction, offset and the start. A curved φ, −θ'' for the
inertia, −θ' for viscous friction, is taken as straight between its ends, an error of second order in the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtbtrs

from stiction.core.errors import StictionError
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, Trajectory, mean_slope


@dataclass(frozen=True)
class Segments:
    """Simulated motion cut at every sample and event; pairs are values at the begin and the end of each step.

    Arrays of shape (num_steps,), pairs of shape (2, num_steps).
    """

    sign: np.ndarray
    """Direction: -1 or 1 while sliding, 0 at rest."""
    side: np.ndarray
    """-1 or 1 while the motor is at that limit, else 0."""
    piece: np.ndarray
    """Piece of the friction law, counted from rest."""
    span: np.ndarray
    """Length of the step [s]."""
    kind: np.ndarray
    """Number of the linear system and span of a step; equal for equal steps."""
    instant: np.ndarray
    """Pair: time in samples."""
    position: np.ndarray
    """Pair: θ [rad]."""
    velocity: np.ndarray
    """Pair: θ' [rad/s]."""
    acceleration: np.ndarray
    """Pair: θ'' [rad/s²]."""
    target: np.ndarray
    """Pair: a [rad]."""
    load: np.ndarray
    """Pair: torque on the joint from outside, gravity included [N m]."""
    samples: np.ndarray
    """Index of the step that begins at each sample, for the last sample the number of steps; shape (num_samples,)."""


def segments(
    joint: Joint,
    gains: PDGains,
    step: float,
    target: np.ndarray,
    trajectory: Trajectory,
    load: np.ndarray | None = None,
) -> Segments:
    """Cut a simulated motion; the arguments are those of `simulate` and its result."""
    first, last, begin, end, sign, side, piece, start = (
        np.array(column) for column in zip(*trajectory.phases, strict=True)
    )
    count = np.maximum(last - first, 1)
    of = np.repeat(np.arange(len(count)), count)
    ahead = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    sample, whole, start = first[of] + ahead, (last > first)[of], start[of]
    instant = np.append(np.where(whole, sample, sample + begin[of] / step), len(target) - 1.0)
    position = np.append(np.where(whole, trajectory.position[sample], start[:, 0]), trajectory.position[-1])
    velocity = np.append(np.where(whole, trajectory.velocity[sample], start[:, 1]), trajectory.velocity[-1])
    sign, side, piece = sign[of], side[of], piece[of]

    def pair(values: np.ndarray) -> np.ndarray:
        return np.stack([values[:-1], values[1:]])

    grid, numbers = np.arange(len(target)), np.arange(len(of))
    outside = np.zeros(len(instant)) if load is None else np.interp(instant, grid, load)
    if joint.gravity is not None:
        outside = outside - joint.gravity.torque(position)
    # Whole samples of one linear system share a negative number, and one matrix exponential; each part of a sample has
    # its own number from 0 on.
    cut = Segments(
        sign=sign,
        side=side,
        piece=piece,
        span=np.where(whole, step, (end - begin)[of]),
        kind=np.where(whole, -1 - (sign + 1) - 3 * (side + 1) - 9 * piece, numbers),
        instant=pair(instant),
        position=pair(position),
        velocity=pair(velocity),
        acceleration=np.empty((2, len(of))),
        target=pair(np.interp(instant, grid, target)),
        load=pair(outside),
        samples=np.append(np.flatnonzero(whole | (begin[of] == 0.0)), len(of)),
    )
    cut.acceleration[:] = _acceleration(joint, gains, cut)
    return cut


def _laws(joint: Joint, cut: Segments) -> tuple[np.ndarray, np.ndarray]:
    """Return level and slope of the friction piece of each step, shape (num_steps,) each."""
    level, slope = np.zeros(len(cut.sign)), np.zeros(len(cut.sign))
    for direction in (-1, 1):
        sliding = cut.sign == direction
        pieces = np.array(joint.friction.pieces(direction))
        level[sliding], slope[sliding] = pieces[cut.piece[sliding], 1], pieces[cut.piece[sliding], 2]
    return level, slope


def _acceleration(joint: Joint, gains: PDGains, cut: Segments) -> np.ndarray:
    """Return θ'' at both ends of each step [rad/s²], zero at rest."""
    commanded = gains.strength * (gains.kp * (cut.target - cut.position) - gains.kd * cut.velocity)
    level, slope = _laws(joint, cut)
    # `where` computes both branches, and zero times an infinite limit would be NaN, with a warning.
    motor = np.where(cut.side == 0, commanded, cut.side * min(gains.torque_limit, 1e300))
    more = joint.friction.load_coefficient * np.abs(cut.load) + joint.friction.at_angle(cut.position)
    more = more + joint.friction.effort_coefficient * np.abs(motor)
    friction = cut.sign * (level + more) + slope * cut.velocity
    force = motor + cut.load - joint.offset - joint.viscous * cut.velocity - friction
    return np.where(cut.sign == 0, 0.0, force / joint.inertia)


def vary(joint: Joint, gains: PDGains, cut: Segments, torque: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the changes of θ and θ' at every sample, shape (2, num_samples, num_changes).

    torque: φ at both ends of each step, shape (2, num_steps, num_changes) [N m per unit]; its values at rest are
    ignored. start: changes of θ and θ' at the first sample, shape (2, num_changes). Raises `StictionError` where the
    changes are not finite: friction over the angle outweighs the inertia in one step.
    """
    moving = (cut.sign != 0).astype(float)
    spring, slope = 0.0, cut.sign * joint.friction.slope_at_angle(cut.position) / joint.inertia
    if joint.gravity is not None:
        # Any spring would do, for `slope` has the rest; at the mean little is left that must be straight within a step.
        spring = mean_slope(joint.gravity, cut.position[0])
        carried = 1.0 - cut.sign * joint.friction.load_coefficient * np.sign(cut.load)
        slope = slope + moving * (joint.gravity.slope(cut.position) * carried - spring) / joint.inertia
    free = cut.side == 0
    # Friction in proportion to the motor's torque takes its share of the gains, or adds to them where it brakes.
    motor = np.sign(gains.kp * (cut.target - cut.position) - gains.kd * cut.velocity).mean(axis=0)
    share = 1.0 - joint.friction.effort_coefficient * cut.sign * motor
    stiffness = (gains.strength * gains.kp * free * share + spring) / joint.inertia
    damping = (gains.strength * gains.kd * free * share + joint.viscous + _laws(joint, cut)[1]) / joint.inertia
    kind = (
        cut.kind
        if not joint.friction.effort_coefficient
        else np.where(cut.kind < 0, 5 * cut.kind - 2 * motor, cut.kind)
    )
    response = _responses(stiffness, damping, cut.span, kind)
    rest = cut.sign == 0
    response[rest] = 0.0
    response[rest, 0, 0] = 1.0
    # At the end of a step the change of the velocity goes on, ends or is turned round.
    keep = np.ones(len(rest))
    turning = cut.sign[:-1] * cut.sign[1:] < 0
    before, after = cut.acceleration[1, :-1][turning], cut.acceleration[0, 1:][turning]
    keep[:-1][turning] = np.divide(after, before, out=np.zeros_like(after), where=before != 0)
    keep[:-1][(cut.sign[1:] == 0) | (cut.sign[:-1] == 0)] = 0.0
    response[:, 1] *= keep[:, None]
    # `late` is the answer to a torque that rises from 0 to 1 over the step, `early` to one that falls from 1 to 0.
    transition, late = response[:, :, :2], response[:, :, 3]
    early = response[:, :, 2] - late
    places, stiff, forced = _break_away(joint, gains, cut, spring)
    transition[places, 1, 0] = stiff
    jump = forced[:, None] * torque[1, places]
    torque = torque * (moving / joint.inertia)[:, None]
    right = np.empty((len(rest) + 1, 2, torque.shape[2]))
    right[0] = start
    right[1:] = early[:, :, None] * torque[0][:, None, :] + late[:, :, None] * torque[1][:, None, :]
    right[1 + places, 1] += jump
    # Each step's state depends on the one before, so the whole run is a lower triangle of three diagonals beside the
    # main one: LAPACK solves all steps and all changes at once. A slope over the angle makes a torque of the change
    # itself, at either end of a step, which is why it is in the matrix and not on the right.
    diagonals = np.zeros((4, len(rest) + 1, 2))
    diagonals[0] = 1.0
    diagonals[0, 1:, 0] += late[:, 0] * slope[1]
    diagonals[1, 1:, 0] = late[:, 1] * slope[1]
    diagonals[1, :-1, 1] = -transition[:, 0, 1]
    diagonals[2, :-1, 0] = early[:, 0] * slope[0] - transition[:, 0, 0]
    diagonals[2, :-1, 1] = -transition[:, 1, 1]
    diagonals[3, :-1, 0] = early[:, 1] * slope[0] - transition[:, 1, 0]
    size = 2 * len(rest) + 2
    solved, singular = dtbtrs(np.asfortranarray(diagonals.reshape(4, size)), right.reshape(size, -1), uplo="L")
    if singular or not np.isfinite(solved).all():
        raise StictionError("the derivatives of the simulated motion are not finite; log with a shorter period")
    return np.moveaxis(solved.reshape(len(rest) + 1, 2, -1)[cut.samples], 1, 0)


def _break_away(
    joint: Joint, gains: PDGains, cut: Segments, spring: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steps that end with a break-away, and s' after them per s and per φ; shape (num_events,) each.

    spring: slope of gravity [N m/rad]. The joint breaks away when the pull p reaches the friction at rest: later by δt
    = (σ (k kp + spring) s − σ φ)/(σ p'), and is slower by q'' δt from then on; σ: its direction.
    """
    places = np.flatnonzero((cut.sign[:-1] == 0) & (cut.sign[1:] != 0))
    direction, starts = cut.sign[places + 1], cut.acceleration[0, places + 1]
    free = cut.side[places] == 0
    stiffness = gains.strength * gains.kp * free
    pull = stiffness * cut.target[:, places] + cut.load[:, places]
    friction = joint.friction.load_coefficient * np.abs(cut.load[:, places])
    rate = direction * (pull[1] - pull[0]) - (friction[1] - friction[0])
    # In a step that ends on the very sample at which it began nothing can be said of the rate.
    known = rate > 1e-9 * np.abs(pull).max(initial=1e-300)
    later = np.divide(cut.span[places], rate, out=np.zeros(len(places)), where=known) * direction
    return places, -starts * later * (stiffness + spring), starts * later


def _responses(stiffness: np.ndarray, damping: np.ndarray, span: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Return q and q' after each step: per unit of q, of q', of a constant input and of one from 0 to 1.

    Shape (num_steps, 2, 4). The matrix exponential, by Taylor series with squaring, once per distinct step.
    """
    _, chosen, of = np.unique(kind, return_index=True, return_inverse=True)
    stiffness, damping, span = stiffness[chosen], damping[chosen], span[chosen]
    matrix = np.zeros((len(span), 4, 4))
    matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1] = span, -stiffness * span, -damping * span
    matrix[:, 1, 2], matrix[:, 2, 3] = span, 1.0
    # The norm in units in which angle and velocity are of one size.
    largest = float((np.abs(damping) * span + np.sqrt(np.abs(stiffness)) * span).max(initial=0.0))
    # Down to a norm of a half, at which the fourteen terms leave less than rounding does.
    halvings = max(0, int(np.ceil(np.log2(max(largest, 1e-9)))) + 1)
    matrix /= 2.0**halvings
    power = exponential = np.broadcast_to(np.eye(4), matrix.shape)
    for order in range(1, 15):
        power = power @ matrix / order
        exponential = exponential + power
    for _ in range(halvings):
        exponential = exponential @ exponential
    return exponential[of, :2]
