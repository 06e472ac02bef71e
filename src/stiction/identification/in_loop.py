"""The estimators that simulate the joint under its controller: output error and instrumental variables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import StictionError
from stiction.files.joints import Estimate
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import (
    LARGEST_MISMATCH,
    ClosedLoop,
    LoopError,
    Mismatch,
    Response,
    controller_mismatch,
)
from stiction.identification.combinations import shifted
from stiction.identification.consistency import COMPARED, TIMING, Comparison, common_speed, splits
from stiction.identification.model import GRAVITY_TERMS, Model, nearest_joint
from stiction.identification.output_error import OutputError, fit_output_error
from stiction.identification.regression import INVERSE_STRENGTH, Fit, fit_instrumental
from stiction.identification.runs import Run
from stiction.identification.setup import Payload
from stiction.joints.pd import PDGains

LOOP_UNKNOWNS = {"delay": "delay", "encoder_bias": "log_bias"}
"""What the user may ask for -> what the simulated loop calls it."""

CONFOUNDED = ("offset", "gravity_sin", "gravity_cos")
"""Parameters that a small range of angles does not tell apart: no harm to the others."""


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
    scales: tuple[float, float] | None = None
    """What multiples of the declared kp and kd the logged torque looks like; None without torque or gains."""


def close_loop(run: Run, base: Fit, chosen: Fit) -> InLoop:
    """Run both estimators from the regression's values; base: the symmetric fit; chosen: that of the chosen law."""
    try:
        controller(run)
        if INVERSE_STRENGTH in base.names:
            return InLoop(scaled=fit_strength(run, base))
    except LoopError as error:
        return InLoop(reason=str(error))
    difference = compare_controller(run)
    mismatch = None if difference is None else difference.size
    if difference is not None and difference.size > LARGEST_MISMATCH and "delay" not in run.setup.unknowns:
        return InLoop(
            mismatch,
            scales=difference.scales,
            reason=f"the logged torque differs from kp (target − position) − kd velocity by {mismatch:.0%}: gains, the "
            "torque's unit or the timing are not as declared, or kd feeds back much noise; output error is not done",
        )
    symmetric, reason = None, None
    try:
        symmetric = simulate_fit(run, base)
    except LoopError as error:
        reason = str(error)
    richer = fit_in_loop(run, chosen) if chosen is not base else None
    # By identity: rows of several logs are of no single run that could be simulated.
    instrumental = fit_with_instruments(run, base) if base.rows is run.rows else None
    scales = None if difference is None else difference.scales
    return InLoop(mismatch, symmetric, richer, instrumental, None, reason, scales)


def controller(run: Run) -> PDGains:
    """Return the gains under which the joint followed its target.

    Raises:
        LoopError: gains or target are not known, so that there is nothing to simulate.

    """
    if run.setup.drive.by_voltage:
        raise LoopError(
            "output error is not done: what a controller asks of a motor by voltage is a duty, which its own brake "
            "makes a torque of"
        )
    if run.gains is None:
        raise LoopError("no kp and kd: output error is not done; give --kp and --kd")
    if run.signals.target is None:
        raise LoopError("no target in the log: output error is not done; log the position asked for")
    return run.gains


def compare_controller(run: Run) -> Mismatch | None:
    """Compare the logged torque with the declared controller's; None where no torque was logged.

    Raises `LoopError` as `controller`.
    """
    if not run.measured:
        return None
    lag = (run.setup.velocity_delay or 0.0) + (run.setup.delay or 0.0)
    late = np.interp(run.signals.time - lag, run.signals.time, run.prepared.velocity)
    biased = "encoder_bias" in run.setup.unknowns and _shows(run, "encoder_bias")
    return controller_mismatch(run.signals, controller(run), late, run.prepared.cutoff, biased)


def fit_with_instruments(run: Run, base: Fit) -> Fit | None:
    """Regress with instruments from simulations; None where no simulation follows the log."""

    def simulate(values: np.ndarray) -> np.ndarray | None:
        try:
            return respond(run, base.model, replace(base, values=values).by_name).position
        except StictionError:
            return None

    return fit_instrumental(run.prepared, run.setup.payload, base, simulate)


