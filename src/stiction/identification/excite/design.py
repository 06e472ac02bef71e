"""Search for the motion that shows a joint best within its limits.

The criterion is the largest relative standard deviation among inertia, viscous and Coulomb friction, in the worst of
four extreme joints: it does not depend on units, and does not trade a vague friction for a sharp inertia.

At gains kp the position lags by f/kp while the joint moves, so a stiff loop hides friction from a position log. A
measured torque shows f whatever the gains; there they decide how fast the joint may move before it overshoots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution

from stiction.core.errors import ConfigurationError
from stiction.core.provenance import seed_streams, stream_seed
from stiction.files.design import GainTrial
from stiction.identification.checks import FEWEST_PER_CYCLE
from stiction.identification.excite.pattern import Pattern
from stiction.identification.excite.task import Task
from stiction.joints.friction import dead_band
from stiction.joints.pd import PDGains

WAVES = 3
"""Number of sines of the fast part."""

POPULATION = 16
"""Number of motions in one generation of the search."""

GENERATIONS = 11
"""Number of generations after the first."""

MUTATION = (0.3, 0.7)
"""Range of the steps between generations, in units of the difference of two motions: small, for few generations."""

FASTEST = 8.0
"""Highest frequency of the search [Hz]."""

BEYOND = 1.5
"""Highest frequency in units of the loop's natural one, sqrt(kp/I)/2π; above it the joint hardly follows."""

LARGEST_SHARE = 0.9
"""Largest share of the slow part in the search [1]."""

OUT_OF_REACH = 1e6
"""Score of a motion that fits no limits or shows nothing."""


