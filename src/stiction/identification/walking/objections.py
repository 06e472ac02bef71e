"""What makes the fit of a walk invalid, joint by joint or not: a log that contradicts the robot's model, or itself.

Legs in swing tell friction, and little else. The rest of the walk tells whether the log is what it was said to be:
feet on the ground turn against the base as the gyroscope says, feet in the air carry nothing, and on average those on
the ground carry the robot's weight. Each takes the model, all angles, and what the motors give.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.rotation import crosses
from stiction.files.joints import Estimate, JointRecord, Objection
from stiction.files.walk import WalkLog
from stiction.identification.objections import NEGATIVE_FRICTION, SERIOUS, no_friction_shown
from stiction.identification.walking.blocks import BlockFit, fit_blocks
from stiction.identification.walking.body import foot_positions, link_effort
from stiction.identification.walking.contact import BEARING, feet_down, upward_map
from stiction.identification.walking.motion import WalkMotion, grow, hann_weights, slow_samples, smooth, swings
from stiction.identification.walking.setup import WalkSetup
from stiction.identification.walking.swing import BLOCK, FEWEST_ROWS, PARAMETERS, SwingFit
from stiction.robots.model import GRAVITY, Robot

TURNS = (0.25, 1.5)
"""Roll and pitch of the base by the feet on the ground over the gyroscope's, outside of which the two are of different
motions. In simulated walks it was 0.6 to 1.1, and 0.3 to 1.1 with contact by torque."""

RATES = (0.7, 1.4)
"""Logged velocity of the joints over the rate of their angles, outside of which the stamps or a unit are wrong; the
median of joints. Filters and noise leave 0.9 to 1.0."""

STANDING = 0.2
"""Share of the weight that a foot bears, from which on it is taken to stand still on the ground [1]."""

EDGE = 0.02
"""Time after lift-off and before touch-down in which a foot is looked at by itself [s]: contact that comes late shows
there alone, and a foot that swings bears hardly any weight by then."""

FEWEST_BLOCKS = 4
"""Half seconds, or swings, from which on their spread says something."""

LATE = 1.5
"""Lateness of the torque beyond which it is none of the declared bound, over that bound [1]; the median of joints."""


@dataclass(frozen=True)
class WalkChecks:
    """What a walk shows about the declared set-up."""

    objections: tuple[Objection, ...]
    """What makes every joint's fit invalid, the plainest first."""
    weight: Estimate | None
    """What the motors hold on the ground over the robot's weight [1]; None where no foot stands long enough."""


def check_walk(
    log: WalkLog, motion: WalkMotion, spec: Robot, setup: WalkSetup, fits: Sequence[SwingFit | None]
) -> WalkChecks:
    """Hold a walk against the robot and against itself. fits: what is known of each joint, None where nothing is."""
    own, vague = _own_torque(motion, fits, np.array(log.header.torque_limit), setup)
    upward = upward_map(motion, spec) / (GRAVITY * (spec.mass + setup.payload))
    left = link_effort(spec, motion.joints, motion.base).torque + own - motion.torque
    force, doubt = np.einsum("tlj,tj->tl", upward, left), np.einsum("tlj,tj->tl", np.abs(upward), vague)
    down, weights = feet_down(log, motion, spec, setup), hann_weights(setup.smoothing, motion.period)
    weight, standing = _weight(motion, force), down & (smooth(force - doubt, weights) > STANDING)
    found = [
        *_rates(log, motion, setup, weights),
        *_turns(spec, motion, standing, weights),
        *_swing(spec, motion, (force, force - doubt), down, _feet_of_known_joints(spec, fits), setup),
        *([] if weight is None else _carried(weight, motion, spec, setup)),
        *_late(motion, fits, setup),
    ]
    return WalkChecks(tuple(found), weight)


def joint_objections(fit: BlockFit, accelerometer: bool) -> tuple[Objection, ...]:
    """Return what makes one joint's fit invalid: friction below zero, or none that is shown.

    accelerometer: whether there was one; what the base's acceleration does is else taken for viscous friction.
    """
    found = []
    # Without an accelerometer the first is left out.
    for name in ("viscous_friction", "coulomb_friction")[not accelerometer :]:
        low, high = fit.estimate(PARAMETERS.index(name)).interval95
        if high < 0:
            found.append(
                Objection(
                    NEGATIVE_FRICTION,
                    f"{name} comes out below zero ({low:.4g} to {high:.4g}), which no joint has: something in its "
                    "swings drives the joint that the model does not have",
                    "log for longer, at different speeds; check the torques, and the contact (--contact)",
                )
            )
    return (*found, *no_friction_shown(JointRecord(), fit.estimate(PARAMETERS.index("coulomb_friction"))))