def fit_in_loop(
    run: Run,
    fit: Fit,
    start: dict[str, float] | None = None,
    part: np.ndarray | None = None,
    known: dict[str, float] | None = None,
) -> OutputError | None:
    """Return what `simulate_fit` does, or None where it raises `LoopError`: for fits that the user need not have."""
    try:
        return simulate_fit(run, fit, start, part, known)
    except LoopError:
        return None


def fit_late(run: Run, base: Fit, start: dict[str, float]) -> OutputError | None:
    """Fit the symmetric law, from `start`, under a controller that may be late; None where that cannot be done."""
    return fit_in_loop(replace(run, setup=replace(run.setup, unknowns=("delay",))), base, start)


def simulate_fit(
    run: Run,
    fit: Fit,
    start: dict[str, float] | None = None,
    part: np.ndarray | None = None,
    known: dict[str, float] | None = None,
) -> OutputError:
    """Fit by output error.

    fit: the regression, whose model is fitted; start: where the search begins, by default where the regression ended;
    part: samples to judge the simulation in, all by default; known: what not to fit.

    Raises:
        LoopError: the loop cannot be simulated, or the best simulation does not depend on all of the model's
            parameters.

    """
    setup, extra, signals = run.setup, _payload(run), _signals(run)
    start, known = start or fit.by_name, dict(known or {})
    model = replace(fit.model, gravity=fit.model.gravity or bool(extra))
    # A payload has weight: the simulation needs gravity, which is then known and not fitted.
    if extra and not fit.model.gravity:
        known |= dict.fromkeys(GRAVITY_TERMS, 0.0)
    found = fit_output_error(
        signals if part is None else replace(signals, valid=signals.valid & part),
        controller(run),
        model,
        {name: start.get(name, 0.0) + extra.get(name, 0.0) for name in model.names},
        run.prepared.velocity,
        velocity_delay=setup.velocity_delay or 0.0,
        delay=setup.delay or 0.0,
        unknown=tuple(LOOP_UNKNOWNS[name] for name in setup.unknowns if _shows(run, name)),
        known={name: value + extra.get(name, 0.0) for name, value in known.items()},
    )
    _check_identified(found, [name for name in fit.model.names if name not in CONFOUNDED])
    return replace(found, estimates={name: shifted(e, -extra.get(name, 0.0)) for name, e in found.estimates.items()})


def fit_strength(run: Run, base: Fit) -> OutputError:
    """Fit the symmetric law and the motor's strength to a log whose known load tells it, all in SI units.

    base: the regression, with 1/k.

    Raises:
        LoopError: as `simulate_fit`, or the strength is not told by this log alone, or beside gravity on the link.

    """
    if base.rows is not run.rows:
        raise LoopError("output error is not done where only several logs together tell the strength k")
    if base.model.gravity:
        raise LoopError("output error is not done where the strength k and gravity on the link are unknown together")
    # The regression's values are over k, the simulation's in SI units.
    payload, strength = run.setup.payload, 1 / base.by_name[INVERSE_STRENGTH]
    start = {name: strength * value for name, value in base.by_name.items() if name != INVERSE_STRENGTH}
    if not strength > 0:
        raise LoopError(
            f"output error is not done: the regression finds a strength k of {strength:.3g}, expected above 0"
        )
    weight = {} if payload is None else _weight(payload)
    added = 0.0 if payload is None else payload.inertia
    start["inertia"] += added
    found = fit_output_error(
        run.signals,
        replace(controller(run), strength=strength),
        Model("coulomb", bool(weight)),
        start | weight,
        run.prepared.velocity,
        velocity_delay=run.setup.velocity_delay or 0.0,
        delay=run.setup.delay or 0.0,
        unknown=("motor_strength",),
        known=weight,
    )
    _check_identified(found, ["motor_strength", *COMPARED])
    return replace(found, estimates=found.estimates | {"inertia": shifted(found.estimates["inertia"], -added)})


def _check_identified(found: OutputError, needed: Sequence[str]) -> None:
    """Raise `LoopError` where the simulation that follows a log best does not tell all of some parameters."""
    if lost := [name for name in needed if name in found.unidentified]:
        raise LoopError(
            f"output error is not done: the simulation that follows the log best does not tell {', '.join(lost)}"
        )


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


def _shows(run: Run, unknown: str) -> bool:
    """Whether the loop can show an unknown; without torque a bias of the encoder is one with the offset."""
    return unknown == "delay" or (run.measured and run.setup.hanging_angle is None)


