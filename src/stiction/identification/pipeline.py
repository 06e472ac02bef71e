"""Identification from a log to records: one joint from start to end, and all joints of a log in parallel.

Steps of each joint: check, filter, regress, choose a law, simulate, compare, judge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, LogError, StictionError
from stiction.core.parallel import spread
from stiction.core.provenance import num_threads
from stiction.files.joints import FitSignals, JointRecord, refused, warning
from stiction.files.log import UNNAMED, Log
from stiction.identification.checks import PoorMotion, coupled_text, other_moving_joints
from stiction.identification.choice import choose_gravity, choose_law
from stiction.identification.combinations import BackEmf, find_back_emf, strength_identified
from stiction.identification.consistency import (
    MIN_EVIDENCE,
    REPEAT,
    Comparison,
    compare,
    compare_parts,
    compare_timing,
    evidence_of,
)
from stiction.identification.contradictions import contradicted
from stiction.identification.findings import NAMELESS, NEGATIVE_FRICTION, find_errors, find_warnings
from stiction.identification.held_out import hold_out, predicts
from stiction.identification.in_loop import InLoop, close_loop, compare_in_loop, predict_run, read_again
from stiction.identification.model import GRAVITY_TERMS, Model
from stiction.identification.pooling import compare_runs, pooled_rows, share_delay
from stiction.identification.prepare import Rows, make_rows
from stiction.identification.record import JointFits, make_record, plain
from stiction.identification.regression import (
    INVERSE_STRENGTH,
    MAX_INFLATION,
    Fit,
    check_fit,
    check_rows,
    fit_at,
    fit_rows,
    predict_torque,
    rigid_torque,
)
from stiction.identification.runs import Run, fit_signals, make_run
from stiction.identification.setup import IdentifySetup
from stiction.identification.simulated_choice import choose_simulated
from stiction.identification.verdict import is_leg, judge

Done = Callable[[str], None]
"""Callback with a joint's name when it is identified."""

_Job = tuple[Log, str | None, IdentifySetup | None, tuple[Log, ...], tuple[Log, ...], tuple[str, ...], Log | None]
"""Arguments of `_attempt`."""


@dataclass(frozen=True)
class Identification:
    """Result for one joint."""

    name: str
    """Name of the joint."""
    record: JointRecord
    """Record for `joints.json`."""
    fit: FitSignals
    """Signals for `fit.npz`."""


def identify_joint(
    log: Log,
    joint: str | None = None,
    setup: IdentifySetup | None = None,
    repeats: Sequence[Log] = (),
    more: Sequence[Log] = (),
    moving: tuple[str, ...] | None = None,
    held_out: Log | None = None,
) -> Identification:
    """Identify one joint of a log.

    joint: its name, or None for the only one; repeats: further logs of the same joint, each with its sidecar, by which
    the result is tested; if a payload hangs on it in some of them, they are fitted together.
    more: further runs, which are fitted together with the log whatever hangs on them, each with its sidecar;
    moving: joints that moved at the same time, by default those of the log that did; held_out: a log to be predicted,
    with its sidecar; by default the last part of the log is. Raises `StictionError` with one
    line for whatever the logs lack.
    """
    setup = setup or IdentifySetup()
    if more and repeats:
        raise ConfigurationError("several runs in one fit, and repeats: give either; a repeat is a log to be predicted")
    if moving is None:
        moving = other_moving_joints(log, log.joint(joint)[0])
    try:
        return _identify(log, joint, setup, repeats, more, moving, held_out)
    except PoorMotion as error:
        if moving:
            raise error.because(coupled_text(moving)) from error
        raise


