"""Least squares with intervals from blocks of data, widened by known systematic errors.

A swing of a leg is a block: residuals are correlated within one, little between them. The spread comes from the
delete-one-block jackknife. Errors that are the same in every block (a link that is heavier than stated) do not show in
it: their effect on the estimate, which is linear, is added to the half-width in quadrature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from stiction.core.linear import check_condition
from stiction.files.joints import Estimate
from stiction.identification.intervals import SMALLEST_RESIDUAL


@dataclass(frozen=True)
class BlockFit:
    """A fit of P parameters."""

    values: np.ndarray
    """Estimates, shape (P,)."""
    covariance: np.ndarray
    """From the spread of the blocks, shape (P, P)."""
    shifts: np.ndarray
    """How far each known possible error would move the estimates, shape (S, P)."""
    blocks: int
    """Number of blocks."""
    condition: float
    """Condition number of the regressor with columns of unit length, priors included."""
    residual: np.ndarray
    """Target minus fit, shape (R,)."""

    def estimate(self, index: int) -> Estimate:
        """Return one parameter; see `combination`."""
        return self.combination(np.eye(len(self.values))[index])

    def combination(self, weights: np.ndarray) -> Estimate:
        """Return a weighted sum of the parameters; weights: shape (P,).

        half-width² = (t std)² + Σ shift². The deviation given is the spread's and half of every shift.
        """
        value = float(weights @ self.values)
        spread = float(np.sqrt(weights @ self.covariance @ weights))
        shift = float(np.linalg.norm(self.shifts @ weights))
        reach = float(np.hypot(student.ppf(0.975, self.blocks - 1) * spread, shift))
        return Estimate(value, float(np.hypot(spread, shift / 2)), (value - reach, value + reach))


def fit_blocks(
    regressor: np.ndarray,
    target: np.ndarray,
    block: np.ndarray,
    systematic: np.ndarray,
    prior: np.ndarray | None = None,
) -> BlockFit:
    """Fit regressor @ values = target.

    regressor: shape (R, P); target: shape (R,); block: number of each row's block, any integers, shape (R,);
    systematic: change of the target by each known possible error at its 95 % bound, shape (S, R); prior: standard
    deviation about zero that each parameter is known to have beforehand, infinite where nothing is known, shape (P,).
    Needs at least two blocks. Raises `numpy.linalg.LinAlgError` where the regressor, prior included, is not of full
    rank without one of them.

    A prior enters as one more equation, weighted by the residual's size; what it contributes to the variance of the
    estimates is computed, since it has no blocks.
    """
    _, block = np.unique(block, return_inverse=True)
    count = int(block.max()) + 1
    scale = np.linalg.norm(regressor, axis=0)
    # An empty column is left to its prior.
    scale[scale == 0] = 1.0
    scaled = regressor / scale
    parts = [block == number for number in range(count)]
    grams = np.stack([scaled[part].T @ scaled[part] for part in parts])
    sums = np.stack([scaled[part].T @ target[part] for part in parts])
    total = sums.sum(axis=0)
    knowledge, size = _prior_weights(scaled, target, scale, prior)
    gram = grams.sum(axis=0) + np.diag(knowledge)
    check_condition(np.concatenate([gram[None], gram - grams]))
    values = np.linalg.solve(gram, total)
    without = np.linalg.solve(gram - grams, (total - sums)[..., None])[..., 0]
    spread = without - without.mean(axis=0)
    inverse = np.linalg.inv(gram)
    covariance = (count - 1) / count * spread.T @ spread + size**2 * inverse @ np.diag(knowledge) @ inverse
    # The estimates are linear in the target: an error of it moves them by what is fitted to that error alone.
    shifts = inverse @ scaled.T @ systematic.T
    return BlockFit(
        values=values / scale,
        covariance=covariance / np.outer(scale, scale),
        shifts=shifts.T / scale,
        blocks=count,
        condition=float(np.sqrt(np.linalg.cond(gram))),
        residual=target - scaled @ values,
    )


def _prior_weights(
    scaled: np.ndarray, target: np.ndarray, scale: np.ndarray, prior: np.ndarray | None
) -> tuple[np.ndarray, float]:
    """Return the weight of each prior in the normal equations of scaled columns, (P,), and the residual's size."""
    if prior is None:
        return np.zeros(len(scale)), 0.0
    rest = target - scaled @ np.linalg.lstsq(scaled, target, rcond=None)[0]
    size = max(float(np.std(rest)), SMALLEST_RESIDUAL * float(np.sqrt(np.mean(target**2))))
    return (size / (prior * scale)) ** 2, size
