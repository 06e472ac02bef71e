"""Unloaded friction, from the legs in swing.

A leg in swing is a known mechanism on a base whose motion the IMU measures: what moves its links, τ_links, follows from
the recorded motion (`body.py`). The rest of the motor's torque is the joint's own:

    τ - τ_links = armature θ'' + B θ' + b_c sign(θ') + offset.

A short Hann window averages neighbouring equations, within a swing and away from reversals of the joint. The offset
takes up what is constant in a swing and is known to be small, without which joints that move one way only could not
tell it from friction. Logged torque is early or late by a part of a period against the encoder, which times kp is a
viscous friction: that lateness is one more unknown, known to be within a period.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.files.walk import WalkLog
from stiction.identification.walking.blocks import BlockFit, fit_blocks
from stiction.identification.walking.body import BaseMotion, JointMotion, link_effort
from stiction.identification.walking.contact import contact_source, feet_down
from stiction.identification.walking.imu import at_place
from stiction.identification.walking.motion import (
    WalkMotion,
    carriers,
    grow,
    hann_weights,
    slow_samples,
    smooth,
    swings,
)
from stiction.identification.walking.setup import WalkSetup
from stiction.robots.model import Robot

PARAMETERS = ("armature", "viscous_friction", "coulomb_friction", "lateness")
"""What every joint of a fit shares; each joint has an offset of its own besides."""

FEWEST_SWINGS = 8
"""Fewer swings say too little about their own spread."""

BLOCK = 0.5
"""Length of a block of data where no swing bounds it [s], one or two steps of a walk."""

FEWEST_ROWS = 40
"""Fewest rows of a fit: as many as two swings have."""

WIDEST = 0.05
"""Half-width of the Coulomb friction's interval over the torque limit beyond which there is no answer [1]."""


@dataclass(frozen=True)
class SwingRows:
    """The equations of one joint in swing, R rows, smoothed."""

    joint: str
    """Name of the joint."""
    acceleration: np.ndarray
    """θ'' [rad/s²], shape (R,)."""
    velocity: np.ndarray
    """θ' [rad/s], shape (R,)."""
    direction: np.ndarray
    """sign(θ') [1], shape (R,): without reversals in the window, exactly ±1."""
    load: np.ndarray
    """|τ| sign(θ') [N m], shape (R,)."""
    torque: np.ndarray
    """τ - τ_links [N m], shape (R,)."""
    slope: np.ndarray
    """Rate of τ [N m/s], shape (R,)."""
    systematic: np.ndarray
    """Change of `torque` by links that are heavier by `link_mass_error`, by the error of the specific force along x, y,
    z, by half a period in which a sampled torque is not known, and, where the IMU's place is not, by that along x, y, z
    [N m], shape (5 or 8, R)."""
    swing: np.ndarray
    """Number of the swing, different between legs, shape (R,)."""
    sample: np.ndarray
    """Number of the sample in the log, shape (R,)."""


def swing_rows(log: WalkLog, motion: WalkMotion, spec: Robot, setup: WalkSetup) -> list[SwingRows]:
    """Return the equations of every joint, in the order of the robot's joints.

    A joint swings while all feet that hang on it do. One that carries no foot always does, in blocks of `BLOCK`.
    """
    carries = carriers(spec)
    bearing = feet_down(log, motion, spec, setup) @ carries
    # The force by which the torque tells contact is smoothed, so that its edges are as vague as half the window.
    vague = setup.smoothing / 2 if contact_source(log, setup) == "torque" else 0.0
    margin, time = round((setup.swing_margin + vague) / motion.period), np.arange(len(motion))
    links = link_effort(spec, motion.joints, motion.base).torque
    systematic = _systematic(spec, motion, links, setup)
    rows: list[SwingRows] = []
    for number, feet in enumerate(carries.T):
        if feet.any():
            phase = swings(bearing[:, number], margin)
            # Numbers of swings must differ between legs: those of a leg are fewer than its samples.
            phase = np.where(phase > 0, phase + feet.argmax() * len(motion), 0)
        else:
            phase = 1 + time // round(BLOCK / motion.period)
        rows.append(_joint_rows(spec, motion, number, links[:, number], systematic[:, :, number], phase, setup))
    return rows


