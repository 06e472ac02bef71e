"""Choice of the friction law by simulation: the simplest that no richer one beats on held-out parts of the log.

The evidence of each law is first predicted from the derivatives of the symmetric law's simulation, all at once; the
laws that could be worth their parameters are then fitted, and judged by the information criterion and by leaving out
one block of the log at a time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stiction.identification.choice import FOLDS, LOAD_UNKNOWN, Candidate, Choice, load_known, negative_friction, settle
from stiction.identification.closed_loop import LoopError
from stiction.identification.consistency import MIN_EVIDENCE, evidence_of, gain_by_block
from stiction.identification.in_loop import TELLING, evidence_between, fit_in_loop
from stiction.identification.intervals import block_count
from stiction.identification.model import Law, Model
from stiction.identification.output_error import FEW_TRIALS, OutputError
from stiction.identification.regression import Fit, fit_at
from stiction.identification.runs import Run
from stiction.joints.variation import Segments

AT_NOISE = 1.15
"""Residual over the position's noise up to which no law has anything left to explain."""

MOST_TRIED, PROMISING = 2, 0.25
"""Most laws that are fitted, the most promising ones, and their least share of the best one's evidence."""

KEPT_PROMISE = 0.7
"""Evidence to first order, over that of a law which follows the log nearly to its noise, below which another law is
not fitted: fits reach their predicted evidence to a third."""

STRIBECK_SHARES = (0.01, 0.03, 0.1, 0.3)
"""Stribeck velocities over the top speed at which that law is screened."""

START_RISES = ((1.0, 1.3), (0.3, 1.5))
"""Friction in motion and at rest, over Coulomb friction of the symmetric law, at which a search begins."""

MUCH, MOST_AGAIN = 0.5, 2
"""Residual over that of the symmetric law below which a law explains much, and further searches for such a law."""

MIN_STATIC_RATIO = 1.05
"""Static over Coulomb friction above which a joint counts as held by more than brakes it in motion."""


@dataclass(frozen=True)
class _Screened:
    """First-order prediction of a law's benefit."""

    law: Law
    evidence: float
    """Drop of the information criterion."""
    start: Mapping[str, float]
    """Values of the law's parameters at which its search begins."""


def choose_simulated(run: Run, plain: OutputError, base: Fit) -> tuple[Choice, OutputError | None]:
    """Return the choice, and the simulation of a richer law where one was chosen.

    plain: output error with viscous and Coulomb friction; base: the regression with that law.
    """
    gravity, parameters = base.model.gravity, len(base.model.names)
    only = Candidate("coulomb", parameters, _share(run, plain), 0.0, 0.0, 0.0, "follows the log to its noise")
    if plain.rms <= AT_NOISE * run.prepared.noise:
        return Choice(base.model, (only,)), None
    screened = _screen(run, plain, base)
    fits, reasons = _fit(run, plain, base, screened)
    rows = {"coulomb": plain} | fits
    counted = np.logical_and.reduce([fit.counted for fit in rows.values()])
    fold = _folds(counted, plain)
    errors = {law: _left_out(fit, fold, counted) for law, fit in rows.items()}
    gains = {law: gain_by_block(errors[law], errors["coulomb"]) for law in rows}
    more = {law: len(Model(law, gravity).names) - parameters for law in rows}
    evidence = {law: evidence_between(plain, fit, more[law]) for law, fit in rows.items()}
    admissible = ["coulomb"]
    for law in sorted(fits, key=lambda law: (more[law], law)):
        if not gains[law].certain:
            reasons[law] = f"held-out error lower by {gains[law].mean:.1%} ± {gains[law].std:.1%}: not beyond noise"
        elif evidence[law] < MIN_EVIDENCE:
            reasons[law] = f"the information criterion does not support it ({evidence[law]:.1f})"
        else:
            admissible.append(law)
    best = max(admissible, key=lambda law: gains[law].mean)
    objections = {law: reasons.get(law, "") for law in rows}
    chosen, verdicts = settle(admissible, best, lambda law: gain_by_block(errors[best], errors[law]), objections)
    candidates = [
        Candidate(
            law=law,
            parameters=parameters + more[law],
            held_out=_share(run, fit),
            gain=gains[law].mean,
            gain_std=gains[law].std,
            evidence=evidence[law],
            verdict=verdicts[law],
        )
        for law, fit in rows.items()
    ]
    if chosen == "coulomb":
        return Choice(base.model, tuple(candidates)), None
    model, first = _model(run, base, chosen), fits[chosen]
    last = fit_in_loop(run, fit_at(base.rows, model, first.values), dict(first.values)) or first
    return Choice(model, tuple(candidates)), last