def _identify(
    log: Log,
    joint: str | None,
    setup: IdentifySetup,
    repeats: Sequence[Log],
    more: Sequence[Log],
    moving: tuple[str, ...],
    held_out: Log | None = None,
    data_ke: BackEmf | None = None,
) -> Identification:
    """Identify one joint; arguments as of `identify_joint`. data_ke: ke from the data, already in `setup`."""
    # Prepare all runs, and ask the log whether gravity pulls on the link.
    run = make_run(log, joint, setup, alone=not more)
    gravity = choose_gravity(run)
    if gravity is not None:
        run = replace(run, setup=replace(run.setup, gravity=gravity.chosen))
    repeat_runs, unusable = _repeats(run, joint, setup, repeats)
    shared = replace(setup.for_repeat(), gravity=run.setup.gravity)
    runs = [run, *(make_run(other, joint, shared, alone=False) for other in more)]
    # Fit viscous and Coulomb friction.
    base = _pooled(runs) if more else _symmetric(run, repeat_runs)
    pooling = compare_runs(runs, base) if more else None
    rows, strength_unknown = base.rows, INVERSE_STRENGTH in base.names
    check_fit(run.where, base)
    drive = find_back_emf(runs, base) if data_ke is None else None
    # A motor by voltage brakes itself: where the data told ke, all is done again, once, with the brake taken off.
    if drive is not None:
        return _identify(log, joint, replace(setup, ke=drive.ke), repeats, more, moving, held_out, drive)
    _check_values(run, base)
    # Simulate, and read the log as the best law's simulation says; where none is believed choose a law by torque.
    read, loop = (run, InLoop(reason=SEVERAL)) if more else close_loop(run, base)
    choice = chosen = None
    if loop.symmetric is not None and rows is run.rows:
        again = _symmetric(read, repeat_runs)
        choice, richer = choose_simulated(read, loop.symmetric, again)
        loop = replace(loop, chosen=richer).believed(run.prepared.noise)
        if loop.symmetric is not None:
            run = read if richer is None else read_again(read, richer)
            base = again if richer is None else _symmetric(run, repeat_runs)
            rows = base.rows
            chosen = base if richer is None else fit_at(rows, choice.model, richer.values)
    else:
        loop = loop.believed(run.prepared.noise)
    if choice is None or chosen is None:
        choice = choose_law(rows, base, strength_unknown)
        chosen = base if choice.law == "coulomb" else fit_rows(rows, choice.model, strength_unknown)
    # Compare and predict; repeats that were fitted as well are no test of the fit.
    unseen = repeat_runs if rows is run.rows else ()
    comparisons = compare_parts(rows, base) if more else _comparisons(run, base, loop, unseen)
    predictions = (*_predictions(chosen, unseen), *unusable)
    unseen_run = None if held_out is None else make_run(held_out, joint, shared, alone=False)
    simulated = loop.symmetric, loop.best
    predicted = hold_out(run, base, chosen, simulated, unseen_run) if rows is run.rows else None
    fits = JointFits(
        run, rows, base, chosen, choice, loop, comparisons, gravity, predictions, pooling, data_ke, predicted
    )
    # Make the record, which errors, verdict and warnings read in this order.
    record = make_record(fits)
    record = replace(record, findings=find_errors(fits, record, moving))
    if any(finding.reason == NEGATIVE_FRICTION for finding in record.objections):
        none = {"law": None, "text": "No friction law was chosen: friction comes out below zero, which no joint has."}
        record = replace(record, friction_law=(record.friction_law or {}) | none)
    verdict = judge(record, legs=is_leg(run.joint), robot=log.robot).to_dict()
    record = replace(record, diagnostics=record.diagnostics | plain({"verdict": verdict}))
    findings = (*record.findings, *find_warnings(record, run))
    if run.joint == UNNAMED and joint is None and record.axis == "rotary":
        findings += (NAMELESS,)
    findings += tuple(warning("runs", text) for text in pooling.sentences()) if pooling else ()
    return Identification(run.joint, replace(record, findings=findings), _fit_signals(fits))


def _repeats(
    run: Run, joint: str | None, setup: IdentifySetup, logs: Sequence[Log]
) -> tuple[list[Run], list[dict[str, Any]]]:
    """Prepare the repeats; return the usable ones, and the reasons against the rest.

    A poor repeat says nothing about the log itself. Raises `ConfigurationError` where a repeat is the log itself.
    """
    usable, unusable = [], []
    shared = replace(setup.for_repeat(), gravity=run.setup.gravity)
    for log in logs:
        try:
            other = make_run(log, joint, shared)
        except StictionError as error:
            unusable.append({"source": log.source, "refusal": str(error)})
            continue
        if np.array_equal(other.signals.position, run.signals.position):
            raise ConfigurationError(
                f"{other.source} is the same log as {run.source}: a repeat is another log of the joint"
            )
        usable.append(other)
    return usable, unusable


