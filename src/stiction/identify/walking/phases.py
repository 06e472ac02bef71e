"""Which samples of a walk say what: swing phases of each leg, joints that clearly move, and the smoothing window."""

from __future__ import annotations

import numpy as np

from stiction.formats.walk import WalkLog
from stiction.identify.walking.leg import foot_position
from stiction.identify.walking.motion import WalkMotion
from stiction.identify.walking.setup import WalkSetup
from stiction.robots.spec import RobotSpec


def hann_weights(length: float, period: float) -> np.ndarray:
    """Return the weights of a Hann window of `length` [s] without its zeros, an odd number of them that add up to 1."""
    half = max(1, round(length / period / 2))
    weights = np.hanning(2 * half + 1)[1:-1]
    return weights / weights.sum()


def smooth(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted mean of neighbours along axis 0, shape of `values`; half a window at each end is unusable."""
    flat = values.reshape(len(values), -1)
    columns = [np.convolve(column, weights, "same") for column in flat.T]
    return np.stack(columns, axis=1).reshape(values.shape)


def grow(mask: np.ndarray, samples: int) -> np.ndarray:
    """Return a mask, shape (T,), widened by `samples` on each side of every sample set; the ends count as set."""
    if samples == 0:
        return mask.copy()
    grown = np.convolve(mask, np.ones(2 * samples + 1), "same") > 0.5
    grown[:samples] = grown[-samples:] = True
    return grown


def feet_down(log: WalkLog, motion: WalkMotion, spec: RobotSpec, setup: WalkSetup) -> np.ndarray:
    """Return whether each foot may bear load, bool, shape (T, L): as logged, else by height above the lowest foot."""
    if log.foot_contact is not None:
        return log.foot_contact
    height = np.stack(
        [
            (foot_position(spec, leg, moving.position) * motion.upward).sum(axis=1)
            for leg, moving in zip(spec.legs, motion.legs, strict=True)
        ],
        axis=1,
    )
    return height - height.min(axis=1, keepdims=True) < setup.clearance


def swings(down: np.ndarray, margin: int) -> np.ndarray:
    """Return the number of the swing that each sample of one foot belongs to, 0 where it is in none, shape (T,).

    down: bool, shape (T,). `margin` samples are left out at both ends of each swing, and the log's ends are no swing.
    """
    air = ~grow(down, margin + 1)
    starts = np.diff(air, prepend=False) & air
    return np.where(air, np.cumsum(starts), 0)


def slow_samples(velocity: np.ndarray, setup: WalkSetup, period: float) -> np.ndarray:
    """Return where a joint hardly moves or turns round, margin included, bool, shape (T,). velocity: θ', shape (T,)."""
    slow = np.abs(velocity) < setup.slow
    slow[1:] |= np.diff(np.sign(velocity)) != 0
    return grow(slow, round(setup.stop_margin / period))
