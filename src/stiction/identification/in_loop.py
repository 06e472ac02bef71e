"""Fits that simulate the joint under its controller, and the reading of the log that they support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import StictionError
from stiction.files.joints import Estimate
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import (
    EXPLAINED,
    ClosedLoop,
    LoopError,
    Mismatch,
    Response,
    controller_mismatch,
)
from stiction.identification.combinations import shifted
from stiction.identification.consistency import COMPARED, MIN_EVIDENCE, Comparison, common_speed, evidence_of, splits
from stiction.identification.model import GRAVITY_TERMS, Model, nearest_joint
from stiction.identification.output_error import FEW_TRIALS, MAX_ITERATIONS, OutputError, Signal, fit_output_error
from stiction.identification.reading import Reading, fine_steps, may_hold, refine, torque_lag
from stiction.identification.regression import INVERSE_STRENGTH, Fit
from stiction.identification.runs import Run, part_of, reread
from stiction.identification.setup import Payload
from stiction.joints.pd import PDGains

CONFOUNDED = ("offset", "gravity_sin", "gravity_cos")
"""Parameters that a small range of angles does not tell apart, without harm to the others."""

MOST_GAPS = 10
"""Most long gaps of a log whose loop is simulated."""

NOISY = 3.0
"""Residual of the best law's simulation over the position's noise above which the logged torque is trusted in place
of a declared controller that does not quite explain it."""

FIRST_DELAY = 1e-3
"""Delay at which the search begins [s]."""


@dataclass(frozen=True)
class InLoop:
    """Simulations of one run; None where one could not be done."""

    symmetric: OutputError | None = None
    """Output error with viscous and Coulomb friction."""
    chosen: OutputError | None = None
    """Output error with the law that was chosen, if that is a richer one."""
    scaled: OutputError | None = None
    """Output error with viscous and Coulomb friction and k, where a known load of one log tells it; in SI units."""
    mismatch: Mismatch | None = None
    """Gap between the logged torque and the declared controller's; None without torque or gains."""
    reason: str | None = None
    """Reason why output error was not done, else None."""
    told: bool = True
    """True if the log tells whether its target was held between the samples, or its rate makes no difference."""

    @property
    def best(self) -> OutputError | None:
        """Output error with the richest law that was simulated."""
        return self.chosen or self.symmetric

    def believed(self, noise: float) -> InLoop:
        """Return the simulations, or none where no law follows a log whose torque is not quite the controller's.

        noise: standard deviation of the position's noise [rad].
        """
        best, mismatch = self.best, self.mismatch
        if best is None or mismatch is None or mismatch.rest <= EXPLAINED or best.rms <= NOISY * noise:
            return self
        return InLoop(
            mismatch=mismatch,
            reason=f"the logged torque is the declared controller's but for {mismatch.rest:.0%}, and under that "
            f"controller the simulation leaves {best.rms / noise:.1f} times the position's noise by any law: the "
            "torque is believed, as with play between motor and encoder; output error is not done",
        )


def close_loop(run: Run, base: Fit) -> tuple[Run, InLoop]:
    """Fit viscous and Coulomb friction by simulation; return the run with its reading, and the fit.

    base: the symmetric regression, where the search begins.
    """
    try:
        controller(run)
        if INVERSE_STRENGTH in base.names:
            return run, InLoop(scaled=fit_strength(run, base))
    except LoopError as error:
        return run, InLoop(reason=str(error))
    mismatch = compare_controller(run)
    if mismatch is not None and not mismatch.trusted:
        return run, InLoop(
            mismatch=mismatch,
            reason=f"the logged torque differs from kp (target − position) − kd velocity by {mismatch.rest:.0%}, "
            "however late: gains, the torque's unit or its joint are not as declared, or kd feeds back much noise; "
            "output error is not done",
        )
    try:
        read, symmetric, told = _read(run, base)
    except LoopError as error:
        return run, InLoop(mismatch=mismatch, reason=str(error))
    return read, InLoop(symmetric, mismatch=mismatch, told=told)


LEAST_LATE = 0.3
"""Delay of a straight target, over a sample interval, above which a held one is tried: it would lag by half."""

