"""Parameters that a log identifies: in SI units where the torque's unit is known, otherwise in units of k.

A log of positions and targets alone stays the same if I, B, f, the offset, gravity and the motor strength k all grow
by the same factor: the motion shows I/k, f/k and (B + k·kd)/k, and nothing else. A known payload breaks the tie, for
its weight does not grow with k, and so does a known torque from outside; measured torque does too, if its unit is N m.

The brake of a motor by voltage, kt ke/R, looks like viscous friction. Two sources identify it where the user does not
state it: a known weight, which gives kt/R, and with R so kt and ke; and runs of one joint with and without the
current, of which only those without it have the brake in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.files.joints import BRAKE, PARAMETERS, Estimate
from stiction.identification.prepare import Rows
from stiction.identification.regression import INVERSE_STRENGTH, MAX_INFLATION, Fit, fit_with_column
from stiction.identification.runs import Run
from stiction.identification.setup import BACK_EMF_ERROR

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
"""Combination in place of B/k where the controller's damping was not measured."""

STRENGTH_ERROR = 0.005
"""Share of k by which an interval from torque regression is widened: noisy regressors bias k beyond its scatter."""

HOLDING = "holding torque at mid-range"
"""Offset and gravity together, in the middle of the range: known even where the two cannot be told apart."""


@dataclass(frozen=True)
class Strength:
    """Estimate of k, torque delivered over the torque that the estimators saw."""

    value: Estimate | None
    """k, or None where it is not known."""
    source: str
    """`measured`, `declared`, `known_load` or `unknown`."""


def strength_identified(fit: Fit) -> bool:
    """Return True if a fit with 1/k identifies it: apart from the other parameters, and not zero."""
    inverse = fit.estimates()[INVERSE_STRENGTH]
    return fit.inflation[INVERSE_STRENGTH] < MAX_INFLATION and inverse.interval95[0] > 0


def find_strength(fit: Fit, measured: bool, calibrated: bool, declared: float | None) -> Strength:
    """Return k and its source: torque in N m, the user's statement, or a known load that the fit could tell."""
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
    """Return an estimate of an exactly known number."""
    return Estimate(value, 0.0, (value, value))


def combine(
    fit: Fit, estimates: dict[str, Estimate], strength: Strength, damping: float, middle: float
) -> tuple[dict[str, Estimate | None], dict[str, Estimate]]:
    """Return the parameters of a symmetric fit, None where the log does not tell, and the known combinations.

    estimates: the fit's estimates, their intervals widened where need be; damping: kd where the torque came from the PD
    law, which is then stated together with B/k, else 0; middle: θ in mid-range [rad].
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
        from_value = abs(estimate.interval95[side] - estimate.value) * factor.value
        from_factor = abs(factor.interval95[side if value >= 0 else 1 - side] - factor.value) * abs(estimate.value)
        reaches.append(float(np.hypot(from_value, from_factor)))
    std = float(np.hypot(estimate.std * factor.value, factor.std * estimate.value))
    return Estimate(value, std, (value - reaches[0], value + reaches[1]))


def holding_torque(fit: Fit, angle: float) -> Estimate:
    """Return the torque that holds the link at an angle [rad], offset and gravity together, in the fit's unit."""
    weights = {"offset": 1.0, "gravity_sin": np.sin(angle), "gravity_cos": np.cos(angle)}
    return fit.combination(weights, "offset")


def missing_experiment(strength: Strength, measured: bool, lacking: tuple[str, ...] = ()) -> str | None:
    """Return the experiment that would identify what this log does not, or None where nothing is missing.

    lacking: missing flags that convert a current, a voltage or a duty to torque.
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
    """Fit the torque equation with θ as a further regressor; fit: the one without θ.

    A torque that follows the position hides in the inertia, for θ'' and θ are opposite in a sine, and leaves a residual
    that looks harmless. Returns `slope` and `std`, torque over position and its deviation [N m/rad], and `changes`:
    relative changes of inertia, viscous and Coulomb friction [1].
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


OVER_STRENGTH = f"({BRAKE})/k"
"""Combination in place of B/k where the brake is in it."""

VISCOUS = "viscous_friction"


@dataclass(frozen=True)
class BackEmf:
    """Back-EMF constant estimated from the data."""

    ke: float
    """Back-EMF constant [V s/rad]."""
    source: str
    """`weight` or `runs`."""
    reach: float = 0.0
    """Half-width of the brake's 95 % interval, in the unit of the torque over speed; 0 where it was not estimated."""


