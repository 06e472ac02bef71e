"""Findings that a reader must know before a number of a joint's record is used: errors first, then warnings.

An interval knows scatter. It does not know that gravity was left out or that a filter decides, and a fit that lacks
something may look as certain as one that does not. After an error no friction, no level and no proposal is stated.
Each finding states what was seen, with its number, and what to do first. Contradictions to the declarations of a log:
see `contradictions`. Each check weighs another quantity by another rule, hence functions in place of a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.files.joints import FRICTION_REACHES_ZERO, Estimate, Finding, JointRecord, warning
from stiction.identification.checks import coupled_text
from stiction.identification.combinations import OVER_K, VISCOUS, brake_text
from stiction.identification.consistency import LARGEST_SIGMAS
from stiction.identification.contradictions import SERIOUS, find_contradictions
from stiction.identification.held_out import prediction_text
from stiction.identification.intervals import FEWEST_BLOCKS
from stiction.identification.prepare import make_rows, prepare
from stiction.identification.record import JointFits, all_admitting, predicted_badly
from stiction.identification.regression import FEWEST_ROWS, INVERSE_STRENGTH, fit_rows
from stiction.identification.runs import Run

LARGEST_REST = 0.3
"""Largest unexplained share of the torque, |residual| / |torque|: several times what the measured joints of
results/identification leave with right flags. Beyond it the missing part is as large as dry friction usually is."""

NEGATIVE_FRICTION = "negative_friction"
"""Reason of a finding on friction below zero: no law is then called the chosen one."""

LARGEST_DROP = 0.25
"""Largest share of dry friction by which friction may drop up to the log's largest speed: a choice. Dry friction that
is less at speed than near rest, as Stribeck's, looks like viscous friction below zero; so does a wrong torque, and
beyond this share it is taken for one."""

EXCITE = "`stiction excite` designs the motion"
"""Source of a better log."""

LARGEST_CHANGE = 0.02
"""Relative change of a parameter, once torque may follow the position, above which a warning is given."""

LARGEST_DRIFT = 0.05
"""Relative change of the friction over the log above which a warning is given, if it also exceeds its interval."""

SAME_FRICTION = 0.15
"""Relative gap of the friction at a common speed below which two parts agree on it."""

NAMELESS = warning(
    "joint",
    "the log does not name the joint; using 'joint': `stiction train --joints` finds a robot's joints by name or "
    "kind; give --joint FL_shank, or --joint shank for all of its kind",
)
"""Warning for the only joint of a log without names."""


def find_errors(fits: JointFits, record: JointRecord, moving: Sequence[str] = ()) -> tuple[Finding, ...]:
    """Return the findings that make the fit invalid, the plainest first: units and flags, the model, the excitation.

    moving: other joints that moved in the log.
    """
    model = [*_position(record), *_negative(fits), *([] if fits.follows else _rest(record))]
    if moving:
        model = [replace(finding, remedy=f"{finding.remedy}; {coupled_text(moving)}") for finding in model]
    return (
        *find_contradictions(fits.run, record, fits.loop.mismatch),
        *model,
        *([] if fits.by_simulation else _cutoff(fits)),
        *_held_out(fits),
        *no_friction_shown(record, record.moving_friction or fits.symmetric()["coulomb_friction"]),
    )


def find_warnings(record: JointRecord, run: Run) -> tuple[Finding, ...]:
    """Return the other findings on the record's numbers and the run behind it."""
    return (
        *(Finding("reading", text, severity="note") for text in run.notes),
        *_missing(record, run),
        *_unknown(record, run),
        *_fit(record),
        *_repeats(record),
        *_parts(record),
        *(warning("timing", text) for text in (run.signals.timing.warnings() if run.signals.timing else ())),
        *_signals(record, run),
    )


def no_friction_shown(record: JointRecord, friction: Estimate) -> Iterator[Finding]:
    """Yield an error for Coulomb friction whose interval reaches zero, unless the joint is held at rest by more."""
    (low, high), holding = friction.interval95, record.holding_friction
    unit = "N m" if record.axis == "rotary" else "N"
    if low <= 0 and not (holding is not None and holding.interval95[0] > 0):
        yield Finding(
            FRICTION_REACHES_ZERO,
            f"the interval of coulomb_friction reaches zero ({low:.4g} to {high:.4g} {unit}): the log does not show "
            "that there is any",
            f"log for longer, with slow stretches and many reversals; {EXCITE}",
        )