def _own_torque(
    motion: WalkMotion, fits: Sequence[SwingFit | None], limit: np.ndarray, setup: WalkSetup
) -> tuple[np.ndarray, np.ndarray]:
    """Return what rotors and friction take of the motors' torque, and how vague that is [N m], shape (T, J) each.

    Friction of a joint that hardly moves may be anything up to its dry friction. Where that is not known it is taken to
    be the others' median share of the torque limit. fits: of each joint; limit: torque limits [N m], shape (J,).
    """
    known = [abs(found.fit.values[2]) / limit[joint] for joint, found in enumerate(fits) if found and found.fit]
    own, vague = np.zeros_like(motion.torque), np.tile(float(np.median(known)) * limit, (len(motion), 1))
    for joint, found in enumerate(fits):
        if found is not None and found.fit is not None:
            armature, viscous, coulomb = found.fit.values[:3]
            rate = motion.rate[:, joint]
            own[:, joint] = armature * motion.joints.acceleration[:, joint] + viscous * rate + coulomb * np.sign(rate)
            vague[:, joint] = abs(coulomb) * slow_samples(rate, setup, motion.period)
    return own, vague


def _slope(x: np.ndarray, y: np.ndarray, block: np.ndarray) -> Estimate | None:
    """Return y over x, each shape (R,), with its interval from blocks; None where there are too few."""
    if len(x) < FEWEST_ROWS or len(np.unique(block)) < FEWEST_BLOCKS or not np.any(x):
        return None
    return fit_blocks(x[:, None], y, block, np.zeros((0, len(x)))).estimate(0)


def _blocks(motion: WalkMotion) -> np.ndarray:
    """Return the number of the block of each sample, shape (T,)."""
    return np.arange(len(motion)) // round(BLOCK / motion.period)


def _rates(log: WalkLog, motion: WalkMotion, setup: WalkSetup, weights: np.ndarray) -> list[Objection]:
    """Object to velocities that are another multiple of the rates of the angles."""
    rate, logged = smooth(motion.rate, weights), smooth(log.joint_velocity, weights)
    moves = np.sqrt(np.mean(rate**2, axis=0)) > setup.slow
    ratios = np.sum(rate * logged, axis=0)[moves] / np.sum(rate**2, axis=0)[moves]
    middle = float(np.median(ratios)) if len(ratios) else 1.0
    if RATES[0] <= middle <= RATES[1]:
        return []
    return [
        Objection(
            "rates",
            f"the joints' velocities are {middle:.3g} times the rates of their angles: the stamps, or the unit of one "
            "of the two, are not as declared",
            "check --time-scale, --rate and --position-scale",
        )
    ]