TELLING = 3.0
"""Residual of the straight reading over the position's noise up to which a held one is tried: more hides it."""

CONTEST = 6.0
"""First part of a log on which a straight and a held target are compared [s]."""

APART = 1.02
"""Ratio of the residuals of two readings above which the positions tell them apart: less may be due to what a
simulation leaves out."""

NEAR_HALF = 0.15
"""Distance of a straight target's delay from half a sample interval, over the interval, within which a held target is
the likelier reading: a target that is held lags by half an interval in the mean."""


def _read(run: Run, base: Fit) -> tuple[Run, OutputError, bool]:
    """Simulate with a straight target and, where it may have been held, with a held one; keep the reading of the log.

    Returns the run with that reading, its simulation, and True if the log tells which it is. Raises `LoopError` where
    it cannot be simulated.
    """
    fitted, told = simulate_fit(run, base), not may_hold(run.signals)
    if not told and _late(run, fitted):
        held, told = _contest(run, base, fitted)
        if held:
            run = replace(run, reading=Reading(held=True))
            fitted = simulate_fit(run, base, fitted.values)
    return read_again(run, fitted), fitted, told


def _late(run: Run, fitted: OutputError) -> bool:
    """Return True if a straight target comes late enough to be a held one, which lags by half a sample interval."""
    return fitted.values.get("delay", run.setup.delay or 0.0) > LEAST_LATE * run.signals.step


def _contest(run: Run, base: Fit, whole: OutputError) -> tuple[bool, bool]:
    """Return True if the target was held between the samples, and True if the log tells so.

    Compares the first part of the log, by its positions. Where both readings follow them equally well, or a deficient
    law hides the difference, the target counts as held if the straight one is late by half a sample interval.
    """
    half = abs(whole.values.get("delay", 0.0) / run.signals.step - 0.5) < NEAR_HALF
    if whole.rms > TELLING * run.prepared.noise:
        return half, False
    short = part_of(run, slice(int(np.searchsorted(run.signals.time, CONTEST, "right"))))
    pieces, start = fine_steps(short.signals, True), base.by_name | whole.values
    straight, held = (
        fit_in_loop(replace(short, reading=Reading(held=way)), base, start, pieces, FEW_TRIALS) for way in (False, True)
    )
    if straight is None or held is None:
        return False, False
    evidence = evidence_between(straight, held, 0)
    told = abs(evidence) >= MIN_EVIDENCE and max(straight.rms, held.rms) > APART * min(straight.rms, held.rms)
    return evidence > 0 if told else half, told


def doubt(run: Run, loop: InLoop) -> dict[str, float]:
    """Return the changes of inertia and viscous friction by the other reading of the target, where that may be right.

    A held target lags by half a step, by which the loop itself is then less late, and a loop that is late by d is a
    joint of inertia I − kd d + kp d²/2 and viscous friction B − kp d (`closed_loop`).
    """
    best, held, step = loop.best, run.reading.held, run.signals.step
    if best is None or loop.told or not (held or _late(run, best)):
        return {}
    gains, less = controller(run), 0.5 * step
    kp, kd, delay = gains.strength * gains.kp, gains.strength * gains.kd, best.values.get("delay", 0.0) + less * held
    inertia = -kd * less + 0.5 * kp * (delay**2 - (delay - less) ** 2)
    return {
        name: -change if held else change for name, change in (("inertia", inertia), ("viscous_friction", -kp * less))
    }


def read_again(run: Run, fitted: OutputError) -> Run:
    """Return the run with its torque moved to the time at which it acted by the simulation."""
    delay = fitted.values.get("delay", run.setup.delay or 0.0)
    lag = 0.0
    if run.signals.torque is not None:
        simulated = fitted.simulated.torque
        lag = torque_lag(run.signals.time, run.signals.torque, simulated, fitted.counted)
    return reread(run, replace(run.reading, delay=delay, torque_lag=lag))


def evidence_between(plain: OutputError, rich: OutputError, more: int) -> float:
    """Return the decrease of the information criterion from a simulation to another; more: its further parameters."""
    both = plain.counted & rich.counted
    before, after = ([fit.residuals[name][both] for name in plain.residuals] for fit in (plain, rich))
    return evidence_of(before, after, more)


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
    gaps = int(np.count_nonzero(np.diff(run.signals.bridged.astype(int)) == 1))
    if gaps > MOST_GAPS:
        raise LoopError(
            f"output error is not done: the log has {gaps} gaps, and in none of them the target is known; log without "
            "pauses"
        )
    return run.gains


