"""Closed-loop output error: simulate the joint under its controller and fit what it does to what was measured.

The residual is simulated − measured (the paper minimises reference − measurement, which measures the controller). In a
closed loop the position hardly depends on the parameters and the torque does, so both are fitted, each in units of its
own residual's size. No derivative of a noisy signal enters.

A controller whose velocity is late by δ (a difference over samples, a filter) brakes with kd (θ' − δ θ''), to first
order: it takes δ kd off the inertia that the position shows, and nothing off the inertia that the torque shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from stiction.formats.errors import StictionError
from stiction.formats.joints import Estimate
from stiction.identify.checks import Uniform
from stiction.identify.intervals import block_count, block_covariance, estimates
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains, pd_torque
from stiction.joints.simulate import Joint, Trajectory, simulate

TOLERANCES = (1e-3, 1e-6)
"""Fits, the weights of position and torque renewed before each: relative change of the cost at which each ends. For ten
thousand rows 1e-6 is a tenth of a standard deviation, and the last step of a Gauss-Newton search is far smaller."""

LARGEST_CONDITION = 1e6
"""Condition number of the scaled Jacobian beyond which a parameter has dropped out: a joint that never moves, say."""

DIFFERENCE = 1e-4
"""Step of the numerical derivatives, in units of each parameter's scale."""


@dataclass(frozen=True)
class OutputError:
    """A joint whose simulation follows the log."""

    estimates: tuple[Estimate, ...]
    """Inertia, viscous friction, Coulomb friction, offset."""
    simulated: Trajectory
    """The simulation with these values."""
    relative_errors: dict[str, float]
    """|simulated − measured| / |measured| for position and torque."""


def fit_output_error(
    signals: Uniform, gains: PDGains, start: tuple[float, ...], speed: float, velocity_delay: float = 0.0
) -> OutputError | None:
    """Fit the four parameters to position and torque; None if the best simulation does not depend on all of them.

    signals: with a target; start: inertia, viscous, Coulomb, offset from the regression; speed: θ' at the first sample
    [rad/s]; velocity_delay: δ [s]. Raises `StictionError` for a delay that would take away half of the inertia.
    """
    borrowed = velocity_delay * gains.kd
    if not 0 <= borrowed < 0.5 * start[0]:
        raise StictionError(
            f"velocity delay {velocity_delay} s: with kd {gains.kd:.4g} and inertia {start[0]:.4g} expected 0 "
            f"to {0.5 * start[0] / gains.kd:.3g} s"
        )
    target = np.asarray(signals.target)
    begin = float(np.mean(signals.position[:3]))
    measured = np.stack([signals.position, signals.torque])
    friction = float(np.std(signals.torque))
    scale = np.array([abs(start[0]), abs(start[1]) + friction / np.ptp(signals.position), friction, friction])

    def run(values: np.ndarray) -> Trajectory:
        inertia, viscous, coulomb, offset = (float(value) for value in values * scale)
        joint = Joint(inertia - borrowed, viscous, Coulomb(coulomb), offset)
        made = simulate(joint, gains, signals.step, target, begin, speed)
        late = np.interp(signals.time - velocity_delay, signals.time, made.velocity)
        return replace(made, torque=pd_torque(gains, target, made.position, late))

    def residual(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        made = run(values)
        return ((np.stack([made.position, made.torque]) - measured) * weights).ravel()

    values = np.array(start) / scale
    values[2] = max(values[2], 1e-3)
    bounds = ([max(1e-2, 1.1 * borrowed / scale[0]), -np.inf, 0.0, -np.inf], np.inf)
    for tolerance in TOLERANCES:
        size = np.std(residual(values, np.ones((2, 1))).reshape(2, -1), axis=1, keepdims=True)
        weights = 1 / np.maximum(size, 1e-9 * np.std(measured, axis=1, keepdims=True))
        fit = least_squares(
            residual,
            values,
            bounds=bounds,
            args=(weights,),
            diff_step=DIFFERENCE,
            x_scale=1.0,
            xtol=1e-6,
            ftol=tolerance,
        )
        values = fit.x
    if not np.linalg.cond(fit.jac) < LARGEST_CONDITION:
        return None
    rows = fit.fun.reshape(2, -1)
    count = min(block_count(row) for row in rows)
    block = np.tile(np.arange(rows.shape[1]) * count // rows.shape[1], 2)
    covariance = block_covariance(fit.jac, fit.fun, block) * np.outer(scale, scale)
    made = run(values)
    errors = np.linalg.norm(rows / weights, axis=1) / np.linalg.norm(measured, axis=1)
    return OutputError(
        estimates(values * scale, covariance, count - 1),
        made,
        {"position": float(errors[0]), "torque": float(errors[1])},
    )
