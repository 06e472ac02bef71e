"""Intervals that stay honest when residuals are correlated in time, as those of a real joint always are.

Textbook least squares counts every sample as new information; a residual that persists for a second makes its
intervals many times too narrow. Here the log is cut into blocks longer than the residuals' memory, and the spread of
the blocks' contributions gives the covariance: the cluster-robust "sandwich", with Student's t for blocks − 1 degrees
of freedom.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from stiction.formats.joints import Estimate

MOST_BLOCKS = 30
"""More blocks gain little: t with 29 degrees of freedom is within 5 % of the normal."""

FEWEST_BLOCKS = 8
"""Fewer blocks say too little about their own spread."""

MEMORIES = 8.0
"""Length of a block in correlation times of the residual."""


def correlation_time(residual: np.ndarray) -> float:
    """Return the integral correlation time in samples, at least 1; it ends at the first lag correlated under 0.05.

    residual: shape (num_samples,).
    """
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * len(centred))) ** 2
    correlation = np.fft.irfft(power)[: len(centred)]
    if correlation[0] <= 0:
        return 1.0
    correlation /= correlation[0]
    end = int(np.argmax(correlation < 0.05)) or len(correlation)
    return float(max(1.0, 2 * correlation[:end].sum() - 1))


def block_count(residual: np.ndarray) -> int:
    """Return how many blocks to cut a series into so that each outlasts the residual's memory."""
    wanted = int(len(residual) / (MEMORIES * correlation_time(residual)))
    return int(np.clip(wanted, FEWEST_BLOCKS, MOST_BLOCKS))


def block_covariance(jacobian: np.ndarray, residual: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Return the covariance of least-squares estimates, shape (num_parameters, num_parameters).

    jacobian: shape (num_rows, num_parameters); residual: shape (num_rows,); block: index of each row's block from 0,
    shape (num_rows,). H⁻¹ (Σ_blocks g gᵀ) H⁻¹ with H = JᵀJ, g = Jᵀr within a block, and the usual small-sample factor.
    """
    count = int(block.max()) + 1
    sums = np.stack([np.bincount(block, column * residual, count) for column in jacobian.T], axis=1)
    rows, parameters = jacobian.shape
    bread = np.linalg.inv(jacobian.T @ jacobian)
    factor = count / (count - 1) * (rows - 1) / (rows - parameters)
    return factor * bread @ (sums.T @ sums) @ bread


def estimates(values: np.ndarray, covariance: np.ndarray, freedom: int) -> tuple[Estimate, ...]:
    """Return each value with its standard deviation and Student's 95 % interval, `freedom` degrees of freedom."""
    reach = float(student.ppf(0.975, freedom))
    deviations = np.sqrt(np.diag(covariance))
    return tuple(
        Estimate(float(value), float(std), (float(value - reach * std), float(value + reach * std)))
        for value, std in zip(values, deviations, strict=True)
    )
