"""What a reader should know before trusting a record: each warning says what was seen, what it means, what to do."""

from __future__ import annotations

import numpy as np

from stiction.formats.joints import JointRecord
from stiction.identify.checks import Uniform
from stiction.identify.controller import LARGEST_MISMATCH
from stiction.identify.intervals import FEWEST_BLOCKS

LARGEST_GAP = 0.03
"""Relative disagreement of the two estimators that is worth a warning, if it is also beyond `LARGEST_SIGMAS`."""

LARGEST_REST = 0.3
"""Share of the torque that may go unexplained, |residual| / |torque|; good logs leave a tenth or less."""

LARGEST_SIGMAS = 3.0
"""Combined standard deviations that chance rarely exceeds."""

LARGEST_CHANGE = 0.02
"""Relative change of a parameter, once torque may follow the position, that is worth a warning."""

LARGEST_EXCESS = 1.05
"""Logged torque over torque limit that noise of the current sensor still explains."""


def find_warnings(record: JointRecord, signals: Uniform, velocity: np.ndarray, has_target: bool) -> tuple[str, ...]:
    """Return the record's warnings and those that its numbers call for.

    velocity: filtered θ' [rad/s], shape (num_samples,).
    """
    return (
        *record.warnings,
        *_missing(record, has_target),
        *_fit(record),
        *_estimators(record),
        *_signals(record, signals, velocity),
    )


def _missing(record: JointRecord, has_target: bool) -> list[str]:
    """Name what was not given, and what is null for it."""
    found = []
    if record.kp is None or record.kd is None:
        found.append("no kp and kd: output error is not done; give --kp and --kd")
    elif not has_target:
        found.append("no target in the log: output error is not done; log the position asked for")
    if record.kp is None:
        found.append("no kp: the dead band f/kp is null")
    if record.torque_limit is None:
        found.append("no torque limit: the ratio f/τ_max is null; give --torque-limit")
    if record.test_condition is None:
        found.append(
            "the test condition was not stated: a bare motor, a leg in the air and a loaded leg differ; "
            "give --test-condition"
        )
    return found


def _fit(record: JointRecord) -> list[str]:
    """Warn of parameters that the log does not show, and of intervals that rest on little."""
    found = []
    for name in ("inertia", "viscous_friction", "coulomb_friction"):
        estimate = getattr(record, name)
        if estimate.interval95[0] <= 0:
            found.append(
                f"the interval of {name} reaches zero: the log does not show that there is any; move more, or longer"
            )
    unexplained = record.diagnostics["relative_torque_error"]
    if unexplained > LARGEST_REST:
        found.append(
            f"{unexplained:.0%} of the torque is not explained by inertia and friction: gravity, a load, or noise; "
            "intervals cover noise, not a model that lacks something"
        )
    follows = record.diagnostics["position_torque"]
    worst = max(follows["changes"], key=lambda name: abs(follows["changes"][name]), default=None)
    if worst and abs(follows["slope"]) > LARGEST_SIGMAS * follows["std"]:
        change = follows["changes"][worst]
        if abs(change) > LARGEST_CHANGE:
            found.append(
                f"the torque follows the position too ({follows['slope']:.3g} per unit): gravity, a spring or a cable, "
                f"which the model lacks; with it {worst} would change by {change:+.0%}, which the interval does not "
                "cover: turn the joint's axis upright, or take the load off"
            )
    if record.diagnostics["blocks"] == FEWEST_BLOCKS:
        found.append(
            f"the residual's memory is long for this log: intervals rest on {FEWEST_BLOCKS} blocks only; log for longer"
        )
    return found


def _estimators(record: JointRecord) -> list[str]:
    """Warn where the two estimators, or the declared gains and the log, do not agree."""
    found = []
    mismatch = record.diagnostics["controller_mismatch"]
    if mismatch is not None and mismatch > LARGEST_MISMATCH:
        found.append(
            f"the logged torque differs from kp (target − position) − kd velocity by {mismatch:.0%}: gains, the "
            "torque's unit or the timing are not as declared; output error, which rests on them, is not done"
        )
    elif mismatch is not None and record.diagnostics["output_error"] is None:
        found.append(
            "output error found no joint whose simulation follows the log: the model is not right, or the gains"
        )
    for name, gap in (record.diagnostics["disagreement"] or {}).items():
        if gap["sigmas"] > LARGEST_SIGMAS and gap["relative"] > LARGEST_GAP:
            found.append(
                f"regression and output error disagree on {name} by {gap['relative']:.0%} ({gap['sigmas']:.1f} "
                "combined standard deviations): the model, the gains or the timing are not quite right"
                + ("; is the controller's velocity late (--velocity-delay)?" if name == "inertia" else "")
            )
    return found


def _signals(record: JointRecord, signals: Uniform, velocity: np.ndarray) -> list[str]:
    """Warn of a logged velocity that is not the derivative of the position, and of a motor at its limit."""
    found = []
    if signals.velocity is not None:
        slope = float(np.dot(signals.velocity, velocity) / np.dot(velocity, velocity))
        if not 0.9 < slope < 1.1:
            found.append(
                f"the logged velocity is {slope:.3g} times the derivative of the position: units? It is not used"
            )
    if record.torque_limit is not None:
        share = float(np.mean(np.abs(signals.torque) >= 0.99 * record.torque_limit))
        if share > 0.01:
            found.append(f"the motor is at its torque limit in {share:.0%} of the samples: move more gently")
        peak = float(np.abs(signals.torque).max())
        if peak > LARGEST_EXCESS * record.torque_limit:
            found.append(
                f"the log's torque reaches {peak:.4g}, beyond the torque limit {record.torque_limit:.4g}: the torque's "
                "unit (--torque-scale) or the limit is not as declared"
            )
    return found
