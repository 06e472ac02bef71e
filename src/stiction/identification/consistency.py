"""Consistency of a fit: halves of the log, its slow and fast parts, repeats, drift, timing, whiteness of the residual.

Each part is fitted by itself with viscous and Coulomb friction. Where the parts disagree beyond their intervals the
law lacks something, and the intervals, which know scatter only, are widened until they admit both. Two descriptions of
a log are compared by the `Gain` of the held-out error, and by the information criterion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from stiction.files.joints import Estimate
from stiction.identification.intervals import correlation_time
from stiction.identification.prepare import Prepared, Rows
from stiction.identification.regression import FEWEST_ROWS, INVERSE_STRENGTH, Fit, fit_rows, fit_with_column

COMPARED = ("inertia", "viscous_friction", "coulomb_friction")
"""Parameters that are compared between parts."""

LARGEST_SIGMAS = 3.0
"""Combined standard deviations above which parts disagree; one comparison in four hundred is beyond by chance."""

SMALLEST_GAP = 0.02
"""Gap of two parts, over the mean of both, below which a disagreement is not reported."""

REPEAT = "repeat"
"""Beginning of the label of a comparison with another log of the joint."""

MAX_SHIFT = 1.5
"""Largest shift of torque in time [samples]: more means that the friction law is wrong, not the timing."""

TIMING = "timing"
"""Label of a comparison with a log whose torque may be late or early."""

STRETCHES = 16
"""Number of stretches of a log, each of which counts as slow or as fast."""

LAGS = 10
"""Number of lags of the whiteness test."""

LARGEST_TIE = 0.3
"""Correlation of speed and time beyond which friction that changes with the one cannot be told from the other."""


@dataclass(frozen=True)
class Comparison:
    """Two fits of the same joint."""

    label: str
    """Kind of comparison: `halves`, `slow and fast`, or the name of another run."""
    parts: tuple[str, str]
    """Names of the two parts."""
    values: dict[str, tuple[Estimate, Estimate]]
    """Estimates of both parts, by parameter."""
    speed: float
    """Speed that both parts reached [rad/s]."""
    friction: tuple[Estimate, Estimate]
    """Friction B θ' + b_c at that speed, of each part [N m]."""
    alternative: bool = False
    """True if the second is another way to read the same log, rather than a part of it."""

    def sigmas(self, name: str) -> float:
        """Return the gap of a parameter in combined standard deviations."""
        first, second = self.values[name]
        return abs(first.value - second.value) / max(float(np.hypot(first.std, second.std)), 1e-300)

    @property
    def disputed(self) -> tuple[str, ...]:
        """Parameters whose gap is beyond chance and, between parts of a log, large enough to matter.

        An alternative reading of the whole log is right about all parameters or none: if one is disputed, all are.
        """
        least = 0.0 if self.alternative else SMALLEST_GAP
        names = tuple(
            name
            for name, (first, second) in self.values.items()
            if self.sigmas(name) > LARGEST_SIGMAS
            and abs(first.value - second.value) > least * abs(first.value + second.value) / 2
        )
        return tuple(self.values) if names and self.alternative else names

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        sigmas = {name: self.sigmas(name) for name in self.values}
        repeat = self.label.startswith(REPEAT)
        return asdict(self) | {"sigmas": sigmas, "disputed": list(self.disputed), "repeat": repeat}


@dataclass(frozen=True)
class Split:
    """A way to cut a log in two."""

    label: str
    """Difference between the parts."""
    parts: tuple[str, str]
    """Names of the parts."""
    first: np.ndarray
    """Mask of the first part, shape as of the times that were split."""


def splits(time: np.ndarray, velocity: np.ndarray) -> tuple[Split, Split]:
    """Cut a log into halves in time, and into its slow and its fast stretches; arrays of one shape."""
    half = time < (time[0] + time[-1]) / 2
    share = (time - time[0]) / max(float(time[-1] - time[0]), 1e-300)
    # Whole stretches and not single samples: all fast motion passes through zero speed, and a slow part of reversals
    # alone would tell nothing.
    stretch = np.minimum((share * STRETCHES).astype(int), STRETCHES - 1)
    size = np.maximum(np.bincount(stretch, minlength=STRETCHES), 1)
    typical = np.sqrt(np.bincount(stretch, velocity**2, STRETCHES) / size)[stretch]
    return (
        Split("halves", ("first half", "second half"), half),
        Split("slow and fast", ("slow part", "fast part"), typical <= np.median(typical)),
    )


