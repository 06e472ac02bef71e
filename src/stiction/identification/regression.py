"""Torque regression: least squares of the torque equation, for any of its friction laws, over the rows of a log.

In a closed loop the noise of the position comes back through the motor's torque, so least squares is biased: where
gains and target are known, output error is used, and this fit starts its search.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import Estimate
from stiction.identification.checks import PoorMotion
from stiction.identification.intervals import (
    Blocks,
    block_count,
    bootstrap_reach,
    make_blocks,
    robust_covariance,
    with_intervals,
)
from stiction.identification.model import GRAVITY_TERMS, Model
from stiction.identification.prepare import Prepared, Rows

FEWEST_ROWS = 50
"""Fewest rows of a fit: fewer say nothing about their scatter."""

MAX_INFLATION = 100.0
"""Norm of a column over that of its part orthogonal to the others, above which its parameter is not identified."""

LOAD_ROUNDS = 3
"""Rounds of fitting the load coefficient: the load follows from gravity and gravity from the fit; two rounds settle."""

SPEEDS = 10
"""Number of Stribeck velocities tried before the best is refined."""

INVERSE_STRENGTH = "inverse_strength"
"""Name of the parameter 1/k: torque, in the torque's unit, per N m of known payload."""


@dataclass(frozen=True)
class Fit:
    """A fitted torque equation; P parameters, R rows."""

    model: Model
    """Torque equation."""
    names: tuple[str, ...]
    """Names of the parameters: the model's, and `inverse_strength` where a known payload gives it."""
    values: np.ndarray
    """Best estimates, shape (P,)."""
    jacobian: np.ndarray
    """Derivative of the torque by each parameter, shape (R, P)."""
    residual: np.ndarray
    """Measured less fitted torque [N m], shape (R,)."""
    rows: Rows
    """Rows of the fit."""

    @cached_property
    def blocks(self) -> Blocks:
        """Estimating equations, summed over blocks that outlast the residual's memory."""
        block = self.rows.blocks(block_count(self.residual))
        return make_blocks(self.jacobian, self.residual, block)

    @cached_property
    def reach(self) -> np.ndarray:
        """Half-width of each 95 % interval in standard deviations, shape (P,)."""
        return bootstrap_reach(self.blocks)

    @cached_property
    def inflation(self) -> dict[str, float]:
        """Norm of each column over the norm of its part orthogonal to the others; 1 is best, 1e12 a copy of another."""
        scaled = self.jacobian / np.linalg.norm(self.jacobian, axis=0).clip(1e-300)
        # The square roots of the diagonal of (XᵀX)⁻¹, by the factor R: XᵀX itself would square the condition number.
        _, sizes, directions = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
        lengths = np.linalg.norm(directions / sizes.clip(1e-12)[:, None], axis=0)
        return dict(zip(self.names, lengths.tolist(), strict=True))

    @property
    def condition(self) -> float:
        """Condition number of the regressor as it is."""
        return float(np.linalg.cond(self.jacobian))

    @property
    def scaled_condition(self) -> float:
        """Condition number of the regressor with columns of unit length."""
        return float(np.linalg.cond(self.jacobian / np.linalg.norm(self.jacobian, axis=0).clip(1e-300)))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the estimates, robust against correlated residuals, shape (P, P)."""
        return robust_covariance(self.blocks)

    @property
    def by_name(self) -> dict[str, float]:
        """Best estimates by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def combination(self, weights: Mapping[str, float], like: str, value: float | None = None) -> Estimate:
        """Return a weighted sum of the parameters, its interval as many deviations wide as that of `like`.

        value: value of a function of the parameters whose gradient the weights are; by default the sum itself.
        """
        row = np.array([weights.get(name, 0.0) for name in self.names])
        centre = row @ self.values if value is None else value
        reach = self.reach[self.names.index(like)]
        # Without the parameters of weight zero: nothing times an infinite variance would be no number.
        used = np.flatnonzero(row)
        variance = row[used] @ self.covariance[np.ix_(used, used)] @ row[used]
        return with_intervals(np.array([centre]), np.array([[variance]]), reach)[0]

    def scatter(self) -> dict[str, Estimate]:
        """Return each parameter with its deviation and interval from the residual's scatter alone."""
        bounded = with_intervals(self.values, self.covariance, self.reach)
        return dict(zip(self.names, bounded, strict=True))

    def estimates(self) -> dict[str, Estimate]:
        """Return each parameter with deviation and interval, which admits the bias of least squares in the inertia."""
        named = self.scatter()
        inertia = named["inertia"]
        more = self.rows.attenuation * abs(inertia.value)
        # Noise in a regressor draws its coefficient towards zero, so that the truth can only lie further up.
        ends = (inertia.interval95[0], inertia.interval95[1] + more)
        named["inertia"] = Estimate(inertia.value, float(np.hypot(inertia.std, more / 2)), ends)
        return named