def find_back_emf(runs: Sequence[Run], base: Fit) -> BackEmf | None:
    """Return ke where the user did not state it and the data tell it, else None; base: the fit to all runs."""
    setup = runs[0].setup
    driven = [run.setup.drive.by_voltage for run in runs]
    if not any(driven) or any(run.setup.ke is not None for run in runs):
        return None
    if setup.drive.brakes_unseen:
        resistance = setup.resistance
        if resistance is None or INVERSE_STRENGTH not in base.names or not strength_identified(base):
            return None
        return BackEmf(resistance / base.by_name[INVERSE_STRENGTH], "weight")
    factor = next(run.setup.drive.per_unit for run, by_voltage in zip(runs, driven) if by_voltage)
    if all(driven) or factor is None:
        return None
    rows = base.rows
    # One further column, the speed in runs by voltage alone: their braking beyond that of the other runs is the error
    # of the brake that was subtracted.
    inside = sum((rows.run == index) * 1.0 for index, by_voltage in enumerate(driven) if by_voltage)
    both = fit_with_column(base, "brake", rows.velocity * inside)
    change = both.scatter()["brake"]
    taken = next(run.setup.drive.brake for run, by_voltage in zip(runs, driven) if by_voltage)
    reach = (change.interval95[1] - change.interval95[0]) / 2
    # A brake that is not known better than the user's word leaves that standing.
    if both.inflation["brake"] >= MAX_INFLATION or reach > BACK_EMF_ERROR * taken or taken + change.value <= 0:
        return None
    return BackEmf((taken + change.value) / factor, "runs", reach)


@dataclass(frozen=True)
class Braking:
    """Effect of a voltage-driven motor's brake on viscous friction."""

    reach: float
    """Widening of the interval of viscous friction, in the unit of the torque over speed."""
    brake: float
    """Brake that was subtracted [the same unit]; 0 where it is not known."""
    source: str | None
    """Source of ke: `kt`, `ke`, `weight`, `runs`; None where it is not known."""

    def widened(self, name: str, estimate: Estimate) -> Estimate:
        """Return an estimate of viscous friction, its interval widened by the uncertainty of the brake."""
        if not name.startswith(VISCOUS):
            return estimate
        low, high = estimate.interval95
        std = (estimate.std**2 + (self.reach / 2) ** 2) ** 0.5
        return Estimate(estimate.value, std, (low - self.reach, high + self.reach))

    def scaled(self, factor: float) -> Braking:
        """Return the same effect in another unit of the torque."""
        return replace(self, reach=factor * self.reach, brake=factor * self.brake)

    @property
    def unseen(self) -> bool:
        """True if no brake was subtracted."""
        return self.source is None


def braking(run: Run, back_emf: BackEmf | None) -> Braking | None:
    """Return the treatment of the brake of a run's motor; None for a motor that is not driven by voltage."""
    drive = run.setup.drive
    if not drive.by_voltage:
        return None
    if drive.brakes_unseen:
        return Braking(0.0, 0.0, None)
    if back_emf is not None:
        reach = back_emf.reach if back_emf.source == "runs" else BACK_EMF_ERROR * drive.brake
        return Braking(reach, drive.brake, back_emf.source)
    return Braking(BACK_EMF_ERROR * drive.brake, drive.brake, "kt" if drive.ke is None else "ke")


def split_viscous(brake: Braking, viscous: Estimate, strength: Strength) -> tuple[Estimate | None, dict[str, Estimate]]:
    """Return viscous friction, None where it is not told from the brake, and the known combinations of the two.

    viscous: as fitted, in the unit of the torque.
    """
    known, whole = strength.value, shifted(viscous, brake.brake)
    separate = None if brake.unseen else brake.widened(VISCOUS, viscous)
    if separate is not None and separate.interval95[0] <= 0:
        separate = None
    if known is None:
        return None, {OVER_STRENGTH: whole} if separate is None else {OVER_STRENGTH: whole, OVER_K[VISCOUS]: separate}
    return None if separate is None else product(separate, known), {BRAKE: product(whole, known)}


def brake_summary(brake: Braking, stated: dict[str, Estimate], strength: Strength) -> dict[str, Any]:
    """Return the treatment of the brake for JSON, in SI units where they are known; stated: combinations."""
    factor = 1.0 if strength.value is None else strength.value.value
    name = OVER_STRENGTH if strength.value is None else BRAKE
    return {
        "source": brake.source,
        "brake": None if brake.unseen else brake.brake * factor,
        "reach": brake.reach * factor,
        "name": name,
        "together": stated[name].value,
    }


ORIGIN = {
    "kt": "ke = kt",
    "ke": "ke as given",
    "weight": "ke = kt = R times kt/R by the known weight",
    "runs": "ke by the runs whose current was logged",
}
"""Source of ke, in words."""


def brake_text(data: dict[str, Any], separable: bool) -> str:
    """Describe the treatment of the brake; data: `brake_summary`; separable: True if viscous friction is stated."""
    whole = data["together"]
    if data["source"] is None:
        return (
            "viscous friction is not known: a motor driven by voltage brakes itself by kt·ke/R, which looks the same "
            f"at every supply voltage; {data['name']} = {whole:.3g} is known. Give --kt and --resistance (ke is kt "
            "then) or --set ke, or log the current too and give both runs to one fit (--torque-column in their "
            "sidecars)"
        )
    share = data["brake"] / whole if whole > 0 else float("inf")
    description = (
        f"the motor brakes itself by kt·ke/R = {data['brake']:.3g}, {share:.0%} of {data['name']} "
        f"({ORIGIN[data['source']]})"
    )
    if separable:
        return f"{description}; that was taken off viscous friction, whose interval admits {data['reach']:.2g} of it"
    return (
        f"viscous friction is not known: {description}, and what is left is no more than that may be off by "
        f"({data['reach']:.2g}; resistance alone grows by a tenth in 25 K); log the current too "
        "(--torque-column current)"
    )
