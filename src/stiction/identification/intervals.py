"""Intervals for residuals that are correlated in time, as those of a real joint always are.

The log is cut into blocks longer than the residual's memory. The spread of the blocks' contributions gives the
covariance (the cluster-robust "sandwich"), and a block bootstrap gives the distribution of each estimate's studentised
error: its error in its standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import stdtrit

from stiction.core.linear import check_condition, invert
from stiction.files.joints import Estimate

MOST_BLOCKS = 30
"""Most blocks of a log: more gain little, for t with 29 degrees of freedom is within 5 % of the normal."""

FEWEST_BLOCKS = 8
"""Fewest blocks of a log: fewer say too little about their spread."""

BLOCK_MEMORIES = 8.0
"""Length of a block in correlation times of the residual."""

DRAWS = 999
"""Resamples of a bootstrap: the 95 % point of that many is known to within one per cent of probability."""

LARGEST_REACH = 2.0
"""Bootstrapped reach over Student's at which it is cut: a handful of blocks says too little about its own scatter."""

SMALLEST_RESIDUAL = 1e-4
"""Residual over torque below which a fit is not believed to be better: a prior keeps some weight [1]."""

SEED = 20_251
"""Seed of the bootstrap: the same log gives the same intervals."""


@dataclass(frozen=True)
class Blocks:
    """Contributions of each block of a log to the estimating equations A δ = g; B blocks, P parameters."""

    curvature: np.ndarray
    """A of each block, ZᵀW, shape (B, P, P)."""
    gradient: np.ndarray
    """g of each block, Zᵀr, shape (B, P)."""
    rows: int
    """Number of rows."""

    @property
    def count(self) -> int:
        """Number of blocks."""
        return len(self.gradient)


def correlation_time(residual: np.ndarray) -> float:
    """Return the integral correlation time in samples, at least 1; it ends at the first lag correlated under 0.05.

    residual: shape (num_samples,).
    """
    centred = residual - residual.mean()
    # Twice as long, with zeros: the transform is periodic, and would correlate the end with the beginning.
    length = 2 << len(centred).bit_length()
    correlation = np.fft.irfft(np.abs(np.fft.rfft(centred, length)) ** 2, length)[: len(centred)]
    if correlation[0] <= 0:
        return 1.0
    correlation /= correlation[0]
    # `argmax` is 0 where no lag is below. Not all lags are summed: those of a centred series add up to -1/2, whatever
    # it remembers.
    end = int(np.argmax(correlation < 0.05)) or len(correlation)
    return float(max(1.0, 2 * correlation[:end].sum() - 1))


def block_count(residual: np.ndarray) -> int:
    """Return the number of blocks of a series with which each outlasts the residual's memory."""
    wanted = int(len(residual) / (BLOCK_MEMORIES * correlation_time(residual)))
    return int(np.clip(wanted, FEWEST_BLOCKS, MOST_BLOCKS))


def make_blocks(
    jacobian: np.ndarray, residual: np.ndarray, block: np.ndarray, instrument: np.ndarray | None = None
) -> Blocks:
    """Sum the estimating equations over blocks.

    jacobian: W, shape (num_rows, P); residual: r, shape (num_rows,); block: index of each row's block from 0, shape
    (num_rows,); instrument: Z, shape (num_rows, P), W itself by default, which is least squares. Empty blocks drop out.
    """
    left = jacobian if instrument is None else instrument
    order = np.argsort(block, kind="stable")
    starts = np.flatnonzero(np.diff(block[order], prepend=-1))
    pairs = np.split(order, starts[1:])
    curvature = np.stack([left[rows].T @ jacobian[rows] for rows in pairs])
    gradient = np.stack([left[rows].T @ residual[rows] for rows in pairs])
    return Blocks(curvature, gradient, len(residual))


