"""Estimators of a few lines: textbook regression, output error with SciPy, the objective that the paper prints."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, decimate, filtfilt

from stiction.identification.model import Model
from stiction.identification.reading import Reading
from stiction_experiments.peers.judge import Fitted, best_start
from stiction_experiments.peers.records import Problem

CUTOFFS = (0.05, 0.1, 0.2)
"""Corners of the regression's filter over the sampling rate; 0.1 is what was published for EMPS."""

SLOW = 0.02
"""Speed over the largest one below which the sign of the velocity is not believed, and rows are left out."""

LATEST = 3.0
"""Longest delay of a loop that is tried, in samples."""

DELAYS = 13
"""Delays that the regression tries, evenly from zero to `LATEST`: it has no other way to find one."""

MOST_TRIALS, CHANGE = 40, 1e-6
"""Simulations, derivatives apart, after which output error ends, and relative change of its cost and parameters."""

FINEST = 1e-3
"""Longest step of the simulation of output error [s]."""

FARTHEST = 1e6
"""Position at which a simulation has run away [rad, or m]."""

GRAVITY = ("gravity_sin", "gravity_cos")
"""Parameters of a link with weight."""

NAMES = ("inertia", "viscous_friction", "coulomb_friction", "offset")
"""Parameters of a joint without gravity."""


def regress(problem: Problem, cutoff: float, delay: float) -> dict[str, float]:
    """Return the joint of least squares on torque, filtered forward and backward and thinned.

    cutoff: corner of the Butterworth filter over the sampling rate; delay: of the loop [s], by which a torque that was
    made from target and position acts late; a logged one is taken as it is.
    """
    torque = problem.torque
    if torque is None:
        velocity = np.gradient(problem.position, problem.step)
        asked = problem.kp * (problem.target - problem.position) - problem.kd * velocity
        torque = np.interp(problem.time - delay, problem.time, asked)
    filter_ = butter(4, 2 * cutoff)
    position, smooth = (filtfilt(*filter_, values) for values in (problem.position, torque))
    velocity = np.gradient(position, problem.step)
    acceleration = np.gradient(velocity, problem.step)
    columns = [acceleration, velocity, np.sign(velocity), np.ones_like(position)]
    columns += [np.sin(position), np.cos(position)] if problem.gravity else []
    moving = np.abs(velocity) > SLOW * np.abs(velocity).max()
    table = np.stack([np.where(moving, values, 0.0) for values in (*columns, smooth)])
    # The ends of a filter that runs both ways are its own.
    edge = round(2 / cutoff)
    thinned = decimate(table[:, edge:-edge], round(1 / cutoff), ftype="fir", axis=1)
    solved = np.linalg.lstsq(thinned[:-1].T, thinned[-1], rcond=None)[0]
    return dict(zip((*NAMES, *GRAVITY) if problem.gravity else NAMES, solved.tolist(), strict=True))


def fit_textbook(problem: Problem) -> Fitted:
    """Return the regression whose filter and delay predict the first part best."""
    model, delays = Model("coulomb", problem.gravity), np.linspace(0.0, LATEST * problem.step, DELAYS)
    tried = []
    for cutoff in CUTOFFS:
        for delay in delays.tolist():
            values = regress(problem, cutoff, delay)
            reading = Reading(delay=delay)
            tried.append(Fitted("coulomb", values, model, reading, note=f"filter {cutoff:g} of the rate"))
    return best_start(problem, tried)


