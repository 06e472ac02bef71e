"""When the samples were taken: what the stamps say, how good they are, and the even grid that they are brought onto.

Signals are interpolated by cubic splines, all by the same linear rule, so that a linear relation between them (the
torque of a PD law, say) survives; stairs are held. Long gaps are bridged by straight lines and marked as not valid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from stiction.core.errors import LogError

SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.1
"""Between these lies the step of every log that can be used [s]."""

LARGEST_LOSS = 0.2
"""Share of samples that may be missing, be double or be out of order: beyond, the log is not what it says."""

LONGEST_SETBACK = 20
"""Steps by which a stamp may lag behind the latest one; more is a second log in the file, or a clock that was set."""

LONGEST_BRIDGE = 3
"""Samples missing in a row that interpolation may replace: a reversal takes longer at any rate worth logging at."""

MARGIN = 2
"""Samples on either side of a long gap that are not valid either: what was interpolated there leans on one side."""

EVEN = 1e-3
"""Departure from even stamps, in steps, that no clock's jitter is smaller than."""

STAIRS = 0.2
"""Share of samples that repeat the one before, from which on a command counts as stairs."""

FIRST_STAMPS = 256
"""Stamps with which the search for the step starts."""

NOTABLE_JITTER = 0.02
"""Jitter, in steps, that is worth a warning."""


@dataclass(frozen=True)
class Timing:
    """How good the stamps of a log are."""

    samples: int
    """Samples in the log."""
    rate: float
    """Samples per second [Hz]."""
    jitter: float
    """Standard deviation of the interval between samples that follow each other, in steps [1]."""
    duplicated: int
    """Samples whose stamp another one had already; they were left out."""
    disordered: int
    """Samples older than one before them; they were put in order."""
    dropped: int
    """Samples that are missing in between."""
    longest_gap: float
    """Longest time between two samples [s]."""
    synthetic: bool
    """The stamps are exactly even: jitter, if there was any, cannot be seen."""

    def warnings(self) -> tuple[str, ...]:
        """Return what went wrong with the stamps and what was done, one sentence each."""
        found = []
        step = 1 / self.rate
        if self.jitter > NOTABLE_JITTER:
            found.append(
                f"the time stamps jitter by {self.jitter:.1%} of a step: the signals were interpolated to even times, "
                "which is right if the stamps say when the samples were taken, and adds noise if they say when they "
                "arrived"
            )
        if self.duplicated:
            found.append(f"{self.duplicated} samples have the time stamp of another one and were left out")
        if self.disordered:
            found.append(f"{self.disordered} samples came out of order and were put in order by their time stamps")
        if self.dropped:
            found.append(
                f"{self.dropped} samples of {self.samples + self.dropped} are missing, the longest gap takes "
                f"{self.longest_gap:.4g} s: up to {LONGEST_BRIDGE} in a row were interpolated"
                + (", longer gaps are not used" if self.longest_gap > (LONGEST_BRIDGE + 1.5) * step else "")
            )
        return tuple(found)


@dataclass(frozen=True)
class Grid:
    """Even times, and where the samples that were kept lie among them."""

    step: float
    """Time between points of the grid [s]."""
    times: np.ndarray
    """The grid, from zero [s], shape (num_points,)."""
    order: np.ndarray
    """Indices of the log's samples that count, in the order of their stamps, shape (num_kept,)."""
    stamps: np.ndarray
    """Their stamps, from zero [s], shape (num_kept,)."""
    valid: np.ndarray
    """False in a long gap and beside it, shape (num_points,)."""
    on_grid: bool
    """The samples lie on the points of the grid, so that nothing needs to be interpolated."""