def _joint_rows(
    spec: Robot,
    motion: WalkMotion,
    number: int,
    links: np.ndarray,
    errors: np.ndarray,
    phase: np.ndarray,
    setup: WalkSetup,
) -> SwingRows:
    """Return the equations of joint `number`; links: τ_links, (T,); errors: systematic, (S, T); phase: swings, (T,)."""
    joint, rate = spec.joints[number], motion.rate[:, number]
    angle = motion.joints.position[:, number]
    stopped = (angle < joint.lower + setup.limit_margin) | (angle > joint.upper - setup.limit_margin)
    unclear = (phase == 0) | stopped | slow_samples(rate, setup, motion.period)
    weights = hann_weights(setup.smoothing, motion.period)
    # By half a window, so that no smoothed equation has an unclear sample in it.
    clear = ~grow(unclear, len(weights) // 2)
    torque, direction = motion.torque[:, number], np.sign(rate)
    if not motion.measured_acceleration:
        # What is neglected keeps step with the legs, so at worst it has friction's own sign throughout.
        errors = np.concatenate([errors[:1], np.abs(errors[1:4]) * direction, errors[4:]])
    slope = np.gradient(torque, motion.period)
    load = np.abs(torque) * direction
    signals = (motion.joints.acceleration[:, number], rate, direction, load, torque - links, slope, *errors)
    table = smooth(np.stack(signals, axis=1), weights)[clear].T
    return SwingRows(
        joint=joint.name,
        acceleration=table[0],
        velocity=table[1],
        direction=table[2],
        load=table[3],
        torque=table[4],
        slope=table[5],
        systematic=table[6:],
        swing=phase[clear],
        sample=np.flatnonzero(clear),
    )


def _systematic(spec: Robot, motion: WalkMotion, links: np.ndarray, setup: WalkSetup) -> np.ndarray:
    """Return the change of the torques left for the joints by all that `SwingRows.systematic` names, (S, T, J)."""
    share = setup.link_mass_error if motion.measured_torque else np.hypot(setup.link_mass_error, setup.strength_error)
    error = setup.specific_force_error if motion.measured_acceleration else setup.neglected_acceleration
    effects = _specific_force_effects(spec, motion.joints.position)
    found = [share * links[None], error * effects, motion.period / 2 * motion.jumps[None]]
    if motion.unplaced:
        rate = motion.base.angular_velocity
        pulls = [at_place(rate, motion.period, motion.unplaced * axis) for axis in np.eye(3)]
        found.append(np.stack([np.einsum("atj,ta->tj", effects, pull) for pull in pulls]))
    return np.concatenate(found)


def _specific_force_effects(spec: Robot, position: np.ndarray) -> np.ndarray:
    """Return the change of the links' torques per m/s² of specific force along x, y, z [kg m], shape (3, T, J)."""
    held = JointMotion(position, np.zeros_like(position), np.zeros_like(position))
    still = np.zeros((len(position), 3))
    pushes = [BaseMotion(still, still, np.broadcast_to(axis, still.shape)) for axis in np.eye(3)]
    return np.stack([link_effort(spec, held, push).torque for push in pushes])


@dataclass(frozen=True)
class SwingFit:
    """Friction of one joint, or of several that were taken to be alike."""

    joints: tuple[str, ...]
    """The joints behind it."""
    fit: BlockFit | None
    """Parameters as in `PARAMETERS`, then an offset per joint; None where the swings do not tell."""
    refusal: str
    """Why there is no fit; empty if there is one."""
    rows: int
    """Number of equations."""
    swings: int
    """Number of swings that they come from."""


def fit_swing(rows: list[SwingRows], torque_limit: float, period: float, setup: WalkSetup) -> SwingFit:
    """Fit armature, viscous and Coulomb friction that are the same for all joints in `rows`, and an offset each.

    torque_limit: of these joints' motors [N m]; period: of the log [s].
    """
    used = [joint for joint in rows if len(joint.torque)]
    count = sum(len(joint.torque) for joint in used)
    number = len(np.unique(np.concatenate([joint.swing for joint in used]))) if used else 0
    found = SwingFit(tuple(joint.joint for joint in rows), None, "", count, number)
    if count < FEWEST_ROWS or number < FEWEST_SWINGS:
        reason = (
            f"{number} swings and {count} samples in which it clearly moves; expected at least {FEWEST_SWINGS} and "
            f"{FEWEST_ROWS}: log for longer, or walk so that this joint moves (hips: sideways, turning)"
        )
        return replace(found, refusal=reason)
    try:
        fit = _fit(used, torque_limit * setup.torque_zero_error / 2, period * setup.timing_error / 2)
    except np.linalg.LinAlgError:
        return replace(found, refusal="its swings are all alike: walk at different speeds")
    rotor = fit.estimate(PARAMETERS.index("armature"))
    if rotor.value <= 0:
        reason = (
            f"its rotor would have an inertia of {rotor.value:.3g} kg m², which must be positive: is the torque the "
            "motor's, in N m, with the sign of the angle, and the robot's geometry right?"
        )
        return replace(found, refusal=reason)
    low, high = fit.estimate(PARAMETERS.index("coulomb_friction")).interval95
    if not high - low <= 2 * WIDEST * torque_limit:
        reason = (
            f"the interval of its dry friction, {low:.3g} to {high:.3g} N m, is too wide to tell anything: dry and "
            "viscous friction and offset look alike: log for longer, at different speeds and in different directions"
        )
        return replace(found, refusal=reason)
    return replace(found, fit=fit)


def _fit(used: list[SwingRows], zero: float, late: float) -> BlockFit:
    """Fit; offsets are known to be zero within `zero` [N m], the lateness within `late` [s], one deviation each."""
    owner = np.repeat(np.arange(len(used)), [len(joint.torque) for joint in used])
    shared = [np.concatenate([getattr(joint, name) for joint in used]) for name in ("acceleration", "velocity")]
    # Logged δ late the torque of now is that of δ ago, τ − δ τ': hence the sign.
    shared += [np.concatenate([joint.direction for joint in used]), -np.concatenate([joint.slope for joint in used])]
    return fit_blocks(
        regressor=np.concatenate([np.stack(shared, axis=1), np.eye(len(used))[owner]], axis=1),
        target=np.concatenate([joint.torque for joint in used]),
        block=np.concatenate([joint.swing for joint in used]),
        systematic=np.concatenate([joint.systematic for joint in used], axis=1),
        prior=np.array([np.inf, np.inf, np.inf, late] + [zero] * len(used)),
    )
