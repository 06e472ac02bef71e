"""Several runs of one joint in one fit: one set of intervals, and by how much the runs disagree.

Within a run the residual's scatter tells how well a parameter is known; between runs the joint may have been warmer,
or loaded otherwise, which no run shows by itself. So the interval is also that of the mean of the runs' own estimates,
Student's with one degree of freedom less than there are runs, whichever reaches further.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, ndtri, stdtrit

from stiction.files.joints import Estimate
from stiction.identification.consistency import COMPARED
from stiction.identification.prepare import Rows, make_rows
from stiction.identification.regression import FEWEST_ROWS, INVERSE_STRENGTH, MAX_INFLATION, Fit, fit_rows
from stiction.identification.runs import Run

CHANCE = 0.01
"""Probability of chance disagreement below which the runs are reported to disagree."""


def pooled_rows(runs: Sequence[Run]) -> Rows:
    """Return the rows of all runs, with the motor strength of the first."""
    strength = runs[0].setup.motor_strength or 1.0
    return make_rows([run.prepared for run in runs], [run.setup.payload for run in runs], strength)


@dataclass(frozen=True)
class Pooling:
    """Estimates of each of several runs, under the equation of the fit to all of them."""

    sources: tuple[str, ...]
    """Names of all runs."""
    alone: tuple[dict[str, Estimate] | None, ...]
    """Estimates of inertia, viscous and dry friction of each run; None where it is too short or too poor."""

    @property
    def telling(self) -> list[dict[str, Estimate]]:
        """Estimates of the runs that can be fitted alone."""
        return [estimates for estimates in self.alone if estimates is not None]

    def values(self, name: str) -> np.ndarray:
        """Return the runs' values of a parameter, shape (num_telling,)."""
        return np.array([estimates[name].value for estimates in self.telling])

    def spread(self, name: str) -> float:
        """Return the standard deviation between the runs; NaN for fewer than two."""
        values = self.values(name)
        return float(values.std(ddof=1)) if len(values) > 1 else float("nan")

    def probability(self, name: str) -> float:
        """Return the probability of so much disagreement by chance alone (Cochran's Q); NaN for fewer than two runs."""
        if len(self.telling) < 2:
            return float("nan")
        return agreement([estimates[name] for estimates in self.telling])[1]

    def admitted(self, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
        """Return estimates whose intervals are at least as wide as that of the mean of the runs."""
        result = dict(estimates)
        count = len(self.telling)
        for name in COMPARED:
            if name not in result or count < 2:
                continue
            old, std = result[name], self.spread(name) / np.sqrt(count)
            reach = float(stdtrit(count - 1, 0.975)) * std
            ends = (min(old.interval95[0], old.value - reach), max(old.interval95[1], old.value + reach))
            result[name] = Estimate(old.value, max(old.std, float(std)), ends)
        return result

    def sentences(self) -> tuple[str, ...]:
        """Return sentences on the number of runs, and on the parameters in which they disagree."""
        mute = len(self.sources) - len(self.telling)
        sentences = [
            f"{len(self.sources)} runs were fitted together"
            + (f"; {mute} of them are too short or too poor to say anything alone" if mute else "")
        ]
        for name in COMPARED:
            if len(self.telling) > 1 and self.probability(name) < CHANCE:
                values = self.values(name)
                sentences.append(
                    f"the runs disagree on the {name.replace('_', ' ')} beyond chance: {values.min():.4g} to "
                    f"{values.max():.4g}, deviation {self.spread(name):.3g}; the interval is that of their mean"
                )
        return tuple(sentences)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "sources": list(self.sources),
            "alone": [
                estimates and {name: estimate.to_dict() for name, estimate in estimates.items()}
                for estimates in self.alone
            ],
            "spread": {name: self.spread(name) for name in COMPARED} if len(self.telling) > 1 else None,
            "probability": {name: self.probability(name) for name in COMPARED} if len(self.telling) > 1 else None,
        }


def agreement(estimates: Sequence[Estimate]) -> tuple[Estimate, float]:
    """Return the weighted mean of estimates of one quantity, and the probability of so much scatter (Cochran's Q)."""
    # Deviations from the intervals, which know how few blocks a short run has.
    widths = [estimate.interval95[1] - estimate.interval95[0] for estimate in estimates]
    weights = (2 * float(ndtri(0.975)) / np.array(widths).clip(1e-300)) ** 2
    values, std = np.array([estimate.value for estimate in estimates]), float(weights.sum() ** -0.5)
    centre, reach = float(weights @ values / weights.sum()), float(ndtri(0.975)) * std
    scatter = float(weights @ (values - centre) ** 2)
    return Estimate(centre, std, (centre - reach, centre + reach)), float(chdtrc(len(values) - 1, scatter))


FEWEST_DELAYS = 3
"""Fewest joints that tell their delay for it to be used for the log's other joints."""


@dataclass(frozen=True)
class SharedDelay:
    """One delay of all joints of a log, which one controller and one bus drive."""

    estimate: Estimate
    """Weighted mean of the joints that tell it [s]."""
    probability: float
    """Probability of so much scatter between these joints by chance."""
    telling: tuple[str, ...]
    """Joints that tell their delay to a sample interval."""
    silent: tuple[str, ...]
    """Joints that do not tell it, or whose estimate is below zero."""

    @property
    def agreed(self) -> bool:
        """True if the joints agree."""
        return self.probability >= CHANCE

    def sentence(self) -> str:
        """Describe the delay of a joint that does not tell its own, or the disagreement of the joints."""
        if self.agreed:
            value, std = 1e3 * max(0.0, self.estimate.value), 1e3 * self.estimate.std
            return (
                f"its motion does not tell how late its loop is: the delay is that of {len(self.telling)} other joints "
                f"of the log together, {value:.2g} ms (± {std:.2g})"
            )
        return (
            f"the delays of {len(self.telling)} joints of the log, {1e3 * self.estimate.value:.2g} ms in the mean, "
            "differ beyond chance: each joint keeps its own"
        )


def share_delay(delays: Mapping[str, Estimate], step: float) -> SharedDelay | None:
    """Return the delay that the joints of a log share; None where fewer than three of them tell it.

    delays: joint -> its estimate [s]; step: sample interval of the log [s].
    """
    telling = tuple(
        name
        for name, delay in delays.items()
        if delay.value >= 0 and delay.interval95[1] - delay.interval95[0] <= 2 * step
    )
    if len(telling) < FEWEST_DELAYS:
        return None
    silent = tuple(name for name in delays if name not in telling)
    return SharedDelay(*agreement([delays[name] for name in telling]), telling, silent)


def compare_runs(runs: Sequence[Run], base: Fit) -> Pooling:
    """Fit each run alone with the equation of the fit to all; take 1/k, which one run need not tell, from that fit."""
    inverse = base.by_name.get(INVERSE_STRENGTH, 1.0)
    alone: list[dict[str, Estimate] | None] = []
    for index in range(len(runs)):
        rows = base.rows.take(base.rows.run == index)
        if INVERSE_STRENGTH in base.names:
            # The known load in the unit of the torque.
            rows = replace(rows, payload=inverse * rows.payload, load=inverse * rows.load)
        if len(rows) < FEWEST_ROWS:
            alone.append(None)
            continue
        fit = fit_rows(rows, base.model)
        clear = max(fit.inflation[name] for name in COMPARED) < MAX_INFLATION
        alone.append({name: fit.estimates()[name] for name in COMPARED} if clear else None)
    return Pooling(tuple(run.source for run in runs), tuple(alone))
