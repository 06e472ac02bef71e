"""Output error on parts of a log, and with a controller that is late: would the simulated joint say the same again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.formats.joints import Estimate
from stiction.identify.consistency import COMPARED, TIMING, Comparison, common_speed, splits
from stiction.identify.in_loop import BLURRED, fit_in_loop, values_of
from stiction.identify.output_error import OutputError
from stiction.identify.regression import Fit
from stiction.identify.runs import Run
from stiction.joints.pd import PDGains


def compare_in_loop(run: Run, base: Fit, whole: OutputError | None) -> tuple[Comparison, ...]:
    """Compare parts of the log with each other, and a log without torque with itself under a late controller.

    base: the regression; whole: output error on the whole log. Returns nothing where there is none.
    """
    gains = run.gains
    if whole is None or gains is None:
        return ()
    late = () if run.measured else _compare_delay(run, gains, base, whole)
    return (*_compare_parts(run, gains, base, whole), *late)


def _compare_parts(run: Run, gains: PDGains, base: Fit, whole: OutputError) -> tuple[Comparison, ...]:
    """Fit the parts of the log by themselves; the joint is simulated all along, and judged in one part.

    Gravity and offset stay as the whole log has them: the link is the same one, and a part tells them less apart.
    """
    start = values_of(base) | {name: estimate.value for name, estimate in whole.estimates.items()}
    known = {name: start[name] for name in BLURRED if name in base.names}
    found = []
    for split in splits(run.signals.time, run.prepared.velocity):
        parts = (split.first, ~split.first)
        fits = [fit_in_loop(run, gains, base, start, part, known) for part in parts]
        if fits[0] is None or fits[1] is None:
            continue
        both = [fit.estimates for fit in fits if fit is not None]
        values = {name: (both[0][name], both[1][name]) for name in COMPARED}
        speed = common_speed(*(run.prepared.velocity[part] for part in parts))
        one, other = (_friction(estimates, speed) for estimates in both)
        found.append(Comparison(split.label, split.parts, values, speed, (one, other)))
    return tuple(found)


def _compare_delay(run: Run, gains: PDGains, base: Fit, whole: OutputError) -> tuple[Comparison, ...]:
    """Set the fit beside one whose controller may be late, unless that was declared or asked for."""
    if run.setup.delay is not None or run.setup.unknowns:
        return ()
    free = replace(run, setup=replace(run.setup, unknowns=("delay",)))
    start = values_of(base) | {name: estimate.value for name, estimate in whole.estimates.items()}
    late = fit_in_loop(free, gains, base, start)
    if late is None or "delay" not in late.estimates:
        return ()
    values = {name: (whole.estimates[name], late.estimates[name]) for name in COMPARED}
    speed = float(np.quantile(np.abs(run.prepared.velocity), 0.9))
    one, other = _friction(whole.estimates, speed), _friction(late.estimates, speed)
    parts = ("as declared", f"controller {1e3 * late.estimates['delay'].value:.2g} ms late")
    return (Comparison(TIMING, parts, values, speed, (one, other), True),)


def _friction(seen: dict[str, Estimate], speed: float) -> Estimate:
    """Return B θ' + b_c at a speed; the two errors are taken as independent, which makes the interval too wide."""
    viscous, dry = seen["viscous_friction"], seen["coulomb_friction"]
    value = viscous.value * speed + dry.value
    std = float(np.hypot(viscous.std * speed, dry.std))
    reach = 2 * std
    return Estimate(value, std, (value - reach, value + reach))
