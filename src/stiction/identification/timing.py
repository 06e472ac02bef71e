"""Times of the samples: quality of the stamps, and the even grid that signals are brought onto.

Signals are interpolated by cubic splines, all by the same linear rule, so that a linear relation between them (the
torque of a PD law, say) survives; stairs are held. Long gaps are bridged by straight lines and marked as not valid.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stiction.core.errors import LogError

SHORTEST_STEP, LONGEST_STEP = 1e-5, 0.1
"""Least and largest step of a usable log [s]."""

LARGEST_LOSS = 0.2
"""Share of samples that may be missing or double: beyond, the stamps are uneven, or stand still."""

LONGEST_SETBACK = 20
"""Most steps by which a stamp may lag behind the one before; more is a second run in the file, or a clock reset."""

PAUSE = 1.0
"""Longest gap that keeps its length on the grid [s]."""

FEWEST_COARSE = 10
"""Fewest doubled stamps, and different ones, for a line through them to tell coarse stamps from doubles."""

MOST_POINTS = 20
"""Mean interval over the median one above which rows came in bursts, and most points of the grid for each sample."""

FEWEST_PER_CYCLE = 20
"""Samples per period of the fastest motion; with fewer, derivatives are guesses."""

LONGEST_BRIDGE, MARGIN = 3, 2
"""Samples missing in a row that interpolation may replace, and samples next to a longer gap that are not valid: a
reversal takes longer at any rate worth logging at, and values interpolated beside a gap lean on one side. Uneven
stamps are judged by the period of the motion instead."""

EVEN = 1e-3
"""Departure from even stamps, in steps, up to which they are exactly even: the jitter of any clock is larger."""


@dataclass(frozen=True)
class Timing:
    """Quality of the time stamps of a log."""

    samples: int
    """Number of samples in the log."""
    rate: float
    """Samples per second [Hz]."""
    jitter: float
    """Standard deviation of the interval between samples that follow each other, in steps [1]."""
    duplicated: int
    """Number of samples that were left out because another one has their stamp."""
    disordered: int
    """Number of samples older than one before them; they were put in order."""
    dropped: int
    """Number of missing samples."""
    longest_gap: float
    """Longest time between two samples [s]."""
    synthetic: bool
    """True if the stamps are exactly even: jitter, if any, cannot be seen."""
    notes: tuple[str, ...] = ()
    """Further facts about the stamps and their treatment, one sentence each."""

    def warnings(self) -> tuple[str, ...]:
        """Return the defects of the stamps and their treatment, one sentence each."""
        sentences = list(self.notes)
        step = 1 / self.rate
        if self.jitter > 0.02:
            sentences.append(
                f"the time stamps jitter by {self.jitter:.1%} of a step: the signals were interpolated to even times, "
                "which is right if the stamps say when the samples were taken, and adds noise if they say when they "
                "arrived"
            )
        if self.duplicated:
            sentences.append(f"{self.duplicated} samples have the time stamp of another one and were left out")
        if self.disordered:
            sentences.append(f"{self.disordered} samples came out of order and were put in order by their time stamps")
        if self.dropped:
            sentences.append(
                f"{self.dropped} samples of {self.samples + self.dropped} are missing, the longest gap takes "
                f"{self.longest_gap:.4g} s: up to {LONGEST_BRIDGE} in a row were interpolated"
                + (", longer gaps are not used" if self.longest_gap > (LONGEST_BRIDGE + 1.5) * step else "")
            )
        return tuple(sentences)


@dataclass(frozen=True)
class Grid:
    """Even times, and the places of the log's samples among them."""

    step: float
    """Time between points of the grid [s]."""
    times: np.ndarray
    """Times of the grid, from zero [s], shape (num_points,)."""
    order: np.ndarray
    """Indices of the log's samples that count, in the order of their stamps, shape (num_counted,)."""
    stamps: np.ndarray
    """Stamps of these samples, from zero [s], shape (num_counted,)."""
    valid: np.ndarray
    """False in a long gap and next to it, shape (num_points,)."""
    on_grid: bool
    """True if the samples lie on the points of the grid, so that nothing needs to be interpolated."""
    bridge: float
    """Longest interval over which signals are interpolated [s]; longer ones are gaps."""


