"""What a log can and cannot tell: parameters where the torque's unit is known, otherwise what they are in units of k.

A log of positions and targets alone stays the same if I, B, f, the offset, gravity and the motor strength k all grow
by the same factor: the motion shows I/k, f/k and (B + k·kd)/k, and nothing else. A known payload breaks the tie, for
its weight does not grow with k, and so does a known torque from outside; measured torque does too, if its unit is N m.

The brake of a motor by voltage, kt ke/R, looks like viscous friction. Beside the user's word two sources tell it: a
known weight, which tells kt/R, and with R so kt and ke; and runs of one joint with and without the current, of which
only those without it have the brake in them.
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


OVER_STRENGTH = f"({BRAKE})/k"
"""What takes the place of B/k where the brake is in it."""

VISCOUS = "viscous_friction"


@dataclass(frozen=True)
class BackEmf:
    """ke as the data show it, without the user saying it."""

    ke: float
    """[V s/rad]."""
    source: str
    """`weight` or `runs`."""
    reach: float = 0.0
    """Half-width of the 95 % interval of the brake, in the unit of the torque over speed; 0 where it was not found."""


def find_back_emf(runs: Sequence[Run], base: Fit) -> BackEmf | None:
    """Return ke where the user did not say it and the data tell it, else None; base: the fit to all runs."""
    setup = runs[0].setup
    driven = [one.setup.drive.by_voltage for one in runs]
    if not any(driven) or any(one.setup.ke is not None for one in runs):
        return None
    if setup.drive.brakes_unseen:
        resistance = setup.resistance
        if resistance is None or INVERSE_STRENGTH not in base.names or not strength_identified(base):
            return None
        return BackEmf(resistance / base.by_name[INVERSE_STRENGTH], "weight")
    factor = next(one.setup.drive.per_unit for one, by_voltage in zip(runs, driven) if by_voltage)
    if all(driven) or factor is None:
        return None
    rows = base.rows
    # One column more, the speed in runs by voltage alone: what they brake beyond the others is the error of the brake
    # that was taken off.
    inside = sum((rows.run == index) * 1.0 for index, by_voltage in enumerate(driven) if by_voltage)
    both = fit_with_column(base, "brake", rows.velocity * inside)
    change = both.scatter()["brake"]
    taken = next(one.setup.drive.brake for one, by_voltage in zip(runs, driven) if by_voltage)
    reach = (change.interval95[1] - change.interval95[0]) / 2
    # A brake that is not known better than the user's word leaves that standing.
    if both.inflation["brake"] >= MAX_INFLATION or reach > BACK_EMF_ERROR * taken or taken + change.value <= 0:
        return None
    return BackEmf((taken + change.value) / factor, "runs", reach)


@dataclass(frozen=True)
class Braking:
    """What becomes of viscous friction where a motor's brake is near it."""

    reach: float
    """By how much the interval of viscous friction is widened, in the unit of the torque over speed."""
    brake: float
    """What was taken off [the same]; 0 where that is not known."""
    source: str | None
    """Where ke is from: `kt`, `ke`, `weight`, `runs`; None where it is not known."""

    def widened(self, name: str, estimate: Estimate) -> Estimate:
        """Return an estimate of viscous friction that admits what is not known of the brake."""
        if not name.startswith(VISCOUS):
            return estimate
        low, high = estimate.interval95
        std = (estimate.std**2 + (self.reach / 2) ** 2) ** 0.5
        return Estimate(estimate.value, std, (low - self.reach, high + self.reach))

    def scaled(self, factor: float) -> Braking:
        """Return the same in another unit of the torque."""
        return replace(self, reach=factor * self.reach, brake=factor * self.brake)

    @property
    def unseen(self) -> bool:
        """Whether nothing was taken off."""
        return self.source is None


def braking(run: Run, found: BackEmf | None) -> Braking | None:
    """Return what was done about the brake of a run's motor; None for one that is not driven by voltage."""
    drive = run.setup.drive
    if not drive.by_voltage:
        return None
    if drive.brakes_unseen:
        return Braking(0.0, 0.0, None)
    if found is not None:
        reach = found.reach if found.source == "runs" else BACK_EMF_ERROR * drive.brake
        return Braking(reach, drive.brake, found.source)
    return Braking(BACK_EMF_ERROR * drive.brake, drive.brake, "kt" if drive.ke is None else "ke")


def split_viscous(found: Braking, viscous: Estimate, strength: Strength) -> tuple[Estimate | None, dict[str, Estimate]]:
    """Return viscous friction, None where it is not told from the brake, and what is known of the two besides.

    viscous: as fitted, in the unit of the torque.
    """
    known, whole = strength.value, shifted(viscous, found.brake)
    own = None if found.unseen else found.widened(VISCOUS, viscous)
    if own is not None and own.interval95[0] <= 0:
        own = None
    if known is None:
        return None, {OVER_STRENGTH: whole} if own is None else {OVER_STRENGTH: whole, OVER_K[VISCOUS]: own}
    return None if own is None else product(own, known), {BRAKE: product(whole, known)}


def brake_summary(found: Braking, stated: dict[str, Estimate], strength: Strength) -> dict[str, Any]:
    """Return what was done about the brake, in SI units where they are known, and in words; stated: combinations."""
    factor = 1.0 if strength.value is None else strength.value.value
    name = OVER_STRENGTH if strength.value is None else BRAKE
    return {
        "source": found.source,
        "brake": None if found.unseen else found.brake * factor,
        "reach": found.reach * factor,
        "name": name,
        "together": stated[name].value,
    }


ORIGIN = {
    "kt": "ke = kt",
    "ke": "ke as given",
    "weight": "ke = kt = R times kt/R by the known weight",
    "runs": "ke by the runs whose current was logged",
}
"""Where ke is from, in words."""


def brake_text(data: dict[str, Any], separable: bool) -> str:
    """Say what was done about the brake; data: `brake_summary`; separable: whether viscous friction is stated."""
    whole = data["together"]
    if data["source"] is None:
        return (
            "viscous friction is not known: a motor driven by voltage brakes itself by kt·ke/R, which looks the same "
            f"at every supply voltage; {data['name']} = {whole:.3g} is known. Give --kt and --resistance (ke is kt "
            "then) or --set ke, or log the current too and give both runs to one fit (--torque-column in their "
            "sidecars)"
        )
    share = data["brake"] / whole if whole > 0 else float("inf")
    said = (
        f"the motor brakes itself by kt·ke/R = {data['brake']:.3g}, {share:.0%} of {data['name']} "
        f"({ORIGIN[data['source']]})"
    )
    if separable:
        return f"{said}; that was taken off viscous friction, whose interval admits {data['reach']:.2g} of it"
    return (
        f"viscous friction is not known: {said}, and what is left is no more than that may be off by "
        f"({data['reach']:.2g}; resistance alone grows by a tenth in 25 K); log the current too "
        "(--torque-column current)"
    )