def compare_controller(run: Run) -> Mismatch | None:
    """Compare the logged torque with the declared controller's; None where no torque was logged.

    Raises `LoopError` as `controller`.
    """
    if not run.measured:
        return None
    lag = (run.setup.velocity_delay or 0.0) + (run.setup.delay or 0.0)
    late = np.interp(run.signals.time - lag, run.signals.time, run.prepared.velocity)
    return controller_mismatch(run.signals, controller(run), late, run.prepared.cutoff, _finds_bias(run))


def fit_in_loop(
    run: Run, fit: Fit, start: dict[str, float] | None = None, pieces: int | None = None, trials: int = MAX_ITERATIONS
) -> OutputError | None:
    """Return the result of `simulate_fit`, or None where it raises `LoopError`: for fits that are not essential."""
    try:
        return simulate_fit(run, fit, start, pieces, trials)
    except LoopError:
        return None


def simulate_fit(
    run: Run, fit: Fit, start: dict[str, float] | None = None, pieces: int | None = None, trials: int = MAX_ITERATIONS
) -> OutputError:
    """Fit by output error, of the positions alone, with the loop's delay unless that is declared.

    fit: the regression, whose model is fitted; start: where the search begins, by default where the regression ended;
    pieces: steps of the simulation in each sample interval, by default as many as the reading needs; trials: points
    tried in each round of the search.

    Raises:
        LoopError: the loop cannot be simulated, or the best simulation does not depend on all of the model's
            parameters.

    """
    setup, extra = run.setup, _payload(run)
    start, known = start or fit.by_name, dict[str, float]()
    model = replace(fit.model, gravity=fit.model.gravity or bool(extra))
    # A payload has weight: the simulation needs gravity, which is then known and not fitted.
    if extra and not fit.model.gravity:
        known |= dict.fromkeys(GRAVITY_TERMS, 0.0)
    signals, velocity = _signals(run), run.prepared.velocity
    pieces = pieces or fine_steps(signals, run.reading.held)
    signals = refine(signals, run.reading.held, pieces)
    velocity = np.interp(signals.time, run.signals.time, velocity)
    # Where the search begins the delay may not take half of the inertia.
    begin = max(start.get("delay", run.reading.delay), 0.0) or FIRST_DELAY
    begin = min(begin, 0.2 * max(start["inertia"], 1e-9) / max(controller(run).kd, 1e-9))
    # The log's angle against the controller's shows in the torque alone.
    judged: tuple[Signal, ...] = ("position", "torque") if _finds_bias(run) else ("position",)
    unknown = ("delay",) if setup.delay is None else ()
    fitted = fit_output_error(
        signals,
        controller(run),
        model,
        {name: start.get(name, 0.0) + extra.get(name, 0.0) for name in model.names},
        velocity,
        velocity_delay=setup.velocity_delay or 0.0,
        delay=begin if setup.delay is None else setup.delay,
        unknown=(*unknown, "log_bias") if _finds_bias(run) else unknown,
        known={name: value + extra.get(name, 0.0) for name, value in known.items()},
        judged=judged,
        trials=trials,
    )
    fitted = fitted.thinned(pieces)
    _check_identified(fitted, [name for name in fit.model.names if name not in CONFOUNDED])
    return replace(fitted, estimates={name: shifted(e, -extra.get(name, 0.0)) for name, e in fitted.estimates.items()})


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
    fitted = fit_output_error(
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
    _check_identified(fitted, ["motor_strength", *COMPARED])
    return replace(fitted, estimates=fitted.estimates | {"inertia": shifted(fitted.estimates["inertia"], -added)})


def _check_identified(fitted: OutputError, needed: Sequence[str]) -> None:
    """Raise `LoopError` where the best simulation of a log does not tell all of some parameters."""
    if lost := [name for name in needed if name in fitted.unidentified]:
        raise LoopError(
            f"output error is not done: the simulation that follows the log best does not tell {', '.join(lost)}"
        )


def _weight(payload: Payload) -> dict[str, float]:
    """Return the gravity terms of a payload [N m]."""
    along, across = np.cos(payload.angle), -np.sin(payload.angle)
    return {"gravity_sin": payload.weight * along, "gravity_cos": payload.weight * across}


def _payload(run: Run) -> dict[str, float]:
    """Return the inertia and gravity of a known payload, over k; empty without one."""
    payload = run.setup.payload
    if payload is None:
        return {}
    return {name: _over_k(run) * value for name, value in ({"inertia": payload.inertia} | _weight(payload)).items()}


def _signals(run: Run) -> Uniform:
    """Return the signals with the torque from outside over k: the loop is simulated as if k were 1."""
    outside = run.signals.disturbance
    return run.signals if outside is None else replace(run.signals, disturbance=_over_k(run) * outside)


def _over_k(run: Run) -> float:
    """Return 1/k where k was declared, else 1: where a known load tells k the loop is not simulated."""
    return 1 / (run.setup.motor_strength or 1.0)


def _finds_bias(run: Run) -> bool:
    """Return True if the encoder's bias is requested, and shows: without torque it is one with the offset."""
    return "encoder_bias" in run.setup.unknowns and run.measured and run.setup.hanging_angle is None


def respond(run: Run, model: Model, values: dict[str, float]) -> Response:
    """Simulate a whole run with the joint's values, the payload's added, on the samples of the log.

    Missing values are zero, and so is friction below zero. Raises `StictionError` as `controller` and
    `ClosedLoop.run`.
    """
    gains, extra, signals = controller(run), _payload(run), _signals(run)
    model = replace(model, gravity=model.gravity or bool(extra))
    begin = {
        "start_position": float(run.signals.position[0]),
        "start_velocity": float(run.prepared.velocity[0]),
        "delay": run.reading.delay if run.setup.delay is None else run.setup.delay,
    }
    pieces = fine_steps(signals, run.reading.held)
    signals = refine(signals, run.reading.held, pieces)
    loop = ClosedLoop(signals, gains, model, begin, run.setup.velocity_delay or 0.0)
    whole = {name: values.get(name, 0.0) + extra.get(name, 0.0) for name in model.names}
    joint = nearest_joint(whole)
    response = loop.run(joint, signals.position)
    if begin["delay"] + loop.velocity_delay > 0.0:
        loop.correct(response, joint)
        response = loop.run(joint, response.motion.position)
    return response.thinned(pieces)


def predict_run(run: Run, fit: Fit) -> dict[str, float] | None:
    """Return the relative errors of a simulation of this run with another run's values; None without a loop."""
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


def compare_in_loop(run: Run, whole: OutputError | None) -> tuple[Comparison, ...]:
    """Compare the parts of a log, each fitted by the derivatives of the whole simulation.

    Gravity, offset and delay stay as the whole log has them: the link is the same one, and a part tells them less
    apart. Empty without a simulation.
    """
    if whole is None or not set(COMPARED) <= set(whole.estimates):
        return ()
    comparisons = []
    for split in splits(run.signals.time, run.prepared.velocity):
        fixed = (*CONFOUNDED, "delay")
        parts = [whole.part(part & run.signals.valid, fixed) for part in (split.first, ~split.first)]
        first, second = parts
        if first is None or second is None:
            continue
        speed = common_speed(*(run.prepared.velocity[part] for part in (split.first, ~split.first)))
        values = {name: (first[name], second[name]) for name in COMPARED}
        friction = _friction(first, speed), _friction(second, speed)
        comparisons.append(Comparison(split.label, split.parts, values, speed, friction))
    return tuple(comparisons)


def _friction(estimates: dict[str, Estimate], speed: float) -> Estimate:
    """Return B θ' + b_c at a speed; the two errors are taken as independent, which makes the interval too wide."""
    viscous, coulomb = estimates["viscous_friction"], estimates["coulomb_friction"]
    value = viscous.value * speed + coulomb.value
    std = float(np.hypot(viscous.std * speed, coulomb.std))
    return Estimate(value, std, (value - 2 * std, value + 2 * std))