def fit_rows(rows: Rows, model: Model, strength_unknown: bool = False) -> Fit:
    """Fit a torque equation; strength_unknown: 1/k is a parameter too, and a payload must tell it."""
    names = model.names + ((INVERSE_STRENGTH,) if strength_unknown else ())
    columns = _columns(rows, model.middle)
    speed = _stribeck_velocity(rows, names, columns) if model.law == "stribeck" else 0.0
    if speed:
        columns |= _rise(rows, speed)
    elif model.law == "load":
        columns |= {"load_coefficient": _load_size(rows, names, columns) * rows.direction}
    linear = [name for name in names if name != "stribeck_velocity"]
    values, residual = _solve(rows, linear, columns)
    named = dict(zip(linear, values, strict=True))
    if speed:
        named["stribeck_velocity"] = speed
        rise = named["static_friction"] - named["coulomb_friction"]
        columns["stribeck_velocity"] = rise * columns["steepening"]
    jacobian = np.stack([columns[name] for name in names], axis=1)
    return Fit(model, names, np.array([named[name] for name in names]), jacobian, residual, rows)


def fit_with_column(fit: Fit, name: str, column: np.ndarray) -> Fit:
    """Fit the equation of `fit` again by least squares with one more parameter; column: its derivative, shape (R,)."""
    torque = fit.jacobian @ fit.values + fit.residual
    jacobian = np.column_stack([fit.jacobian, column])
    values = np.linalg.lstsq(jacobian, torque, rcond=None)[0]
    residual = torque - jacobian @ values
    names = (*fit.names, name)
    return replace(fit, names=names, values=values, jacobian=jacobian, residual=residual)


def fit_at(rows: Rows, model: Model, values: Mapping[str, float]) -> Fit:
    """Return an equation at the values of a simulation, zero where it has none, as if fitted to the rows."""
    values = dict.fromkeys(model.names, 0.0) | dict(values)
    columns = _columns(rows, model.middle)
    if model.law == "stribeck":
        columns |= _rise(rows, values["stribeck_velocity"])
        rise = values["static_friction"] - values["coulomb_friction"]
        columns["stribeck_velocity"] = rise * columns["steepening"]
    elif model.law == "load":
        columns["load_coefficient"] = _load(rows, values, columns) * rows.direction
    jacobian = np.stack([columns[name] for name in model.names], axis=1)
    # A placeholder for the residual, which the prediction of the fit gives.
    fit = Fit(model, model.names, np.array([values[name] for name in model.names]), jacobian, rows.torque, rows)
    return replace(fit, residual=rows.torque - predict_torque(fit, rows))


def predict_torque(fit: Fit, rows: Rows) -> np.ndarray:
    """Return the torque that a fit predicts on rows, which it need not have seen [N m], shape (num_rows,)."""
    values, columns = fit.by_name, _columns(rows, fit.model.middle)
    if fit.model.law == "stribeck":
        columns |= _rise(rows, values["stribeck_velocity"])
    elif fit.model.law == "load":
        columns |= {"load_coefficient": _load(rows, values, columns) * rows.direction}
    # Where 1/k is a parameter the payload is its column.
    payload = 0.0 if INVERSE_STRENGTH in values else rows.payload
    terms = (parameter * columns[name] for name, parameter in values.items() if name != "stribeck_velocity")
    return payload + sum(terms, np.zeros(len(rows)))


def rigid_torque(fit: Fit, rows: Rows) -> np.ndarray:
    """Return the part of the predicted torque that is not friction: inertia, offset, gravity, payload [N m]."""
    columns = _columns(rows)
    payload = 0.0 if INVERSE_STRENGTH in fit.names else rows.payload
    rigid = ("inertia", "offset", *GRAVITY_TERMS, INVERSE_STRENGTH)
    return payload + sum(
        (value * columns[name] for name, value in fit.by_name.items() if name in rigid), np.zeros(len(rows))
    )


def check_fit(source: str, fit: Fit) -> None:
    """Raise `LogError` if the motion does not tell inertia, viscous and dry friction apart; source: name for messages.

    Also if the link's gravity cannot be told from the payload's in any run that was fitted.
    """
    # Not `>=`, which is false for NaN.
    if not fit.inflation.get(INVERSE_STRENGTH, 0.0) < MAX_INFLATION:
        raise LogError(
            f"{source}: the payload's weight cannot be told from the link's own, so the motor strength and the inertia "
            "are not known; log once without the payload as well and give that log with --repeat"
        )
    worst = max(("inertia", "viscous_friction", "coulomb_friction"), key=lambda name: fit.inflation[name])
    if not fit.inflation[worst] < MAX_INFLATION:
        raise PoorMotion(
            source,
            f"{worst} cannot be told from the other parameters (its share of the motion is "
            f"1/{fit.inflation[worst]:.3g} of "
            f"its own, at least 1/{MAX_INFLATION:.0f} is needed)",
            "use at least two frequencies and both directions",
        )