SEVERAL = "output error was not done: it is for one run at a time, and several were fitted together"


def _pooled(runs: Sequence[Run]) -> Fit:
    """Fit viscous and Coulomb friction to several runs; reject two that are the same, and too little of all of them."""
    first = runs[0]
    for number, run in enumerate(runs):
        for other in runs[:number]:
            if np.array_equal(run.signals.position, other.signals.position):
                raise ConfigurationError(f"{run.source} is the same log as {other.source}: give each run once")
    known = first.setup.motor_strength is not None or (first.measured and all(run.setup.calibrated for run in runs))
    if any(run.measured != first.measured or run.setup.fits_gravity != first.setup.fits_gravity for run in runs):
        raise ConfigurationError(
            f"{first.source}: runs with and without torque, or gravity, in one fit; give runs of one kind"
        )
    units = {(run.setup.drive.column, run.setup.drive.per_unit) for run in runs if not run.setup.calibrated}
    if not known and first.measured and (len(units) > 1 or any(run.setup.calibrated for run in runs)):
        raise ConfigurationError(
            f"{first.source}: torque columns of several unknown units in one fit; give --kt, and --resistance for a "
            "voltage or a duty, or runs of one kind"
        )
    rows = pooled_rows(runs)
    check_rows(f"{first.source} and {len(runs) - 1} more", rows, first.prepared)
    if known and first.setup.motor_strength is None and any(run.setup.pendulum for run in runs):
        return _weighed(rows, first.model)
    scaled = not known and any(run.setup.payload for run in runs)
    return fit_rows(rows, first.model, strength_unknown=scaled)


def _weighed(rows: Rows, model: Model) -> Fit:
    """Fit with a pendulum, whose weight gives the scale of the torque, whatever was declared, where it can."""
    scaled = fit_rows(rows, model, strength_unknown=True)
    return scaled if strength_identified(scaled) else fit_rows(rows, model)


def _symmetric(run: Run, repeats: Sequence[Run]) -> Fit:
    """Fit viscous and Coulomb friction to the log, or to all logs where only together they tell the strength k.

    A payload tells k, and so does a known torque from outside, if it is large enough; else k stays unknown.
    """
    model, strength = run.model, run.setup.motor_strength
    runs = (run, *repeats)
    payloads = [item.setup.payload for item in runs]
    known = strength is not None or (run.measured and run.setup.calibrated)
    pushed = [item for item in runs if item.signals.disturbance is not None]
    if len(set(payloads)) > 1 or (pushed and not known and len(repeats) > 0):
        rows = make_rows([item.prepared for item in runs], payloads, strength or 1.0)
    else:
        rows = run.rows
    if known and strength is None and run.setup.pendulum:
        return _weighed(rows, model)
    if known:
        return fit_rows(rows, model)
    # With a payload 1/k stays in the fit even where it is not told: `check_fit` then says which log is missing.
    if any(payloads) or pushed:
        scaled = fit_rows(rows, model, strength_unknown=True)
        if any(payloads) or strength_identified(scaled):
            return scaled
    return fit_rows(run.rows, model)


