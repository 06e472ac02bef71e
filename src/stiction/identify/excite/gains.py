"""Which gains to run the log at: low ones let friction show in the position, until it holds the joint.

At gains kp the position lags by f/kp while the joint moves, so a stiff loop hides friction from a position log. A
measured torque shows f whatever the gains; there the gains decide how fast the joint may move before it overshoots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stiction.formats.design import GainTrial
from stiction.formats.errors import StictionError
from stiction.identify.excite.design import nothing_moves, pattern_of, starters
from stiction.identify.excite.task import Task
from stiction.joints.friction import dead_band
from stiction.joints.pd import PDGains

FACTORS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15)
"""Gains tried, in units of the given kp. Lower ones leave the joint to cogging and cables, which no guess covers."""

LEAST_REACH = 0.7
"""Range of the motion over that of its target under which a loop does not track."""

LARGEST_SAG = 0.25
"""How far the link may hang below its target, in units of the swing, before a loop does not track."""

WORTH = 0.9
"""Gains are changed only where the criterion falls below this share of what the given gains reach."""


def softened(gains: PDGains, factor: float) -> PDGains:
    """Return gains with kp times `factor` and kd times its root, which keeps the loop's damping ratio.

    Rounded to three digits: somebody has to type them.
    """
    if factor == 1:
        return gains
    return replace(gains, kp=float(f"{gains.kp * factor:.3g}"), kd=float(f"{gains.kd * factor**0.5:.3g}"))


def try_gains(task: Task, gains: PDGains) -> GainTrial:
    """Judge gains by the best of a few motions that need no search; a link that sags too much does not track."""
    sag = task.at(gains).sag
    task = task.at(gains).weightless()
    extremes, lively = task.extremes(), task.lively()
    best, reach = None, 0.0
    for point in starters():
        pattern = task.fitted(pattern_of(task, point), [*extremes, lively])
        if pattern is None:
            continue
        worst = max(task.information(values, pattern, fast=True).worst for values in extremes)
        if np.isfinite(worst) and (best is None or worst < best):
            best, reach = worst, task.reach(task.target(pattern), task.believed()[-1:])
    tracks = best is not None and reach >= LEAST_REACH and sag <= LARGEST_SAG * task.room
    return GainTrial(gains.kp, gains.kd, best, reach, tracks)


def choose_gains(task: Task, fixed: bool, progress: Callable[[float], None]) -> tuple[PDGains, tuple[GainTrial, ...]]:
    """Return the gains to run at, and what every pair promised; the given ones where no lower ones are worth it.

    fixed: keep the given gains. Raises `StictionError` where friction holds the joint, or nothing fits the limits.
    """
    check_dead_band(task)
    pairs = [softened(task.gains, factor) for factor in FACTORS]
    trials = []
    for index, gains in enumerate(pairs):
        trials.append(try_gains(task, gains))
        progress((index + 1) / len(FACTORS))
    scores = [trial.worst if trial.tracks and trial.worst is not None else np.inf for trial in trials]
    best = min(scores)
    if trials[0].worst is None and (fixed or not np.isfinite(best)):
        raise StictionError(nothing_moves(task))
    if fixed or not np.isfinite(best) or scores[0] <= best / WORTH:
        return pairs[0], tuple(trials)
    return next(gains for gains, worst in zip(pairs, scores, strict=True) if worst <= best / WORTH), tuple(trials)


def check_dead_band(task: Task) -> None:
    """Raise `StictionError` where the whole swing of the target would not break the joint away: f >= kp × swing.

    That goes for the guess, and for the largest friction in the range around it.
    """
    swing = task.room
    for friction, said in (
        (float(task.values[2]), "friction of"),
        (float(task.values[2]) * task.spread, f"--spread {task.spread:g} allows for friction of"),
    ):
        if friction >= task.gains.kp * swing:
            other = "" if friction == task.values[2] else ", lower --spread"
            raise StictionError(
                f"{said} {friction:g} N m, which holds the joint: the dead band at kp {task.gains.kp:g} is "
                f"{dead_band(friction, task.gains.kp):.3g} rad, and the limits allow a swing of {swing:.3g} rad; "
                f"raise --kp above {friction / swing:.3g}{other}, or widen --position-limits"
            )
