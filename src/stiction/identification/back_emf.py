"""The brake of a motor by voltage, kt ke/R, apart from viscous friction: where the data tell it, and what is said.

Two sources beside the user's word: a known weight, which tells kt/R, and with R so kt and ke; and runs of one joint
with and without the current, of which only those without it have the brake in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from stiction.files.joints import Estimate
from stiction.identification.combinations import OVER_K, Strength, product, shifted, strength_identified
from stiction.identification.drive import BACK_EMF_ERROR, BRAKE
from stiction.identification.regression import INVERSE_STRENGTH, MAX_INFLATION, Fit, fit_with_column
from stiction.identification.runs import Run

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
