"""Which friction law does the log call for? The simplest that no richer one beats beyond noise.

Never by training error, which a richer law always lowers: each law is fitted to all blocks of the log but one and
judged on the one left out, and by the Bayesian information criterion with as many samples as are independent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.identify.intervals import block_count, correlation_time
from stiction.identify.model import GRAVITY, LAWS, Law, Model
from stiction.identify.regression import LARGEST_INFLATION, Fit, fit_rows, predict_torque
from stiction.identify.rows import Rows

FOLDS = 10
"""Blocks of which one is left out at a time."""

DEVIATIONS = 2.0
"""Standard deviations by which the held-out error must fall for a richer law."""

LEAST_GAIN = 0.02
"""Share by which the held-out error must fall: less is not worth a parameter to anybody."""

LARGEST_BLUR = 30.0
"""Inflation of the gravity terms beyond which the load that they stand for is guesswork."""

LEAST_EVIDENCE = 6.0
"""Drop of the information criterion for a richer law; 6 is called strong."""


@dataclass(frozen=True)
class Candidate:
    """How one law fares."""

    law: Law
    """The law."""
    parameters: int
    """How many it has."""
    held_out: float
    """Torque not explained in blocks that the fit did not see, over the torque [1]."""
    gain: float
    """By how much it lowers the simplest law's held-out squared error, a share of it; negative is worse."""
    gain_std: float
    """Standard deviation of the gain, from the scatter of the blocks."""
    evidence: float
    """Information criterion of the simplest law less its own: positive speaks for it."""
    verdict: str
    """Chosen, or why not, in words."""


@dataclass(frozen=True)
class Choice:
    """The law that was chosen and what it was chosen from."""

    model: Model
    """Chosen."""
    candidates: tuple[Candidate, ...]
    """All that were tried, the simplest first."""
    by_simulation: bool = False
    """Whether it was a simulation of the loop that chose."""

    @property
    def law(self) -> Law:
        """Its law."""
        return self.model.law

    @property
    def text(self) -> str:
        """One sentence for people."""
        if self.law == "coulomb":
            return "No richer law than viscous and Coulomb friction predicts unseen blocks better beyond noise."
        chosen = next(candidate for candidate in self.candidates if candidate.law == self.law)
        if self.by_simulation:
            return (
                f"The {self.law} law was chosen: simulated in its loop, on halves of the log that the fit did not see, "
                f"its squared error is {chosen.gain:.0%} (± {chosen.gain_std:.0%}) lower than that of viscous and "
                "Coulomb friction. Torque regression, which leaves turning points out, does not see it."
            )
        return (
            f"The {self.law} law was chosen: on blocks that the fit did not see its squared error is {chosen.gain:.0%} "
            f"(± {chosen.gain_std:.0%}) lower than that of viscous and Coulomb friction."
        )


def choose_law(rows: Rows, base: Fit, strength_unknown: bool = False) -> Choice:
    """Choose among the laws that the log can tell; base: the fit of viscous and Coulomb friction."""
    gravity = base.model.gravity
    middle = float(rows.position.min() + rows.position.max()) / 2
    laws = [law for law in LAWS if law != "load" or gravity or np.ptp(rows.load) > 0]
    fold = rows.blocks(min(FOLDS, block_count(base.residual)))
    fits: dict[Law, Fit] = {"coulomb": base}
    fits |= {law: fit_rows(rows, Model(law, gravity, middle), strength_unknown) for law in laws[1:]}
    errors = {law: _held_out(rows, fit.model, strength_unknown, fold) for law, fit in fits.items()}
    objections = {law: _objection(rows, fits[law], base, errors[law], errors["coulomb"]) for law in laws}
    fair = [law for law in laws if not objections[law]] or ["coulomb"]
    best = min(fair, key=lambda law: errors[law].sum())
    chosen = next(law for law in fair if law == best or not gain_of(errors[best], errors[law]).certain)
    reasons = {law: objections[law] or "no simpler law is as good, and this one is not beyond it" for law in laws}
    reasons |= {"coulomb": "predicts as well as any richer law" if chosen == "coulomb" else "beaten"}
    reasons |= {chosen: "chosen"}
    size = float(np.sum(rows.torque**2))
    return Choice(
        fits[chosen].model,
        tuple(
            Candidate(
                law,
                len(fits[law].names),
                float(np.sqrt(errors[law].sum() / size)),
                gain_of(errors[law], errors["coulomb"]).mean,
                gain_of(errors[law], errors["coulomb"]).std,
                _evidence(fits[law], base),
                reasons[law],
            )
            for law in laws
        ),
    )


