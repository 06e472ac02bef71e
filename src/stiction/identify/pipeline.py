"""From a log to records: one joint from start to end, and all joints of a log in parallel.

Of each joint: check, filter, regress, choose a law, simulate, compare, judge.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, LogError, StictionError
from stiction.core.isolation import isolate_workers
from stiction.core.provenance import num_threads
from stiction.formats.joints import FitSignals, JointRecord
from stiction.formats.log import UNNAMED, Log
from stiction.identify.choice import choose_in_loop, choose_law
from stiction.identify.combinations import strength_identified
from stiction.identify.consistency import Comparison, compare, compare_parts, compare_timing
from stiction.identify.in_loop import InLoop, close_loop, compare_in_loop, predict_run
from stiction.identify.pooling import compare_runs, pooled_rows
from stiction.identify.prepare import make_rows
from stiction.identify.record import Evidence, make_record
from stiction.identify.regression import (
    INVERSE_STRENGTH,
    Fit,
    check_fit,
    check_rows,
    fit_rows,
    predict_torque,
    rigid_torque,
)
from stiction.identify.runs import Run, make_run
from stiction.identify.setup import IdentifySetup
from stiction.identify.warnings import NAMELESS, find_warnings

Done = Callable[[str], None]
"""Called with a joint's name when it is identified."""

REFUSED = "not identified: "
"""How the warning of a refused joint begins."""


_Job = tuple[Log, str | None, IdentifySetup | None, tuple[Log, ...], tuple[Log, ...]]
"""What `_attempt` is called with."""


@dataclass(frozen=True)
class Identification:
    """What came out for one joint."""

    name: str
    """The joint."""
    record: JointRecord
    """For `joints.json`."""
    fit: FitSignals
    """For `fit.npz`."""


def identify_joint(
    log: Log,
    joint: str | None = None,
    setup: IdentifySetup | None = None,
    repeats: Sequence[Log] = (),
    more: Sequence[Log] = (),
) -> Identification:
    """Identify one joint of a log.

    joint: its name, or None for the only one; repeats: further logs of the same joint, each with what its sidecar says.
    They show whether the joint says the same again; if a payload hangs on it in some of them, they are fitted together.
    more: further runs, which are fitted together with the log whatever hangs on them, each with its own sidecar.
    Raises `StictionError` with one line for whatever the logs lack.
    """
    setup = setup or IdentifySetup()
    if more and repeats:
        raise ConfigurationError("several runs in one fit, and repeats: give either; a repeat is a log to be predicted")
    run = make_run(log, joint, setup, alone=not more)
    runs = [run, *(make_run(other, joint, setup.for_repeat(), alone=False) for other in more)]
    others = [make_run(other, joint, setup.for_repeat()) for other in repeats]
    for other in others:
        if np.array_equal(other.signals.position, run.signals.position):
            raise ConfigurationError(
                f"{other.source} is the same log as {run.source}: a repeat is another log of the joint"
            )
    base = _symmetric(run, others) if not more else _pooled(runs)
    pooling = compare_runs(runs, base) if more else None
    rows, strength_unknown = base.rows, INVERSE_STRENGTH in base.names
    check_fit(run.source, base)
    _check_values(run, base)
    choice = choose_law(rows, base, strength_unknown)
    chosen = base if choice.law == "coulomb" else fit_rows(rows, choice.model, strength_unknown)
    loop = close_loop(run, base, chosen) if not more else InLoop(reason=SEVERAL)
    simulated = choose_in_loop(run, base, loop) if choice.law == "coulomb" and rows is run.rows else None
    if simulated is not None:
        choice, chosen, loop = (
            choice.with_simulated_law(simulated),
            simulated.fit,
            replace(loop, chosen=simulated.found),
        )
    delay = _found_delay(run, loop)
    if delay is not None:
        return identify_joint(log, joint, replace(setup, delay=delay), repeats)
    unseen = others if rows is run.rows else ()
    comparisons = _comparisons(run, base, loop, unseen) if not more else compare_parts(rows, base)
    evidence = Evidence(
        run, rows, base, chosen, choice, loop, comparisons, _predictions(chosen, unseen), pooling=pooling
    )
    record = make_record(evidence)
    warnings = find_warnings(record, run)
    if run.joint == UNNAMED and joint is None and record.axis == "rotary":
        warnings += (NAMELESS,)
    warnings += pooling.sentences() if pooling else ()
    return Identification(run.joint, replace(record, warnings=warnings), _fit_signals(evidence))


