"""Choice of the friction law: the simplest that no richer one beats beyond noise.

A law is judged on parts of the log that its fit did not see, and by the Bayesian information criterion with as many
samples as are independent: here by torque regression, where the loop is known by simulation (`simulated_choice`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.identification.consistency import MIN_EVIDENCE, Gain, evidence_of, gain_of
from stiction.identification.intervals import block_count
from stiction.identification.model import GRAVITY_TERMS, LAWS, Law, Model
from stiction.identification.prepare import Rows
from stiction.identification.regression import MAX_INFLATION, Fit, fit_rows, predict_torque
from stiction.identification.runs import Run

FOLDS = 10
"""Number of blocks in cross-validation; one is left out at a time."""

MAX_GRAVITY_INFLATION = 30.0
"""Inflation of the gravity terms above which the load that they stand for is not known."""

SIMULATED = ("breakaway", "effort")
"""Laws that only simulation can choose: rows hold motion alone, and the motor's torque is what they explain."""

LAW_PARAMETER_SUFFIXES = ("friction", "_forward", "_backward", "stribeck_velocity", "coefficient", "slope", "curvature")
"""Endings of the names of friction parameters."""

NOT_NEGATIVE = ("viscous", "coulomb", "load", "static")
"""Beginnings of the names of friction parameters; a law with one below zero is not chosen."""


@dataclass(frozen=True)
class Candidate:
    """Result of one candidate law."""

    law: Law
    """The law."""
    parameters: int
    """Number of its parameters."""
    held_out: float
    """Torque error on blocks that the fit did not see, over the torque [1]."""
    gain: float
    """Reduction of the simplest law's held-out squared error, as a share of it; negative is worse."""
    gain_std: float
    """Standard deviation of the gain, from the scatter of the blocks."""
    evidence: float
    """Information criterion of the simplest law less that of this one; positive speaks for this law."""
    verdict: str
    """`chosen`, or the reason why not, in words."""


@dataclass(frozen=True)
class Choice:
    """Chosen friction law and its candidates."""

    model: Model
    """Model with the chosen law."""
    candidates: tuple[Candidate, ...]
    """All candidates, the simplest first."""

    @property
    def law(self) -> Law:
        """Name of the chosen law."""
        return self.model.law

    @property
    def text(self) -> str:
        """Sentence for people about the choice."""
        if self.law == "coulomb":
            return "No richer law than viscous and Coulomb friction predicts unseen blocks better beyond noise."
        chosen = next(candidate for candidate in self.candidates if candidate.law == self.law)
        return (
            f"The {self.law} law was chosen: on blocks that the fit did not see its squared error is {chosen.gain:.0%} "
            f"(± {chosen.gain_std:.0%}) lower than that of viscous and Coulomb friction."
        )


def choose_law(rows: Rows, base: Fit, strength_unknown: bool = False) -> Choice:
    """Choose among the laws that the log can distinguish; base: the fit of viscous and Coulomb friction."""
    gravity = base.model.gravity
    middle = float(rows.position.min() + rows.position.max()) / 2
    loaded = gravity or np.ptp(rows.load) > 0
    laws = [law for law in LAWS if law not in SIMULATED and (law != "load" or loaded)]
    fold = rows.blocks(min(FOLDS, block_count(base.residual)))
    fits: dict[Law, Fit] = {"coulomb": base}
    fits |= {law: fit_rows(rows, Model(law, gravity, middle), strength_unknown) for law in laws[1:]}
    errors = {law: _held_out(rows, fit.model, strength_unknown, fold) for law, fit in fits.items()}
    gains = {law: gain_of(errors[law], errors["coulomb"]) for law in laws}
    evidence = {
        law: evidence_of([base.residual], [fit.residual], len(fit.names) - len(base.names)) for law, fit in fits.items()
    }
    objections = {law: _objection(rows, fits[law], base, gains[law], evidence[law]) for law in laws}
    admissible = [law for law in laws if not objections[law]] or ["coulomb"]
    best = min(admissible, key=lambda law: errors[law].sum())
    chosen, reasons = settle(admissible, best, lambda law: gain_of(errors[best], errors[law]), objections)
    size = float(np.sum(rows.torque**2))
    candidates = tuple(
        Candidate(
            law=law,
            parameters=len(fits[law].names),
            held_out=float(np.sqrt(errors[law].sum() / size)),
            gain=gains[law].mean,
            gain_std=gains[law].std,
            evidence=evidence[law],
            verdict=reasons[law],
        )
        for law in laws
    )
    return Choice(fits[chosen].model, candidates)


def settle(
    admissible: Sequence[Law], best: Law, gain: Callable[[Law], Gain], objections: Mapping[Law, str]
) -> tuple[Law, dict[Law, str]]:
    """Return the simplest law that the best one does not beat beyond noise, and the verdict on each law.

    admissible: in the order of their number of parameters; gain: of the best over a law; objections: law -> why it
    cannot be chosen, empty where it can.
    """
    chosen = next(law for law in admissible if law == best or not gain(law).certain)
    unbeaten = "no simpler law is as good, and this one is not beyond it"
    verdicts = {law: objections[law] or unbeaten for law in objections}
    verdicts |= {"coulomb": "predicts as well as any richer law" if chosen == "coulomb" else "beaten"}
    return chosen, verdicts | {chosen: "chosen"}


