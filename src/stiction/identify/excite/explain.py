"""Why the design is as it is: what one sine would tell, and what the gains do.

One sine moves at nearly one speed, so that B|θ'| and f act alike: the estimates' correlation goes to -1, and either is
known only as long as the other is. Where the gains are high the position follows the target whatever friction does.
Gravity is left out of both comparisons.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stiction.formats.design import GainPoint, OneSine
from stiction.identify.excite.design import frequency_limit
from stiction.identify.excite.fisher import LogNoise
from stiction.identify.excite.gains import softened
from stiction.identify.excite.motion import Pattern, sine
from stiction.identify.excite.task import Task

SINES = 8
"""Frequencies at which one sine is tried."""

SLOWEST = 0.25
"""Lowest of them [Hz]."""

SWEEP = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Gains of the sweep in units of those of the design; far up, to where a torque sensor is worth having."""


def one_sines(task: Task, amplitude: float) -> tuple[OneSine, ...]:
    """Return what single sines of the design's amplitude [rad] tell, those that fit and move the joint."""
    found = []
    task = task.weightless()
    extremes = task.extremes()
    for frequency in np.geomspace(SLOWEST, max(frequency_limit(task), 4 * SLOWEST), SINES):
        pattern = task.fitted(sine(float(frequency), amplitude), [*extremes, task.lively()])
        if pattern is None:
            continue
        nominal = task.information(task.values, pattern)
        worst = max(task.information(values, pattern).worst for values in extremes)
        if not np.isfinite([nominal.worst, worst]).all():
            continue
        found.append(
            OneSine(
                frequency=float(frequency),
                amplitude=pattern.fast_peak,
                relative=(float(nominal.relative[0]), float(nominal.relative[1]), float(nominal.relative[2])),
                worst=worst,
                correlation=nominal.correlation(1, 2),
            )
        )
    return tuple(found)


def gain_sweep(task: Task, pattern: Pattern) -> tuple[GainPoint, ...]:
    """Return what a motion tells of the nominal joint's friction at lower and at higher gains than the task's."""
    points = []
    task = task.weightless()
    for factor in SWEEP:
        stiffer = task.at(softened(task.gains, factor))
        blind = replace(stiffer, noise=replace(task.noise, torque=None))
        seeing = replace(stiffer, noise=replace(task.noise, torque=task.noise.torque or LogNoise().torque))
        points.append(
            GainPoint(
                kp=stiffer.gains.kp,
                kd=stiffer.gains.kd,
                position_only=_friction(blind, pattern),
                with_torque=_friction(seeing, pattern),
                reach=stiffer.reach(task.target(pattern), [task.values]),
            )
        )
    return tuple(points)


def _friction(task: Task, pattern: Pattern) -> float | None:
    """Return the relative standard deviation of the nominal joint's Coulomb friction, None where it holds the joint."""
    deviation = float(task.information(task.values, pattern).relative[2])
    return deviation if np.isfinite(deviation) else None
