"""Design of a log from start to end: choose the gains, search the motion, predict the information, explain it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import ceil

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.files.design import (
    DesignSignals,
    ExcitationDesign,
    GainPoint,
    GainTrial,
    OneSine,
    Predicted,
    two_digits,
)
from stiction.files.log import JointSignals, Log, LogSetup
from stiction.identification.excite.design import (
    LEAST_REACH,
    REQUIRED_REDUCTION,
    choose_gains,
    frequency_limit,
    nothing_moves,
    search,
    softened,
)
from stiction.identification.excite.fisher import Information
from stiction.identification.excite.pattern import Pattern, sine
from stiction.identification.excite.setup import ExciteSetup
from stiction.identification.excite.task import Task
from stiction.joints.pd import PDGains

SINES = 8
"""Number of frequencies at which one sine is tried."""

SLOWEST = 0.25
"""Lowest of these frequencies [Hz]."""

SWEEP = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Gains of the sweep in units of those of the design; far up, to where a torque sensor is worth having."""

NEGLIGIBLE = 0.005
"""Predicted deviations below which the friction law, and not the noise, decides how right the result is."""


@dataclass(frozen=True)
class Excitation:
    """Finished design."""

    record: ExcitationDesign
    """Record for `design.json`."""
    signals: DesignSignals
    """Signals for `design.npz`."""
    trajectory: Log
    """Trajectory for `trajectory.csv` and its sidecar, which the controller plays back."""


def design_excitation(
    setup: ExciteSetup, joint: str, command: str, progress: Callable[[str, float], None] = lambda name, share: None
) -> Excitation:
    """Design the log of one joint; `setup` is filled. progress: gets the name of the work and its share done.

    Raises `StictionError` where friction holds the joint, or no motion fits the limits.
    """
    asked = Task(setup)
    gains, trials = choose_gains(asked, lambda share: progress("gains", share))
    task = asked.with_gains(gains)
    pattern = search(task, setup.seed, lambda share: progress("motion", share))
    signals, reached = simulate_range(task, pattern)
    informations = [task.information(v, pattern, fast=index > 0) for index, v in enumerate(task.candidates())]
    if not all(np.isfinite(belief.worst) for belief in informations):
        raise ConfigurationError(nothing_moves(task))
    sines = one_sines(task, max(pattern.slow_amplitude, pattern.fast_peak))
    sweep = gain_sweep(task, pattern)
    progress("figures", 1.0)
    record = ExcitationDesign(
        joint=joint,
        setup=asdict(setup),
        gains={"kp": gains.kp, "kd": gains.kd},
        advice=advice(asked, gains, trials),
        pattern=asdict(pattern),
        pattern_duration=task.count / setup.rate,
        repeats=task.repeats,
        duration=task.total / setup.rate,
        limits=task.limits,
        reached=reached,
        predicted=predictions(informations),
        correlation=informations[0].correlation(1, 2),
        d_criterion=informations[0].d_criterion,
        worst=max(belief.worst for belief in informations),
        wanted={"relative": setup.wanted, "duration": duration_for(task, informations, setup.wanted)},
        sines=sines,
        trials=trials,
        sweep=sweep,
        warnings=tuple(cautions(task, trials, informations)),
        command=command,
    )
    sidecar = LogSetup(
        kp=gains.kp,
        kd=gains.kd,
        torque_limit=setup.torque_limit,
        axis="rotary",
        test_condition=record.test_condition,
    )
    trajectory = Log("trajectory.csv", signals.time, {joint: JointSignals(target=signals.target)}, sidecar)
    return Excitation(record, signals, trajectory)


def one_sines(task: Task, amplitude: float) -> tuple[OneSine, ...]:
    """Return the information in single sines of the design's amplitude [rad] that fit the limits and move the joint."""
    sines, task = [], task.without_gravity()
    for frequency in np.geomspace(SLOWEST, max(frequency_limit(task), 4 * SLOWEST), SINES):
        pattern = task.within_limits(sine(float(frequency), amplitude), [*task.extremes(), task.least_damped()])
        if pattern is None:
            continue
        nominal, worst = task.information(task.values, pattern), task.worst(pattern)
        if np.isfinite([nominal.worst, worst]).all():
            inertia, viscous, coulomb = nominal.relative.tolist()
            relative, correlation = (inertia, viscous, coulomb), nominal.correlation(1, 2)
            sines.append(OneSine(float(frequency), pattern.fast_peak, relative, worst, correlation))
    return tuple(sines)


def gain_sweep(task: Task, pattern: Pattern) -> tuple[GainPoint, ...]:
    """Return the information on the nominal joint's friction by a motion at lower and higher gains than the task's."""
    points, task = [], task.without_gravity()
    # A log without torque has no noise of it: the usual one shows what a sensor would be worth.
    noise = ExciteSetup.noise_torque if task.setup.position_only else task.setup.noise_torque
    for factor in SWEEP:
        stiffer = task.with_gains(softened(task.gains, factor))
        blind, seeing = (
            replace(stiffer, setup=replace(stiffer.setup, position_only=alone, noise_torque=noise))
            for alone in (True, False)
        )
        points.append(
            GainPoint(
                kp=stiffer.gains.kp,
                kd=stiffer.gains.kd,
                position_only=_friction(blind, pattern),
                with_torque=_friction(seeing, pattern),
                reach=stiffer.reach(task.target(pattern), [task.values]),
            )
        )
    return tuple(points)