SEVERAL = "output error was not done: it is for one run at a time, and several were fitted together"


def _pooled(runs: Sequence[Run]) -> Fit:
    """Fit viscous and Coulomb friction to several runs; refuse two that are the same, and too little of all of them."""
    first = runs[0]
    for number, one in enumerate(runs):
        for other in runs[:number]:
            if np.array_equal(one.signals.position, other.signals.position):
                raise ConfigurationError(f"{one.source} is the same log as {other.source}: give each run once")
    known = first.setup.motor_strength is not None or (first.measured and first.setup.torque_calibrated is not False)
    if any(one.measured != first.measured or one.setup.fits_gravity != first.setup.fits_gravity for one in runs):
        raise ConfigurationError(
            f"{first.source}: runs with and without torque, or gravity, in one fit; give runs of one kind"
        )
    rows = pooled_rows(runs)
    check_rows(f"{first.source} and {len(runs) - 1} more", rows)
    scaled = not known and any(one.setup.payload for one in runs)
    return fit_rows(rows, first.model, strength_unknown=scaled)


def _symmetric(run: Run, others: Sequence[Run]) -> Fit:
    """Fit viscous and Coulomb friction to the log, or to all logs where only together they tell the strength k.

    A payload tells k, and so does a known torque from outside, if it is large enough; else k stays unknown.
    """
    model, strength = run.model, run.setup.motor_strength
    runs = (run, *others)
    payloads = [one.setup.payload for one in runs]
    known = strength is not None or (run.measured and run.setup.torque_calibrated is not False)
    pushed = [one for one in runs if one.signals.disturbance is not None]
    if len(set(payloads)) > 1 or (pushed and not known and len(others) > 0):
        rows = make_rows([one.prepared for one in runs], payloads, strength or 1.0)
    else:
        rows = run.rows
    if known:
        return fit_rows(rows, model)
    if any(payloads) or pushed:
        scaled = fit_rows(rows, model, strength_unknown=True)
        if any(payloads) or strength_identified(scaled):
            return scaled
    return fit_rows(run.rows, model)


def _found_delay(run: Run, loop: InLoop) -> float | None:
    """Return the delay that the loop showed and that the torque made from the PD law did not have [s], else None.

    Such torque is too early, which looks like another friction law: all of it is done again, once, with the delay.
    """
    if run.measured or run.setup.delay is not None or loop.symmetric is None:
        return None
    found = loop.symmetric.estimates.get("delay")
    return None if found is None else found.value


def _check_values(run: Run, fit: Fit) -> None:
    """Refuse values that no joint has."""
    found = fit.estimates()
    inertia, (low, high) = found["inertia"].value, found["inertia"].interval95
    if high <= 0:
        raise LogError(
            f"{run.source}: the fitted inertia is {inertia:.3g}; it must be positive: is the torque's "
            "sign that of the position (--torque-scale -1 turns it round), and its column the right one?"
        )
    if all(found[name].interval95[0] <= 0 for name in ("inertia", "viscous_friction", "coulomb_friction")):
        raise LogError(
            f"{run.source}: excitation too poor: the intervals of inertia, viscous and dry friction all reach zero; "
            "move further and faster, or check that the torque belongs to this joint"
        )
    if inertia <= 0:
        raise LogError(
            f"{run.source}: excitation too poor: the fitted inertia is {inertia:.3g} ({low:.3g} to {high:.3g}), and it "
            "must be positive; move further and faster, so that the joint sticks less"
        )
    limit = run.setup.torque_limit
    if limit is not None and found["coulomb_friction"].value >= limit:
        raise LogError(
            f"{run.source}: dry friction of {found['coulomb_friction'].value:.4g} would be beyond the torque limit "
            f"{limit:.4g}, and yet the joint moved: check the torque's unit (--torque-scale) and --torque-limit"
        )


def _comparisons(run: Run, base: Fit, loop: InLoop, others: Sequence[Run]) -> tuple[Comparison, ...]:
    """Compare the parts of the log, and the log with its repeats that carry the same load."""
    alike = [other for other in others if other.setup.payload == run.setup.payload]
    runs = tuple(
        compare(f"repeat {index}", (run.source, other.source), run.rows, other.rows, base)
        for index, other in enumerate(alike, 1)
    )
    parts = compare_in_loop(run, base, loop.symmetric) or compare_parts(run.rows, base)
    timing = compare_timing(run.prepared, base) if run.measured and base.rows is run.rows else None
    return (*parts, *([timing] if timing else []), *runs)