def below_zero(name: str, friction: Estimate, where: str, remedy: str) -> Iterator[Finding]:
    """Yield an error for friction below zero. name: parameter; where: fitted data in words, `this log`."""
    low, high = friction.interval95
    if high < 0:
        yield Finding(
            NEGATIVE_FRICTION,
            f"{name} comes out below zero ({low:.4g} to {high:.4g}), which no joint has: something in {where} "
            "drives the joint that the model does not have",
            remedy,
        )


def unexplained(share: float, known: str, more: str, remedy: str) -> Iterator[Finding]:
    """Yield an error for a fit that leaves much of the torque. known: explained part; more: causes of the rest."""
    if share > LARGEST_REST:
        seen = f"{share:.0%} of the torque is not explained by {known}, at most {LARGEST_REST:.0%} may be{more}"
        yield Finding("unexplained_torque", seen, remedy)


def _position(record: JointRecord) -> Iterator[Finding]:
    """Yield an error for a torque that follows the position, where no gravity was fitted and it matters."""
    follows = record.diagnostics["position_torque"]
    worst = follows_position(follows, SERIOUS)
    if follows is None or worst is None:
        return
    yield Finding(
        "follows_position",
        f"the torque follows the position too ({follows['slope']:.3g} per unit): gravity, a spring, a cable or a "
        f"stop, which the model lacks; with it {worst} would change by {follows['changes'][worst]:+.0%}, which the "
        "interval does not cover",
        "--gravity True fits it; or turn the joint's axis upright, or take the load off",
    )


def follows_position(follows: dict[str, Any] | None, least: float) -> str | None:
    """Return the parameter that changes most once torque may follow the position; None below a relative change `least`.

    follows: see `combinations.position_torque`.
    """
    if follows is None or abs(follows["slope"]) <= LARGEST_SIGMAS * follows["std"]:
        return None
    changes = follows["changes"]
    worst = max(changes, key=lambda name: abs(changes[name]), default=None)
    return worst if worst is not None and abs(changes[worst]) > least else None


def _negative(fits: JointFits) -> Iterator[Finding]:
    """Yield an error for friction below zero, the plainest, where no other law is in its place."""
    if fits.chosen is not fits.base:
        return
    stated = all_admitting(fits, fits.symmetric())
    for name in ("coulomb_friction", "viscous_friction"):
        friction = stated[name]
        if fits.braking is not None:
            # The interval admits what is not known of a motor's brake.
            friction = fits.braking.widened(name, friction)
        if fits.braking is not None and name == VISCOUS:
            cause = (
                "check --kt, --set ke, --resistance and the supply's voltage: more was taken off for the motor's own "
                "brake than there is"
            )
        elif not fits.run.measured:
            cause = "check that the log was made at these gains (--kp, --kd) and this rate"
        elif name == VISCOUS and drop_share(friction, stated["coulomb_friction"], fits.rows.velocity) <= LARGEST_DROP:
            return
        else:
            cause = (
                "check --torque-scale and the columns; log this joint alone, in the air, with --gravity if a link "
                "hangs on it"
            )
        if errors := list(below_zero(name, friction, "this log", cause)):
            yield from errors
            return


def drop_share(viscous: Estimate, dry: Estimate, velocity: np.ndarray) -> float:
    """Return the largest share of dry friction by which friction drops up to the largest of some speeds [1].

    Infinite where dry friction is not told from zero.
    """
    drop = max(0.0, -viscous.interval95[0]) * float(np.abs(velocity).max())
    return drop / dry.value if dry.interval95[0] > 0 else np.inf


def _rest(record: JointRecord) -> Iterator[Finding]:
    """Yield an error for a fit that leaves much of the torque unexplained."""
    yield from unexplained(
        (record.friction_law or {})["relative_torque_error"],
        "inertia and friction",
        ": gravity, a load, contact, other joints in motion, or noise; intervals cover noise, not a model that lacks "
        "something",
        "--gravity True if a link hangs on the joint; else log this joint alone, free of contact, and check that the "
        "torque column is its own",
    )