def check_rows(source: str, rows: Rows, prepared: Prepared) -> None:
    """Raise `LogError` for too few rows; prepared: the signals that they were taken from."""
    if len(rows) < FEWEST_ROWS:
        raise PoorMotion(
            source,
            f"{len(rows)} samples are left, at least {FEWEST_ROWS} are needed: {prepared.left_over}",
            prepared.remedy,
        )


def _columns(rows: Rows, middle: float = 0.0) -> dict[str, np.ndarray]:
    """Return the derivative of the torque by every parameter that enters linearly, shape (R,) each; middle: θ_m."""
    return {
        "inertia": rows.acceleration,
        "viscous_friction": rows.velocity,
        "coulomb_friction": rows.direction,
        "offset": np.ones(len(rows)),
        "viscous_friction_forward": np.clip(rows.velocity, 0.0, None),
        "viscous_friction_backward": np.clip(rows.velocity, None, 0.0),
        "coulomb_friction_forward": np.clip(rows.direction, 0.0, None),
        "coulomb_friction_backward": np.clip(rows.direction, None, 0.0),
        "effort_coefficient": rows.direction * np.abs(rows.torque),
        # Rows are of a joint in motion.
        "static_friction": np.zeros(len(rows)),
        "gravity_sin": np.sin(rows.position),
        "gravity_cos": np.cos(rows.position),
        "position_slope": rows.direction * (rows.position - middle),
        "position_curvature": rows.direction * (rows.position - middle) ** 2,
        INVERSE_STRENGTH: rows.payload,
    }


def _solve(rows: Rows, names: list[str], columns: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares parameters and the residual torque; a payload whose 1/k is not asked for is known."""
    torque = rows.torque if INVERSE_STRENGTH in names else rows.torque - rows.payload
    regressor = np.stack([columns[name] for name in names], axis=1)
    values = np.linalg.lstsq(regressor, torque, rcond=None)[0]
    return values, torque - regressor @ values


def _load_size(rows: Rows, names: tuple[str, ...], columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return the size of the load that the gear carries, gravity and what is known from outside, shape (R,)."""
    trial = dict(columns)
    load = np.abs(rows.load)
    for _ in range(LOAD_ROUNDS):
        trial["load_coefficient"] = load * rows.direction
        values = dict(zip(names, _solve(rows, list(names), trial)[0], strict=True))
        load = _load(rows, values, columns)
    return load


def _load(rows: Rows, values: dict[str, float], columns: dict[str, np.ndarray]) -> np.ndarray:
    """Return |gravity + known load| for fitted parameters, in the torque's unit, shape (R,)."""
    gravity = sum(values[name] * columns[name] for name in GRAVITY_TERMS if name in values)
    return np.abs(gravity + rows.load * values.get(INVERSE_STRENGTH, 1.0))


def _rise(rows: Rows, speed: float) -> dict[str, np.ndarray]:
    """Return the columns of the Stribeck law at v_s = speed [rad/s], and the derivative by v_s over b_s - b_c."""
    rise = np.exp(-((rows.velocity / speed) ** 2))
    return {
        "coulomb_friction": rows.direction * (1 - rise),
        "static_friction": rows.direction * rise,
        "steepening": rows.direction * rise * 2 * rows.velocity**2 / speed**3,
    }


def _stribeck_velocity(rows: Rows, names: tuple[str, ...], columns: dict[str, np.ndarray]) -> float:
    """Return the Stribeck velocity that leaves the least torque unexplained [rad/s].

    It is searched between the 5th percentile of the speed and half of the top speed.
    """
    # Imported here, for it takes long and few logs need it.
    from scipy.optimize import minimize_scalar

    # All else is linear and solved for at each v_s, so that the search has one unknown. It finds one valley only: a
    # grid says which.
    linear = [name for name in names if name != "stribeck_velocity"]

    def cost(logarithm: float) -> float:
        return float(np.sum(_solve(rows, linear, columns | _rise(rows, float(np.exp(logarithm))))[1] ** 2))

    speeds = np.abs(rows.velocity)
    low, high = float(np.quantile(speeds, 0.05)), 0.5 * float(speeds.max())
    tried = np.linspace(np.log(min(low, 0.5 * high)), np.log(high), SPEEDS)
    best = int(np.argmin([cost(speed) for speed in tried]))
    ends = tried[max(best - 1, 0)], tried[min(best + 1, SPEEDS - 1)]
    return float(np.exp(minimize_scalar(cost, bounds=ends, method="bounded", options={"xatol": 1e-3}).x))