def _predictions(fit: Fit, others: Sequence[Run]) -> tuple[dict[str, Any], ...]:
    """Try the law that was chosen on the repeats, which it was not fitted to.

    torque_error: |measured − predicted| over |measured| torque, at the samples that count; simulation_errors: the same
    for the signals of a simulation of the whole log, None where it could not be done.
    """
    found = []
    for other in others:
        residual = other.rows.torque - predict_torque(fit, other.rows)
        error = float(np.linalg.norm(residual) / np.linalg.norm(other.rows.torque))
        found.append({"source": other.source, "torque_error": error, "simulation_errors": predict_run(other, fit)})
    return tuple(found)


def _fit_signals(evidence: Evidence) -> FitSignals:
    """Collect what the page draws."""
    run, prepared = evidence.run, evidence.run.prepared
    used = np.zeros(len(prepared.torque))
    used[prepared.used] = 1.0
    whole = replace(prepared, used=np.arange(len(prepared.torque)))
    everything = make_rows([whole], [run.setup.payload], run.setup.motor_strength or 1.0)
    best = evidence.loop.chosen or evidence.loop.symmetric
    return FitSignals(
        time=run.signals.time,
        position=run.signals.position,
        velocity=prepared.velocity,
        acceleration=prepared.acceleration,
        torque=prepared.torque - prepared.outside,
        fitted_torque=predict_torque(evidence.base, everything),
        law_torque=predict_torque(evidence.chosen, everything),
        rigid_torque=rigid_torque(evidence.chosen, everything),
        used=used,
        target=run.signals.target,
        simulated_position=best.simulated.position if best else None,
        simulated_torque=best.simulated.torque if best and run.measured else None,
    )


def identify_log(
    log: Log,
    setup: IdentifySetup | None = None,
    joints: Sequence[str] = (),
    repeats: Sequence[Log] = (),
    done: Done = lambda name: None,
    workers: int | None = None,
    more: Sequence[Log] = (),
) -> tuple[dict[str, Identification], dict[str, JointRecord]]:
    """Identify several joints, every one of the log's by default.

    Returns the joints that were identified, and for those that were refused an empty record whose warning says why,
    both in the order of the log, or of `joints`. more: further runs, fitted together with the log. `workers`:
    processes, by default one a core. Raises `StictionError`
    where a joint is not in the log, or none could be identified.
    """
    names = [log.joint(name)[0] for name in joints] or list(log.joints)
    found: dict[str, Identification] = {}
    refused: dict[str, str] = {}
    # Of several joints each is asked for by name, or a repeat that lacks it could offer its only joint instead.
    named = bool(joints) or len(log.joints) > 1
    jobs = {
        name: (
            _single_joint(log, name),
            name if named else None,
            setup,
            tuple(_single_joint(one, name) for one in repeats),
            tuple(_single_joint(one, name) for one in more),
        )
        for name in names
    }
    for name, outcome in _outcomes(jobs, min(len(jobs), workers or num_threads())):
        if isinstance(outcome, StictionError):
            refused[name] = str(outcome)
        else:
            found[name] = outcome
            done(name)
    if not found:
        raise LogError(refused[names[0]])
    empty = {name: JointRecord(warnings=(REFUSED + refused[name],)) for name in names if name in refused}
    return {name: found[name] for name in names if name in found}, empty


def _outcomes(jobs: Mapping[str, _Job], workers: int) -> Iterator[tuple[str, Identification | StictionError]]:
    """Yield each joint's name with its identification or its refusal, as they are finished."""
    if workers == 1:
        for name, job in jobs.items():
            yield name, _attempt(*job)
        return
    isolate_workers()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting: dict[Future, str] = {pool.submit(_attempt, *job): name for name, job in jobs.items()}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise StictionError(
                "a process at work was killed, perhaps for want of memory; cut the log, or raise --memory-limit"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _single_joint(log: Log, name: str) -> Log:
    """Return the log with one joint: a worker needs no more. A repeat without the joint stays whole, and is refused."""
    return replace(log, joints={name: log.joints[name]}) if name in log.joints else log


def _attempt(
    log: Log, name: str | None, setup: IdentifySetup | None, repeats: Sequence[Log], more: Sequence[Log]
) -> Identification | StictionError:
    """Identify one joint; what is wrong with it comes back as a value, for an exception would lose its class."""
    try:
        return identify_joint(log, name, setup, repeats, more)
    except StictionError as error:
        return error