def _held_out(fits: JointFits) -> Iterator[Finding]:
    """Yield an error for a model that predicts a held-out record no better than one without friction."""
    held = fits.held_out
    if held is None or not held.fails:
        return
    yield Finding(
        "held_out",
        f"{held.source} is predicted no better than by a joint without friction "
        f"({prediction_text(held.to_dict(), fits.run.setup.axis or 'rotary')})",
        "check that its gains, load and temperature are those of the log that was fitted; log this joint alone",
    )


def _cutoff(fits: JointFits) -> Iterator[Finding]:
    """Yield an error where a filter of half the corner gives other friction: the filter decides then, not the joint."""
    run, base = fits.run, fits.base
    if not run.measured or base.rows is not run.rows or INVERSE_STRENGTH in base.names:
        return
    other = prepare(run.signals, run.torque, run.prepared.cutoff / 2)
    rows = make_rows([other], [run.setup.payload], run.setup.motor_strength or 1.0)
    if len(rows) < FEWEST_ROWS:
        return
    first, second = (fit.estimates()["coulomb_friction"] for fit in (base, fit_rows(rows, base.model)))
    gap = abs(first.value - second.value)
    if gap <= SERIOUS * abs(first.value) or gap <= LARGEST_SIGMAS * float(np.hypot(first.std, second.std)):
        return
    yield Finding(
        "cutoff",
        f"coulomb_friction is {first.value:.4g} with the filter at {run.prepared.cutoff:.3g} Hz and {second.value:.4g} "
        "at half of that: the filter decides, not the joint",
        f"log faster and with less noise, and some of it slower; {EXCITE}",
    )


def _missing(record: JointRecord, run: Run) -> Iterator[Finding]:
    """Yield warnings about missing declarations, and about what is null without them."""
    if run.measured and run.setup.torque_source is None:
        yield warning(
            "torque_source",
            "where torque was measured was not declared: taken as the motor's side (current or command, joint friction "
            "not in it); declare it with --torque-source",
        )
    if record.kp is None:
        yield warning("kp", "no kp: the dead band f/kp is null")
    if record.torque_limit is None:
        yield warning("torque_limit", "no torque limit: the ratio f/τ_max is null; give --torque-limit")
    gravity = record.diagnostics["gravity"]
    if record.test_condition is None:
        yield warning(
            "test_condition",
            "the test condition was not stated: a bare motor, a link in the air and a loaded one differ; "
            "give --test-condition" + (f"; {gravity}" if gravity else ""),
        )
    elif gravity and run.setup.fits_gravity:
        yield warning("gravity", f"{gravity}; --gravity False leaves it out")
    if run.signals.feedforward is not None and (run.signals.target is None or record.kp is None):
        yield warning(
            "feedforward",
            "the feedforward has no effect: it belongs to the controller, which is not simulated without target, --kp "
            "and --kd; a logged torque has it in it already",
        )
    if record.diagnostics["closed_loop"]:
        yield warning("closed_loop", record.diagnostics["closed_loop"])