def _held_out(rows: Rows, model: Model, strength_unknown: bool, fold: np.ndarray) -> np.ndarray:
    """Return the squared torque error on each block, predicted by the fit to all the others; shape (num_blocks,)."""
    errors = []
    for block in np.unique(fold):
        unseen = rows.take(fold == block)
        fit = fit_rows(rows.take(fold != block), model, strength_unknown)
        errors.append(float(np.sum((unseen.torque - predict_torque(fit, unseen)) ** 2)))
    return np.array(errors)


@dataclass(frozen=True)
class GravityChoice:
    """Choice between a model with and without gravity."""

    chosen: bool
    """True if gravity is fitted."""
    gain: Gain | None
    """Reduction of the held-out squared error; None where gravity and inertia cannot be told apart."""

    @property
    def text(self) -> str:
        """Sentence for people about the choice."""
        if self.gain is None:
            return "gravity was not fitted: in this motion it cannot be told from inertia or friction"
        lower = f"on blocks that the fit did not see it lowers the squared error by {self.gain.mean:.0%}"
        return f"gravity was {'' if self.chosen else 'not '}fitted: {lower} (± {self.gain.std:.0%})"


def choose_gravity(run: Run) -> GravityChoice | None:
    """Choose by held-out error whether to fit gravity; None where the user stated it.

    A choice is made for a rotary joint without a stated load, or with a load that may or may not be a weight. A known
    payload already is gravity, and could not be told from more of it.
    """
    setup = run.setup
    stated = setup.gravity is not None or setup.test_condition not in (None, "loaded")
    if stated or setup.axis == "linear" or setup.payload is not None:
        return None
    plain, heavy = (fit_rows(run.rows, Model("coulomb", gravity)) for gravity in (False, True))
    if max(heavy.inflation[name] for name in ("inertia", "viscous_friction", "coulomb_friction")) >= MAX_INFLATION:
        return GravityChoice(False, None)
    fold = run.rows.blocks(min(FOLDS, block_count(heavy.residual)))
    gain = gain_of(*(_held_out(run.rows, fit.model, False, fold) for fit in (heavy, plain)))
    evidence = evidence_of([plain.residual], [heavy.residual], len(GRAVITY_TERMS))
    return GravityChoice(gain.certain and evidence >= MIN_EVIDENCE, gain)


def _objection(rows: Rows, fit: Fit, base: Fit, gain: Gain, evidence: float) -> str:
    """Return the reason why a law cannot be chosen, empty where it can."""
    if fit is base:
        return ""
    values = fit.by_name
    unidentified = [
        name for name in fit.names if name.endswith(LAW_PARAMETER_SUFFIXES) and fit.inflation[name] > MAX_INFLATION
    ]
    if unidentified:
        return f"the motion does not tell {unidentified[0]}"
    if fit.model.law == "stribeck" and values["static_friction"] <= values["coulomb_friction"]:
        return "friction does not rise toward rest"
    if fit.model.law == "load" and not load_known(fit):
        return LOAD_UNKNOWN
    if negative := negative_friction(values):
        return negative
    if fit.model.law == "position" and _least_friction(fit, rows) < 0:
        return "its friction would drive the joint"
    if not gain.certain:
        side = "lower" if gain.mean >= 0 else "higher"
        return f"held-out error {side} by {abs(gain.mean):.1%} ± {gain.std:.1%}: not beyond noise"
    if evidence < MIN_EVIDENCE:
        return f"the information criterion does not support it ({evidence:.1f}, at least {MIN_EVIDENCE:.0f})"
    return ""


LOAD_UNKNOWN = "over this range of angles gravity cannot be told from the offset, so the load is not known"


def load_known(fit: Fit) -> bool:
    """Return True if gravity is told from the offset well enough to be a load, or none is fitted."""
    return max(fit.inflation.get(name, 0.0) for name in GRAVITY_TERMS) <= MAX_GRAVITY_INFLATION


def negative_friction(values: Mapping[str, float]) -> str:
    """Describe the first friction parameter below zero among a law's values by name; empty where none is."""
    negative = [name for name, value in values.items() if name.startswith(NOT_NEGATIVE) and value < 0]
    return f"its friction would drive the joint: {negative[0]} is {values[negative[0]]:.3g}" if negative else ""


def _least_friction(fit: Fit, rows: Rows) -> float:
    """Return the least friction of a position law over the angles of the log [N m]."""
    values = fit.by_name
    away = np.linspace(rows.position.min(), rows.position.max(), 50) - fit.model.middle
    friction = values["coulomb_friction"] + values["position_slope"] * away + values["position_curvature"] * away**2
    return float(friction.min())