def even_grid(source: str, time: np.ndarray, motion: np.ndarray | None = None) -> tuple[Grid, Timing]:
    """Return the even grid for stamps [s], shape (num_samples,), and the quality of the stamps.

    source: the log's name, for messages; motion: the position, shape (num_samples,), whose period bounds the steps of
    uneven stamps. Raises `LogError` for stamps that are not in seconds, that stand still, or that come in bursts.
    """
    samples = len(time)
    order, stamps, disordered, ordered = _in_order(source, time)
    order, stamps, step, spaced = _spaced(source, order, stamps)
    # A pause shows nothing, however long it is.
    intervals, notes = np.diff(stamps), ordered + spaced
    pauses = np.flatnonzero(intervals > 0.999 * PAUSE)
    if len(pauses):
        first, count = pauses[0], "once" if len(pauses) == 1 else f"{len(pauses)} times, first"
        notes += (
            f"the log pauses {count} for {intervals[first]:.4g} s, at {stamps[first]:.4g} s: the parts before and "
            "after are used as runs, and nothing between them",
        )
        stamps = np.concatenate(([0.0], np.cumsum(np.where(intervals > PAUSE, PAUSE, intervals))))
        intervals = np.diff(stamps)
    longest = float(np.delete(intervals, pauses).max(initial=step))
    step, points, dropped, uneven = _fitted(intervals, stamps, step)
    dropped = max(0, dropped - len(pauses) * (round(PAUSE / step) - 1))
    if points > MOST_POINTS * samples + 10**6:
        raise LogError(f"{source}: {len(pauses)} pauses in {samples} samples; cut the log to a part without pauses")
    times = np.arange(points + 1) * step
    if motion is not None and (straight := _arrived(stamps, step, motion[order])) is not None:
        notes += (
            f"the time stamps stray by {float(np.std(stamps - straight)) / step:.1%} of a step from even ones, at "
            "which the position is smoother: they are rounded, or say when samples arrived, and even ones were used",
        )
        stamps, intervals, uneven = straight, np.diff(straight), False
    bridge = (LONGEST_BRIDGE + 1.5) * step
    if uneven:
        fastest = None if motion is None else fastest_motion(np.interp(times, stamps, motion[order]), step)
        if fastest is not None:
            bridge = max(bridge, 1 / (FEWEST_PER_CYCLE * fastest))
        near = intervals[intervals <= bridge]
        notes += (
            f"the time stamps are uneven, {near.min():.3g} to {near.max():.3g} s apart: the signals were interpolated "
            f"to one sample every {step:.3g} s"
            + (f"; {len(intervals) - len(near)} longer gaps are not used" if len(near) < len(intervals) else ""),
        )
    # Say how good the stamps are.
    near = (intervals if dropped == 0 else intervals[intervals < 1.5 * step]) / step
    off = np.abs(stamps - step * np.rint(stamps / step)) / step
    # Stamps may have been stored as 32-bit floats: what that rounds off is no jitter.
    resolution = 4 * np.finfo(np.float32).eps * float(np.abs(time).max()) / step
    even = bool(off.max() <= max(EVEN, min(resolution, 0.01)) or _rounded(stamps, step))
    timing = Timing(
        samples=samples,
        rate=1 / step,
        jitter=0.0 if even or uneven or len(near) < 2 else float(np.std(near)),
        duplicated=samples - len(order),
        disordered=disordered,
        dropped=dropped,
        longest_gap=longest,
        synthetic=even,
        notes=notes,
    )
    return Grid(step, times, order, stamps, _valid(times, stamps, step, bridge), even, bridge), timing


def _fitted(intervals: np.ndarray, stamps: np.ndarray, step: float) -> tuple[float, int, int, bool]:
    """Return the step [s], the number of steps, the number of missing samples, and True if the stamps are uneven.

    intervals: between `stamps`; step: their median [s].
    """
    if intervals.max() < 1.5 * step and intervals.min() > 0.5 * step:
        # No interval is long enough for a missing sample: a clock that alternates between 10 and 12 ms has none.
        return float(stamps[-1]) / len(intervals), len(intervals), 0, False
    usual = float(intervals[intervals <= LONGEST_SETBACK * step].mean())
    step, points, coherence = _refined(stamps, step)
    near = intervals[intervals <= (LONGEST_BRIDGE + 1.5) * step]
    # Jitter of a fifth of a step leaves a coherence of 0.45.
    if coherence >= 0.3 and float(np.sum(near / step - 1)) <= LARGEST_LOSS * float(near.sum()) / step:
        return step, points, max(0, points - len(intervals)), False
    # Stamps without a common step, or with so many missing that one is no use: the mean step.
    points = max(1, round(float(stamps[-1]) / usual))
    return float(stamps[-1]) / points, points, 0, True