def compare_parts(rows: Rows, fit: Fit) -> tuple[Comparison, ...]:
    """Compare the parts of a log, each fitted alone; omit a pair where a part has too few rows."""
    comparisons = []
    for split in splits(rows.time, rows.velocity):
        if min(split.first.sum(), (~split.first).sum()) >= FEWEST_ROWS:
            comparisons.append(compare(split.label, split.parts, rows.take(split.first), rows.take(~split.first), fit))
    return tuple(comparisons)


def compare(label: str, parts: tuple[str, str], first: Rows, second: Rows, fit: Fit) -> Comparison:
    """Compare fits to two sets of rows, each with the equation of `fit`.

    Where 1/k is unknown both take that of `fit`: the rows of a run without payload do not tell it.
    """
    inverse = fit.by_name.get(INVERSE_STRENGTH, 1.0)
    parted = [replace(rows, payload=inverse * rows.payload, load=inverse * rows.load) for rows in (first, second)]
    fits = [fit_rows(rows, fit.model) for rows in parted]
    both = [fitted.estimates() for fitted in fits]
    values = {name: (both[0][name], both[1][name]) for name in COMPARED}
    speed = common_speed(first.velocity, second.velocity)
    return Comparison(label, parts, values, speed, (friction_at(fits[0], speed), friction_at(fits[1], speed)))


def common_speed(first: np.ndarray, second: np.ndarray) -> float:
    """Return a speed that both velocities reach, most of the slower one's range."""
    return min(float(np.quantile(np.abs(velocity), 0.9)) for velocity in (first, second))


def friction_at(fit: Fit, speed: float) -> Estimate:
    """Return B θ' + b_c of a symmetric fit at a speed [rad/s], with its interval [N m]."""
    return fit.combination({"viscous_friction": speed, "coulomb_friction": 1.0}, "coulomb_friction")


@dataclass(frozen=True)
class Drift:
    """Change of friction from start to end of the log, as of a joint that warms up."""

    change: Estimate | None
    """Change of all friction over its mean [1]; None where the log cannot tell."""
    reason: str | None
    """Reason why the log cannot tell, else None."""


def find_drift(rows: Rows, fit: Fit) -> Drift:
    """Fit a friction that changes steadily over the log: one more column, friction times the time from the middle."""
    late = (rows.time - rows.time[0]) / float(rows.time[-1] - rows.time[0]) - 0.5
    tied = abs(float(np.corrcoef(late, np.abs(rows.velocity))[0, 1]))
    if tied > LARGEST_TIE:
        return Drift(
            None, f"the motion itself changes over the log (speed follows time with a correlation of {tied:.2f})"
        )
    values = fit.by_name
    friction = values["viscous_friction"] * rows.velocity + values["coulomb_friction"] * rows.direction
    return Drift(fit_with_column(fit, "drift", late * friction).scatter()["drift"], None)


@dataclass(frozen=True)
class Whiteness:
    """Memory of the residual."""

    correlation_time: float
    """Correlation time [rows], 1 for white noise."""
    first_lag: float
    """Correlation of neighbouring rows [1]."""
    probability: float
    """Probability that white noise has so large a portmanteau statistic (Ljung and Box, 10 lags); near 0: not white."""


