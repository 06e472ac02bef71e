"""Contradictions between a log and its declarations: units, limits, gains, a pendulum's weight and angle.

An interval knows scatter, not that a column is in degrees or that a flag is wrong: a fit to such a log may look as
certain as any other. Each finding states what was seen, with its number, and what to do first.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import Finding, JointRecord
from stiction.identification.checks import LARGEST_REACH, Uniform
from stiction.identification.closed_loop import LoopError, Mismatch
from stiction.identification.in_loop import compare_controller
from stiction.identification.runs import Run, hanging
from stiction.identification.setup import LARGEST_TORQUE, IdentifySetup

SERIOUS = 0.1
"""Relative change of a parameter between two readings of a log above which no answer is given. Less is lost in a
level, rounded up to a whole per cent and doubled where the joint was not loaded; from a tenth on it shows."""

LARGEST_SCALE = SERIOUS
"""Relative gap, either way, between kp (target − position) and the logged torque, delay apart, above which one of the
two is wrong: more than delays and biases of virtual robots make of right gains."""

LARGEST_DAMPING_SCALE = 0.3
"""Relative gap of kd velocity above which it is wrong; wider, for noise, filter and backlash. A torque in another unit
shows in both, and dry friction from measured torque does not depend on kd."""

AGAINST = -0.5
"""Correlation of target and position below which a sign is wrong: at low gains a joint lags, and does not run away."""

LARGEST_EXCESS = 1.05
"""Logged torque over torque limit that noise of the current sensor still explains."""

FLAT_SHARE = 0.02
"""Share of samples at exactly the extreme torque above which it counts as clipped. Noise reaches an extreme once."""

FLAT_RATIO = 2.0
"""Samples at the extreme over those in the next twentieth of the range below it: a torque that reverses by itself
has as many there; a clipped one piles up."""


def find_contradictions(run: Run, record: JointRecord, mismatch: Mismatch | None) -> Iterator[Finding]:
    """Yield contradictions between a joint's log and its declarations, the plainest first.

    mismatch: declared gains against the logged torque, where both are known.
    """
    yield from signal_findings(run, record)
    yield from _controller(run, mismatch)
    yield from _hangs(run)
    yield from _weight(run, record)


def signal_findings(run: Run, record: JointRecord) -> Iterator[Finding]:
    """Yield findings on a joint's signals that make any fit wrong: units, and torque that was cut off."""
    yield from unit_findings(run.signals, record.axis)
    limit, peak = record.torque_limit, float(np.abs(run.torque).max())
    if run.setup.drive.column != "torque" and not run.setup.calibrated:
        # Volts or amperes, and a limit in N m: a known weight tells the one from the other, or nothing does.
        peak *= 0.0 if record.motor_strength is None else record.motor_strength.value
    if limit is not None and run.measured and peak > LARGEST_EXCESS * limit:
        yield Finding(
            "beyond_limit",
            f"the log's torque reaches {peak:.4g}, beyond the torque limit {limit:.4g}: the torque's unit "
            "(--torque-scale) or the limit is not as declared",
            "find out which of the two is wrong: --torque-scale, --torque-limit",
        )
    yield from _clipped(run)


def unit_findings(signals: Uniform, axis: str = "rotary") -> Iterator[Finding]:
    """Yield findings on signals that are probably not in SI units; none on a linear axis, where nothing is known."""
    if axis != "rotary":
        return
    reach = float(np.ptp(signals.position))
    if reach > LARGEST_REACH:
        yield Finding(
            "units",
            f"the position covers {reach:.3g} rad, over {reach / (2 * np.pi):.1f} turns: is it in degrees, or at "
            "the motor instead of the joint? The result is wrong then",
            "run again with --position-scale 0.0174533 if the angles are degrees, one over the gear ratio if they "
            "are the motor's",
        )
    if signals.target is not None:
        ratio = float(np.std(signals.target)) / max(float(np.std(signals.position)), 1e-300)
        for factor, word in ((180 / np.pi, "target"), (np.pi / 180, "position")):
            if abs(np.log(max(ratio, 1e-300) / factor)) < 0.5:
                yield Finding(
                    "units",
                    f"the target moves {ratio:.3g} times as far as the position: is the {word} in degrees?",
                    f"convert the {word} to rad in the log, for --position-scale is of both, and run again",
                )
    if signals.torque is not None and (peak := float(np.abs(signals.torque).max())) > LARGEST_TORQUE:
        yield Finding(
            "units",
            f"the torque reaches {peak:.4g} N m: is it in other units, N mm, mA or counts?",
            "run again with --torque-scale, N m per unit of the torque column",
        )


def contradicted(run: Run) -> str:
    """Describe how a log contradicts its declared gains or target; empty where they fit."""
    try:
        mismatch = compare_controller(run)
    except LoopError:
        mismatch = None
    return "; ".join(f"{finding.seen}; {finding.remedy}" for finding in _controller(run, mismatch)) or _against(run)


def _controller(run: Run, mismatch: Mismatch | None) -> Iterator[Finding]:
    """Yield a finding where the logged torque is another multiple of position error, or speed, than the gains say."""
    if mismatch is None:
        return
    spring, damper = mismatch.scales
    if _gap(spring) <= LARGEST_SCALE and _gap(damper) <= LARGEST_DAMPING_SCALE:
        return
    seen = (
        f"the logged torque is {spring:.3g} times kp (target − position) less {damper:.3g} times kd velocity, and is "
        f"off by {mismatch.size:.0%}: torque, angles or stamps are in another unit, belong to another joint, "
        "or the gains are not as declared"
    )
    yield Finding("controller", seen, _against(run) or _other_scale(run.setup, spring, damper))


