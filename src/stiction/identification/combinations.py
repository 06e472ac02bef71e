"""What a log can and cannot tell: parameters where the torque's unit is known, otherwise what they are in units of k.

A log of positions and targets alone stays the same if I, B, f, the offset, gravity and the motor strength k all grow
by the same factor: the motion shows I/k, f/k and (B + k·kd)/k, and nothing else. A known payload breaks the tie, for
its weight does not grow with k, and so does a known torque from outside; measured torque does too, if its unit is N m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.files.joints import PARAMETERS, Estimate
from stiction.identification.prepare import Rows
from stiction.identification.regression import INVERSE_STRENGTH, MAX_INFLATION, Fit, fit_with_column

OVER_K = {
    "inertia": "I/k",
    "viscous_friction": "B/k",
    "coulomb_friction": "f/k",
    "offset": "offset/k",
    "gravity_sin": "gravity_sin/k",
    "gravity_cos": "gravity_cos/k",
}
"""Parameter -> the combination that is known where k is not known."""

DAMPED = "(B + k·kd)/k"
"""What takes the place of B/k where the controller's damping was not measured."""

STRENGTH_ERROR = 0.005
"""Share of k by which its interval is widened where torque regression found it: noisy regressors bias it by more than
their scatter."""

HOLDING = "holding torque at mid-range"
"""Offset and gravity together, in the middle of the range: known even where the two are not told apart."""


@dataclass(frozen=True)
class Strength:
    """What is known of k, torque delivered over the torque that the estimators saw."""

    value: Estimate | None
    """k, or None where it is not known."""
    source: str
    """`measured`, `declared`, `known_load` or `unknown`."""


def strength_identified(fit: Fit) -> bool:
    """Return whether a fit with 1/k tells it: apart from the rest, and not zero."""
    inverse = fit.estimates()[INVERSE_STRENGTH]
    return fit.inflation[INVERSE_STRENGTH] < MAX_INFLATION and inverse.interval95[0] > 0


def find_strength(fit: Fit, measured: bool, calibrated: bool, declared: float | None) -> Strength:
    """Say where k comes from: torque in N m, the user's word, or a known load that the fit could tell."""
    if INVERSE_STRENGTH in fit.names:
        inverse = fit.estimates()[INVERSE_STRENGTH]
        if strength_identified(fit):
            # A reciprocal turns the interval's ends round.
            low, high = inverse.interval95
            more = STRENGTH_ERROR / inverse.value
            reached = (1 / high - more, 1 / low + more)
            return Strength(
                Estimate(1 / inverse.value, inverse.std / inverse.value**2 + more / 2, reached), "known_load"
            )
        return Strength(None, "unknown")
    if declared is not None:
        return Strength(exact(declared), "declared")
    return Strength(exact(1.0), "measured") if measured and calibrated else Strength(None, "unknown")


def exact(value: float) -> Estimate:
    """Return a number that is taken as known."""
    return Estimate(value, 0.0, (value, value))


def combine(
    fit: Fit, estimates: dict[str, Estimate], strength: Strength, damping: float, middle: float
) -> tuple[dict[str, Estimate | None], dict[str, Estimate]]:
    """Return the parameters of a symmetric fit, None where the log does not tell, and what it tells instead.

    estimates: the fit's estimates as they may be stated, their intervals widened where need be; damping: kd where the
    torque came from the PD law, else 0: B/k is then not said without it; middle: θ in mid-range [rad].
    """
    clear = [name for name in OVER_K if name in estimates and fit.inflation[name] < MAX_INFLATION]
    combinations: dict[str, Estimate] = {}
    parameters: dict[str, Estimate | None] = dict.fromkeys(PARAMETERS)
    for name in clear:
        if strength.value is None:
            damped = name == "viscous_friction" and damping > 0
            combinations[DAMPED if damped else OVER_K[name]] = shifted(estimates[name], damping if damped else 0.0)
        else:
            parameters[name] = product(estimates[name], strength.value)
    if "gravity_sin" in estimates:
        held = holding_torque(fit, middle)
        if strength.value is None:
            combinations[HOLDING + "/k"] = held
        else:
            combinations[HOLDING] = product(held, strength.value)
    return parameters, combinations


def shifted(estimate: Estimate, change: float) -> Estimate:
    """Return the estimate of the quantity plus an exactly known number."""
    low, high = estimate.interval95
    return Estimate(estimate.value + change, estimate.std, (low + change, high + change))


def product(estimate: Estimate, factor: Estimate) -> Estimate:
    """Return the estimate of a product; the relative errors of the two are taken as independent."""
    value = estimate.value * factor.value
    reaches = []
    for side in (0, 1):
        # Factors are positive. Of a negative value the lower end of the product comes from the factor's upper one.
        own = abs(estimate.interval95[side] - estimate.value) * factor.value
        others = abs(factor.interval95[side if value >= 0 else 1 - side] - factor.value) * abs(estimate.value)
        reaches.append(float(np.hypot(own, others)))
    std = float(np.hypot(estimate.std * factor.value, factor.std * estimate.value))
    return Estimate(value, std, (value - reaches[0], value + reaches[1]))


def holding_torque(fit: Fit, angle: float) -> Estimate:
    """Return the torque that holds the link at an angle [rad], offset and gravity together, in the fit's unit."""
    weights = {"offset": 1.0, "gravity_sin": np.sin(angle), "gravity_cos": np.cos(angle)}
    return fit.combination(weights, "offset")


def missing_experiment(strength: Strength, measured: bool, lacking: tuple[str, ...] = ()) -> str | None:
    """Return which experiment would tell what this log does not, or None where nothing is missing.

    lacking: flags without which a current, a voltage or a duty is no torque.
    """
    if strength.value is not None:
        return None
    if lacking:
        return (
            f"without {' and '.join(lacking)} the torque column is not in N m, so inertia and friction are known over "
            "k, N m per volt or ampere, only, and are null; give that, or hang all of a known weight on the joint "
            "(--pendulum-mass, --pendulum-length), which tells k"
        )
    what = "the torque column has no known unit" if measured else "positions and targets alone do not show the torque"
    return (
        f"{what}, so inertia and friction are known over the motor strength k only, and are null; hang a known mass on "
        "the link and log again (--payload-mass, --payload-distance, --payload-angle), or "
        + ("give the torque constant (--torque-scale)" if measured else "log the motor's torque in N m")
        + f"; --set motor_strength=1 takes the {'column to be in N m' if measured else 'commanded torque at its word'}"
    )


def position_torque(rows: Rows, fit: Fit) -> dict[str, Any]:
    """Fit the torque equation with θ beside its regressors; fit: the one without θ.

    A torque that follows the position hides in the inertia, for θ'' and θ are opposite in a sine, and leaves a residual
    that looks harmless. Returns `slope` and `std`, torque over position and its deviation [N m/rad], and `changes`: by
    how much inertia, viscous and Coulomb friction change with it, each over its value [1].
    """
    # About its mean, where the offset does not change with it.
    both = fit_with_column(fit, "slope", rows.position - rows.position.mean())
    changes = {
        name: float(value / before - 1)
        for name, value, before in zip(PARAMETERS[:3], both.values, fit.values)
        if before != 0
    }
    return {
        "slope": float(both.values[-1]),
        "std": float(np.sqrt(both.covariance[-1, -1])),
        "changes": changes,
    }