def respond(run: Run, model: Model, values: dict[str, float]) -> Response:
    """Simulate the whole of a run with the joint's own values, the payload's added.

    What is not given is zero, and so is friction below zero. Raises `StictionError` as `controller` and
    `ClosedLoop.run`.
    """
    extra = _payload(run)
    model = replace(model, gravity=model.gravity or bool(extra))
    begin = {
        "start_position": float(run.signals.position[0]),
        "start_velocity": float(run.prepared.velocity[0]),
        "delay": run.setup.delay or 0.0,
    }
    loop = ClosedLoop(_signals(run), controller(run), model, begin, run.setup.velocity_delay or 0.0)
    whole = {name: values.get(name, 0.0) + extra.get(name, 0.0) for name in model.names}
    return loop.run(nearest_joint(whole), run.signals.position)


def predict_run(run: Run, fit: Fit) -> dict[str, float] | None:
    """Return how far a simulation with another run's values is from this run, over its signals; None without a loop."""
    if INVERSE_STRENGTH in fit.names:
        return None
    try:
        response = respond(run, fit.model, fit.by_name)
    except StictionError:
        return None
    pairs = {
        "position": (response.position, run.signals.position),
        "velocity": (response.motion.velocity, run.prepared.velocity),
    }
    if run.signals.torque is not None:
        pairs["torque"] = (response.torque, run.signals.torque)
    valid = run.signals.valid
    return {
        name: float(np.linalg.norm((simulated - measured)[valid]) / np.linalg.norm(measured[valid]))
        for name, (simulated, measured) in pairs.items()
    }


def compare_in_loop(run: Run, base: Fit, whole: OutputError | None) -> tuple[Comparison, ...]:
    """Compare parts of the log with each other, and a log without torque with itself under a late controller.

    base: the regression; whole: output error on the whole log. Returns nothing where there is none.
    """
    if whole is None:
        return ()
    late = () if run.measured else _compare_delay(run, base, whole)
    return (*_compare_parts(run, base, whole), *late)


def _compare_parts(run: Run, base: Fit, whole: OutputError) -> tuple[Comparison, ...]:
    """Fit the parts of the log by themselves; the joint is simulated all along, and judged in one part.

    Gravity and offset stay as the whole log has them: the link is the same one, and a part tells them less apart.
    """
    start = base.by_name | whole.values
    known = {name: start[name] for name in CONFOUNDED if name in base.names}
    found = []
    for split in splits(run.signals.time, run.prepared.velocity):
        parts = (split.first, ~split.first)
        one, other = (fit_in_loop(run, base, start, part, known) for part in parts)
        if one is None or other is None:
            continue
        speed = common_speed(*(run.prepared.velocity[part] for part in parts))
        found.append(_comparison(split.label, split.parts, one, other, speed))
    return tuple(found)


def _compare_delay(run: Run, base: Fit, whole: OutputError) -> tuple[Comparison, ...]:
    """Set the fit beside one whose controller may be late, unless that was declared or asked for."""
    if run.setup.delay is not None or run.setup.unknowns:
        return ()
    late = fit_late(run, base, base.by_name | whole.values)
    if late is None or "delay" not in late.estimates:
        return ()
    speed = float(np.quantile(np.abs(run.prepared.velocity), 0.9))
    parts = ("as declared", f"controller {1e3 * late.values['delay']:.2g} ms late")
    return (_comparison(TIMING, parts, whole, late, speed, True),)


def _comparison(
    label: str,
    parts: tuple[str, str],
    one: OutputError,
    other: OutputError,
    speed: float,
    alternative: bool = False,
) -> Comparison:
    """Compare two fits by output error, also in their friction at a speed [rad/s]."""
    values = {name: (one.estimates[name], other.estimates[name]) for name in COMPARED}
    friction = _friction(one.estimates, speed), _friction(other.estimates, speed)
    return Comparison(label, parts, values, speed, friction, alternative)


def _friction(estimates: dict[str, Estimate], speed: float) -> Estimate:
    """Return B θ' + b_c at a speed; the two errors are taken as independent, which makes the interval too wide."""
    viscous, coulomb = estimates["viscous_friction"], estimates["coulomb_friction"]
    value = viscous.value * speed + coulomb.value
    std = float(np.hypot(viscous.std * speed, coulomb.std))
    return Estimate(value, std, (value - 2 * std, value + 2 * std))
