"""What a reader should know before trusting a record: each warning says what was seen, what it means, what to do."""

from __future__ import annotations

from typing import Any

import numpy as np

from stiction.files.joints import JointRecord
from stiction.identification.back_emf import brake_text
from stiction.identification.combinations import OVER_K
from stiction.identification.intervals import FEWEST_BLOCKS
from stiction.identification.objections import SERIOUS, follows_position
from stiction.identification.record import predicted_badly
from stiction.identification.runs import Run

LARGEST_CHANGE = 0.02
"""Relative change of a parameter, once torque may follow the position, that is worth a warning."""

LARGEST_DRIFT = 0.05
"""Change of the friction over the log, as a share, that is worth a warning if it is also beyond its interval."""

SAME_FRICTION = 0.15
"""Relative gap of the friction at a common speed under which two parts agree on it."""

UNDECLARED = (
    "where torque was measured was not declared: taken as the motor's side (current or command, joint friction not in "
    "it); declare it with --torque-source"
)

NAMELESS = (
    "nobody named the joint, so it is called 'joint': `stiction train --joints` finds a robot's joints by name or "
    "kind; give --joint FL_shank, or --joint shank for all of its kind"
)


def find_warnings(record: JointRecord, run: Run) -> tuple[str, ...]:
    """Return what the record's numbers and the run behind it call for."""
    return (
        *run.notes,
        *_missing(record, run),
        *_unknown(record, run),
        *_fit(record),
        *_repeats(record),
        *_parts(record, run),
        *(run.signals.timing.warnings() if run.signals.timing else ()),
        *_signals(record, run),
    )


def _missing(record: JointRecord, run: Run) -> list[str]:
    """Name what was not given, and what is null for it."""
    found = [UNDECLARED] if run.measured and run.setup.torque_source is None else []
    if record.kp is None:
        found.append("no kp: the dead band f/kp is null")
    if record.torque_limit is None:
        found.append("no torque limit: the ratio f/τ_max is null; give --torque-limit")
    gravity = record.diagnostics["gravity"]
    if record.test_condition is None:
        found.append(
            "the test condition was not stated: a bare motor, a link in the air and a loaded one differ; "
            "give --test-condition" + (f"; {gravity}" if gravity else "")
        )
    elif gravity and run.setup.fits_gravity:
        found.append(f"{gravity}; --gravity False leaves it out")
    if run.signals.feedforward is not None and (run.signals.target is None or record.kp is None):
        found.append(
            "the feedforward has no effect: it belongs to the controller, which is not simulated without target, --kp "
            "and --kd; a logged torque has it in it already"
        )
    if record.diagnostics["closed_loop"]:
        found.append(record.diagnostics["closed_loop"])
    return found


def _unknown(record: JointRecord, run: Run) -> list[str]:
    """Say what this kind of log cannot tell, and which experiment would."""
    found = []
    strength = record.diagnostics["strength"]
    if strength["missing"]:
        found.append(strength["missing"])
    if (drive := record.diagnostics.get("drive")) is not None:
        separable = record.viscous_friction is not None or OVER_K["viscous_friction"] in record.combinations
        found.append(brake_text(drive, separable))
    if run.setup.pendulum and strength["source"] == "known_load" and record.motor_strength is not None:
        angle = "" if run.setup.pendulum_angle is None else f"; it hangs at {run.setup.pendulum_angle:.4g} rad"
        found.append(
            f"the scale of the torque is that of the pendulum's weight, {record.motor_strength.value:.4g} times the "
            f"column's{angle}"
        )
    if not run.measured and run.setup.kd and not run.setup.velocity_delay:
        found.append(
            f"I/k holds for a controller whose velocity is not late: each millisecond of lateness adds "
            f"{1e-3 * run.setup.kd:.3g} to it (--set velocity_delay)"
        )
    if "encoder_bias" in run.setup.unknowns and record.encoder_bias is not None and run.setup.hanging_angle is None:
        found.append(
            "the encoder's bias is that of the log's angle against the controller's; one that both share shows in "
            "gravity alone: --set hanging_angle"
        )
    if strength["source"] == "declared":
        found.append(f"all of it rests on the motor strength that was declared, {run.setup.motor_strength:.4g}")
    if run.setup.payload is not None and strength["source"] == "unknown":
        found.append(
            "the payload's weight cannot be told from the link's own: log once without it as well and give that log "
            "with --repeat"
        )
    if run.setup.torque_calibrated is False:
        found.append(
            "the unit of the torque is not known: the torque limit was taken to be in the unit of the torque column, "
            "and the dead band is null, for kp is not in that unit"
        )
    if run.setup.hanging_angle is not None and record.encoder_bias is None:
        found.append(
            "--set hanging_angle has no effect: "
            + (
                "over this range the phase of gravity is not known well enough to tell the encoder's bias"
                if run.setup.fits_gravity
                else "no gravity is fitted, from whose phase alone it could tell the encoder's bias (--gravity True)"
            )
        )
    for name in run.setup.unknowns:
        if getattr(record, name) is None:
            found.append(f"the {name.replace('_', ' ')} was asked for, and this log does not tell it")
    if not record.diagnostics["inertia_known"]:
        found.append(
            "the inertia is not known: at these accelerations it takes less torque than is left unexplained; it is "
            "null; "
            "move faster to find it"
        )
    if not strength["missing"] and record.offset is None and record.coulomb_friction is not None:
        found.append("over this range of angles the offset cannot be told from gravity: it is null; move further")
    return found