def _unknown(record: JointRecord, run: Run) -> Iterator[Finding]:
    """Yield warnings about what this kind of log cannot tell, and the experiment that would."""
    strength, setup = record.diagnostics["strength"], run.setup
    if strength["missing"]:
        yield warning("motor_strength", strength["missing"])
    if (drive := record.diagnostics.get("drive")) is not None:
        separable = record.viscous_friction is not None or OVER_K["viscous_friction"] in record.combinations
        yield warning("back_emf", brake_text(drive, separable))
    if setup.pendulum and strength["source"] == "known_load" and record.motor_strength is not None:
        angle = "" if setup.pendulum_angle is None else f"; it hangs at {setup.pendulum_angle:.4g} rad"
        yield warning(
            "pendulum",
            f"the scale of the torque is that of the pendulum's weight, {record.motor_strength.value:.4g} times the "
            f"column's{angle}",
        )
    if not run.measured and setup.kd and not setup.velocity_delay:
        yield warning(
            "velocity_delay",
            f"I/k holds for a controller whose velocity is not late: each millisecond of lateness adds "
            f"{1e-3 * setup.kd:.3g} to it (--set velocity_delay)",
        )
    if "encoder_bias" in setup.unknowns and record.encoder_bias is not None and setup.hanging_angle is None:
        yield warning(
            "encoder_bias",
            "the encoder's bias is that of the log's angle against the controller's; one that both share shows in "
            "gravity alone: --set hanging_angle",
        )
    if strength["source"] == "declared":
        yield warning(
            "motor_strength", f"all of it rests on the motor strength that was declared, {setup.motor_strength:.4g}"
        )
    if setup.payload is not None and strength["source"] == "unknown":
        yield warning(
            "payload",
            "the payload's weight cannot be told from the link's own: log once without it as well and give that log "
            "with --repeat",
        )
    if setup.torque_calibrated is False:
        yield warning(
            "torque_calibrated",
            "the unit of the torque is not known: the torque limit was taken to be in the unit of the torque column, "
            "and the dead band is null, for kp is not in that unit",
        )
    if setup.hanging_angle is not None and record.encoder_bias is None:
        yield warning(
            "hanging_angle",
            "--set hanging_angle has no effect: "
            + (
                "over this range the phase of gravity is not known well enough to tell the encoder's bias"
                if setup.fits_gravity
                else "no gravity is fitted, from whose phase alone it could tell the encoder's bias (--gravity True)"
            ),
        )
    for name in setup.unknowns:
        if getattr(record, name) is None:
            yield warning(name, f"the {name.replace('_', ' ')} was asked for, and this log does not tell it")
    if not record.diagnostics["inertia_known"]:
        yield warning(
            "inertia",
            "the inertia is not known: at these accelerations it takes less torque than is left unexplained; it is "
            "null; move faster to find it",
        )
    if not strength["missing"] and record.offset is None and record.coulomb_friction is not None:
        yield warning(
            "offset", "over this range of angles the offset cannot be told from gravity: it is null; move further"
        )


def _fit(record: JointRecord) -> Iterator[Finding]:
    """Yield warnings about parameters that the log does not show, and intervals that rest on little."""
    for name in ("inertia", "viscous_friction"):
        estimate = getattr(record, name)
        if estimate is not None and estimate.interval95[0] <= 0 <= estimate.interval95[1]:
            yield warning(
                f"{name}_reaches_zero",
                f"the interval of {name} reaches zero: the log does not show that there is any; move more, or longer",
            )
    viscous, refused = record.viscous_friction, {finding.reason for finding in record.objections}
    if viscous is not None and viscous.interval95[1] < 0 and NEGATIVE_FRICTION not in refused:
        low, high = viscous.interval95
        yield warning(
            "viscous_friction_below_zero",
            f"viscous_friction comes out below zero ({low:.4g} to {high:.4g}): dry friction that is less at speed than "
            "near rest looks so, and so does a torque that is a little wrong",
        )
    follows = record.diagnostics["position_torque"]
    if (worst := follows_position(follows, LARGEST_CHANGE)) and not follows_position(follows, SERIOUS):
        yield warning(
            "follows_position",
            f"the torque follows the position too ({follows['slope']:.3g} per unit): gravity, a spring or a cable, "
            f"which the model lacks; with it {worst} would change by {follows['changes'][worst]:+.0%}, which the "
            "interval does not cover: --gravity fits it, or turn the joint's axis upright, or take the load off",
        )
    if record.diagnostics["blocks"] == FEWEST_BLOCKS:
        yield warning(
            "blocks",
            f"the residual's memory is long for this log: intervals rest on {FEWEST_BLOCKS} blocks only; log for "
            "longer",
        )


def repeat_lines(record: JointRecord) -> list[str]:
    """Return a line for each repeat: agreement, error of its prediction, and ratio to the fit's error."""
    fit_error = (record.friction_law or {}).get("relative_torque_error")
    compared = {data["parts"][1]: data for data in record.diagnostics.get("comparisons", ()) if data["repeat"]}
    lines = []
    for tried in record.diagnostics.get("predictions", ()):
        if "refusal" in tried:
            lines.append(f"repeat {tried['source']}: not used: {tried['refusal']}")
            continue
        data, parts = compared.get(tried["source"]), []
        if data is not None:
            agreeing = [name for name in data["values"] if name not in data["disputed"]]
            parts += [f"{', '.join(agreeing)} agree"] if agreeing else []
            parts += [f"{', '.join(data['disputed'])} do not"] if data["disputed"] else []
        error = tried["torque_error"]
        parts.append(
            f"torque predicted to {error:.2%}"
            + (f", {error / fit_error:.2g} times the fit's own {fit_error:.2%}" if fit_error else "")
        )
        lines.append(f"repeat {tried['source']}: {'; '.join(parts)}")
    return lines