def simulate(problem: Problem, joint: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the position of a joint that follows its target [rad, or m], shape (T,).

    joint: inertia, viscous and Coulomb friction, offset, two terms of gravity, and the loop's delay. Semi-implicit
    steps; friction takes at most what stops the joint within one. Numbers, not arrays: one joint at a time is fastest.
    """
    inertia, viscous, coulomb, offset, along, across, delay = map(float, joint)
    kp, kd, limit = problem.kp, problem.kd, problem.limit
    pieces = steps_of(problem)
    step, count = problem.step / pieces, (len(problem.time) - 1) * pieces + 1
    # The motor's torque is that of the middle of a step: half a step ahead of the state, less what the loop is late.
    targets = problem.targets((np.arange(count) + 0.5) * step - delay).tolist()
    late, rate_late = delay / step - 0.5, (delay + problem.velocity_delay) / step - 0.5
    lag, rate_lag = max(0, int(late)), max(0, int(rate_late))
    share, rest, weighs = late - lag, rate_late - rate_lag, bool(along or across)
    position, velocity = float(problem.position[0]), problem.speed
    positions, velocities = [position] * (rate_lag + 2), [velocity] * (rate_lag + 2)
    for target in targets:
        seen = positions[-1 - lag] + share * (positions[-2 - lag] - positions[-1 - lag])
        rate = velocities[-1 - rate_lag] + rest * (velocities[-2 - rate_lag] - velocities[-1 - rate_lag])
        push = min(max(kp * (target - seen) - kd * rate, -limit), limit) - offset - viscous * velocity
        if weighs:
            push -= along * sin(position) + across * cos(position)
        stop = inertia / step * velocity + push
        faster = velocity + step / inertia * (push - min(max(stop, -coulomb), coulomb))
        position, velocity = position + 0.5 * step * (velocity + faster), faster
        if not -FARTHEST < position < FARTHEST:
            return np.full(len(problem.time), np.inf)
        positions.append(position)
        velocities.append(velocity)
    return np.array(positions[rate_lag + 1 : -1 : pieces])


def steps_of(problem: Problem) -> int:
    """Return the number of steps in which a sample interval is simulated."""
    return max(1, int(np.ceil(problem.step / FINEST - 1e-9)))


def full_joint(values: Sequence[float], gravity: bool) -> np.ndarray:
    """Return a column of `simulate` from inertia, viscous, Coulomb, offset, perhaps gravity, and delay, shape (7,)."""
    return np.array([*values[:4], *(values[4:6] if gravity else (0.0, 0.0)), values[-1]])


def fit_output_error(problem: Problem, textbook: Fitted) -> Fitted:
    """Return viscous and Coulomb friction, and the loop's delay, by `scipy.optimize.least_squares` on the position.

    It begins where the regression ends, and from half and twice that friction; the lowest cost is taken.
    """
    assert textbook.values is not None
    names = (*NAMES, *GRAVITY) if problem.gravity else NAMES
    begin = np.array([*(textbook.values[name] for name in names), textbook.reading.delay])
    begin[:3] = np.maximum(begin[:3], 1e-3 * np.abs(begin[0]))
    torque = max(begin[2], 1e-3 * problem.kp * float(np.ptp(problem.position)))
    scale = np.array([begin[0], max(begin[1], begin[2]), *[torque] * (len(names) - 2), problem.step])
    low = np.array([0.05 * begin[0], *[-np.inf if name != "coulomb_friction" else 0.0 for name in names[1:]], 0.0])
    high = np.array([20 * begin[0], *[np.inf] * (len(names) - 1), LATEST * problem.step])

    def residuals(point: np.ndarray) -> np.ndarray:
        error = simulate(problem, full_joint(point * scale, problem.gravity)) - problem.position
        return np.clip(error / float(np.std(problem.position)), -FARTHEST, FARTHEST)

    results = []
    for more in (1.0, 0.5, 2.0):
        start = begin.copy()
        start[2] *= more
        start = np.clip(start, low + 1e-9 * scale, high - 1e-9 * scale) / scale
        results.append(
            least_squares(
                residuals,
                start,
                bounds=(low / scale, high / scale),
                diff_step=1e-5,
                ftol=CHANGE,
                xtol=CHANGE,
                gtol=None,
                max_nfev=MOST_TRIALS,
            )
        )
    best = min(results, key=lambda result: result.cost).x * scale
    reading = Reading(delay=float(best[-1]))

    def predict(other: Problem) -> np.ndarray:
        return simulate(other, full_joint(best, problem.gravity))

    values = dict(zip(names, best[:-1].tolist(), strict=True))
    return Fitted("coulomb", values, Model("coulomb", problem.gravity), reading, predict)


def paper_objective(problem: Problem, inertia: float, viscous: float, coulomb: float) -> float:
    """Return the objective of the paper's identification, mean (θ* − θ)², at a joint [rad²].

    θ* is the excitation signal and θ the sampled angle: both are data, and the joint does not enter. Source: the
    equation of section V.
    """
    del inertia, viscous, coulomb
    return float(np.mean((problem.target - problem.position) ** 2))


def fit_paper(problem: Problem, textbook: Fitted) -> Fitted:
    """Return that the objective which the paper prints has no minimum."""
    del textbook
    rng = np.random.default_rng(0)
    values = {paper_objective(problem, *joint) for joint in rng.uniform(0.0, 1.0, (1000, 3))}
    return Fitted("none", note=f"objective {min(values):.3g} at 1000 joints drawn at random, {len(values)} value")
