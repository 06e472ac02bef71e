"""How much better one description of a log is than another: held-out error, and the information criterion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stiction.identification.intervals import correlation_time

DEVIATIONS = 2.0
"""Standard deviations by which the held-out error must fall for a richer law."""

MIN_GAIN = 0.02
"""Share by which the held-out error must fall: less is not worth a parameter to anybody."""

MIN_EVIDENCE = 6.0
"""Drop of the information criterion for a richer law; 6 is called strong."""


@dataclass(frozen=True)
class Gain:
    """By how much a held-out squared error fell, as a share, with the deviation that the blocks' scatter gives it."""

    mean: float
    """The share by which it fell [1]."""
    std: float
    """Its deviation [1]."""

    @property
    def certain(self) -> bool:
        """Whether it is beyond noise and worth a parameter."""
        return self.mean > DEVIATIONS * self.std and self.mean > MIN_GAIN


def gain_of(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors block by block; shape (num_blocks,) each."""
    shares = (reference - error) * len(error) / max(float(reference.sum()), 1e-300)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


def gain_by_block(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors as a share of each block's own, where single blocks hold most of all error.

    error, reference: shape (num_blocks,) each; no block counts for more than it all.
    """
    shares = np.clip(1.0 - error / reference.clip(1e-300), -1.0, 1.0)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


def evidence_of(plain: Sequence[np.ndarray], rich: Sequence[np.ndarray], more: int) -> float:
    """Return by how much the Bayesian information criterion falls from a law to a richer one.

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
