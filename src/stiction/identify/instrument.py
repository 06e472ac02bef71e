"""Instrumental variables: the torque equation with regressors that the noise did not touch.

In a closed loop the noise of the position comes back through the motor's torque, so regressors made from the measured
position are correlated with the residual, and least squares is biased: the more noise, the more. The instruments are
the same regressors made from a simulation of the loop with the last estimates: what the joint would have done without
noise. (ZᵀW) p = Zᵀτ is then free of that bias, as long as the simulation follows the log. After Janot, Vandanjon and
Gautier, IEEE Transactions on Control Systems Technology 22(1), 2014.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stiction.identify.prepare import Prepared, derivatives, low_pass
from stiction.identify.regression import Fit, linear_jacobian
from stiction.identify.rows import Rows, make_rows
from stiction.identify.setup import Payload

MOST_ROUNDS = 5
"""Simulations; two or three usually do."""

SETTLED = 0.02
"""Largest change of an estimate from round to round, in its standard deviations."""

WEAKEST = 0.5
"""Cosine between instrument and regressor under which the simulation does not follow the log."""

Simulator = Callable[[np.ndarray], np.ndarray | None]
"""Estimates, shape (P,) -> simulated position [rad], shape (num_samples,); None where it cannot be simulated."""


def fit_instrumental(prepared: Prepared, payload: Payload | None, start: Fit, simulate: Simulator) -> Fit | None:
    """Fit the equation of `start`, which is linear in its parameters, with simulated instruments.

    prepared, payload: the run behind the rows of `start`. Returns None where no simulation follows the log, and where
    the rounds do not settle.
    """
    fit, torque = start, start.jacobian @ start.values + start.residual
    for _ in range(MOST_ROUNDS):
        position = simulate(fit.values)
        if position is None:
            return None
        instrument = linear_jacobian(_simulated_rows(prepared, payload, position), fit.names)
        if _cosines(instrument, start.jacobian).min() < WEAKEST:
            return None
        values = np.linalg.solve(instrument.T @ start.jacobian, instrument.T @ torque)
        residual = torque - start.jacobian @ values
        previous, fit = fit, replace(start, values=values, residual=residual, instrument=instrument)
        deviations = np.sqrt(np.diag(fit.covariance))
        if np.all(np.abs(fit.values - previous.values) < SETTLED * deviations):
            return fit
    return None


def _simulated_rows(prepared: Prepared, payload: Payload | None, position: np.ndarray) -> Rows:
    """Return the rows that a simulated position would have given, at the same samples."""
    velocity, acceleration = derivatives(position, prepared.step, prepared.cutoff)
    direction = low_pass(np.sign(velocity), prepared.cutoff, prepared.step)
    angle = low_pass(position, prepared.cutoff, prepared.step)
    noiseless = replace(prepared, position=angle, velocity=velocity, acceleration=acceleration, direction=direction)
    return make_rows([noiseless], [payload])


def _cosines(instrument: np.ndarray, regressor: np.ndarray) -> np.ndarray:
    """Return the cosine between matching columns, shape (P,)."""
    lengths = np.linalg.norm(instrument, axis=0) * np.linalg.norm(regressor, axis=0)
    return np.sum(instrument * regressor, axis=0) / np.maximum(lengths, 1e-300)