def _check_values(run: Run, fit: Fit) -> None:
    """Reject values that no joint has."""
    estimates = fit.estimates()
    inertia, (low, high) = estimates["inertia"].value, estimates["inertia"].interval95
    poor = all(estimates[name].interval95[0] <= 0 for name in ("inertia", "viscous_friction", "coulomb_friction"))
    heavy = (inertia <= 0 or poor) and _wants_gravity(run, fit)
    backwards = high <= 0 and estimates["coulomb_friction"].interval95[0] <= 0
    # Exchanged columns look like anything, so a contradiction is reported before a cause is guessed.
    if (heavy or backwards) and (contradiction := contradicted(run)):
        raise LogError(f"{run.where}: the fitted inertia is {inertia:.3g}; it must be positive: {contradiction}")
    # Gravity first: by itself it can turn the fitted inertia negative, for θ and θ'' are opposite in a sine.
    if heavy:
        raise LogError(
            f"{run.where}: the torque follows the position, as with gravity, a spring or a cable, and without it the "
            "fitted "
            f"inertia is {inertia:.3g}: --gravity True fits it; or turn the joint's axis upright, or take the load off"
        )
    if backwards:
        raise LogError(
            f"{run.where}: the fitted inertia is {inertia:.3g}; it must be positive: is the torque's "
            "sign that of the position (--torque-scale -1 turns it round), and its column the right one?"
            if run.measured
            else f"{run.where}: the fitted inertia is {inertia:.3g}; it must be positive: is the target this joint's, "
            "and its sign that of the position?"
        )
    if poor:
        raise PoorMotion(
            run.where,
            "the intervals of inertia, viscous and dry friction all reach zero",
            "move further and faster, or check that the torque belongs to this joint",
        )
    if inertia <= 0:
        raise PoorMotion(
            run.where,
            f"the fitted inertia is {inertia:.3g} ({low:.3g} to {high:.3g}), and it must be positive",
            "move further and faster, so that the joint sticks less, and check that target and torque are this joint's",
        )
    limit = run.setup.torque_limit
    if limit is not None and estimates["coulomb_friction"].value >= limit:
        raise LogError(
            f"{run.where}: dry friction of {estimates['coulomb_friction'].value:.4g} would be beyond the torque limit "
            f"{limit:.4g}, and yet the joint moved: check the torque's unit (--torque-scale) and --torque-limit"
        )


def _wants_gravity(run: Run, fit: Fit) -> bool:
    """Return True if the log makes sense with gravity where none was fitted."""
    if fit.model.gravity or run.setup.axis == "linear" or run.setup.payload is not None:
        return False
    heavy = fit_rows(run.rows, Model("coulomb", True))
    clear = heavy.inflation["inertia"] < MAX_INFLATION and heavy.estimates()["inertia"].interval95[0] > 0
    return clear and evidence_of([fit.residual], [heavy.residual], len(GRAVITY_TERMS)) >= MIN_EVIDENCE


def _comparisons(run: Run, base: Fit, loop: InLoop, repeats: Sequence[Run]) -> tuple[Comparison, ...]:
    """Compare the parts of the log, and the log with its repeats that carry the same load."""
    alike = [other for other in repeats if other.setup.payload == run.setup.payload]
    runs = tuple(
        compare(f"{REPEAT} {index}", (run.source, other.source), run.rows, other.rows, base)
        for index, other in enumerate(alike, 1)
    )
    parts = compare_in_loop(run, loop.best) or compare_parts(run.rows, base)
    # Where the loop is simulated the log has told when its torque acted.
    late = compare_timing(run.prepared, base) if loop.symmetric is None and base.rows is run.rows else None
    return (*parts, *([late] if late else []), *runs)


def _predictions(fit: Fit, repeats: Sequence[Run]) -> tuple[dict[str, Any], ...]:
    """Test the chosen law on the repeats, which it was not fitted to.

    torque_error: |measured − predicted| over |measured| torque, at the samples that count; simulation_errors: the same
    for the signals of a simulation of the whole log, None where it could not be done.
    """
    predictions = []
    for other in repeats:
        residual = other.rows.torque - predict_torque(fit, other.rows)
        error = float(np.linalg.norm(residual) / np.linalg.norm(other.rows.torque))
        predictions.append(
            {"source": other.source, "torque_error": error, "simulation_errors": predict_run(other, fit)}
        )
    return tuple(predictions)


def _fit_signals(fits: JointFits) -> FitSignals:
    """Collect the signals that the page draws."""
    run, prepared = fits.run, fits.run.prepared
    whole = replace(prepared, used=np.arange(len(prepared.torque)))
    everything = make_rows([whole], [run.setup.payload], run.setup.motor_strength or 1.0)
    best = fits.loop.best
    return fit_signals(
        run,
        predict_torque(fits.base, everything),
        predict_torque(fits.chosen, everything),
        rigid_torque(fits.chosen, everything),
        best.simulated.position if best else None,
        best.simulated.torque if best and run.measured else None,
    )