def with_loop(choice: Choice, model: Model, gain: Gain, evidence: float) -> Choice:
    """Return the choice with a law that a simulation of the loop calls for."""

    def told(entry: Candidate) -> Candidate:
        if entry.law == model.law:
            reason = "chosen by simulation, which sees the turning points"
            return replace(entry, gain=gain.mean, gain_std=gain.std, evidence=evidence, verdict=reason)
        return replace(entry, verdict="beaten") if entry.law == "coulomb" else entry

    return Choice(model, tuple(told(entry) for entry in choice.candidates), True)


@dataclass(frozen=True)
class Gain:
    """By how much a held-out squared error fell, as a share, with the deviation that the blocks' scatter gives it."""

    mean: float
    """The share by which it fell [1]."""
    std: float
    """Its deviation [1]."""

    @property
    def certain(self) -> bool:
        """Whether it is beyond noise and worth a parameter."""
        return self.mean > DEVIATIONS * self.std and self.mean > LEAST_GAIN


def gain_of(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors block by block; shape (num_blocks,) each."""
    shares = (reference - error) * len(error) / max(float(reference.sum()), 1e-300)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


def _held_out(rows: Rows, model: Model, strength_unknown: bool, fold: np.ndarray) -> np.ndarray:
    """Return the squared torque error on each block, predicted by the fit to all the others; shape (num_blocks,)."""
    errors = []
    for block in np.unique(fold):
        unseen = rows.take(fold == block)
        fit = fit_rows(rows.take(fold != block), model, strength_unknown)
        errors.append(float(np.sum((unseen.torque - predict_torque(fit, unseen)) ** 2)))
    return np.array(errors)


def _evidence(fit: Fit, base: Fit) -> float:
    """Return by how much the Bayesian information criterion falls from `base` to `fit`.

    Samples count by how many of them are independent, for the residual that has the longer memory.
    """
    independent = len(base.residual) / max(correlation_time(one.residual) for one in (fit, base))
    spread = float(np.sum(base.residual**2)) / max(float(np.sum(fit.residual**2)), 1e-300)
    more = len(fit.names) - len(base.names)
    return independent * float(np.log(spread)) - more * float(np.log(independent))


def _objection(rows: Rows, fit: Fit, base: Fit, error: np.ndarray, reference: np.ndarray) -> str:
    """Return why a law cannot be chosen, or nothing."""
    if fit is base:
        return ""
    found = dict(zip(fit.names, fit.values, strict=True))
    blurred = [name for name in fit.names if name.endswith(OF_LAWS) and fit.inflation[name] > LARGEST_INFLATION]
    if blurred:
        return f"the motion does not tell {blurred[0]}"
    if fit.model.law == "stribeck" and found["static_friction"] <= found["coulomb_friction"]:
        return "friction does not rise toward rest"
    if fit.model.law == "load" and max(fit.inflation.get(name, 0.0) for name in GRAVITY) > LARGEST_BLUR:
        return "over this range of angles gravity cannot be told from the offset, so the load is not known"
    if fit.model.law == "asymmetric":
        # The offset is half the difference of the two, so one of them may be below zero.
        driving = found["coulomb_friction_forward"] + found["coulomb_friction_backward"] < 0
    else:
        driving = any(found[name] < 0 for name in fit.names if name.startswith(("coulomb", "load", "static")))
    if driving:
        return "its friction would drive the joint"
    if fit.model.law == "position" and _least_friction(fit, rows) < 0:
        return "its friction would drive the joint"
    gain, evidence = gain_of(error, reference), _evidence(fit, base)
    if not gain.certain:
        way = "lower" if gain.mean >= 0 else "higher"
        return f"held-out error {way} by {abs(gain.mean):.1%} ± {gain.std:.1%}: not beyond noise"
    if evidence < LEAST_EVIDENCE:
        return f"the information criterion does not support it ({evidence:.1f}, at least {LEAST_EVIDENCE:.0f})"
    return ""


def _least_friction(fit: Fit, rows: Rows) -> float:
    """Return the least friction of a position law over the angles of the log [N m]."""
    found = dict(zip(fit.names, fit.values, strict=True))
    away = np.linspace(rows.position.min(), rows.position.max(), 50) - fit.model.middle
    friction = found["coulomb_friction"] + found["position_slope"] * away + found["position_curvature"] * away**2
    return float(friction.min())


OF_LAWS = ("friction", "_forward", "_backward", "stribeck_velocity", "coefficient", "slope", "curvature")
"""How the names of the friction laws' parameters end."""