def _repeats(record: JointRecord) -> Iterator[Finding]:
    """Yield warnings about repeats that could not be used, or that the law does not predict."""
    fit_error = (record.friction_law or {})["relative_torque_error"]
    for tried in record.diagnostics["predictions"]:
        if "refusal" in tried:
            yield warning(
                "repeat",
                f"the repeat {tried['source']} could not be used, and the rest stands without it: {tried['refusal']}",
            )
        elif predicted_badly(tried, fit_error):
            yield warning(
                "repeat",
                f"the repeat {tried['source']} is predicted badly: {tried['torque_error']:.1%} of its torque is not, "
                f"against {fit_error:.1%} of the log's own: other gains do not matter to that, but another load, "
                "temperature, payload or torque from outside (feedforward, disturbance) does",
            )


def _parts(record: JointRecord) -> Iterator[Finding]:
    """Yield warnings about parts of the log, or repeats, that disagree, with the likely reason."""
    fit_error = (record.friction_law or {})["relative_torque_error"]
    poor = {tried["source"] for tried in record.diagnostics["predictions"] if predicted_badly(tried, fit_error)}
    for comparison in record.diagnostics["comparisons"]:
        first, second = comparison["parts"]
        disputed = " and ".join(comparison["disputed"])
        if disputed and comparison["alternative"]:
            yield warning(
                "late_torque",
                f"with the {second}, {disputed} come out otherwise, beyond their intervals, which are widened until "
                "they admit both: torque and angle of the log are not of the same instant; log the target too and give "
                "--kp and --kd, and the log tells when the torque acted",
            )
        elif disputed:
            alone = comparison["repeat"] and second in poor
            yield warning(
                "disputed",
                f"{first} and {second} do not agree on {disputed}, beyond their own intervals{_reason(comparison)}; "
                "the stated intervals "
                + (
                    f"are those of {first} alone, for {second} is predicted badly"
                    if alone
                    else "are widened until they admit both"
                ),
            )
    law = (record.friction_law or {}).get("law")
    if law not in (None, "coulomb"):
        yield warning(
            "law",
            f"this joint's friction is not plain Coulomb friction: the {law} law predicts unseen parts of the log "
            "better, and the stated values are its own, over the motion of the log; those of viscous and Coulomb "
            "friction alone stand beside them (friction_law.symmetric)",
        )
    change = record.diagnostics["drift"]["change"]
    if change is not None:
        low, high = change["interval95"]
        if low * high > 0 and abs(change["value"]) > LARGEST_DRIFT:
            yield warning(
                "drift",
                f"friction changes by {change['value']:+.0%} from start to end of the log ({low:+.0%} to {high:+.0%}): "
                "does the joint warm up? Warm it up first, or log it cold and hot and compare the two with --repeat",
            )


def _reason(comparison: dict[str, Any]) -> str:
    """Describe whether two parts agree on the friction itself, though not on its split into viscous and dry."""
    if not {"viscous_friction", "coulomb_friction"} & set(comparison["disputed"]):
        return ""
    first, second = (data["value"] for data in comparison["friction"])
    gap = abs(first - second) / max(abs(first), abs(second), 1e-300)
    where = f"at a speed of {comparison['speed']:.3g}, which both reach, their friction is {first:.4g} and {second:.4g}"
    if gap < SAME_FRICTION:
        return f": {where}, so they differ in how it splits into viscous and dry, not in how much there is"
    return f": {where}"


def _signals(record: JointRecord, run: Run) -> Iterator[Finding]:
    """Yield warnings about a logged velocity that is not the derivative of the position, and a motor at its limit."""
    logged, velocity = run.signals.velocity, run.prepared.velocity
    if logged is not None:
        slope = float(np.dot(logged, velocity) / np.dot(velocity, velocity))
        if not 0.9 < slope < 1.1:
            yield warning(
                "velocity",
                f"the logged velocity is {slope:.3g} times the derivative of the position: units? It is not used",
            )
    if record.torque_limit is not None and run.measured:
        share = float(np.mean(np.abs(run.torque) >= 0.99 * record.torque_limit))
        if share > 0.01:
            yield warning(
                "at_torque_limit",
                f"the motor is at its torque limit in {share:.0%} of the samples: move more gently",
            )
