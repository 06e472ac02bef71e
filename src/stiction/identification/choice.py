"""Choice of the friction law: the simplest that no richer one beats beyond noise.

A law is judged on parts of the log that its fit did not see, and by the Bayesian information criterion with as many
samples as are independent. Torque regression is asked first, with every law. It leaves out the samples around turning
points, where Stribeck's fall of friction with speed often lies; output error simulates them. So where the two
estimators disagree on friction, that law is fitted by simulation as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.identification.consistency import beyond_chance, disagreement
from stiction.identification.in_loop import InLoop, fit_in_loop, fit_late, respond
from stiction.identification.intervals import block_count, correlation_time
from stiction.identification.model import GRAVITY_TERMS, LAWS, Law, Model
from stiction.identification.output_error import OutputError
from stiction.identification.prepare import Rows
from stiction.identification.regression import MAX_INFLATION, Fit, fit_at, fit_rows, predict_torque
from stiction.identification.runs import Run

FOLDS = 10
"""Blocks of which one is left out at a time."""

DEVIATIONS = 2.0
"""Standard deviations by which the held-out error must fall for a richer law."""

MIN_GAIN = 0.02
"""Share by which the held-out error must fall: less is not worth a parameter to anybody."""

MAX_GRAVITY_INFLATION = 30.0
"""Inflation of the gravity terms beyond which the load that they stand for is guesswork."""

MIN_EVIDENCE = 6.0
"""Drop of the information criterion for a richer law; 6 is called strong."""

LAW_PARAMETER_SUFFIXES = ("friction", "_forward", "_backward", "stribeck_velocity", "coefficient", "slope", "curvature")
"""How the names of the friction laws' parameters end."""

NOT_NEGATIVE = ("viscous", "coulomb", "load", "static")
"""How the names of parameters begin that are friction: a law in which one is below zero is not chosen."""

MIN_STATIC_RATIO = 1.2
"""Static over Coulomb friction in simulation: a controller that holds its torque for 2 ms looks like a rise by a
tenth."""

BLOCKS_OF_HALF = 5
"""Blocks of a half of the log, whose scatter gives the deviation of the gain in simulation."""

START_STATIC_RATIO, START_STRIBECK_SHARE = 1.3, 0.1
"""Where the search by simulation begins: static over Coulomb friction, and v_s over the top speed."""


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
        return self.mean > DEVIATIONS * self.std and self.mean > MIN_GAIN


def gain_of(error: np.ndarray, reference: np.ndarray) -> Gain:
    """Compare squared errors block by block; shape (num_blocks,) each."""
    shares = (reference - error) * len(error) / max(float(reference.sum()), 1e-300)
    return Gain(float(shares.mean()), float(shares.std(ddof=1) / np.sqrt(len(shares))))


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

    def with_simulated_law(self, found: SimulatedLaw) -> Choice:
        """Return the choice with the law that simulation calls for in place of viscous and Coulomb friction."""
        chosen = {
            "gain": found.gain.mean,
            "gain_std": found.gain.std,
            "evidence": found.evidence,
            "verdict": "chosen by simulation, which sees the turning points",
        }
        changes: dict[Law, dict[str, Any]] = {"coulomb": {"verdict": "beaten"}, found.fit.model.law: chosen}
        candidates = tuple(replace(entry, **changes.get(entry.law, {})) for entry in self.candidates)
        return Choice(found.fit.model, candidates, True)

    def without_richer(self, base: Fit, reason: str) -> Choice:
        """Return the choice with viscous and Coulomb friction in place of the law that was chosen; reason: why."""
        changes: dict[Law, str] = {self.law: reason, "coulomb": "chosen, for the richer law cannot be"}
        candidates = tuple(replace(one, verdict=changes.get(one.law, one.verdict)) for one in self.candidates)
        return Choice(base.model, candidates)

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


@dataclass(frozen=True)
class SimulatedLaw:
    """A Stribeck law that simulation calls for."""

    found: OutputError
    """Output error with it."""
    fit: Fit
    """The same values as a torque equation, for prediction and figures."""
    gain: Gain
    """By how much it lowers the squared simulation error in halves that the fit did not see."""
    evidence: float
    """Drop of the information criterion."""


