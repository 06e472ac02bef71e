"""The estimators that simulate the joint under its controller: output error and instrumental variables."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.formats.errors import StictionError
from stiction.identify.checks import Uniform
from stiction.identify.closed_loop import ClosedLoop, Response
from stiction.identify.combinations import shifted
from stiction.identify.consistency import COMPARED
from stiction.identify.controller import LARGEST_MISMATCH, controller_mismatch
from stiction.identify.instrument import fit_instrumental
from stiction.identify.model import GRAVITY, Model, nearest_joint
from stiction.identify.output_error import OutputError, fit_output_error
from stiction.identify.regression import INVERSE_STRENGTH, Fit
from stiction.identify.runs import Run
from stiction.identify.setup import Payload
from stiction.joints.pd import PDGains


@dataclass(frozen=True)
class InLoop:
    """What the simulations of one run gave; None where one could not be done."""

    mismatch: float | None = None
    """Relative gap between logged torque and the declared controller's; None without torque or gains."""
    symmetric: OutputError | None = None
    """Output error with viscous and Coulomb friction."""
    chosen: OutputError | None = None
    """Output error with the law that was chosen, if that is a richer one."""
    instrumental: Fit | None = None
    """Regression with simulated instruments."""
    scaled: OutputError | None = None
    """Output error with viscous and Coulomb friction and k, where a known load of one log tells it; in SI units."""
    reason: str | None = None
    """Why it was not done."""


def close_loop(run: Run, base: Fit, chosen: Fit) -> InLoop:
    """Run both estimators from the regression's values; base: the symmetric fit; chosen: that of the chosen law."""
    gains, target = run.gains, run.signals.target
    if gains is None:
        return InLoop(reason="no kp and kd: output error is not done; give --kp and --kd")
    if target is None:
        return InLoop(reason="no target in the log: output error is not done; log the position asked for")
    if INVERSE_STRENGTH in base.names:
        scaled = fit_strength(run, gains, base) if base.rows is run.rows and not base.model.gravity else None
        reason = None if scaled else "output error is not done where only several logs together tell the strength k"
        return InLoop(scaled=scaled, reason=reason)
    mismatch = _mismatch(run, gains)
    if mismatch is not None and mismatch > LARGEST_MISMATCH and "delay" not in run.setup.unknowns:
        return InLoop(
            mismatch,
            reason=f"the logged torque differs from kp (target − position) − kd velocity by {mismatch:.0%}: gains, the "
            "torque's unit or the timing are not as declared, or kd feeds back much noise; output error is not done",
        )
    symmetric = fit_in_loop(run, gains, base)
    richer = fit_in_loop(run, gains, chosen) if chosen is not base else None
    alone = base.rows is run.rows
    instrumental = fit_with_instruments(run, gains, base) if alone else None
    reason = None
    if symmetric is None:
        reason = "output error found no joint whose simulation follows the log: the model is not right, or the gains"
    return InLoop(mismatch, symmetric, richer, instrumental, None, reason)


def _mismatch(run: Run, gains: PDGains) -> float | None:
    """Compare the logged torque with the declared controller's; None where no torque was logged."""
    if not run.measured:
        return None
    lag = (run.setup.velocity_delay or 0.0) + (run.setup.delay or 0.0)
    late = np.interp(run.signals.time - lag, run.signals.time, run.prepared.velocity)
    biased = "encoder_bias" in run.setup.unknowns and _shows(run, "encoder_bias")
    return controller_mismatch(run.signals, gains, late, run.prepared.cutoff, biased)


def values_of(fit: Fit) -> dict[str, float]:
    """Return a fit's values by name."""
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def fit_with_instruments(run: Run, gains: PDGains, base: Fit) -> Fit | None:
    """Regress with instruments from simulations; None where no simulation follows the log."""
    payload = run.setup.payload
    return fit_instrumental(run.prepared, payload, base, lambda values: _follow(run, gains, base, values))


def fit_in_loop(
    run: Run,
    gains: PDGains,
    fit: Fit,
    start: dict[str, float] | None = None,
    part: np.ndarray | None = None,
    known: dict[str, float] | None = None,
) -> OutputError | None:
    """Fit by output error; None where the best simulation does not depend on all of the equation's parameters.

    start: where the search begins, by default where the regression ended; part: samples to judge the simulation in, all
    by default; known: what not to fit.
    """
    setup, extra, signals = run.setup, _payload(run), _signals(run)
    start, known = start or values_of(fit), dict(known or {})
    model = replace(fit.model, gravity=fit.model.gravity or bool(extra))
    if extra and not fit.model.gravity:
        known |= dict.fromkeys(GRAVITY, 0.0)
    found = fit_output_error(
        signals if part is None else replace(signals, valid=signals.valid & part),
        gains,
        model,
        {name: start.get(name, 0.0) + extra.get(name, 0.0) for name in model.names},
        run.prepared.velocity,
        velocity_delay=setup.velocity_delay,
        delay=setup.delay or 0.0,
        unknown=tuple(LOOP_UNKNOWNS[name] for name in setup.unknowns if _shows(run, name)),
        known={name: value + extra.get(name, 0.0) for name, value in known.items()},
    )
    needed = {name for name in fit.model.names if name not in BLURRED}
    if needed & set(found.unidentified):
        return None
    return replace(found, estimates={name: shifted(e, -extra.get(name, 0.0)) for name, e in found.estimates.items()})