def identify_log(
    log: Log,
    setup: IdentifySetup | None = None,
    joints: Sequence[str] = (),
    repeats: Sequence[Log] = (),
    done: Done = lambda name: None,
    workers: int | None = None,
    more: Sequence[Log] = (),
    held_out: Log | None = None,
) -> tuple[dict[str, Identification], dict[str, JointRecord]]:
    """Identify several joints, every one of the log's by default.

    Returns the identified joints, and for the refused ones an empty record whose warning gives the reason,
    both in the order of the log, or of `joints`. more: further runs, fitted together with the log; held_out: a log to
    be predicted; workers: processes, by default one a core. Raises `StictionError` where a joint is not in the log, or
    none could be identified.
    """
    names = [log.joint(name)[0] for name in joints] or list(log.joints)
    identified: dict[str, Identification] = {}
    unable: dict[str, str] = {}
    # Of several joints each is asked for by name, or a repeat that lacks it could offer its only joint instead.
    named = bool(joints) or len(log.joints) > 1
    jobs = {
        name: (
            _single_joint(log, name),
            name if named else None,
            setup,
            tuple(_single_joint(other, name) for other in repeats),
            tuple(_single_joint(other, name) for other in more),
            other_moving_joints(log, name),
            None if held_out is None else _single_joint(held_out, name),
        )
        for name in names
    }
    for name, outcome in _outcomes(jobs, min(len(jobs), workers or num_threads())):
        if isinstance(outcome, StictionError):
            unable[name] = str(outcome)
        else:
            identified[name] = outcome
            done(name)
    if not identified:
        raise LogError(unable[names[0]])
    identified |= _with_shared_delay(log, setup or IdentifySetup(), identified, jobs)
    empty = {name: refused(unable[name]) for name in names if name in unable}
    return {name: identified[name] for name in names if name in identified}, empty


def _with_shared_delay(
    log: Log, setup: IdentifySetup, results: Mapping[str, Identification], jobs: Mapping[str, _Job]
) -> dict[str, Identification]:
    """Identify joints that do not tell the delay of their loop again, with that of the others; warn where these differ.

    results, jobs: joint -> its identification, and the arguments of that. Returns the changed identifications.
    """
    # In the order of the log: in that of who was done first, the last bits of their mean would be of chance.
    identified = {name: results[name].record for name in jobs if name in results}
    delays = {name: record.delay for name, record in identified.items() if record.delay is not None}
    shared = share_delay(delays, float(np.median(np.diff(log.time))))
    if shared is None:
        return {}
    changed = {name: results[name] for name in shared.telling} if not shared.agreed else {}
    if shared.agreed:
        late = replace(setup, delay=max(0.0, shared.estimate.value))
        again = {name: (*jobs[name][:2], late, *jobs[name][3:]) for name in shared.silent}
        for name, outcome in _outcomes(again, min(len(again), num_threads())):
            # A delay that the joint's inertia does not admit leaves nothing that could predict.
            if not isinstance(outcome, StictionError) and predicts(outcome.record) >= predicts(results[name].record):
                changed[name] = outcome
    return {
        name: replace(
            result,
            record=replace(
                result.record, findings=(*result.record.findings, warning("shared_delay", shared.sentence()))
            ),
        )
        for name, result in changed.items()
    }


def _outcomes(jobs: Mapping[str, _Job], workers: int) -> Iterator[tuple[str, Identification | StictionError]]:
    """Yield each joint's name with its identification or its refusal, in the order of completion."""
    names = list(jobs)
    for number, outcome in spread(_attempt, list(jobs.values()), workers):
        yield names[number], outcome


def _single_joint(log: Log, name: str) -> Log:
    """Return the log with one joint: a worker needs no more. A repeat without the joint stays whole, and is refused."""
    return replace(log, joints={name: log.joints[name]}) if name in log.joints else log


def _attempt(
    log: Log,
    name: str | None,
    setup: IdentifySetup | None,
    repeats: Sequence[Log],
    more: Sequence[Log],
    moving: tuple[str, ...],
    held_out: Log | None,
) -> Identification | StictionError:
    """Identify one joint; return a failure as a value, for an exception would lose its class."""
    try:
        return identify_joint(log, name, setup, repeats, more, moving, held_out)
    except StictionError as error:
        return error
