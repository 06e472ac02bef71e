"""Where a gap in the log is still felt: a filter smears it, and a simulated joint forgets it only after a while."""

from __future__ import annotations

import numpy as np

MOST_LOST = 0.5
"""Share of the samples that may be given up to let the joint settle. Where there are more gaps than that allows, the
shortest are not waited for: what a straight line misses grows with the cube of its length."""


def near(bridged: np.ndarray, reach: int) -> np.ndarray:
    """Return True for samples in a gap or within `reach` samples of one; all of shape (num_samples,)."""
    return np.convolve(bridged, np.ones(2 * reach + 1), "full")[reach : reach + len(bridged)] > 0.5


def unsettled(bridged: np.ndarray, moving: np.ndarray, wait: int) -> np.ndarray:
    """Return True for samples after a gap up to the one by which the joint was in motion for `wait` samples.

    What the target did in the gap is not known, so a simulation leaves the gap elsewhere than the joint did. In motion
    the difference dies away; friction at rest preserves it. bridged: in a gap; moving: not at rest, (num_samples,).
    """
    found = np.zeros(len(bridged), bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], bridged.astype(int), [0]))))
    moved = np.concatenate(([0], np.cumsum(moving)))
    for _, end in sorted(edges.reshape(-1, 2).tolist(), key=lambda gap: gap[0] - gap[1]):
        settled = int(np.searchsorted(moved, moved[end] + wait))
        more = found.copy()
        more[end:settled] = True
        if (more & ~bridged).sum() <= MOST_LOST * (~bridged).sum():
            found = more
    return found & ~bridged