def fit_strength(run: Run, gains: PDGains, base: Fit) -> OutputError | None:
    """Fit the symmetric law and the motor's strength to a log whose known load tells it, all in SI units.

    base: the regression, with 1/k. Returns None where the simulation does not show all of them.
    """
    payload, strength = run.setup.payload, 1 / values_of(base)[INVERSE_STRENGTH]
    start = {name: strength * value for name, value in values_of(base).items() if name != INVERSE_STRENGTH}
    weight = {} if payload is None else _weight(payload)
    if payload is not None:
        start["inertia"] += payload.inertia
    try:
        found = fit_output_error(
            run.signals,
            replace(gains, strength=strength),
            Model("coulomb", bool(weight)),
            start | weight,
            run.prepared.velocity,
            velocity_delay=run.setup.velocity_delay,
            delay=run.setup.delay or 0.0,
            unknown=("motor_strength",),
            known=weight,
        )
    except StictionError:
        return None
    if {"motor_strength", *COMPARED} & set(found.unidentified):
        return None
    less = 0.0 if payload is None else payload.inertia
    return replace(found, estimates=found.estimates | {"inertia": shifted(found.estimates["inertia"], -less)})


def _weight(payload: Payload) -> dict[str, float]:
    """Return the gravity terms of a payload [N m]."""
    along, across = np.cos(payload.angle), -np.sin(payload.angle)
    return {"gravity_sin": payload.weight * along, "gravity_cos": payload.weight * across}


def _payload(run: Run) -> dict[str, float]:
    """Return what a known payload adds to inertia and gravity, over k; nothing without one."""
    payload = run.setup.payload
    if payload is None:
        return {}
    return {name: _over_k(run) * value for name, value in ({"inertia": payload.inertia} | _weight(payload)).items()}


def _signals(run: Run) -> Uniform:
    """Return the log with the torque from outside over k: the loop is simulated as if k were 1."""
    outside = run.signals.disturbance
    return run.signals if outside is None else replace(run.signals, disturbance=_over_k(run) * outside)


def _over_k(run: Run) -> float:
    """Return 1/k where k was declared, else 1: where a known load tells k the loop is not simulated."""
    return 1 / (run.setup.motor_strength or 1.0)


LOOP_UNKNOWNS = {"delay": "delay", "encoder_bias": "log_bias"}
"""What the user may ask for -> what the simulated loop calls it."""

BLURRED = ("offset", "gravity_sin", "gravity_cos")
"""Parameters that a small range of angles does not tell apart: no harm to the others."""


def _shows(run: Run, unknown: str) -> bool:
    """Whether the loop can show an unknown; without torque a bias of the encoder is one with the offset."""
    return unknown == "delay" or (run.measured and run.setup.hanging_angle is None)


def _follow(run: Run, gains: PDGains, fit: Fit, values: np.ndarray) -> np.ndarray | None:
    """Return the position that the loop would have had with these values, or None where no joint has them."""
    try:
        response = respond(run, gains, fit.model, values_of(replace(fit, values=values)))
    except StictionError:
        return None
    return response.position


def respond(run: Run, gains: PDGains, model: Model, values: dict[str, float]) -> Response:
    """Simulate the whole of a run with the joint's own values, the payload's added.

    What is not given is zero, and so is friction below zero.

    Raises `StictionError` where no joint has them.
    """
    extra = _payload(run)
    model = replace(model, gravity=model.gravity or bool(extra))
    begin = {
        "start_position": float(run.signals.position[0]),
        "start_velocity": float(run.prepared.velocity[0]),
        "delay": run.setup.delay or 0.0,
    }
    loop = ClosedLoop(_signals(run), gains, model, begin, run.setup.velocity_delay)
    whole = {name: values.get(name, 0.0) + extra.get(name, 0.0) for name in model.names}
    return loop.run(nearest_joint(whole), run.signals.position)


def predict_run(run: Run, fit: Fit) -> dict[str, float] | None:
    """Return how far a simulation with another run's values is from this run, over its signals; None without a loop."""
    gains = run.gains
    if gains is None or run.signals.target is None or INVERSE_STRENGTH in fit.names:
        return None
    try:
        response = respond(run, gains, fit.model, values_of(fit))
    except StictionError:
        return None
    pairs = {
        "position": (response.position, run.signals.position),
        "velocity": (response.made.velocity, run.prepared.velocity),
    }
    if run.signals.torque is not None:
        pairs["torque"] = (response.torque, run.signals.torque)
    valid = run.signals.valid
    return {
        name: float(np.linalg.norm((made - measured)[valid]) / np.linalg.norm(measured[valid]))
        for name, (made, measured) in pairs.items()
    }


def symmetric_model(run: Run) -> Model:
    """Return the symmetric torque equation for a run."""
    return Model("coulomb", run.setup.fits_gravity)