def _turns(spec: Robot, motion: WalkMotion, standing: np.ndarray, weights: np.ndarray) -> list[Objection]:
    """Object to feet on the ground that turn about the base otherwise than the gyroscope says.

    Of two feet that stand the distance p turns with the world, p' = -ω × p in the base frame. Along up this holds for
    feet that slip, too. standing: bool, shape (T, L); weights: of the smoothing.
    """
    place = foot_positions(spec, motion.joints.position)
    moved, block = np.gradient(place, motion.period, axis=0), _blocks(motion)
    said: list[np.ndarray] = []
    seen: list[np.ndarray] = []
    blocks: list[np.ndarray] = []
    for one in range(len(spec.feet)):
        for other in range(one):
            # By half a window: no smoothed sample has one in it at which a foot did not stand.
            both = ~grow(~(standing[:, one] & standing[:, other]), len(weights) // 2)
            turned = -crosses(motion.base.angular_velocity, place[:, one] - place[:, other])
            for found, rate in ((said, turned), (seen, moved[:, one] - moved[:, other])):
                found.append(smooth(np.einsum("ti,ti->t", rate, motion.upward)[:, None], weights)[both, 0])
            blocks.append(block[both])
    turn = _slope(*map(np.concatenate, (said, seen, blocks))) if said else None
    if turn is None or (turn.interval95[0] <= TURNS[1] and turn.interval95[1] >= TURNS[0]):
        return []
    return [
        Objection(
            "turns",
            f"by the joints' angles the base turns over the feet on the ground {_said(turn)} times as fast as its "
            "gyroscope says: angles, their order or signs, the stamps, the gyroscope's unit or the IMU's axes are not "
            "as declared",
            "check --names, --joint-map, --position-scale, --time-scale and the rate, the IMU's axes and unit, and "
            "that --robot is the robot that walked",
        )
    ]


def _feet_of_known_joints(spec: Robot, fits: Sequence[SwingFit | None]) -> list[int]:
    """Return the numbers of the feet that hang on joints of which each one's friction is known."""
    known = {joint for joint, found in enumerate(fits) if found is not None and found.fit is not None}
    return [number for number, foot in enumerate(spec.feet) if known.issuperset(spec.chain(foot.link))]


def _swing(
    spec: Robot,
    motion: WalkMotion,
    forces: tuple[np.ndarray, np.ndarray],
    down: np.ndarray,
    known: list[int],
    setup: WalkSetup,
) -> list[Objection]:
    """Object to a foot that is said to swing and bears load, by the motors' torque, on average or at a swing's ends.

    forces: on each foot over the weight, and at least, (T, L) each; known: feet whose legs' friction is known. The ends
    of a swing, where joints turn round and friction is vague, are looked at of those alone.
    """
    margin, edge = round(setup.swing_margin / motion.period), round(EDGE / motion.period)
    found: list[tuple[float, str, Estimate]] = []
    for number, name in enumerate(spec.foot_names):
        phase = swings(down[:, number], margin)
        # Begin and end alternate, for the ends of a log are in no swing: every other change is a start, or an end.
        starts, ends = (np.flatnonzero(np.diff(phase > 0, **side)) for side in ({"prepend": False}, {"append": False}))
        first, last = (phase * _near(places, len(phase), edge) for places in (starts[::2], ends[1::2] - edge + 1))
        for part, force in zip((phase, first, last), (forces[0], forces[1], forces[1]), strict=True):
            if part is not phase and number not in known:
                continue
            load = _slope(np.ones(int((part > 0).sum())), force[part > 0, number], part[part > 0])
            if load is not None and load.interval95[0] > BEARING:
                found.append((load.value, name, load))
    if not found:
        return []
    _, name, load = max(found, key=lambda one: one[0])
    low, high = load.interval95
    return [
        Objection(
            "swing_load",
            f"by the motors' torque foot {name} bears {load.value:.0%} ({low:.0%} to {high:.0%}) of the robot's weight "
            "where it is said to swing: its contact is another foot's, or comes late, or torques and angles are of "
            "other joints",
            "check the order of the feet and of the joints' names, and the stamps; or --contact torque, which needs no "
            "contact in the log",
        )
    ]


def _near(starts: np.ndarray, samples: int, length: int) -> np.ndarray:
    """Return which samples are in stretches of a length from these starts on, bool, shape (samples,)."""
    found = np.zeros(samples, dtype=bool)
    for start in starts:
        found[max(start, 0) : start + length] = True
    return found


def _weight(motion: WalkMotion, force: np.ndarray) -> Estimate | None:
    """Return the ground's upward force on all feet over the robot's weight, its motion counted; force: over weight."""
    pull = np.einsum("ti,ti->t", motion.base.specific_force, motion.upward) / GRAVITY
    return _slope(pull, force.sum(axis=1), _blocks(motion))


def _carried(weight: Estimate, motion: WalkMotion, spec: Robot, setup: WalkSetup) -> list[Objection]:
    """Object to torques that hold another weight than the robot's."""
    low, high = weight.interval95
    most = SERIOUS if motion.measured_torque else SERIOUS + setup.strength_error
    if low <= 1 + most and high >= 1 - most:
        return []
    source, flag = ("torques", "--torque-scale") if motion.measured_torque else ("gains", "--kp, --kd")
    return [
        Objection(
            "weight",
            f"on the ground the motors hold {_said(weight)} times the robot's weight, {spec.mass + setup.payload:.3g} "
            f"kg: the {source}, the masses and lengths of --robot or its load are not as declared, a torque was cut "
            "off, or something else held the robot",
            f"check {flag}, that --robot is the robot that walked, and the joints' names; weigh it, and declare what "
            "it carries (--payload)",
        )
    ]


def _late(motion: WalkMotion, fits: Sequence[SwingFit | None], setup: WalkSetup) -> list[Objection]:
    """Object to torque that is later, or earlier, against the angles than was declared."""
    index, bound = PARAMETERS.index("lateness"), setup.timing_error * motion.period
    late = [found.fit.values[index] for found in fits if found is not None and found.fit is not None]
    middle = float(np.median(late)) if late else 0.0
    if abs(middle) <= LATE * bound or not motion.measured_acceleration:
        return []
    return [
        Objection(
            "late_torque",
            f"the torque is {1e3 * abs(middle):.2g} ms {'late' if middle > 0 else 'early'} against the angles, and at "
            f"most {1e3 * bound:.2g} ms were declared",
            "log torque and angles by one clock; or declare more, --timing-error, in periods of the log",
        )
    ]


def _said(ratio: Estimate) -> str:
    """Return a ratio and its interval in words."""
    return f"{ratio.value:.3g} ({ratio.interval95[0]:.3g} to {ratio.interval95[1]:.3g})"