def _share(run: Run, fit: OutputError) -> float:
    """Return the residual of the position over the position's own deviation [1]."""
    return fit.rms / max(float(np.std(run.signals.position)), 1e-300)


def _model(run: Run, base: Fit, law: Law) -> Model:
    """Return the torque equation of a law for this log."""
    position = run.rows.position
    return Model(law, base.model.gravity, float(position.min() + position.max()) / 2)


def _screen(run: Run, plain: OutputError, base: Fit) -> list[_Screened]:
    """Return the first-order prediction of each law, the most promising first; empty where it is not known."""
    top = float(np.quantile(np.abs(run.prepared.velocity), 0.99))
    middle = _model(run, base, "position").middle
    groups: list[tuple[Law, int, tuple[str, ...]]] = [
        ("asymmetric", 1, ("viscous_friction_forward",)),
        ("effort", 1, ("effort_coefficient",)),
        ("position", 2, ("position_slope", "position_curvature")),
        *(("stribeck", 2, (f"{share}",)) for share in STRIBECK_SHARES),
    ]
    if base.model.gravity or np.ptp(run.rows.load) > 0:
        groups.append(("load", 1, ("load_coefficient",)))
    names = [name for _, _, parameters in groups for name in parameters]

    def torques(pieces: Segments, effort: np.ndarray) -> list[np.ndarray]:
        ones = np.ones_like(pieces.position)
        sign, away = pieces.sign * ones, pieces.position - middle
        known = {
            "viscous_friction_forward": -pieces.velocity * (pieces.sign > 0),
            "effort_coefficient": -sign * np.abs(effort),
            "position_slope": -sign * away,
            "position_curvature": -sign * away**2,
            "load_coefficient": -sign * np.abs(pieces.load),
        }
        known |= {f"{s}": -sign * np.exp(-((pieces.velocity / (s * top)) ** 2)) for s in STRIBECK_SHARES}
        return [known[name] for name in names]

    try:
        columns = plain.torque_columns(torques)
    except LoopError:
        return []
    rows, slopes = plain.position_rows()
    basis = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0).clip(1e-300))[0]
    left, columns = rows - basis @ (basis.T @ rows), columns - basis @ (basis.T @ columns)
    promising: dict[Law, _Screened] = {}
    for law, more, parameters in groups:
        places = [names.index(name) for name in parameters]
        values = np.linalg.lstsq(columns[:, places], -left, rcond=None)[0]
        after = left + columns[:, places] @ values
        evidence = evidence_of([left], [after], more)
        start = dict(zip(parameters, values.tolist(), strict=True))
        if law == "stribeck":
            start = {"stribeck_velocity": float(parameters[0]) * top}
        if law not in promising or evidence > promising[law].evidence:
            promising[law] = _Screened(law, evidence, start)
    return sorted(promising.values(), key=lambda law: -law.evidence)


def _fit(
    run: Run, plain: OutputError, base: Fit, screened: list[_Screened]
) -> tuple[dict[Law, OutputError], dict[Law, str]]:
    """Fit the promising laws; return those that a joint can have, and the reasons against the others."""
    fits: dict[Law, OutputError] = {}
    reasons: dict[Law, str] = {}
    reached = 0.0
    worth = [candidate for candidate in screened if candidate.evidence >= MIN_EVIDENCE]
    tried = [candidate for candidate in worth if candidate.evidence >= PROMISING * worth[0].evidence][:MOST_TRIED]
    rises = any(candidate.law == "stribeck" and candidate.evidence >= MIN_EVIDENCE for candidate in screened)
    if rises and any(phase.sign == 0 for phase in plain.response.motion.phases):
        tried.append(_Screened("breakaway", 0.0, {}))
    for candidate in tried:
        if candidate.law == "load" and not load_known(base):
            reasons[candidate.law] = LOAD_UNKNOWN
            continue
        if candidate.law != "breakaway" and candidate.evidence < KEPT_PROMISE * reached:
            continue
        fit = _search(run, plain, base, candidate)
        if fit is None:
            reasons[candidate.law] = "the simulation does not tell its parameters"
        elif negative := negative_friction(fit.values):
            reasons[candidate.law] = negative
        elif not _rises(fit):
            reasons[candidate.law] = "friction does not rise toward rest"
        else:
            fits[candidate.law] = fit
            if fit.rms <= TELLING * run.prepared.noise:
                more = len(fit.estimates) - len(plain.estimates)
                reached = max(reached, evidence_between(plain, fit, more))
    return fits, reasons


