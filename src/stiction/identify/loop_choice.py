"""Is friction higher at rest? What a simulation of the loop sees and torque regression does not.

Regression leaves out the samples around turning points, where friction may take any value; Stribeck's fall of friction
with speed often lies there. Output error simulates them. Where the two estimators disagree on friction, the law is
fitted by simulation too, and judged as the other laws are: each half of the log by a fit to the other half.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.errors import StictionError
from stiction.identify.agreement import beyond_chance, disagreement
from stiction.identify.choice import LEAST_EVIDENCE, Gain, gain_of
from stiction.identify.in_loop import InLoop, fit_in_loop, respond, values_of
from stiction.identify.intervals import correlation_time
from stiction.identify.model import Model
from stiction.identify.output_error import OutputError
from stiction.identify.regression import Fit, fit_at
from stiction.identify.runs import Run

LEAST_RISE = 1.2
"""Static over Coulomb friction: a controller that holds its torque for 2 ms looked like a rise by a tenth."""

BLOCKS = 5
"""Blocks of a half, whose scatter gives the deviation of the gain."""

FIRST_RISE, FIRST_SPEED = 1.3, 0.1
"""Where the search begins: static over Coulomb friction, and v_s over the top speed."""


@dataclass(frozen=True)
class LoopChoice:
    """A Stribeck law that the loop calls for."""

    found: OutputError
    """Output error with it."""
    fit: Fit
    """The same values as a torque equation, for prediction and figures."""
    gain: Gain
    """By how much it lowers the squared simulation error in halves that the fit did not see."""
    evidence: float
    """Drop of the information criterion."""


def choose_in_loop(run: Run, base: Fit, loop: InLoop) -> LoopChoice | None:
    """Return the Stribeck law if simulation calls for it; base and loop: the symmetric fits, which must disagree."""
    gains = run.gains
    if loop.symmetric is None or gains is None or not _disagree(base, loop.symmetric):
        return None
    rich = replace(base, model=Model("stribeck", base.model.gravity))
    start = {name: estimate.value for name, estimate in loop.symmetric.estimates.items()}
    start = values_of(base) | start
    start["static_friction"] = FIRST_RISE * start["coulomb_friction"]
    start["stribeck_velocity"] = FIRST_SPEED * float(np.quantile(np.abs(run.prepared.velocity), 0.99))
    try:
        found = fit_in_loop(run, gains, rich, start)
    except StictionError:
        # With friction that falls so steeply a joint would run away within a sample, and so there is no such joint.
        return None
    if found is None or not _rises(found) or _is_late(run, base, start, loop.symmetric, found):
        return None
    gain = _held_out(run, base, rich, start)
    evidence = _evidence(loop.symmetric, found)
    if gain is None or not gain.certain or evidence < LEAST_EVIDENCE:
        return None
    values = {name: found.estimates[name].value for name in rich.model.names if name in found.estimates}
    fit = fit_at(base.rows, rich.model, start | values)
    return LoopChoice(found, fit, gain, evidence)


def _disagree(base: Fit, found: OutputError) -> bool:
    """Return whether regression and output error dispute the friction."""
    gaps = disagreement(base, found.estimates)
    return any(beyond_chance(gaps[name]) for name in ("viscous_friction", "coulomb_friction") if name in gaps)


def _rises(found: OutputError) -> bool:
    """Return whether friction at rest is above Coulomb friction, clearly."""
    static, dry = found.estimates["static_friction"], found.estimates["coulomb_friction"]
    return static.interval95[0] > dry.interval95[1] and static.value > LEAST_RISE * dry.value


def _is_late(run: Run, base: Fit, start: dict[str, float], plain: OutputError, rich: OutputError) -> bool:
    """Return whether a controller that is late explains the log better than friction that rises toward rest."""
    gains = run.gains
    assert gains is not None
    free = replace(run, setup=replace(run.setup, unknowns=("delay",)))
    late = fit_in_loop(free, gains, base, start)
    return late is not None and _misfit(late, plain) < _misfit(rich, plain)


def _misfit(found: OutputError, plain: OutputError) -> float:
    """Return the squared error of a simulation, each signal in units of the symmetric law's."""
    return sum(
        float(np.sum(row**2) / max(float(np.sum(plain.residuals[name] ** 2)), 1e-300))
        for name, row in found.residuals.items()
    )


def _held_out(run: Run, base: Fit, rich: Fit, start: dict[str, float]) -> Gain | None:
    """Compare both laws on each half of the log, fitted to the other one; None where a half tells too little."""
    gains = run.gains
    assert gains is not None
    half = run.signals.time < run.signals.time[-1] / 2
    errors: list[list[float]] = [[], []]
    for part in (half, ~half):
        fits = [fit_in_loop(run, gains, fit, start, part) for fit in (base, rich)]
        if fits[0] is None or fits[1] is None:
            return None
        sizes = {name: float(np.std(row[part & run.signals.valid])) for name, row in fits[0].residuals.items()}
        blocks = np.array_split(np.flatnonzero(~part & run.signals.valid), BLOCKS)
        for index, (one, fit) in enumerate(zip((base, rich), fits, strict=True)):
            assert fit is not None
            values = {name: estimate.value for name, estimate in fit.estimates.items()}
            response = respond(run, gains, one.model, values)
            rows = {name: getattr(response, name) - getattr(run.signals, name) for name in sizes}
            squares = sum((row / max(sizes[name], 1e-300)) ** 2 for name, row in rows.items())
            errors[index] += [float(np.sum(np.asarray(squares)[block])) for block in blocks]
    return gain_of(np.array(errors[1]), np.array(errors[0]))


def _evidence(plain: OutputError, rich: OutputError) -> float:
    """Return by how much the information criterion falls; samples count by how many of them are independent."""
    total = 0.0
    for name, row in plain.residuals.items():
        independent = len(row) / max(correlation_time(one) for one in (row, rich.residuals[name]))
        total += independent * float(np.log(np.sum(row**2) / max(float(np.sum(rich.residuals[name] ** 2)), 1e-300)))
    return total - 2 * float(np.log(len(next(iter(plain.residuals.values())))))