def choose_law(rows: Rows, base: Fit, strength_unknown: bool = False) -> Choice:
    """Choose among the laws that the log can tell; base: the fit of viscous and Coulomb friction."""
    gravity = base.model.gravity
    middle = float(rows.position.min() + rows.position.max()) / 2
    laws = [law for law in LAWS if law != "load" or gravity or np.ptp(rows.load) > 0]
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
    # The simplest that the best does not beat beyond noise: laws are in the order of their number of parameters.
    chosen = next(law for law in admissible if law == best or not gain_of(errors[best], errors[law]).certain)
    reasons = {law: objections[law] or "no simpler law is as good, and this one is not beyond it" for law in laws}
    reasons |= {"coulomb": "predicts as well as any richer law" if chosen == "coulomb" else "beaten"}
    reasons |= {chosen: "chosen"}
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


def _held_out(rows: Rows, model: Model, strength_unknown: bool, fold: np.ndarray) -> np.ndarray:
    """Return the squared torque error on each block, predicted by the fit to all the others; shape (num_blocks,)."""
    errors = []
    for block in np.unique(fold):
        unseen = rows.take(fold == block)
        fit = fit_rows(rows.take(fold != block), model, strength_unknown)
        errors.append(float(np.sum((unseen.torque - predict_torque(fit, unseen)) ** 2)))
    return np.array(errors)


def evidence_of(plain: Sequence[np.ndarray], rich: Sequence[np.ndarray], more: int) -> float:
    """Return by how much the Bayesian information criterion falls from a law to a richer one.

    plain, rich: residuals by either law of every signal, in the same order, shape (num_samples,) each, of the samples
    that count alone; more: the richer law's further parameters. Σ n ln(Σ r₀² / Σ r₁²) − more ln Σ n over the signals,
    where n counts independent samples, by the residual with the longer memory.
    """
    total, samples = 0.0, 0.0
    for before, after in zip(plain, rich, strict=True):
        independent = len(before) / max(correlation_time(before), correlation_time(after))
        total += independent * float(np.log(np.sum(before**2) / max(float(np.sum(after**2)), 1e-300)))
        samples += independent
    return total - more * float(np.log(samples))


@dataclass(frozen=True)
class GravityChoice:
    """Whether gravity pulls on the link, as the log says."""

    chosen: bool
    """Whether it is fitted."""
    gain: Gain | None
    """By how much it lowers the held-out squared error; None where gravity and inertia cannot be told apart."""

    @property
    def text(self) -> str:
        """One sentence for people."""
        if self.gain is None:
            return "gravity was not fitted: in this motion it cannot be told from inertia or friction"
        lower = f"on blocks that the fit did not see it lowers the squared error by {self.gain.mean:.0%}"
        return f"gravity was {'' if self.chosen else 'not '}fitted: {lower} (± {self.gain.std:.0%})"


def choose_gravity(run: Run) -> GravityChoice | None:
    """Say whether the log wants gravity, by held-out error; None where that was stated.

    It is asked where nobody said what hung on a rotary joint, and where it was loaded, which may or may not be by a
    weight. A known payload is gravity already, and would not be told from more of it.
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
    """Return why a law cannot be chosen, or nothing."""
    if fit is base:
        return ""
    found = fit.by_name
    unidentified = [
        name for name in fit.names if name.endswith(LAW_PARAMETER_SUFFIXES) and fit.inflation[name] > MAX_INFLATION
    ]
    if unidentified:
        return f"the motion does not tell {unidentified[0]}"
    if fit.model.law == "stribeck" and found["static_friction"] <= found["coulomb_friction"]:
        return "friction does not rise toward rest"
    if fit.model.law == "load" and max(fit.inflation.get(name, 0.0) for name in GRAVITY_TERMS) > MAX_GRAVITY_INFLATION:
        return "over this range of angles gravity cannot be told from the offset, so the load is not known"
    if negative := negative_friction(found):
        return negative
    if fit.model.law == "position" and _least_friction(fit, rows) < 0:
        return "its friction would drive the joint"
    if not gain.certain:
        side = "lower" if gain.mean >= 0 else "higher"
        return f"held-out error {side} by {abs(gain.mean):.1%} ± {gain.std:.1%}: not beyond noise"
    if evidence < MIN_EVIDENCE:
        return f"the information criterion does not support it ({evidence:.1f}, at least {MIN_EVIDENCE:.0f})"
    return ""


def negative_friction(values: Mapping[str, float]) -> str:
    """Return which friction of a law's values, by name, is below zero, in words; nothing where none is."""
    negative = [name for name, value in values.items() if name.startswith(NOT_NEGATIVE) and value < 0]
    return f"its friction would drive the joint: {negative[0]} is {values[negative[0]]:.3g}" if negative else ""