def even_grid(source: str, time: np.ndarray) -> tuple[Grid, Timing]:
    """Return the even grid for stamps [s], shape (num_samples,), and how good they are.

    source: the log's name, for messages. Raises `LogError` for stamps that are not in seconds, run backwards at large,
    or of which more than a fifth is missing or double.
    """
    # Put the stamps in order, and refuse what is no clock.
    samples = len(time)
    setbacks = np.maximum.accumulate(time) - time
    order = np.argsort(time, kind="stable")
    # Of samples with one stamp the first in the file stays, for the sort is stable.
    fresh = np.concatenate(([True], np.diff(time[order]) > 0))
    order = order[fresh]
    duplicated, disordered = samples - len(order), int(np.count_nonzero(setbacks > 0))
    stamps = time[order] - time[order[0]]
    # Before equal stamps: those of a second log, or of a clock that was set, may be the ones of the first again.
    if disordered:
        _refuse_backwards(source, setbacks, disordered, float(np.median(np.diff(stamps))))
    if duplicated > LARGEST_LOSS * samples:
        raise LogError(
            f"{source}: time stands still: {duplicated} of {samples} samples have the stamp of another one; log stamps "
            "with more digits, or give the rate instead (--rate)"
        )
    step = _middle_step(source, stamps)
    if np.diff(stamps).max() < 1.5 * step and np.diff(stamps).min() > 0.5 * step:
        # No interval is long enough for a missing sample: a clock that alternates between 10 and 12 ms has none.
        points = len(stamps) - 1
        step = float(stamps[-1] / points)
    else:
        step, points = _refined(stamps, step)
    dropped = max(0, points + 1 - len(order))
    if dropped > LARGEST_LOSS * points:
        raise LogError(
            f"{source}: {dropped} of {points + 1} samples are missing at one every {step:.4g} s; expected at most "
            f"{LARGEST_LOSS:.0%}: cut the log to a part without gaps, or log at an even rate"
        )
    # Say how good the stamps are.
    times = np.arange(points + 1) * step
    intervals = np.diff(stamps)
    near = (intervals if dropped == 0 else intervals[intervals < 1.5 * step]) / step
    off = np.abs(stamps - step * np.rint(stamps / step)) / step
    # Stamps may have been stored as 32-bit floats: what that rounds off is no jitter.
    resolution = 4 * np.finfo(np.float32).eps * float(np.abs(time).max()) / step
    even = bool(off.max() <= max(EVEN, min(resolution, 0.01)) or _rounded(stamps, step))
    timing = Timing(
        samples=samples,
        rate=1 / step,
        jitter=0.0 if even or len(near) < 2 else float(np.std(near)),
        duplicated=duplicated,
        disordered=disordered,
        dropped=dropped,
        longest_gap=float(intervals.max()),
        synthetic=even,
    )
    return Grid(step, times, order, stamps, _valid(times, stamps, step), even), timing


def stands_still(time: np.ndarray) -> bool:
    """Return whether stamps, shape (num_samples,), do not run backwards, and more than may be lost are equal."""
    steps = np.diff(time)
    return bool(np.all(steps >= 0) and np.count_nonzero(steps == 0) > LARGEST_LOSS * len(time))


def _refuse_backwards(source: str, setbacks: np.ndarray, disordered: int, step: float) -> None:
    """Refuse stamps that are more than a little out of order."""
    far = np.flatnonzero(setbacks > LONGEST_SETBACK * step)
    if len(far) or disordered > LARGEST_LOSS * len(setbacks):
        place = int(far[0] if len(far) else np.flatnonzero(setbacks > 0)[0])
        raise LogError(
            f"{source}: time runs backwards at sample {place + 1}, by {setbacks[place]:.4g} s: are there several logs "
            "in one file? Cut them apart"
        )


def _middle_step(source: str, stamps: np.ndarray) -> float:
    """Return the median interval [s]; refuse what is not in seconds."""
    step = float(np.median(np.diff(stamps)))
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        raise LogError(
            f"{source}: one sample every {step:.3g} s; expected {SHORTEST_STEP:g} s to {LONGEST_STEP:g} s: are the "
            "stamps in seconds? --time-scale 1e-3 where they are ms; where they count samples, 1 over the rate"
        )
    return step


def _refined(stamps: np.ndarray, step: float) -> tuple[float, int]:
    """Return the step [s] and the number of steps in the log, from the median interval, which jitter makes uncertain.

    The step is the period at which |Σ exp(2πi t/step)| is largest, sought in the first stamps around the median, then
    more and more finely in twice as many. Counting intervals would add up the errors of jitter and missing samples.
    """
    length = min(FIRST_STAMPS, len(stamps))
    # Neighbours drift apart by a quarter of a step over the stretch, so that no peak falls between two of them.
    candidates = step * np.arange(0.65, 1.35, 0.25 / length)
    while True:
        angles = 2 * np.pi * stamps[:length] / candidates[:, None]
        step = float(candidates[np.argmax(np.abs(np.exp(1j * angles).mean(axis=1)))])
        if length == len(stamps):
            break
        length = min(2 * length, len(stamps))
        candidates = step * (1 + np.arange(-4, 5) / (8 * length))
    # The first stamp jitters like all others, so the grid's phase is taken from all of them.
    phase = float(np.angle(np.exp(2j * np.pi * stamps / step).mean())) / (2 * np.pi)
    index = np.rint(np.minimum(stamps / step, 1e15) - phase)
    points = max(1, int(index[-1] - index[0]))
    return float(stamps[-1] / points), points


