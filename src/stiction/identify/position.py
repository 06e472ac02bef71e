"""Does the torque follow the position? Gravity on a leg in the air, a spring or a cable does that; the model has none.

Such a torque hides in the inertia, for θ'' and θ are opposite in a sine: 0.2 N m of gravity on the paper's shank moves
it by 8 %, many of its standard deviations, and leaves a residual that looks harmless. So the regression is done again
with θ as a fifth regressor; what that changes is what the law with four lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.joints import PARAMETERS
from stiction.identify.intervals import block_count, block_covariance
from stiction.identify.prepare import Prepared, low_pass
from stiction.identify.regression import Regression


@dataclass(frozen=True)
class PositionTorque:
    """Torque that follows the position, and what leaving it out costs."""

    slope: float
    """Torque over position [N m/rad]."""
    std: float
    """Standard deviation of the slope [N m/rad]."""
    changes: dict[str, float]
    """Inertia, viscous and Coulomb friction: how much each changes once the slope is fitted too, over its value [1]."""


def position_torque(prepared: Prepared, position: np.ndarray, step: float, regression: Regression) -> PositionTorque:
    """Fit the torque equation with θ beside the four regressors.

    position: θ [rad], shape (num_samples,); step [s]; regression: the fit without θ.
    """
    angle = low_pass(position, prepared.cutoff, step)[prepared.used]
    regressor = np.column_stack([prepared.regressor, angle - angle.mean()])
    torque = prepared.torque[prepared.used]
    values = np.linalg.lstsq(regressor, torque, rcond=None)[0]
    residual = torque - regressor @ values
    block = prepared.used * block_count(residual) // len(prepared.torque)
    covariance = block_covariance(regressor, residual, block)
    changes = {
        name: float(value / estimate.value - 1)
        for name, value, estimate in zip(PARAMETERS[:3], values, regression.estimates)
        if estimate.value != 0
    }
    return PositionTorque(float(values[4]), float(np.sqrt(covariance[4, 4])), changes)
