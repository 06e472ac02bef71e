"""Least squares of torques whose errors come in blocks, with priors on some parameters.

Residuals are correlated within a block (a swing of a leg, a stretch of the log), little between blocks: the spread of
the estimates comes from the delete-one-block jackknife. A prior, about zero with a standard deviation, enters as one
more equation per parameter. Errors that are the same in every block (a link that is heavier than stated) do not show
in the spread: their effect on an estimate, which is linear, is added to the half-width in quadrature.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from stiction.files.joints import Estimate
from stiction.identification.intervals import SMALLEST_RESIDUAL, jackknife_covariance, make_blocks


@dataclass(frozen=True)
class PriorFit:
    """Fit of P parameters to R rows."""

    names: tuple[str, ...]
    """Names of the parameters."""
    values: np.ndarray
    """Estimates, shape (P,)."""
    covariance: np.ndarray
    """Covariance by the spread of the blocks and the priors, shape (P, P)."""
    shifts: np.ndarray
    """Change of the estimates by each known possible error at its 95 % bound, shape (S, P)."""
    prior: np.ndarray
    """Standard deviation of the priors about zero, infinite where nothing is known, shape (P,)."""
    blocks: int
    """Number of blocks."""
    condition: float
    """Condition number of the regressor with columns of unit length, priors included."""
    residual: np.ndarray
    """Target minus fit, shape (R,)."""

    def value(self, name: str) -> float:
        """Return the estimate of one parameter."""
        return float(self.values[self.names.index(name)])

    def estimate(self, name: str) -> Estimate:
        """Return one parameter with its interval, see `combination`."""
        return self.combination({name: 1.0})

    def combination(self, weights: Mapping[str, float]) -> Estimate:
        """Return a weighted sum of parameters; half-width² = (t std)² + Σ shift².

        The deviation stated is that of the spread and half of every shift.
        """
        row = np.array([weights.get(name, 0.0) for name in self.names])
        value, spread = float(row @ self.values), float(np.sqrt(row @ self.covariance @ row))
        shift = float(np.linalg.norm(self.shifts @ row))
        reach = float(np.hypot(stdtrit(self.blocks - 1, 0.975) * spread, shift))
        return Estimate(value, float(np.hypot(spread, shift / 2)), (value - reach, value + reach))


def solve(regressor: np.ndarray, target: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Return the values that best explain rows with errors of size one, and their priors, shape (P,).

    regressor: shape (R, P); target: shape (R,); prior: see `PriorFit`.
    """
    scaled, length, knowledge = _normalised(regressor, prior)
    return np.linalg.solve(scaled.T @ scaled + np.diag(knowledge), scaled.T @ target) / length


def fit_blocks(
    names: tuple[str, ...],
    regressor: np.ndarray,
    target: np.ndarray,
    block: np.ndarray,
    prior: np.ndarray | None = None,
    systematic: np.ndarray | None = None,
    size: float | None = None,
) -> PriorFit:
    """Fit regressor @ values = target.

    regressor: shape (R, P); target: shape (R,); block: number of each row's block, any integers, at least two of them,
    shape (R,); prior: see `PriorFit`, by default nothing is known; systematic: change of the target by each known
    possible error at its 95 % bound, shape (S, R); size: size of the rows' errors, by default that of the residual
    without priors. Raises `numpy.linalg.LinAlgError` where the rows, priors included, do not tell all parameters
    without one of the blocks.
    """
    if prior is None:
        prior, size = np.full(len(names), np.inf), 1.0
    if size is None:
        scaled, _, _ = _normalised(regressor, prior)
        rest = target - scaled @ np.linalg.lstsq(scaled, target, rcond=None)[0]
        size = max(float(np.std(rest)), SMALLEST_RESIDUAL * float(np.sqrt(np.mean(target**2))))
    # In units of its size, a row weighs against a prior as much as a deviation does.
    scaled, length, knowledge = _normalised(regressor / size, prior)
    gram = scaled.T @ scaled + np.diag(knowledge)
    values = np.linalg.solve(gram, scaled.T @ target / size)
    residual = target / size - scaled @ values
    blocks = make_blocks(scaled, residual, np.unique(block, return_inverse=True)[1])
    covariance = jackknife_covariance(blocks, knowledge)
    errors = np.zeros((0, len(target))) if systematic is None else systematic / size
    return PriorFit(
        names=names,
        values=values / length,
        covariance=covariance / np.outer(length, length),
        # The estimates are linear in the target: an error of it moves them by what is fitted to that error alone.
        shifts=np.linalg.solve(gram, scaled.T @ errors.T).T / length,
        prior=prior,
        blocks=blocks.count,
        condition=float(np.sqrt(np.linalg.cond(gram))),
        residual=size * residual,
    )


def _normalised(regressor: np.ndarray, prior: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return columns of unit length, their lengths, (P,), and the weight of each prior in their normal equations, (P,).

    Columns differ by orders of magnitude, which normal equations square. An empty one is left to its prior.
    """
    length = np.linalg.norm(regressor, axis=0)
    length[length == 0] = 1.0
    return regressor / length, length, 1 / (prior * length) ** 2