def _against(run: Run) -> str:
    """Return the advice for a position that runs against its target; empty where it does not, or without a target."""
    if run.logged_target is None:
        return ""
    alike = float(np.corrcoef(run.logged_target, run.signals.position)[0, 1])
    return (
        f"turn the position's sign round in the log, or take this joint's own columns: the position runs against its "
        f"target (correlation {alike:.2f})"
        if alike < AGAINST
        else ""
    )


def _other_scale(setup: IdentifySetup, spring: float, damper: float) -> str:
    """Return the advice for a logged torque that is these multiples of what kp and kd ask for.

    One factor in both is the torque's, the angles' or the gains': the log does not tell which, and matching numbers are
    named for each. In kd alone it is kd's, or that of the stamps.
    """
    kp, kd, turned = setup.kp or 0.0, setup.kd or 0.0, setup.position_scale or 1.0
    flag = "--kt" if setup.drive.column == "current" else "--torque-scale"
    if _gap(spring) <= LARGEST_SCALE and damper > LARGEST_SCALE:
        return (
            f"check --kd (about {_rounded(kd * damper)} would fit) and the stamps (--time-scale, --rate: a log about "
            f"{_rounded(1 / damper)} times as long would fit)"
        )
    if kd > 0 and not _gap(damper / spring) <= LARGEST_DAMPING_SCALE:
        return (
            f"check that all columns are this joint's, and none are exchanged, then {flag}, --kp, --kd and the rate; "
            "torque that the controller adds goes into a feedforward column"
        )
    fits = _rounded(((setup.drive.kt if flag == "--kt" else setup.torque_scale) or 1.0) / spring)
    if spring < 0:
        return f"check {flag} (about {fits} would fit), and that all columns are this joint's"
    if _gap(spring * 180 / np.pi) < SERIOUS and turned == 1:
        return "run again with --position-scale 0.0174533, if the angles are degrees: they look like it"
    return (
        f"check {flag} (about {fits} would fit), --position-scale (about {_rounded(turned * spring)}) and the gains "
        f"(about --kp {_rounded(kp * spring)} --kd {_rounded(kd * spring)}): one of the three is wrong, and the log "
        "does not tell which"
    )


def _rounded(value: float) -> str:
    """Return a number with two digits, without an exponent: more is not known of a matching value."""
    return f"{float(f'{value:.2g}'):g}"


def _gap(scale: float) -> float:
    """Return the relative deviation of a scale factor from 1, up or down."""
    return max(scale, 1 / scale) - 1 if scale > 0 else np.inf


def _clipped(run: Run) -> Iterator[Finding]:
    """Yield a finding where a torque stands still at its extremes, unless that is the declared limit."""
    if not run.measured or run.setup.drive.by_voltage:  # A bridge that is fully on is not a value cut off.
        return
    torque, limit = run.torque[run.signals.valid], run.setup.torque_limit
    flat = [_flat_share(side) for side in (torque, -torque)]
    most = float(np.abs(torque).max())
    if sum(flat) < FLAT_SHARE or (limit is not None and most > 0.99 * limit):
        return
    yield Finding(
        "clipped",
        f"the torque stands at exactly its extremes in {sum(flat):.0%} of the samples ({most:.4g}): it was cut off "
        "there, and what the motor gave beyond is missing",
        f"log the whole range, or move more gently; if {most:.4g} is the motor's own limit say so: --torque-limit",
    )


def _flat_share(torque: np.ndarray) -> float:
    """Return the share of samples at the maximum where it is a plateau, else 0; shape (num_samples,)."""
    top, reach = float(torque.max()), 0.05 * float(np.ptp(torque))
    at_top = int(np.count_nonzero(torque >= top - 1e-9 * max(abs(top), 1e-300)))
    below = int(np.count_nonzero(torque >= top - reach)) - at_top
    return at_top / len(torque) if at_top > FLAT_RATIO * below else 0.0


def _weight(run: Run, record: JointRecord) -> Iterator[Finding]:
    """Yield a finding where a pendulum's weight contradicts the declared scale of torque."""
    strength = record.motor_strength
    if not run.setup.pendulum or not run.setup.calibrated or not run.measured or strength is None:
        return
    low, high = strength.interval95
    if max(low - 1, 1 - high) <= SERIOUS:
        return
    flags = {"torque": "--torque-scale", "current": "--kt"}.get(run.setup.drive.column, "--kt, --resistance")
    yield Finding(
        "pendulum_weight",
        f"by the pendulum's weight the torque is {strength.value:.3g} times ({low:.3g} to {high:.3g}) what the "
        f"column and {flags} say: one of the two is wrong",
        f"weigh and measure the pendulum; if it is right leave {flags} out, and the pendulum tells the scale",
    )


def _hangs(run: Run) -> Iterator[Finding]:
    """Yield a finding where the phase of a pendulum's weight contradicts the declared angle at which it hangs."""
    declared = run.setup.pendulum_angle
    if not run.setup.pendulum or declared is None:
        return
    try:
        measured = hanging(run.where, run.prepared)
    except LogError:
        return
    # By the circle: an angle and the same one turn on are equal.
    if abs(np.angle(np.exp(1j * (measured - declared)))) <= SERIOUS:
        return
    yield Finding(
        "pendulum_angle",
        f"by the phase of its weight the pendulum hangs straight down at {measured:.3g} rad, and not at {declared:.3g}",
        "leave --set pendulum_angle out, and the log tells it; or check the encoder's zero and sign",
    )