def _rounded(stamps: np.ndarray, step: float) -> bool:
    """Return whether even stamps were rounded to a coarser unit: few different intervals, and no drift from even.

    At 400 Hz in whole milliseconds the intervals are 2 and 3 ms, but the samples were taken every 2.5 ms.
    """
    intervals = np.unique(np.round(np.diff(stamps), 9))
    spread = float(np.ptp(intervals))
    if not 2 <= len(intervals) <= 3 or spread > step:
        return False
    residual = stamps - step * np.arange(len(stamps))
    return bool(np.ptp(residual) <= 1.05 * spread)


def _valid(times: np.ndarray, stamps: np.ndarray, step: float) -> np.ndarray:
    """Return False for the points of the grid in a long gap, or within `MARGIN` points of one."""
    valid = np.ones(len(times), dtype=bool)
    # So many missing samples make an interval of one step more; the half step is for jitter.
    for place in np.flatnonzero(np.diff(stamps) > (LONGEST_BRIDGE + 1.5) * step):
        first = np.searchsorted(times, stamps[place] - (MARGIN - 0.5) * step)
        last = np.searchsorted(times, stamps[place + 1] + (MARGIN - 0.5) * step)
        valid[first:last] = False
    return valid


def resample(grid: Grid, values: np.ndarray, command: bool = False) -> np.ndarray:
    """Return a signal on the grid, shape (num_points,): by cubic splines, and by straight lines over long gaps.

    values: the signal at all samples of the log, shape (num_samples,); command: if it is held between changes, hold it.
    """
    order = values[grid.order]
    if grid.on_grid and len(order) == len(grid.times):
        return order.copy()
    if command and is_stairs(order):
        # A hair late, or rounding would keep a command that came at a point of the grid for the next one.
        place = np.searchsorted(grid.stamps, grid.times + EVEN * grid.step, side="right") - 1
        return order[np.clip(place, 0, len(order) - 1)]
    result = np.interp(grid.times, grid.stamps, order)
    breaks = np.flatnonzero(np.diff(grid.stamps) > (LONGEST_BRIDGE + 1.5) * grid.step) + 1
    for part in np.split(np.arange(len(order)), breaks):
        # A cubic needs four points; the straight lines stand.
        if len(part) < 4:
            continue
        inside = (grid.times >= grid.stamps[part[0]]) & (grid.times <= grid.stamps[part[-1]])
        spline = make_interp_spline(grid.stamps[part], order[part], k=3)
        result[inside] = spline(grid.times[inside])
    return result


def is_stairs(values: np.ndarray) -> bool:
    """Return whether a signal, shape (num_samples,), is held between changes, as a command is that comes slowly."""
    return bool(np.mean(np.diff(values) == 0) > STAIRS)


MOST_LOST = 0.5
"""Share of the samples that may be given up to let the joint settle; beyond, the shortest gaps are not waited for."""


def near(bridged: np.ndarray, reach: int) -> np.ndarray:
    """Return True for samples in a gap or within `reach` samples of one; all of shape (num_samples,)."""
    return np.convolve(bridged, np.ones(2 * reach + 1), "full")[reach : reach + len(bridged)] > 0.5


def settling(bridged: np.ndarray, moving: np.ndarray, wait: int) -> np.ndarray:
    """Return True for samples after a gap up to the one by which the joint was in motion for `wait` samples.

    A simulation leaves the gap elsewhere than the joint did; in motion the difference decays, at rest friction
    preserves it. bridged: in a gap; moving: not at rest, shape (num_samples,) each.
    """
    found = np.zeros(len(bridged), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], bridged.astype(int), [0]))))
    moved = np.concatenate(([0], np.cumsum(moving)))
    # The longest first: there the simulation is furthest off.
    for _, end in sorted(edges.reshape(-1, 2).tolist(), key=lambda gap: gap[0] - gap[1]):
        settled = int(np.searchsorted(moved, moved[end] + wait))
        more = found.copy()
        more[end:settled] = True
        if (more & ~bridged).sum() <= MOST_LOST * (~bridged).sum():
            found = more
    return found & ~bridged
