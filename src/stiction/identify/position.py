"""Does the torque follow the position? Gravity on a leg in the air, a spring or a cable does that; the model has none.

Such a torque hides in the inertia, for θ'' and θ are opposite in a sine: 0.2 N m of gravity on the paper's shank moves
it by 8 %, many of its standard deviations, and leaves a residual that looks harmless. So the regression is done again
with θ as a fifth regressor; what that changes is what the law with four lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.joints import PARAMETERS
from stiction.identify.regression import Fit, fit_beside
from stiction.identify.rows import Rows


@dataclass(frozen=True)
class PositionTorque:
    """Torque that follows the position, and what leaving it out costs."""

    slope: float
    """Torque over position [N m/rad]."""
    std: float
    """Standard deviation of the slope [N m/rad]."""
    changes: dict[str, float]
    """Inertia, viscous and Coulomb friction: how much each changes once the slope is fitted too, over its value [1]."""


def position_torque(rows: Rows, fit: Fit) -> PositionTorque:
    """Fit the torque equation with θ beside its regressors; fit: the one without θ."""
    both = fit_beside(fit, "slope", rows.position - rows.position.mean())
    changes = {
        name: float(value / before - 1)
        for name, value, before in zip(PARAMETERS[:3], both.values, fit.values)
        if before != 0
    }
    return PositionTorque(float(both.values[-1]), float(np.sqrt(both.covariance[-1, -1])), changes)