def _least_friction(fit: Fit, rows: Rows) -> float:
    """Return the least friction of a position law over the angles of the log [N m]."""
    found = fit.by_name
    away = np.linspace(rows.position.min(), rows.position.max(), 50) - fit.model.middle
    friction = found["coulomb_friction"] + found["position_slope"] * away + found["position_curvature"] * away**2
    return float(friction.min())


def choose_in_loop(run: Run, base: Fit, loop: InLoop) -> SimulatedLaw | None:
    """Return the Stribeck law if simulation calls for it; base and loop: the symmetric fits, which must disagree."""
    plain = loop.symmetric
    if plain is None:
        return None
    gaps = disagreement(base, plain.estimates)
    if not any(beyond_chance(gaps[name]) for name in ("viscous_friction", "coulomb_friction") if name in gaps):
        return None
    rich = replace(base, model=Model("stribeck", base.model.gravity))
    start = base.by_name | plain.values
    start["static_friction"] = START_STATIC_RATIO * start["coulomb_friction"]
    start["stribeck_velocity"] = START_STRIBECK_SHARE * float(np.quantile(np.abs(run.prepared.velocity), 0.99))
    found = fit_in_loop(run, rich, start)
    if found is None or not _rises(found) or negative_friction(found.values):
        return None
    # A late controller looks like friction that rises toward rest: if that explains the log better, it is that.
    late = fit_late(run, base, start)
    if late is not None and _misfit(late, plain) < _misfit(found, plain):
        return None
    gain = _gain_in_loop(run, base, rich, start)
    both = plain.counted & found.counted
    before, after = ([fit.residuals[name][both] for name in plain.residuals] for fit in (plain, found))
    evidence = evidence_of(before, after, len(rich.model.names) - len(base.model.names))
    if gain is None or not gain.certain or evidence < MIN_EVIDENCE:
        return None
    return SimulatedLaw(found, fit_at(base.rows, rich.model, start | found.values), gain, evidence)


def _rises(found: OutputError) -> bool:
    """Return whether friction at rest is above Coulomb friction, clearly."""
    static, coulomb = found.estimates["static_friction"], found.estimates["coulomb_friction"]
    return static.interval95[0] > coulomb.interval95[1] and static.value > MIN_STATIC_RATIO * coulomb.value


def _misfit(found: OutputError, plain: OutputError) -> float:
    """Return the squared error of a simulation, each signal in units of the symmetric law's."""
    return sum(
        float(np.sum(row**2) / max(float(np.sum(plain.residuals[name] ** 2)), 1e-300))
        for name, row in found.residuals.items()
    )


def _gain_in_loop(run: Run, base: Fit, rich: Fit, start: dict[str, float]) -> Gain | None:
    """Compare both laws on each half of the log, fitted to the other one; None where a half tells too little."""
    half, valid = run.signals.time < run.signals.time[-1] / 2, run.signals.valid
    errors: list[list[float]] = [[], []]
    # Fitted to `part`, judged in the other half.
    for part in (half, ~half):
        plain, richer = (fit_in_loop(run, fit, start, part) for fit in (base, rich))
        if plain is None or richer is None:
            return None
        sizes = {name: float(np.std(row[part & valid])) for name, row in plain.residuals.items()}
        blocks = np.array_split(np.flatnonzero(~part & valid), BLOCKS_OF_HALF)
        for model, found, own in zip((base.model, rich.model), (plain, richer), errors, strict=True):
            response = respond(run, model, found.values)
            rows = {name: getattr(response, name) - getattr(run.signals, name) for name in sizes}
            squares = sum((row / max(sizes[name], 1e-300)) ** 2 for name, row in rows.items())
            own += [float(np.sum(np.asarray(squares)[block])) for block in blocks]
    return gain_of(np.array(errors[1]), np.array(errors[0]))