def robust_covariance(blocks: Blocks) -> np.ndarray:
    """Return the covariance of the estimates, shape (P, P): A⁻¹ (Σ_blocks g gᵀ) A⁻ᵀ with the small-sample factor.

    Infinite on the diagonal, and zero off it, for estimates that the equations leave open.
    """
    bread, told = invert(blocks.curvature.sum(axis=0))
    parameters = bread.shape[0]
    factor = blocks.count / (blocks.count - 1) * (blocks.rows - 1) / max(blocks.rows - parameters, 1)
    covariance = factor * bread @ (blocks.gradient.T @ blocks.gradient) @ bread.T
    return np.where(np.outer(told, told), covariance, np.diag(np.full(parameters, np.inf)))


def jackknife_covariance(blocks: Blocks, knowledge: np.ndarray) -> np.ndarray:
    """Return the covariance of estimates with Gaussian priors about zero, shape (P, P).

    knowledge: 1/σ² of each prior, 0 where nothing is known, shape (P,). The estimates solve a system with the matrix
    M = Σ A + diag(knowledge). Without block b they move by exactly −(M − A_b)⁻¹ g_b, g being of residuals at the whole
    fit: the spread of that over the blocks is the data's part. The priors' part, M⁻¹ diag(knowledge) M⁻¹, is for true
    values that scatter about zero by σ. The sandwich of `robust_covariance` would be too small where parameters are
    nearly as many as blocks. Raises `numpy.linalg.LinAlgError` where a system, of all blocks or without one, leaves an
    estimate open.
    """
    total = blocks.curvature.sum(axis=0) + np.diag(knowledge)
    check_condition(np.concatenate([total[None], total - blocks.curvature]))
    moved = -np.linalg.solve(total - blocks.curvature, blocks.gradient[..., None])[..., 0]
    spread = moved - moved.mean(axis=0)
    inverse = np.linalg.inv(total)
    scatter = (blocks.count - 1) / blocks.count * spread.T @ spread
    return scatter + inverse @ np.diag(knowledge) @ inverse.T


def bootstrap_reach(blocks: Blocks) -> np.ndarray:
    """Return the 95 % point of each estimate's studentised error, |δ| / std, by resampling blocks; shape (P,).

    At least Student's point for B − 1 degrees of freedom, at most `LARGEST_REACH` times it.
    """
    least = float(stdtrit(blocks.count - 1, 0.975))
    draws = _draws(blocks.count)
    # As products of matrices: sums over single indices, of three factors above all, take several times as long.
    parameters = blocks.gradient.shape[1]
    flat = blocks.curvature.reshape(blocks.count, -1)
    curvature = (draws @ flat).reshape(-1, parameters, parameters)
    scale = 1 / np.sqrt(np.einsum("bii->i", blocks.curvature).clip(1e-300))
    solvable = np.linalg.cond(curvature * np.outer(scale, scale), 1) < 1e10
    draws, curvature = draws[solvable], curvature[solvable]
    if len(draws) < DRAWS // 2:
        return np.full(len(scale), LARGEST_REACH * least)
    bread = np.linalg.inv(curvature)
    change = (bread @ (draws @ blocks.gradient)[..., None])[..., 0]
    told = change @ blocks.curvature.reshape(-1, parameters).T
    left = blocks.gradient - told.reshape(-1, blocks.count, parameters)
    # Each resample is studentised by the sandwich of what its blocks leave unexplained at its estimates.
    influence = left @ bread.swapaxes(1, 2)
    spread = np.sqrt((draws[:, None, :] @ influence**2)[:, 0].clip(1e-300))
    reach = np.quantile(np.abs(change) / spread, 0.95, axis=0)
    return np.clip(reach, least, LARGEST_REACH * least)


@cache
def _draws(count: int) -> np.ndarray:
    """Return the number of times that each block is drawn in each resample; shape (DRAWS, count)."""
    return np.random.default_rng(SEED).multinomial(count, np.full(count, 1 / count), DRAWS).astype(float)


def with_intervals(values: np.ndarray, covariance: np.ndarray, reach: np.ndarray | float) -> tuple[Estimate, ...]:
    """Return each value with its standard deviation and its 95 % interval, `reach` deviations to each side."""
    deviations = np.sqrt(np.diag(covariance))
    ends = np.broadcast_to(reach, deviations.shape) * deviations
    return tuple(
        Estimate(float(value), float(std), (float(value - end), float(value + end)))
        for value, std, end in zip(values, deviations, ends, strict=True)
    )