def starters() -> np.ndarray:
    """Return reasonable motions to start the search from, in the coordinates of `pattern_of`, shape (6, 11)."""
    waves = [0.4, 0.6, 0.8, 1.0, 0.8, 0.5, 0.0, 0.25, 0.5]
    single = [0.0, 0.5, 0.7, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    rows = [[share, 0.3, *waves] for share in (0.4, 0.6, 0.9)]
    rows += [[share, 0.3, *single] for share in (0.0, 0.4, 0.8)]
    return np.array(rows)


def pattern_of(task: Task, point: np.ndarray) -> Pattern:
    """Return the motion at a point of the unit cube, shape (11,).

    Coordinates: share of the slow part; its frequency; of each sine frequency, amplitude and phase. Both
    parts swing through the whole room, for a small slow swing would see the friction of one angle only;
    `Task.within_limits` scales them down.
    """
    frequencies, amplitudes, phases = np.reshape(point[2:], (3, WAVES))
    slowest, fastest = 2 * task.setup.rate / task.count, frequency_limit(task)
    return Pattern(
        share=float(point[0]) * LARGEST_SHARE,
        slow_frequency=float(0.5 * slowest * (2.0 / slowest) ** point[1]),
        slow_amplitude=task.room,
        frequencies=tuple(float(slowest * (fastest / slowest) ** place) for place in frequencies),
        # Not all of them zero, or there would be nothing for `fast_peak` to scale.
        amplitudes=tuple(float(value) + 1e-3 for value in amplitudes),
        phases=tuple(float(2 * np.pi * value) for value in phases),
        fast_peak=task.room,
    )


def frequency_limit(task: Task) -> float:
    """Return the highest frequency worth trying [Hz]."""
    natural = float(np.sqrt(task.gains.kp / task.values[0])) / (2 * np.pi)
    # With fewer samples a period the log would be refused (`check_excitation`).
    rate = task.setup.rate
    return max(min(FASTEST, BEYOND * natural, rate / FEWEST_PER_CYCLE), 4 * rate / task.count)


def search(task: Task, seed: int, progress: Callable[[float], None]) -> Pattern:
    """Return the best motion of the search; the same seed gives the same one. progress: gets the share done.

    Gravity enters at the end, when the motion is made to fit the limits.
    Raises `StictionError` if no motion within the limits shows anything.
    """
    known, light = starters(), task.without_gravity()
    drawn = seed_streams(seed, ["first"])["first"].random((POPULATION - len(known), known.shape[1]))
    done = 0

    def objective(point: np.ndarray) -> float:
        nonlocal done
        done += 1
        progress(min(1.0, done / (POPULATION * (GENERATIONS + 1))))
        pattern = light.within_limits(pattern_of(light, point), [light.least_damped()])
        return OUT_OF_REACH if pattern is None else min(OUT_OF_REACH, light.worst(pattern, fast=True))

    result = differential_evolution(
        objective,
        [(0.0, 1.0)] * known.shape[1],
        init=np.concatenate([known, drawn]),
        maxiter=GENERATIONS,
        mutation=MUTATION,
        # Neither an early end nor a polish: the number of motions is what `progress` counts to.
        tol=0.0,
        polish=False,
        # SciPy hands it to a RandomState, which takes 32 bits.
        seed=stream_seed(seed, "search") % 2**32,
    )
    pattern = None
    if result.fun < OUT_OF_REACH:
        pattern = light.within_limits(pattern_of(light, result.x), light.candidates())
        pattern = pattern and task.within_limits(pattern, task.candidates())
    if pattern is None:
        raise ConfigurationError(nothing_moves(task))
    return pattern


def nothing_moves(task: Task) -> str:
    """Return the one line for limits within which no motion shows anything."""
    sag = f", or it hangs {task.sag:.2g} rad below its target" if task.sag else ""
    return (
        "no motion within angles {low:g} to {high:g} rad, {speed:g} rad/s and {torque:g} N m ".format(**task.limits)
        + f"shows the joint at kp {task.gains.kp:g}: friction of {task.values[2]:g} N m, off by a factor of "
        f"{task.setup.spread:g}, holds it or throws it beyond a limit{sag}; widen the limits, lower --spread, or "
        "change --kp"
    )


FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Gain factors that are tried. Lower ones leave the joint to cogging and cables, which no guess covers."""

LEAST_REACH = 0.7
"""Range of the motion over that of its target below which a loop does not track."""

LARGEST_SAG = 0.25
"""Largest sag of the link below its target, in units of the swing, in a loop that tracks."""

REQUIRED_REDUCTION = 0.9
"""Share of the given gains' criterion below which gains are changed."""


def softened(gains: PDGains, factor: float) -> PDGains:
    """Return gains with kp times `factor` and kd times its root, which keeps the loop's damping ratio.

    Rounded to three digits, which people can type.
    """
    if factor == 1:
        return gains
    return replace(gains, kp=float(f"{gains.kp * factor:.3g}"), kd=float(f"{gains.kd * factor**0.5:.3g}"))


def try_gains(task: Task, gains: PDGains) -> GainTrial:
    """Judge gains by the best of a few motions that need no search; a link that sags too much does not track."""
    task = task.with_gains(gains)
    # The sag is of the link with its gravity, so it is computed before that is left out.
    sag, task = task.sag, task.without_gravity()
    best, reach = None, 0.0
    for point in starters():
        pattern = task.within_limits(pattern_of(task, point), [*task.extremes(), task.least_damped()])
        worst = np.inf if pattern is None else task.worst(pattern, fast=True)
        if pattern is not None and worst < (np.inf if best is None else best):
            best, reach = worst, task.reach(task.target(pattern), task.candidates()[-1:])
    tracks = best is not None and reach >= LEAST_REACH and sag <= LARGEST_SAG * task.room
    return GainTrial(gains.kp, gains.kd, best, reach, tracks)


def choose_gains(task: Task, progress: Callable[[float], None]) -> tuple[PDGains, tuple[GainTrial, ...]]:
    """Return the gains to run at, and the prediction for every pair; the given ones where no lower ones are worth it.

    Raises `StictionError` where friction holds the joint, or nothing fits the limits.
    """
    check_dead_band(task)
    pairs, trials = [softened(task.gains, factor) for factor in FACTORS], []
    for index, gains in enumerate(pairs):
        trials.append(try_gains(task, gains))
        progress((index + 1) / len(FACTORS))
    scores = [trial.worst if trial.tracks and trial.worst is not None else np.inf for trial in trials]
    best = min(scores)
    given_gains = task.setup.fixed_gains or not np.isfinite(best)
    if trials[0].worst is None and given_gains:
        raise ConfigurationError(nothing_moves(task))
    # From the given gains downwards: the highest that show about as much as the best.
    enough = best / REQUIRED_REDUCTION
    chosen = (
        pairs[0] if given_gains else next(gains for gains, worst in zip(pairs, scores, strict=True) if worst <= enough)
    )
    return chosen, tuple(trials)


def check_dead_band(task: Task) -> None:
    """Raise `StictionError` where the whole swing of the target would not break the joint away: f >= kp × swing.

    The check is of the guess, and of the largest friction in the range around it.
    """
    swing, guess, kp, spread = task.room, float(task.values[2]), task.gains.kp, task.setup.spread
    for friction, phrase, other in (
        (guess, "friction of", ""),
        (guess * spread, f"--spread {spread:g} allows for friction of", ", lower --spread"),
    ):
        if friction >= kp * swing:
            raise ConfigurationError(
                f"{phrase} {friction:g} N m, which holds the joint: the dead band at kp {kp:g} is "
                f"{dead_band(friction, kp):.3g} rad, and the limits allow a swing of {swing:.3g} rad; "
                f"raise --kp above {friction / swing:.3g}{other}, or widen --position-limits"
            )