def _fit(record: JointRecord) -> list[str]:
    """Warn of parameters that the log does not show, and of intervals that rest on little."""
    found = []
    for name in ("inertia", "viscous_friction"):
        estimate = getattr(record, name)
        if estimate is not None and estimate.interval95[0] <= 0 <= estimate.interval95[1]:
            found.append(
                f"the interval of {name} reaches zero: the log does not show that there is any; move more, or longer"
            )
    found += _position_torque(record.diagnostics["position_torque"])
    if record.diagnostics["blocks"] == FEWEST_BLOCKS:
        found.append(
            f"the residual's memory is long for this log: intervals rest on {FEWEST_BLOCKS} blocks only; log for longer"
        )
    return found


def _position_torque(follows: dict[str, Any] | None) -> list[str]:
    """Warn of torque that follows the position where no gravity was fitted; from `SERIOUS` on it is an objection."""
    worst = follows_position(follows, LARGEST_CHANGE)
    if follows is None or worst is None or follows_position(follows, SERIOUS):
        return []
    return [
        f"the torque follows the position too ({follows['slope']:.3g} per unit): gravity, a spring or a cable, which "
        f"the model lacks; with it {worst} would change by {follows['changes'][worst]:+.0%}, which the interval does "
        "not cover: --gravity fits it, or turn the joint's axis upright, or take the load off"
    ]


def repeat_lines(record: JointRecord) -> list[str]:
    """Return a line for each repeat: what agrees, how well it is predicted, and over the fit's own error."""
    own = (record.friction_law or {}).get("relative_torque_error")
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
            f"torque predicted to {error:.2%}" + (f", {error / own:.2g} times the fit's own {own:.2%}" if own else "")
        )
        lines.append(f"repeat {tried['source']}: {'; '.join(parts)}")
    return lines


def _repeats(record: JointRecord) -> list[str]:
    """Warn of repeats that could not be used, or that the law does not predict."""
    own, found = (record.friction_law or {})["relative_torque_error"], []
    for tried in record.diagnostics["predictions"]:
        if "refusal" in tried:
            found.append(
                f"the repeat {tried['source']} could not be used, and the rest stands without it: {tried['refusal']}"
            )
        elif predicted_badly(tried, own):
            found.append(
                f"the repeat {tried['source']} is predicted badly: {tried['torque_error']:.1%} of its torque is not, "
                "against "
                f"{own:.1%} of the log's own: other gains do not matter to that, but another load, temperature, "
                "payload or "
                "torque from outside (feedforward, disturbance) does"
            )
    return found


def _parts(record: JointRecord, run: Run) -> list[str]:
    """Warn where parts of the log, or repeats, do not agree, and say what that points to."""
    found, own = [], (record.friction_law or {})["relative_torque_error"]
    poor = {tried["source"] for tried in record.diagnostics["predictions"] if predicted_badly(tried, own)}
    for comparison in record.diagnostics["comparisons"]:
        one, two = comparison["parts"]
        if comparison["disputed"] and comparison["alternative"]:
            found.append(
                f"with the {two}, {' and '.join(comparison['disputed'])} come out otherwise, beyond their intervals, "
                f"which are widened until they admit both: torque and angle of the log are not of "
                "the same instant; log the target too and give --kp and --kd, and the log tells when the torque acted"
            )
        elif comparison["disputed"]:
            found.append(
                f"{one} and {two} do not agree on {' and '.join(comparison['disputed'])}, beyond their own intervals"
                f"{_reason(comparison)}; the stated intervals "
                + (
                    f"are those of {one} alone, for {two} is predicted badly"
                    if comparison["repeat"] and two in poor
                    else "are widened until they admit both"
                )
            )
    law = (record.friction_law or {}).get("law")
    if law not in (None, "coulomb"):
        found.append(
            f"this joint's friction is not plain Coulomb friction: the {law} law predicts unseen parts of the log "
            "better, and the stated values are its own, over the motion of the log; those of viscous and Coulomb "
            "friction alone stand beside them (friction_law.symmetric)"
        )
    change = record.diagnostics["drift"]["change"]
    if change is not None:
        low, high = change["interval95"]
        if low * high > 0 and abs(change["value"]) > LARGEST_DRIFT:
            found.append(
                f"friction changes by {change['value']:+.0%} from start to end of the log ({low:+.0%} to {high:+.0%}): "
                "does the joint warm up? Warm it up first, or log it cold and hot and compare the two with --repeat"
            )
    return found


def _reason(comparison: dict[str, Any]) -> str:
    """Say whether two parts agree on the friction itself, though not on how it splits into viscous and dry."""
    if not {"viscous_friction", "coulomb_friction"} & set(comparison["disputed"]):
        return ""
    one, two = (data["value"] for data in comparison["friction"])
    gap = abs(one - two) / max(abs(one), abs(two), 1e-300)
    where = f"at a speed of {comparison['speed']:.3g}, which both reach, their friction is {one:.4g} and {two:.4g}"
    if gap < SAME_FRICTION:
        return f": {where}, so they differ in how it splits into viscous and dry, not in how much there is"
    return f": {where}"


def _signals(record: JointRecord, run: Run) -> list[str]:
    """Warn of units, of a logged velocity that is not the derivative of the position, of a motor at its limit."""
    signals, velocity = run.signals, run.prepared.velocity
    found: list[str] = []
    if signals.velocity is not None:
        slope = float(np.dot(signals.velocity, velocity) / np.dot(velocity, velocity))
        if not 0.9 < slope < 1.1:
            found.append(
                f"the logged velocity is {slope:.3g} times the derivative of the position: units? It is not used"
            )
    if record.torque_limit is not None and run.measured:
        share = float(np.mean(np.abs(run.torque) >= 0.99 * record.torque_limit))
        if share > 0.01:
            found.append(f"the motor is at its torque limit in {share:.0%} of the samples: move more gently")
    return found
