"""Unloaded friction, from the legs in swing.

A leg in swing is a known mechanism on a base whose motion the IMU measures: what moves its links, τ_links, follows from
the recorded motion. The rest of the motor's torque is the joint's own:

    τ - τ_links = armature θ'' + B θ' + b_c sign(θ') + offset.

A short Hann window averages neighbouring equations, within a swing and away from reversals of the joint. The offset
takes up what is constant in a swing and is known to be small, without which joints that move one way only could not
tell it from friction. Logged torque is early or late by a part of a period against the encoder, which times kp is a
viscous friction: that lateness is one more unknown, known to be within a period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.identification.limb.dynamics import motions_at_rest, whole_effort
from stiction.identification.limb.fit import PriorFit, fit_blocks
from stiction.identification.walking.imu import at_place
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.walk import Walk, grow, smooth, swings

PARAMETERS = ("armature", "viscous_friction", "coulomb_friction", "lateness")
"""Names of the parameters that all joints of a fit share; each joint has an offset besides, `offset.NAME`."""

FEWEST_SWINGS = 8
"""Fewest swings of a fit: fewer say too little about their spread."""

BLOCK = 0.5
"""Length of a block of data where no swing bounds it [s], one or two steps of a walk."""

FEWEST_ROWS = 40
"""Fewest rows of a fit: as many as two swings have."""

WIDEST = 0.05
"""Half-width of the Coulomb friction's interval over the torque limit above which no value is stated [1]."""


@dataclass(frozen=True)
class SwingRows:
    """Equations of one joint in swing, R rows, smoothed."""

    joint: str
    """Name of the joint."""
    regressor: np.ndarray
    """Columns of `PARAMETERS`: θ'', θ', sign(θ'), ±1 without reversals in the window, and −τ', shape (R, 4)."""
    load: np.ndarray
    """|τ| sign(θ') [N m], shape (R,)."""
    torque: np.ndarray
    """τ - τ_links [N m], shape (R,)."""
    systematic: np.ndarray
    """Change of `torque` by links that are heavier by `link_mass_error`, by the error of the specific force along x, y,
    z, by half a period in which a sampled torque is not known, and, where the IMU's place is not, by that along x, y, z
    [N m], shape (5 or 8, R)."""
    swing: np.ndarray
    """Number of the swing, different between legs, shape (R,)."""
    sample: np.ndarray
    """Number of the sample in the log, shape (R,)."""


