"""Torque regression: least squares of I θ'' + B θ' + b_c sign(θ') + offset = τ over the clear samples of a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.joints import Estimate
from stiction.formats.log import LogError
from stiction.identify.intervals import block_count, block_covariance, estimates
from stiction.identify.prepare import Prepared

LARGEST_CONDITION = 100.0
"""Condition number of the regressor with unit columns beyond which parameters are not told apart."""


@dataclass(frozen=True)
class Regression:
    """A fitted torque equation."""

    estimates: tuple[Estimate, ...]
    """Inertia, viscous friction, Coulomb friction, offset."""
    fitted: np.ndarray
    """Torque by the fitted law at every sample [N m], shape (num_samples,); at reversals it is a guess."""
    condition: float
    """Condition number of the regressor as it is."""
    scaled_condition: float
    """Condition number of the regressor with columns of unit length."""
    relative_error: float
    """|residual| / |torque| over the samples used."""
    blocks: int
    """Number of blocks behind the intervals."""


def regress(source: str, prepared: Prepared) -> Regression:
    """Fit the four parameters; `source` is named in messages.

    Raises `LogError` if the motion does not tell the parameters apart.
    """
    used, regressor = prepared.used, prepared.regressor
    if len(used) < 50:
        raise LogError(
            f"{source}: excitation too poor: {len(used)} samples are clear of reversals and faster than "
            f"{prepared.threshold:.3g}; expected at least 50: move further, faster, or for longer"
        )
    scaled = np.linalg.cond(regressor / np.linalg.norm(regressor, axis=0))
    if not scaled < LARGEST_CONDITION:
        raise LogError(
            f"{source}: excitation too poor: inertia, viscous and dry friction and offset look alike (condition "
            f"{scaled:.3g}, at most {LARGEST_CONDITION:.0f}); use at least two frequencies and both directions"
        )
    values = np.linalg.lstsq(regressor, prepared.torque[used], rcond=None)[0]
    residual = prepared.torque[used] - regressor @ values
    count = block_count(residual)
    block = used * count // len(prepared.torque)
    covariance = block_covariance(regressor, residual, block)
    every = np.stack(
        [prepared.acceleration, prepared.velocity, prepared.direction, np.ones_like(prepared.torque)], axis=1
    )
    return Regression(
        estimates=estimates(values, covariance, count - 1),
        fitted=every @ values,
        condition=float(np.linalg.cond(regressor)),
        scaled_condition=float(scaled),
        relative_error=float(np.linalg.norm(residual) / np.linalg.norm(prepared.torque[used])),
        blocks=count,
    )
