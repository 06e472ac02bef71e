"""Stamps of a log: their faults, and the resampling of signals on an even grid."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.identification.timing import even_grid, is_stairs, resample

STEP = 0.005
TIME = np.arange(1000) * STEP


def wave(time: np.ndarray) -> np.ndarray:
    """Return a motion of 2 Hz."""
    return np.sin(2 * np.pi * 2 * time)


def jittered(share: float, seed: int = 0) -> np.ndarray:
    """Return stamps that are off by normal noise of `share` of a step."""
    return TIME + share * STEP * np.random.default_rng(seed).standard_normal(len(TIME))


def test_even_stamps_change_nothing() -> None:
    """Signals on the grid must come out bit for bit, and nothing is warned of but that jitter is hidden."""
    grid, timing = even_grid("x", TIME + 1.7e9)
    np.testing.assert_array_equal(resample(grid, wave(TIME)), wave(TIME))
    assert timing.synthetic and timing.warnings() == () and timing.jitter == 0 and timing.samples == 1000
    assert timing.rate == pytest.approx(200, rel=1e-6) and grid.valid.all()


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2])
def test_jitter_is_measured_and_taken_out(share: float) -> None:
    """The interval between two jittered stamps varies by sqrt(2) times the jitter; cubic splines leave 1e-6."""
    stamps = jittered(share)
    grid, timing = even_grid("x", stamps)
    assert timing.jitter == pytest.approx(share * np.sqrt(2), rel=0.1)
    assert timing.rate == pytest.approx(200, rel=1e-3) and timing.dropped == 0 and not timing.synthetic
    inside = slice(5, -5)
    moved = wave(grid.times + stamps.min())
    assert np.abs(resample(grid, wave(stamps)) - moved)[inside].max() < 2e-6
    assert ("jitter" in " ".join(timing.warnings())) == (timing.jitter > 0.02)


@pytest.mark.parametrize("seed", range(20))
def test_missing_samples_are_counted_exactly_in_spite_of_jitter(seed: int) -> None:
    """Missing samples are counted exactly; a late stamp is none."""
    rng = np.random.default_rng(seed)
    count, step = int(rng.integers(300, 20000)), 10 ** rng.uniform(-4, -1.5)
    stamps = step * (np.arange(count) + rng.uniform(0, 0.2) * rng.standard_normal(count))
    order = rng.random(count) > rng.uniform(0, 0.1)
    order[[0, -1]] = True
    _, timing = even_grid("x", np.sort(stamps[order]))
    assert timing.dropped == np.count_nonzero(~order)


def test_interpolation_is_of_fourth_order() -> None:
    """Half the step has a sixteenth of the error."""
    errors = []
    for step in (0.01, 0.005):
        time = np.arange(0, 4, step)
        stamps = time + 0.3 * step * np.sin(37 * np.arange(len(time)))
        grid, _ = even_grid("x", stamps)
        error = resample(grid, wave(stamps)) - wave(grid.times + stamps[0])
        errors.append(np.abs(error)[20:-20].max())
    assert errors[0] / errors[1] > 10


def test_duplicated_and_disordered_samples_are_mended_and_counted() -> None:
    """A stamp that came twice counts once, the first; neighbours that changed places change back."""
    order = np.arange(1000)
    order[[400, 401]] = order[[401, 400]]
    order = np.insert(order, 700, 699)
    stamps, values = TIME[order], wave(TIME[order])
    values[700] = 99.0
    grid, timing = even_grid("x", stamps)
    assert (timing.duplicated, timing.disordered, timing.dropped) == (1, 1, 0)
    np.testing.assert_allclose(resample(grid, values), wave(TIME), atol=1e-12)
    assert len(timing.warnings()) == 2


def test_short_gaps_are_interpolated_and_long_ones_marked() -> None:
    """Three samples can be replaced; twenty cannot, nor their neighbours; both are counted."""
    order = np.ones(1000, dtype=bool)
    order[200:203] = order[500:520] = False
    grid, timing = even_grid("x", TIME[order])
    assert timing.dropped == 23 and timing.longest_gap == pytest.approx(21 * STEP)
    out = np.flatnonzero(~grid.valid)
    assert out[0] in (498, 499) and out[-1] in (520, 521) and grid.valid[200:203].all()
    error = np.abs(resample(grid, wave(TIME[order])) - wave(TIME))
    assert error[grid.valid].max() < 1e-4 and np.isfinite(error).all() and error.max() < 1
    assert "longer gaps are not used" in timing.warnings()[0]


def test_commands_in_stairs_stay_stairs() -> None:
    """A command at 50 Hz in a log at 200 Hz keeps its steps."""
    stairs = np.repeat(np.sin(np.arange(250)), 4)
    grid, _ = even_grid("x", jittered(0.05))
    held = resample(grid, stairs, command=True)
    assert is_stairs(stairs) and not is_stairs(wave(TIME) + TIME)
    assert set(held) <= set(stairs) and np.mean(held == stairs) > 0.7


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (np.zeros(1000), "time stands still: 999 of 1000"),
        (np.floor(TIME**1.3 * 5) / 5, "time stands still"),
        (1000 * TIME, "in seconds"),
        (np.where(np.arange(1000) % 10 < 5, TIME, TIME + 3), "time runs backwards 99 times"),
        (np.repeat(TIME[::50], 50) + np.tile(np.arange(50) * 2e-5, 20), "come in bursts"),
    ],
)
def test_hopeless_stamps_are_refused(stamps: np.ndarray, message: str) -> None:
    """Rejects hopeless stamps in one line, with the remedy."""
    with pytest.raises(LogError, match=message) as caught:
        even_grid("x.csv", stamps)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("stamps", "points", "message"),
    [
        (TIME[::-1], 1000, "newest row first"),
        (np.concatenate([TIME, TIME]), 2199, "begins again at sample 1001"),
        (np.where(TIME > 2, TIME + 100, TIME), 1199, "pauses once for 100"),
        (np.append(TIME, 1e15), 1200, "pauses once for 1e.15"),
        (np.round(TIME, 2), 1000, "rounded to 0.01 s"),
        (np.where(np.arange(1000) == 500, 1e6, TIME), 1000, "1 samples have a stamp far from"),
    ],
)
def test_odd_stamps_are_used_and_said(stamps: np.ndarray, points: int, message: str) -> None:
    """The grid has as many points as the samples take, a pause of one second at most, and a warning."""
    grid, timing = even_grid("x.csv", stamps)
    assert len(grid.times) == points and re.search(message, " ".join(timing.warnings()))
    assert grid.step == pytest.approx(STEP, rel=1e-3) and (np.diff(grid.stamps) > 0).all()