def fastest_motion(position: np.ndarray, step: float) -> float | None:
    """Return the frequency below which 95 % of the velocity's energy lies [Hz]; None where there is no motion.

    position: shape (num_samples,), with noise, which is taken for white; step [s].
    """
    power = np.abs(np.fft.rfft((position - position.mean()) * np.hanning(len(position)))) ** 2
    noise = np.median(power[len(power) // 2 :]) / np.log(2)
    frequencies = np.fft.rfftfreq(len(position), step)
    share = np.cumsum(np.maximum(power - 4 * noise, 0.0) * frequencies**2)
    return float(frequencies[np.searchsorted(share, 0.95 * share[-1])]) if share[-1] > 0 else None


def _in_order(source: str, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, int, tuple[str, ...]]:
    """Return samples in the order of their stamps, the stamps from zero [s], the number of misplaced ones, and notes.

    A file with its newest row first is turned round. Parts whose clock begins again follow one another, with a pause
    between them.
    """
    samples, order = len(time), np.arange(len(time))
    notes: tuple[str, ...] = ()
    # A stamp that is far from those beside it, which are near each other, is damaged.
    far = LONGEST_SETBACK * float(np.median(np.abs(np.diff(time)))) if samples > 1 else 0.0
    if (stray := stands_out(time, far, far)).any():
        order = order[~stray]
        notes = (f"{samples - len(order)} samples have a stamp far from those before and after, and were left out",)
        samples = len(order)
    if np.count_nonzero(np.diff(time[order]) < 0) > 0.9 * samples:
        order, notes = order[::-1], (*notes, "the file has its newest row first: it was turned round")
    stamps = time[order]
    disordered = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    steps = np.diff(stamps)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    parts = np.split(np.arange(samples), np.flatnonzero(steps < -LONGEST_SETBACK * usual) + 1)
    if len(parts) > 1:
        place = len(parts[0])
        # Of more runs, or shorter ones, rows are mixed.
        if len(parts) > 50 or min(map(len, parts)) < 20:
            raise LogError(
                f"{source}: time runs backwards {len(parts) - 1} times, first at sample {place + 1}, by "
                f"{stamps[place - 1] - stamps[place]:.4g} s: rows of several logs or clocks are mixed; keep those of "
                "one in the file, or sort them by a column that counts them"
            )
        spans = sorted((stamps[part].min(), stamps[part].max()) for part in parts)
        if all(begin > end for (_, end), (begin, _) in pairwise(spans)):
            disordered = 0
            notes += (f"its {len(parts)} parts lay in the file in another order, and were put in order",)
        else:
            # Runs by one clock that began again: behind each other, as they lie in the file.
            disordered = int(
                sum(np.count_nonzero(np.diff(np.argsort(stamps[part], kind="stable")) < 0) for part in parts)
            )
            end = stamps[parts[0]].min() - PAUSE
            for part in parts:
                stamps[part] += end + PAUSE - stamps[part].min()
                end = stamps[part].max()
            notes += (
                f"the clock begins again at sample {place + 1}: the {len(parts)} parts were taken for runs of one "
                "joint, one after the other; if they are not, cut the file there",
            )
    elif disordered > LARGEST_LOSS * samples and not (np.diff(np.sort(stamps)) > 0).all():
        raise LogError(
            f"{source}: time runs backwards at {disordered} of {samples} samples, and stamps come twice: rows of "
            "several logs or clocks are mixed; keep those of one in the file"
        )
    sort = np.argsort(stamps, kind="stable")
    return order[sort], stamps[sort] - stamps[sort[0]], disordered, notes


def stands_out(values: np.ndarray, far: float, near: float) -> np.ndarray:
    """Return True for values, shape (num_samples,), that lie `far` from those on either side, which lie `near`."""
    before, after = np.diff(values)[:-1], np.diff(values)[1:]
    alone = (np.minimum(np.abs(before), np.abs(after)) > far) & (np.abs(before + after) <= near)
    return np.concatenate(([False], alone, [False]))[: len(values)]


def _spaced(
    source: str, order: np.ndarray, stamps: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, tuple[str, ...]]:
    """Return one sample a stamp, the first in the file, their stamps, and the median interval [s].

    Raises `LogError` where time stands still, is not in seconds, or comes in bursts. A note reports stamps that are
    merely coarse.
    """
    fresh = np.concatenate(([True], np.diff(stamps) > 0))
    doubled = int(np.count_nonzero(~fresh))
    notes: tuple[str, ...] = ()
    # Even samples under rounded stamps stay within one unit of a straight line.
    unit, count = float(np.diff(stamps[fresh]).min(initial=np.inf)), np.arange(len(stamps))
    slope = float(np.polyfit(count, stamps, 1)[0]) if doubled >= FEWEST_COARSE < fresh.sum() else 0.0
    if slope > 0 and np.ptp(stamps - slope * count) <= 1.05 * unit:
        notes = (f"{doubled} samples share a time stamp, rounded to {unit:.3g} s: they were taken {slope:.4g} s apart",)
        stamps = slope * count
    elif doubled > LARGEST_LOSS * len(stamps):
        raise LogError(
            f"{source}: time stands still: {doubled} of {len(stamps)} samples have the stamp of another one; log "
            "stamps with more digits, or give the rate instead (--rate)"
        )
    else:
        order, stamps = order[fresh], stamps[fresh]
    intervals = np.diff(stamps)
    step, within = float(np.median(intervals)), intervals[intervals < PAUSE]
    if len(within) and within.mean() > MOST_POINTS * step and within.mean() < LONGEST_STEP:
        raise LogError(
            f"{source}: the time stamps come in bursts, {step:.3g} s apart within one and up to {within.max():.3g} s "
            "between them: they say when rows arrived; write the sensor's own stamps into the time column, or take "
            "that column out and give --rate"
        )
    if not SHORTEST_STEP <= step <= LONGEST_STEP:
        raise LogError(
            f"{source}: one sample every {step:.3g} s; expected {SHORTEST_STEP:g} s to {LONGEST_STEP:g} s: are the "
            "stamps in seconds? --time-scale 1e-3 where they are ms; where they count samples, 1 over the rate"
        )
    return order, stamps, step, notes


def _arrived(stamps: np.ndarray, step: float, position: np.ndarray) -> np.ndarray | None:
    """Return even stamps for jittering ones that give the samples' arrival; None where they are right as they are.

    A position that was read at even times is smooth there, and as rough as its speed times the jitter at any other.
    """
    index = np.rint(stamps / step)
    if abs(len(stamps) - 1 - stamps[-1] / step) < 2:
        index = np.arange(len(stamps))
    strays = np.ptp(stamps - index * step) > 5 * step
    if len(stamps) < FEWEST_COARSE or strays or (np.diff(index) < 1).any():
        return None

    def roughness(times: np.ndarray) -> float:
        # The third derivative by divided differences.
        third = position
        for order in (1, 2, 3):
            third = order * np.diff(third) / (times[order:] - times[:-order])
        return float(np.median(np.abs(third)))

    return index * step if roughness(index * step) < 0.5 * roughness(stamps) else None


def stands_still(time: np.ndarray) -> bool:
    """Return True if stamps, shape (num_samples,), do not run backwards, and more than may be lost are equal."""
    steps = np.diff(time)
    return bool(np.all(steps >= 0) and np.count_nonzero(steps == 0) > LARGEST_LOSS * len(time))


def _refined(stamps: np.ndarray, step: float) -> tuple[float, int, float]:
    """Return the step [s], the number of steps in the log, and how well the stamps fit them, 1 for even ones.

    step: the median interval, which jitter makes uncertain.

    The step is the period at which |Σ exp(2πi t/step)| is largest, sought in the first stamps around the median, then
    more and more finely in twice as many. Counting intervals would add up the errors of jitter and missing samples.
    """
    length = min(256, len(stamps))
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
    pointer = np.exp(2j * np.pi * stamps / step).mean()
    index = np.rint(stamps / step - float(np.angle(pointer)) / (2 * np.pi))
    points = max(1, int(index[-1] - index[0]))
    return float(stamps[-1] / points), points, float(np.abs(pointer))


def _rounded(stamps: np.ndarray, step: float) -> bool:
    """Return True if even stamps were rounded to a coarser unit: few different intervals, and no drift from even.

    At 400 Hz in whole milliseconds the intervals are 2 and 3 ms, but the samples were taken every 2.5 ms.
    """
    intervals = np.unique(np.round(np.diff(stamps), 9))
    spread = float(np.ptp(intervals))
    if not 2 <= len(intervals) <= 3 or spread > step:
        return False
    residual = stamps - step * np.arange(len(stamps))
    return bool(np.ptp(residual) <= 1.05 * spread)


def _valid(times: np.ndarray, stamps: np.ndarray, step: float, bridge: float) -> np.ndarray:
    """Return False for the points of the grid in a long gap, or within `MARGIN` points of one."""
    valid = np.ones(len(times), dtype=bool)
    for place in np.flatnonzero(np.diff(stamps) > bridge):
        first = np.searchsorted(times, stamps[place] - (MARGIN - 0.5) * step)
        last = np.searchsorted(times, stamps[place + 1] + (MARGIN - 0.5) * step)
        valid[first:last] = False
    return valid


def resample(grid: Grid, values: np.ndarray, command: bool = False) -> np.ndarray:
    """Return a signal on the grid, shape (num_points,): by cubic splines, and by straight lines over long gaps.

    values: the signal at all samples of the log, shape (num_samples,); command: True to hold it between changes, where
    it is held.
    """
    order = values[grid.order]
    if grid.on_grid and len(order) == len(grid.times):
        return order.copy()
    if command and is_stairs(order):
        # A hair late, or rounding would keep a command that came at a point of the grid for the next one.
        place = np.searchsorted(grid.stamps, grid.times + EVEN * grid.step, side="right") - 1
        return order[np.clip(place, 0, len(order) - 1)]
    # Imported here, for it takes long, and an even log has no use for it.
    from scipy.interpolate import make_interp_spline

    result = np.interp(grid.times, grid.stamps, order)
    breaks = np.flatnonzero(np.diff(grid.stamps) > grid.bridge) + 1
    for part in np.split(np.arange(len(order)), breaks):
        # A cubic needs four points; the straight lines stand.
        if len(part) < 4:
            continue
        inside = (grid.times >= grid.stamps[part[0]]) & (grid.times <= grid.stamps[part[-1]])
        spline = make_interp_spline(grid.stamps[part], order[part], k=3)
        result[inside] = spline(grid.times[inside])
    return result


def is_stairs(values: np.ndarray) -> bool:
    """Return True if a signal, shape (num_samples,), is held between changes, as a slow command is."""
    return bool(np.mean(np.diff(values) == 0) > 0.2)


def near(bridged: np.ndarray, reach: int) -> np.ndarray:
    """Return True for samples in a gap or within `reach` samples of one; all of shape (num_samples,)."""
    return np.convolve(bridged, np.ones(2 * reach + 1), "full")[reach : reach + len(bridged)] > 0.5


def settling(bridged: np.ndarray, moving: np.ndarray, wait: int) -> np.ndarray:
    """Return True for samples after a gap until the joint has been in motion for `wait` samples.

    A simulation leaves the gap elsewhere than the joint did; in motion the difference decays, at rest friction
    preserves it. Where it would cost half of the samples, the shortest gaps are not waited for. bridged: True in a gap;
    moving: True if not at rest, shape (num_samples,) each.
    """
    excluded = np.zeros(len(bridged), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], bridged.astype(int), [0]))))
    moved = np.concatenate(([0], np.cumsum(moving)))
    # The longest first: there the simulation is furthest off.
    for _, end in sorted(edges.reshape(-1, 2).tolist(), key=lambda gap: gap[0] - gap[1]):
        settled = int(np.searchsorted(moved, moved[end] + wait))
        more = excluded.copy()
        more[end:settled] = True
        if (more & ~bridged).sum() <= 0.5 * (~bridged).sum():
            excluded = more
    return excluded & ~bridged
