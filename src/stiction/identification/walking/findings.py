"""Errors that make the fit of a walk invalid: a log that contradicts the robot's model, or itself.

Legs in swing tell friction, and little else. The rest of the walk tells whether the log is as declared:
feet on the ground turn against the base as the gyroscope says, feet in the air carry nothing, and on average those on
the ground carry the robot's weight. Each takes the model, all angles, and what the motors give.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from stiction.core.rotation import crosses
from stiction.files.joints import Estimate, Finding, JointRecord
from stiction.identification.contradictions import SERIOUS
from stiction.identification.findings import below_zero, no_friction_shown
from stiction.identification.limb.fit import PriorFit, fit_blocks
from stiction.identification.walking.swing import BLOCK, FEWEST_ROWS
from stiction.identification.walking.walk import BEARING, Walk, foot_positions, grow, smooth, swings
from stiction.robots.model import GRAVITY

TURNS = (0.25, 1.5)
"""Roll and pitch of the base by the feet on the ground over the gyroscope's, outside of which they are of different
motions. In simulated walks it was 0.6 to 1.1, and 0.3 to 1.1 with contact by torque."""

RATES = (0.7, 1.4)
"""Logged velocity of the joints over the rate of their angles, outside of which the stamps or a unit are wrong; the
median of joints. Filters and noise leave 0.9 to 1.0."""

STANDING = 0.2
"""Share of the weight above which a foot is taken to stand still on the ground [1]."""

EDGE = 0.02
"""Time after lift-off and before touch-down in which a foot is judged by itself [s]: contact that comes late shows
there alone, and a foot that swings bears hardly any weight by then."""

FEWEST_BLOCKS = 4
"""Fewest half seconds, or swings, for their spread to mean something."""

LATE = 1.5
"""Lateness of the torque over its declared bound above which it contradicts that bound [1]; the median of joints."""

Fits = Sequence[PriorFit | None]
"""Fit of each joint of a robot, None where there is none."""


def check_walk(walk: Walk, fits: Fits) -> tuple[tuple[Finding, ...], Estimate | None]:
    """Check a walk against the robot and against itself.

    Returns the errors that make every joint's fit invalid, the plainest first, and the weight that the motors hold on
    the ground over the robot's [1], None where no foot stands long enough.
    """
    losses, vague = _lost_torque(walk, fits)
    upward = walk.upward_map / (GRAVITY * (walk.spec.mass + walk.setup.payload))
    # Upward force of the ground on each foot over the robot's weight, and how vague it is, (T, L) each.
    force = np.einsum("tlj,tj->tl", upward, walk.effort[0] + losses - walk.torque)
    least = force - np.einsum("tlj,tj->tl", np.abs(upward), vague)
    pull = np.einsum("ti,ti->t", walk.base.pull, walk.upward) / GRAVITY
    weight = _slope(pull, force.sum(axis=1), walk.blocks(BLOCK))
    checks = (
        _rates(walk),
        _turns(walk, walk.down & (smooth(least, walk.weights) > STANDING)),
        _swing(walk, force, least, fits),
        None if weight is None else _carried(walk, weight),
        _late(walk, fits),
    )
    return tuple(finding for finding in checks if finding is not None), weight


def joint_errors(fit: PriorFit, accelerometer: bool) -> Iterator[Finding]:
    """Yield errors that make one joint's fit invalid: friction below zero, or friction that is not shown.

    accelerometer: True if there was one; otherwise the base's acceleration is taken for viscous friction.
    """
    for name in ("viscous_friction", "coulomb_friction") if accelerometer else ("coulomb_friction",):
        remedy = "log for longer, at different speeds; check the torques, and the contact (--contact)"
        yield from below_zero(name, fit.estimate(name), "its swings", remedy)
    yield from no_friction_shown(JointRecord(), fit.estimate("coulomb_friction"))


def _lost_torque(walk: Walk, fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque that rotors and friction take of the motors', and its uncertainty [N m], shape (T, J) each.

    Friction of a joint that hardly moves may be anything up to its dry friction. Where that is not known it follows
    from the median share of the torque limit over the other joints.
    """
    known = {number: fit.values[:3] for number, fit in enumerate(fits) if fit is not None}
    share = float(np.median([abs(values[2]) / walk.limits[number] for number, values in known.items()]))
    losses, vague = np.zeros_like(walk.torque), np.tile(share * walk.limits, (len(walk), 1))
    for joint, (armature, viscous, coulomb) in known.items():
        rate = walk.rate[:, joint]
        losses[:, joint] = armature * walk.acceleration[:, joint] + viscous * rate + coulomb * np.sign(rate)
        vague[:, joint] = abs(coulomb) * walk.resting[:, joint]
    return losses, vague


def _slope(x: np.ndarray, y: np.ndarray, block: np.ndarray) -> Estimate | None:
    """Return y over x, each shape (R,), with its interval from blocks; None where there are too few."""
    if len(x) < FEWEST_ROWS or len(np.unique(block)) < FEWEST_BLOCKS or not np.any(x):
        return None
    return fit_blocks(("slope",), x[:, None], y, block).estimate("slope")


def _rates(walk: Walk) -> Finding | None:
    """Return an error for velocities that are another multiple of the rates of the angles."""
    rate, logged = smooth(walk.rate, walk.weights), smooth(walk.log.joint_velocity, walk.weights)
    moves = np.sqrt(np.mean(rate**2, axis=0)) > walk.setup.slow
    ratios = np.sum(rate * logged, axis=0)[moves] / np.sum(rate**2, axis=0)[moves]
    middle = float(np.median(ratios)) if len(ratios) else 1.0
    if RATES[0] <= middle <= RATES[1]:
        return None
    seen = (
        f"the joints' velocities are {middle:.3g} times the rates of their angles: the stamps, or the unit of one of "
        "the two, are not as declared"
    )
    return Finding("rates", seen, "check --time-scale, --rate and --position-scale")