def whiteness(residual: np.ndarray) -> Whiteness:
    """Test a residual, shape (num_rows,), for memory."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    if power <= 0:
        return Whiteness(1.0, 0.0, 1.0)
    count = len(centred)
    lags = np.arange(1, LAGS + 1)
    correlations = np.array([float(centred[lag:] @ centred[:-lag]) / power for lag in lags])
    statistic = count * (count + 2) * float(np.sum(correlations**2 / (count - lags)))
    return Whiteness(correlation_time(residual), float(correlations[0]), float(chdtrc(LAGS, statistic)))


def widened(estimates: dict[str, Estimate], comparisons: tuple[Comparison, ...]) -> dict[str, Estimate]:
    """Return the estimates with intervals widened to admit the values of disputing parts of the log.

    For an alternative reading of the whole log the interval is admitted, not the value alone.
    """
    result = dict(estimates)
    for comparison in comparisons:
        for name in comparison.disputed:
            old, values = result[name], [part.value for part in comparison.values[name]]
            reached = comparison.values[name][1].interval95 if comparison.alternative else tuple(values)
            ends = (min(old.interval95[0], *reached), max(old.interval95[1], *reached))
            result[name] = Estimate(old.value, max(old.std, abs(values[0] - values[1]) / 2), ends)
    return result


def compare_timing(prepared: Prepared, base: Fit) -> Comparison | None:
    """Compare a fit with one whose torque may be early or late; None where the shift is larger than clocks make.

    base: fitted to the rows of `prepared`. What acts in a sampled controller is the logged torque of half an update
    before, and B is off by what kp and the inertia make of that time. The other fit has one more column, the torque's
    rate, times the time by which the torque is logged early. That column is noisy, so neither fit is the better one.
    """
    rate = np.gradient(prepared.torque - prepared.outside, prepared.step)[prepared.used]
    plain, other = base.estimates(), fit_with_column(base, "early", rate).scatter()
    early = other["early"].value
    if abs(early) > MAX_SHIFT * prepared.step:
        return None
    parts = ("as logged", f"torque {1e3 * early:.2g} ms later")
    values = {name: (plain[name], other[name]) for name in COMPARED}
    speed = float(np.quantile(np.abs(base.rows.velocity), 0.9))
    moved = replace(base, values=np.array([other[name].value for name in base.names]))
    return Comparison(TIMING, parts, values, speed, (friction_at(base, speed), friction_at(moved, speed)), True)


DEVIATIONS = 2.0
"""Standard deviations by which the held-out error must fall for a richer law."""

MIN_GAIN = 0.02
"""Share by which the held-out error must fall for one more parameter to be worth it."""

MIN_EVIDENCE = 6.0
"""Drop of the information criterion for a richer law; 6 is called strong."""


@dataclass(frozen=True)
class Gain:
    """Reduction of a held-out squared error, as a share, with the deviation from the scatter of the blocks."""

    mean: float
    """Reduction, as a share [1]."""
    std: float
    """Standard deviation of the reduction [1]."""

    @property
    def certain(self) -> bool:
        """True if the reduction is beyond noise and worth a parameter."""
        return self.mean > DEVIATIONS * self.std and self.mean > MIN_GAIN


def gain_of(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors block by block; shape (num_blocks,) each."""
    shares = (reference - error) * len(error) / max(float(reference.sum()), 1e-300)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


def gain_by_block(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors as a share of each block's error, where single blocks hold most of all error.

    error, reference: shape (num_blocks,) each; no block counts for more than it all.
    """
    shares = np.clip(1.0 - error / reference.clip(1e-300), -1.0, 1.0)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


def evidence_of(plain: Sequence[np.ndarray], rich: Sequence[np.ndarray], more: int) -> float:
    """Return the decrease of the Bayesian information criterion from a law to a richer one.

    plain, rich: residuals by either law of every signal, in the same order, shape (num_samples,) each, of the samples
    that count alone; more: the richer law's further parameters. Σ n ln(Σ r₀² / Σ r₁²) − more ln Σ n over the signals,
    where n counts independent samples, by the residual with the longer memory.
    """
    total, samples = 0.0, 0.0
    for before, after in zip(plain, rich, strict=True):
        independent = len(before) / max(correlation_time(before), correlation_time(after))
        total += independent * float(np.log(np.sum(before**2) / max(float(np.sum(after**2)), 1e-300)))
        samples += independent
    return total - more * float(np.log(samples))