def swing_rows(walk: Walk) -> list[SwingRows]:
    """Return the equations of every joint, in the order of the robot's joints.

    A joint swings while all feet that hang on it do. One that carries no foot always does, in blocks of `BLOCK`.
    """
    setup, bearing = walk.setup, walk.down @ walk.carriers
    # The force by which the torque tells contact is smoothed, so that its edges are as vague as half the window.
    vague = setup.smoothing / 2 if walk.contact == "torque" else 0.0
    margin = round((setup.swing_margin + vague) / walk.period)
    position, direction, systematic = walk.log.joint_position, np.sign(walk.rate), _systematic(walk)
    rows = []
    for number, (joint, feet) in enumerate(zip(walk.spec.joints, walk.carriers.T, strict=True)):
        if feet.any():
            phase = swings(bearing[:, number], margin)
            # Numbers of swings must differ between legs: those of a leg are fewer than its samples.
            phase = np.where(phase > 0, phase + feet.argmax() * len(walk), 0)
        else:
            phase = 1 + walk.blocks(BLOCK)
        angle, sign = position[:, number], direction[:, number]
        stopped = (angle < joint.lower + setup.limit_margin) | (angle > joint.upper - setup.limit_margin)
        # By half a window, so that no smoothed equation has an unclear sample in it.
        clear = ~grow((phase == 0) | stopped | walk.resting[:, number], len(walk.weights) // 2)
        errors = systematic[:, :, number]
        if not walk.measured_acceleration:
            # What is neglected keeps step with the legs, so at worst it has friction's own sign throughout.
            errors = np.concatenate([errors[:1], np.abs(errors[1:4]) * sign, errors[4:]])
        torque = walk.torque[:, number]
        signals = (walk.acceleration[:, number], walk.rate[:, number], sign, -walk.slope[:, number])
        signals = (*signals, np.abs(torque) * sign, torque - walk.effort[0][:, number], *errors)
        table = smooth(np.stack(signals, axis=1), walk.weights)[clear]
        rows.append(
            SwingRows(
                joint=joint.name,
                regressor=table[:, :4],
                load=table[:, 4],
                torque=table[:, 5],
                systematic=table[:, 6:].T,
                swing=phase[clear],
                sample=np.flatnonzero(clear),
            )
        )
    return rows


def _systematic(walk: Walk) -> np.ndarray:
    """Return the change of the torques left for the joints by all errors of `SwingRows.systematic`, (S, T, J)."""
    setup, spec = walk.setup, walk.spec
    share = setup.link_mass_error if walk.measured_torque else np.hypot(setup.link_mass_error, setup.strength_error)
    error = setup.specific_force_error if walk.measured_acceleration else setup.neglected_acceleration
    # What a specific force of 1 m/s² along x, y and z asks of the joints, (3, T, J).
    pulled = [
        whole_effort(spec.links, motions_at_rest(spec.links, walk.log.joint_position, axis))[0] for axis in np.eye(3)
    ]
    effects = np.stack(pulled)
    changes = [share * walk.effort[0][None], error * effects, walk.period / 2 * walk.jumps[None]]
    if walk.unplaced:
        pulls = [at_place(walk.base.spin, walk.period, walk.unplaced * axis) for axis in np.eye(3)]
        changes.append(np.stack([np.einsum("ti,itj->tj", pull, effects) for pull in pulls]))
    return np.concatenate(changes)


@dataclass(frozen=True)
class SwingFit:
    """Friction of one joint, or of several that are taken to be alike."""

    joints: tuple[str, ...]
    """Joints of the fit."""
    rows: int
    """Number of equations."""
    swings: int
    """Number of swings of these equations."""
    fit: PriorFit | None
    """Parameters as in `PARAMETERS`, then an offset per joint; None where the swings do not tell."""
    refusal: str = ""
    """Reason why there is no fit; empty if there is one."""


def fit_swing(rows: list[SwingRows], torque_limit: float, period: float, setup: WalkSetup) -> SwingFit:
    """Fit armature, viscous and Coulomb friction that are the same for all joints in `rows`, and an offset each.

    torque_limit: limit of these joints' motors [N m]; period: of the log [s].
    """
    used = [joint for joint in rows if len(joint.torque)]
    swing = np.concatenate([np.zeros(0, int), *(joint.swing for joint in used)])
    number, fit = len(np.unique(swing)), None
    if len(swing) < FEWEST_ROWS or number < FEWEST_SWINGS:
        refusal = (
            f"{number} swings and {len(swing)} samples in which it clearly moves; expected at least {FEWEST_SWINGS} "
            f"and {FEWEST_ROWS}: log for longer, or walk so that this joint moves (hips: sideways, turning)"
        )
    else:
        owner = np.repeat(np.arange(len(used)), [len(joint.torque) for joint in used])
        # Declared bounds hold with 95 %: two deviations.
        late, zero = period * setup.timing_error / 2, torque_limit * setup.torque_zero_error / 2
        try:
            fit = fit_blocks(
                names=(*PARAMETERS, *(f"offset.{joint.joint}" for joint in used)),
                regressor=np.column_stack(
                    [np.concatenate([joint.regressor for joint in used]), np.eye(len(used))[owner]]
                ),
                target=np.concatenate([joint.torque for joint in used]),
                block=swing,
                prior=np.array([np.inf, np.inf, np.inf, late] + [zero] * len(used)),
                systematic=np.concatenate([joint.systematic for joint in used], axis=1),
            )
            refusal = _refusal(fit, torque_limit)
        except np.linalg.LinAlgError:
            refusal = "its swings are all alike: walk at different speeds"
    return SwingFit(tuple(joint.joint for joint in rows), len(swing), number, None if refusal else fit, refusal)


def _refusal(fit: PriorFit, torque_limit: float) -> str:
    """Return the reason why the values of a fit cannot be stated, else nothing."""
    rotor, (low, high) = fit.value("armature"), fit.estimate("coulomb_friction").interval95
    if rotor <= 0:
        return (
            f"its rotor would have an inertia of {rotor:.3g} kg m², which must be positive: is the torque the "
            "motor's, in N m, with the sign of the angle, and the robot's geometry right?"
        )
    if not high - low <= 2 * WIDEST * torque_limit:
        return (
            f"the interval of its dry friction, {low:.3g} to {high:.3g} N m, is too wide to tell anything: dry and "
            "viscous friction and offset look alike: log for longer, at different speeds and in different directions"
        )
    return ""