def _search(run: Run, plain: OutputError, base: Fit, screened: _Screened) -> OutputError | None:
    """Return the simulation of a law, from the first start that explains more than the symmetric law, else the last."""
    model, fit = _model(run, base, screened.law), None

    def follow(start: dict[str, float]) -> OutputError | None:
        return fit_in_loop(run, fit_at(base.rows, model, start), start, trials=FEW_TRIALS)

    for start in _starts(screened, base.by_name | plain.values, model):
        fit = follow(start)
        for _ in range(MOST_AGAIN):
            # One that explains much and not nearly all is on its way still.
            if fit is None or not TELLING * run.prepared.noise < fit.rms < MUCH * plain.rms:
                break
            fit = follow(fit.values) or fit
        if fit is not None and fit.rms < plain.rms:
            break
    return fit


def _starts(screened: _Screened, plain: Mapping[str, float], model: Model) -> list[dict[str, float]]:
    """Return values at which the search for a law begins; plain: those of viscous and Coulomb friction."""
    start = dict(plain) | dict(screened.start)
    coulomb, viscous = max(plain["coulomb_friction"], 1e-9), max(plain["viscous_friction"], 0.0)
    if screened.law == "asymmetric":
        half, offset = screened.start["viscous_friction_forward"] / 2, plain.get("offset", 0.0)
        start |= {"viscous_friction_forward": viscous + half, "viscous_friction_backward": viscous - half}
        start |= {"coulomb_friction_forward": coulomb + offset, "coulomb_friction_backward": coulomb - offset}
    if "static_friction" not in model.names:
        return [start]
    # Viscous and Coulomb friction are between what holds a joint at rest and what brakes it in motion.
    return [
        start | {"viscous_friction": viscous, "coulomb_friction": moving * coulomb, "static_friction": held * coulomb}
        for moving, held in START_RISES
    ]


def _rises(fit: OutputError) -> bool:
    """Return True unless friction at rest is estimated, and is not clearly above friction in motion."""
    if "static_friction" not in fit.estimates:
        return True
    static, coulomb = fit.estimates["static_friction"], fit.estimates["coulomb_friction"]
    return static.interval95[0] > coulomb.interval95[1] and static.value > MIN_STATIC_RATIO * coulomb.value


def _folds(counted: np.ndarray, plain: OutputError) -> np.ndarray:
    """Return the block of each sample that counts, shape (num_counted,)."""
    samples = int(counted.sum())
    count = min(FOLDS, block_count(plain.residuals["position"][counted]))
    return np.arange(samples) * count // samples


def _left_out(fit: OutputError, fold: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return the squared error of the position on each block, by the fit to all other blocks to first order."""
    rows, slopes = fit.position_rows()
    selected = counted[fit.counted]
    rows, slopes = rows[selected], slopes[selected]
    # In orthogonal directions the systems without a block are near the identity.
    basis = np.linalg.qr(slopes / np.linalg.norm(slopes, axis=0).clip(1e-300))[0]
    whole, errors = basis.T @ rows, []
    for block in np.unique(fold):
        columns, left = basis[fold == block], rows[fold == block]
        change = np.linalg.lstsq(np.eye(len(whole)) - columns.T @ columns, columns.T @ left - whole, rcond=1e-9)[0]
        # A search that was not ended promises more to first order than its fit does.
        errors.append(max(float(np.sum((left + columns @ change) ** 2)), float(left @ left)))
    return np.array(errors)
