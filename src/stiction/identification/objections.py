"""What makes a fit invalid: where one of these holds, no friction is stated, no level, and nothing is proposed.

An interval knows scatter. It does not know that gravity was left out, that a column is in degrees or that a flag is
wrong, and a fit that lacks something may look as certain as one that does not. Each objection says what was seen, with
its number, and what to do first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import FRICTION_REACHES_ZERO, Estimate, JointRecord, Objection
from stiction.identification.back_emf import VISCOUS
from stiction.identification.checks import coupled_text, unit_doubts
from stiction.identification.closed_loop import LoopError, Mismatch
from stiction.identification.consistency import LARGEST_SIGMAS
from stiction.identification.held_out import prediction_text
from stiction.identification.in_loop import compare_controller
from stiction.identification.prepare import make_rows, prepare
from stiction.identification.record import JointFits
from stiction.identification.regression import FEWEST_ROWS, INVERSE_STRENGTH, fit_rows
from stiction.identification.runs import Run, hanging
from stiction.identification.setup import IdentifySetup

LARGEST_REST = 0.3
"""Share of the torque that may go unexplained, |residual| / |torque|: several times what the measured joints of
results/identification leave with right flags. Beyond it what is missing is as large as dry friction usually is."""

SERIOUS = 0.1
"""Relative change of a parameter, by another reading of the same log, from which on there is no answer. Less is lost in
a level, rounded up to a whole per cent and doubled where the joint was not loaded; from a tenth on it shows."""

LARGEST_SCALE = SERIOUS
"""Relative gap, either way, between kp (target − position) and the logged torque, lateness apart, beyond which one of
the two is wrong: above what delays and biases of virtual robots make of right gains."""

LARGEST_DAMPING_SCALE = 0.3
"""The same of kd velocity, whose noise, filter and backlash make it vaguer. A torque in another unit shows in both,
and dry friction that was found from measured torque does not depend on kd."""

AGAINST = -0.5
"""Correlation of target and position under which a sign is wrong: at low gains a joint lags, and does not run away."""

LARGEST_EXCESS = 1.05
"""Logged torque over torque limit that noise of the current sensor still explains."""

FLAT_SHARE = 0.02
"""Share of the samples at exactly the extreme torque from which on it counts as clipped. Noise reaches an extreme
once."""

FLAT_RATIO = 2.0
"""Samples at the extreme over those in the next twentieth of the range below it: a torque that turns round by itself
has as many there; one that is cut off piles up."""

NEGATIVE_FRICTION = "negative_friction"
"""Reason of the objection to friction that would drive the joint: no law is then called the chosen one."""

EXCITE = "`stiction excite` designs the motion"
"""Where a better log comes from."""


def find_objections(fits: JointFits, record: JointRecord, moving: Sequence[str] = ()) -> tuple[Objection, ...]:
    """Return what makes the fit invalid, the plainest first: units and flags, then the model, then the excitation.

    moving: other joints that moved in the log.
    """
    run = fits.run
    found = [
        *_units(run, record),
        *_clipped(run),
        *_controller(run, fits.loop.mismatch),
        *_hangs(run),
        *_weight(run, record),
        *_coupled([*_position(record), *_negative(fits), *([] if fits.follows else _rest(record))], moving),
        *([] if fits.by_simulation else _cutoff(fits)),
        *_held_out(fits),
    ]
    shown = record.moving_friction or fits.symmetric()["coulomb_friction"]
    return (*found, *no_friction_shown(record, shown))


def signal_objections(run: Run, record: JointRecord) -> tuple[Objection, ...]:
    """Return what a joint's signals say against any fit to them: their units, and torque that was cut off."""
    return (*_units(run, record), *_clipped(run))


def no_friction_shown(record: JointRecord, friction: Estimate) -> tuple[Objection, ...]:
    """Object to Coulomb friction whose interval reaches zero, unless the joint is held at rest by more."""
    (low, high), holding = friction.interval95, record.holding_friction
    unit = "N m" if record.axis == "rotary" else "N"
    if low > 0 or (holding is not None and holding.interval95[0] > 0):
        return ()
    return (
        Objection(
            FRICTION_REACHES_ZERO,
            f"the interval of coulomb_friction reaches zero ({low:.4g} to {high:.4g} {unit}): the log does not show "
            "that there is any",
            f"log for longer, with slow stretches and many reversals; {EXCITE}",
        ),
    )


def _units(run: Run, record: JointRecord) -> list[Objection]:
    """Object to signals that are probably not in SI units, and to torque beyond the motor's limit."""
    found = [Objection("units", seen, remedy) for seen, remedy in unit_doubts(run.signals, record.axis)]
    limit, peak = record.torque_limit, float(np.abs(run.torque).max())
    if run.setup.drive.column != "torque" and not run.setup.calibrated:
        # Volts or amperes, and a limit in N m: a known weight tells the one from the other, or nothing does.
        peak *= 0.0 if record.motor_strength is None else record.motor_strength.value
    if limit is not None and run.measured and peak > LARGEST_EXCESS * limit:
        found.append(
            Objection(
                "beyond_limit",
                f"the log's torque reaches {peak:.4g}, beyond the torque limit {limit:.4g}: the torque's unit "
                "(--torque-scale) or the limit is not as declared",
                "find out which of the two is wrong: --torque-scale, --torque-limit",
            )
        )
    return found