def _friction(task: Task, pattern: Pattern) -> float | None:
    """Return the relative standard deviation of the nominal joint's Coulomb friction, None where it holds the joint."""
    deviation = float(task.information(task.values, pattern).relative[2])
    return deviation if np.isfinite(deviation) else None


def simulate_range(task: Task, pattern: Pattern) -> tuple[DesignSignals, dict[str, float]]:
    """Simulate the whole log over the range of guesses; return the signals and their extremes.

    Raises `StictionError` should the repeated pattern leave the limits where a single one did not.
    """
    target = task.full_target(pattern)
    runs = [task.run(values, target) for values in task.candidates()]
    ranges = {
        f"{name}_{end}": choose(np.stack([getattr(motion, name) for motion in runs]), axis=0)
        for name in ("position", "velocity", "torque")
        for end, choose in (("low", np.min), ("high", np.max))
    }
    if max(max(task.limit_use(target, motion).values()) for motion in runs) > 1:
        raise ConfigurationError(nothing_moves(task))
    reached = {
        "low": float(min(ranges["position_low"].min(), target.min())),
        "high": float(max(ranges["position_high"].max(), target.max())),
        "speed": float(max(-ranges["velocity_low"].min(), ranges["velocity_high"].max())),
        "torque": float(max(-ranges["torque_low"].min(), ranges["torque_high"].max())),
    }
    time, first = np.arange(len(target)) / task.setup.rate, runs[0]
    return DesignSignals(time, target, first.position, first.velocity, first.torque, **ranges), reached


def duration_for(task: Task, informations: list[Information], wanted: float) -> float:
    """Return the length in whole patterns [s] at which every joint's Coulomb friction is known to `wanted` [1].

    informations: of the whole log about each joint; the variance falls as one over the time.
    """
    worst = max(float(belief.relative[2]) for belief in informations)
    return task.count / task.setup.rate * max(1, ceil(task.repeats * (worst / wanted) ** 2))


def predictions(informations: list[Information]) -> tuple[Predicted, ...]:
    """Return each parameter's predicted deviation, of the nominal joint, which is the first, and the worst of all."""
    nominal = informations[0]
    predicted = []
    for index, name in enumerate(nominal.names):
        value, std = float(nominal.values[index]), float(nominal.std[index])
        relative = std / abs(value) if value else None
        worst = max(float(b.std[index] / abs(b.values[index])) for b in informations) if value else None
        predicted.append(Predicted(name, value, std, relative, worst))
    return tuple(predicted)


def advice(task: Task, gains: PDGains, trials: tuple[GainTrial, ...]) -> str:
    """Explain the gains in a sentence or two; task: at the gains that were given, of the first trial."""
    first_trial, run_at = trials[0], f"Run at kp {gains.kp:g}, kd {gains.kd:g}"
    if gains != task.gains:
        after = next(trial.worst for trial in trials if trial.kp == gains.kp)
        gain = f" by a factor of {two_digits(first_trial.worst / after)}" if first_trial.worst and after else ""
        return (
            f"{run_at}, not at the given kp {task.gains.kp:g}, kd {task.gains.kd:g}: the largest relative "
            f"deviation falls{gain}. Still lower gains do not track, overshoot, or bring less than a tenth. If you "
            "cannot set gains, design again with --fixed-gains."
        )
    if not task.setup.fixed_gains:
        return f"{run_at}, as given: lower gains do not track, or show less than a tenth more."
    enough = REQUIRED_REDUCTION * (first_trial.worst or 0.0)
    better = [(trial.worst, trial.kp) for trial in trials[1:] if trial.tracks and trial.worst and trial.worst < enough]
    more = f"kp {min(better)[1]:g} would show more." if better else "Lower ones show no more."
    return f"{run_at}, as fixed. {more}"


def cautions(task: Task, trials: tuple[GainTrial, ...], informations: list[Information]) -> list[str]:
    """Return the facts that the reader must know before running the log."""
    warnings, setup = [], task.setup
    chosen = next((trial for trial in trials if trial.kp == task.gains.kp), None)
    if chosen is not None and chosen.reach < LEAST_REACH:
        warnings.append(
            f"at kp {task.gains.kp:g} the joint may cover no more than {chosen.reach:.0%} of what its target does"
        )
    if setup.position_only:
        warnings.append(
            "without torque in the log only combinations are known: I/k, (B + k kd)/k, f/k, k being the motor's "
            "strength; log the motor's current, or add a known load, to separate them"
        )
    if setup.resolution > 2 * setup.noise_position:
        warnings.append(
            "the encoder's step is larger than the noise: rounding is counted as white noise, which it is not in slow "
            "motion; the real deviations may be larger"
        )
    if max(belief.worst for belief in informations) < NEGLIGIBLE:
        warnings.append(
            "white noise leaves less than half a per cent: noise that the loop feeds back, friction that is not quite "
            "Coulomb's, timing and cogging will decide how right the result is. Read the predictions as a comparison "
            "of logs; simulated logs with correlated loop noise scattered 10 to 25 times as much"
        )
    return warnings