def _turns(walk: Walk, standing: np.ndarray) -> Finding | None:
    """Return an error for feet on the ground that turn about the base otherwise than the gyroscope says.

    The distance p of two standing feet turns with the world, p' = -ω × p in the base frame. Along up this holds for
    feet that slip, too. standing: bool, shape (T, L).
    """
    place = foot_positions(walk.spec, walk.links)
    moved, block = np.gradient(place, walk.period, axis=0), walk.blocks(BLOCK)
    parts = []
    for second, first in combinations(range(len(walk.spec.feet)), 2):
        # By half a window: no smoothed sample has one in it at which a foot did not stand.
        both = ~grow(~(standing[:, first] & standing[:, second]), len(walk.weights) // 2)
        expected = -crosses(walk.base.spin, place[:, first] - place[:, second])
        rates = np.stack([expected, moved[:, first] - moved[:, second]], axis=1)
        parts.append(np.column_stack([smooth(np.einsum("tki,ti->tk", rates, walk.upward), walk.weights), block])[both])
    turn = _slope(*np.concatenate(parts).T) if parts else None
    if turn is None or (turn.interval95[0] <= TURNS[1] and turn.interval95[1] >= TURNS[0]):
        return None
    return Finding(
        "turns",
        f"by the joints' angles the base turns over the feet on the ground {_with_interval(turn)} times as fast as its "
        "gyroscope says: angles, their order or signs, the stamps, the gyroscope's unit or the IMU's axes are not as "
        "declared",
        "check --names, --joint-map, --position-scale, --time-scale and the rate, the IMU's axes and unit, and that "
        "--robot is the robot that walked",
    )


def _swing(walk: Walk, force: np.ndarray, least: np.ndarray, fits: Fits) -> Finding | None:
    """Return an error for a foot in swing that bears load, by the motors' torque, on average or at a swing's ends.

    force, least: on each foot over the weight, (T, L). The ends of a swing, where joints turn round and friction is
    vague, are judged only for feet that hang on joints of known friction.
    """
    margin, edge = round(walk.setup.swing_margin / walk.period), round(EDGE / walk.period)
    loaded: list[tuple[float, str, Estimate]] = []
    for number, foot in enumerate(walk.spec.feet):
        phase = swings(walk.down[:, number], margin)
        parts = [(phase, force)]
        if all(fits[joint] is not None for joint in walk.spec.chain(foot.link)):
            # Begin and end alternate, for the ends of a log are in no swing.
            changes = np.flatnonzero(np.diff(phase > 0)) + 1
            for starts in (changes[::2], changes[1::2] - edge):
                near = np.zeros(len(phase), dtype=bool)
                for start in starts:
                    near[max(start, 0) : start + edge] = True
                parts.append((phase * near, least))
        for part, load in parts:
            borne = _slope(np.ones(int((part > 0).sum())), load[part > 0, number], part[part > 0])
            if borne is not None and borne.interval95[0] > BEARING:
                loaded.append((borne.value, foot.name, borne))
    if not loaded:
        return None
    _, name, borne = max(loaded, key=lambda item: item[0])
    low, high = borne.interval95
    return Finding(
        "swing_load",
        f"by the motors' torque foot {name} bears {borne.value:.0%} ({low:.0%} to {high:.0%}) of the robot's weight "
        "where it is said to swing: its contact is another foot's, or comes late, or torques and angles are of other "
        "joints",
        "check the order of the feet and of the joints' names, and the stamps; or --contact torque, which needs no "
        "contact in the log",
    )


def _carried(walk: Walk, weight: Estimate) -> Finding | None:
    """Return an error for torques that hold another weight than the robot's."""
    (low, high), most = weight.interval95, SERIOUS + (0 if walk.measured_torque else walk.setup.strength_error)
    if low <= 1 + most and high >= 1 - most:
        return None
    source, flag = ("torques", "--torque-scale") if walk.measured_torque else ("gains", "--kp, --kd")
    return Finding(
        "weight",
        f"on the ground the motors hold {_with_interval(weight)} times the robot's weight, "
        f"{walk.spec.mass + walk.setup.payload:.3g} kg: the {source}, the masses and lengths of --robot or its load "
        "are not as declared, a torque was cut off, or something else held the robot",
        f"check {flag}, that --robot is the robot that walked, and the joints' names; weigh it, and declare what it "
        "carries (--payload)",
    )


def _late(walk: Walk, fits: Fits) -> Finding | None:
    """Return an error for torque that is later, or earlier, against the angles than was declared."""
    late = [fit.value("lateness") for fit in fits if fit is not None]
    middle, bound = float(np.median(late)) if late else 0.0, walk.setup.timing_error * walk.period
    if abs(middle) <= LATE * bound or not walk.measured_acceleration:
        return None
    return Finding(
        "late_torque",
        f"the torque is {1e3 * abs(middle):.2g} ms {'late' if middle > 0 else 'early'} against the angles, and at most "
        f"{1e3 * bound:.2g} ms were declared",
        "log torque and angles by one clock; or declare more, --timing-error, in periods of the log",
    )


def _with_interval(ratio: Estimate) -> str:
    """Return a ratio and its interval in words."""
    return f"{ratio.value:.3g} ({ratio.interval95[0]:.3g} to {ratio.interval95[1]:.3g})"