def contradicted(run: Run) -> str:
    """Say what the declared gains, or the target, have against the columns of a log; nothing where they fit it."""
    try:
        found = compare_controller(run)
    except LoopError:
        found = None
    objections = _controller(run, found)
    return "; ".join(f"{one.seen}; {one.remedy}" for one in objections) or _against(run)


def _controller(run: Run, mismatch: Mismatch | None) -> list[Objection]:
    """Object to a logged torque that is another multiple of the position's error, or speed, than the gains say."""
    if mismatch is None:
        return []
    spring, damper = mismatch.scales
    if _gap(spring) <= LARGEST_SCALE and _gap(damper) <= LARGEST_DAMPING_SCALE:
        return []
    seen = (
        f"the logged torque is {spring:.3g} times kp (target − position) less {damper:.3g} times kd velocity, and is "
        f"off by {mismatch.size:.0%}: torque, angles or stamps are in another unit, belong to another joint, "
        "or the gains are not as declared"
    )
    return [Objection("controller", seen, _against(run) or _other_scale(run.setup, spring, damper))]


def _against(run: Run) -> str:
    """Say what to do about a position that runs against its target; nothing where it does not, or there is none."""
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
    """Say what to check where the logged torque is such multiples of what kp, and kd, ask for.

    One factor in both is the torque's, the angles' or the gains': the log does not tell which, and numbers that fit are
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
    """Return a number with two digits, without an exponent: more is not known of what would fit."""
    return f"{float(f'{value:.2g}'):g}"


def _gap(scale: float) -> float:
    """Return by what share a scale is off, up or down."""
    return max(scale, 1 / scale) - 1 if scale > 0 else np.inf


def _clipped(run: Run) -> list[Objection]:
    """Object to a torque that stands still at its extremes, unless that is the declared limit."""
    if not run.measured or run.setup.drive.by_voltage:  # A bridge that is fully on is not a value cut off.
        return []
    torque, limit = run.torque[run.signals.valid], run.setup.torque_limit
    flat = [_flat_share(side) for side in (torque, -torque)]
    most = float(np.abs(torque).max())
    if sum(flat) < FLAT_SHARE or (limit is not None and most > 0.99 * limit):
        return []
    return [
        Objection(
            "clipped",
            f"the torque stands at exactly its extremes in {sum(flat):.0%} of the samples ({most:.4g}): it was cut off "
            "there, and what the motor gave beyond is missing",
            f"log the whole range, or move more gently; if {most:.4g} is the motor's own limit say so: --torque-limit",
        )
    ]


def _flat_share(torque: np.ndarray) -> float:
    """Return the share of samples at the maximum where it is a plateau, else 0; shape (num_samples,)."""
    top, reach = float(torque.max()), 0.05 * float(np.ptp(torque))
    there = int(np.count_nonzero(torque >= top - 1e-9 * max(abs(top), 1e-300)))
    below = int(np.count_nonzero(torque >= top - reach)) - there
    return there / len(torque) if there > FLAT_RATIO * below else 0.0


def _coupled(objections: list[Objection], moving: Sequence[str]) -> list[Objection]:
    """Add to objections to the model that other joints moved, where they did."""
    if not moving:
        return objections
    return [replace(one, remedy=f"{one.remedy}; {coupled_text(moving)}") for one in objections]


def _position(record: JointRecord) -> list[Objection]:
    """Object to a torque that follows the position, where no gravity was fitted and it matters."""
    follows = record.diagnostics["position_torque"]
    worst = follows_position(follows, SERIOUS)
    if follows is None or worst is None:
        return []
    return [
        Objection(
            "follows_position",
            f"the torque follows the position too ({follows['slope']:.3g} per unit): gravity, a spring, a cable or a "
            "stop, "
            f"which the model lacks; with it {worst} would change by {follows['changes'][worst]:+.0%}, which the "
            "interval does not cover",
            "--gravity True fits it; or turn the joint's axis upright, or take the load off",
        )
    ]


def follows_position(follows: dict[str, Any] | None, least: float) -> str | None:
    """Return which parameter changes most once torque may follow the position; None where by less than a share `least`.

    follows: see `combinations.position_torque`.
    """
    if follows is None or abs(follows["slope"]) <= LARGEST_SIGMAS * follows["std"]:
        return None
    changes = follows["changes"]
    worst = max(changes, key=lambda name: abs(changes[name]), default=None)
    return worst if worst is not None and abs(changes[worst]) > least else None


def _negative(fits: JointFits) -> list[Objection]:
    """Object to friction that would drive the joint, where no other law is in its place."""
    if fits.chosen is not fits.base:
        return []
    for name in ("coulomb_friction", "viscous_friction"):
        low, high = _with_brake(fits, name).interval95
        if high < 0:
            cause = (
                "check --kt, --set ke, --resistance and the supply's voltage: more was taken off for the motor's own "
                "brake than there is"
                if fits.braking is not None and name == VISCOUS
                else "check that the log was made at these gains (--kp, --kd) and this rate"
                if not fits.run.measured
                else "check --torque-scale and the columns; log this joint alone, in the air, with --gravity if a link "
                "hangs on it"
            )
            return [
                Objection(
                    NEGATIVE_FRICTION,
                    f"{name} comes out below zero ({low:.4g} to {high:.4g}), which no joint has: something in this log "
                    "drives the joint that the model does not have",
                    cause,
                )
            ]
    return []


def _with_brake(fits: JointFits, name: str) -> Estimate:
    """Return an estimate whose interval admits what is not known of a motor's brake."""
    found = fits.symmetric()[name]
    return found if fits.braking is None else fits.braking.widened(name, found)


def _weight(run: Run, record: JointRecord) -> list[Objection]:
    """Object to a declared scale of torque that a pendulum's weight contradicts."""
    strength = record.motor_strength
    if not run.setup.pendulum or not run.setup.calibrated or not run.measured or strength is None:
        return []
    low, high = strength.interval95
    if max(low - 1, 1 - high) <= SERIOUS:
        return []
    flags = {"torque": "--torque-scale", "current": "--kt"}.get(run.setup.drive.column, "--kt, --resistance")
    return [
        Objection(
            "pendulum_weight",
            f"by the pendulum's weight the torque is {strength.value:.3g} times ({low:.3g} to {high:.3g}) what the "
            f"column and {flags} say: one of the two is wrong",
            f"weigh and measure the pendulum; if it is right leave {flags} out, and the pendulum tells the scale",
        )
    ]


def _hangs(run: Run) -> list[Objection]:
    """Object to an angle at which a pendulum was said to hang, where the phase of its weight is another."""
    said = run.setup.pendulum_angle
    if not run.setup.pendulum or said is None:
        return []
    try:
        found = hanging(run.where, run.prepared)
    except LogError:
        return []
    # By the circle: an angle and the same one turn on are equal.
    if abs(np.angle(np.exp(1j * (found - said)))) <= SERIOUS:
        return []
    return [
        Objection(
            "pendulum_angle",
            f"by the phase of its weight the pendulum hangs straight down at {found:.3g} rad, and not at {said:.3g}",
            "leave --set pendulum_angle out, and the log tells it; or check the encoder's zero and sign",
        )
    ]


def _rest(record: JointRecord) -> list[Objection]:
    """Object to a fit that leaves much of the torque unexplained."""
    rest = (record.friction_law or {})["relative_torque_error"]
    if rest <= LARGEST_REST:
        return []
    return [
        Objection(
            "unexplained_torque",
            f"{rest:.0%} of the torque is not explained by inertia and friction, at most {LARGEST_REST:.0%} may be: "
            "gravity, a load, contact, other joints in motion, or noise; intervals cover noise, not a model that lacks "
            "something",
            "--gravity True if a link hangs on the joint; else log this joint alone, free of contact, and check that "
            "the torque column is its own",
        )
    ]


def _held_out(fits: JointFits) -> list[Objection]:
    """Object to a model that predicts a record which no fit saw no better than one without friction."""
    held = fits.held_out
    if held is None or not held.fails:
        return []
    return [
        Objection(
            "held_out",
            f"{held.source} is predicted no better than by a joint without friction "
            f"({prediction_text(held.to_dict(), fits.run.setup.axis or 'rotary')})",
            "check that its gains, load and temperature are those of the log that was fitted; log this joint alone",
        )
    ]


def _cutoff(fits: JointFits) -> list[Objection]:
    """Object where a filter of half the corner finds another friction: then the filter decides, not the joint."""
    run, base = fits.run, fits.base
    if not run.measured or base.rows is not run.rows or INVERSE_STRENGTH in base.names:
        return []
    other = prepare(run.signals, run.torque, run.prepared.cutoff / 2)
    rows = make_rows([other], [run.setup.payload], run.setup.motor_strength or 1.0)
    if len(rows) < FEWEST_ROWS:
        return []
    one, two = (fit.estimates()["coulomb_friction"] for fit in (base, fit_rows(rows, base.model)))
    gap = abs(one.value - two.value)
    if gap <= SERIOUS * abs(one.value) or gap <= LARGEST_SIGMAS * float(np.hypot(one.std, two.std)):
        return []
    return [
        Objection(
            "cutoff",
            f"coulomb_friction is {one.value:.4g} with the filter at {run.prepared.cutoff:.3g} Hz and {two.value:.4g} "
            "at half of that: the filter decides, not the joint",
            f"log faster and with less noise, and some of it slower; {EXCITE}",
        )
    ]
