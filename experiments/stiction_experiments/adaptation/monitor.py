"""Fits the wear monitor of a policy and tests it on robots that it was neither fitted nor calibrated on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.statistics import t_interval
from stiction.deploy.wear import Moments
from stiction.evaluation.evaluate import Evaluation, EvaluationCfg
from stiction.files.wear import WearModel
from stiction_experiments.adaptation.probes import (
    LIMIT,
    TEST_OF,
    FrictionWalk,
    Per,
    determination,
    fit_ridge,
    mean_interval,
    windows,
)
from stiction_experiments.lab.statistics import conformal_bound
from stiction_experiments.lab.trained import LATENTS, walk_run

WINDOW = 500
"""Control steps of a window: 10 s at 50 Hz, two commands or more."""

LEAST_R2 = 0.5
"""The lower end of a target's R² on unseen robots must be above this, else no estimate of it is given: the error is
then under 0.71 of the spread."""

COVERED, USUAL = 0.95, 0.99
"""Shares of calibration windows within the interval, and that do not count as unusual."""


def fit_monitor(
    walks: Mapping[Per, FrictionWalk],
    moments: Moments,
    joint_names: tuple[str, ...],
    highest: float,
    student: str,
    window: int = WINDOW,
) -> WearModel:
    """Fit on half of the robots, calibrate the intervals on a quarter, test on the last quarter.

    The robots of both walks are put together: of those drawn per joint none has much friction, or little, everywhere.
    A joint is judged by the robots drawn per joint, where no other joint is correlated with it, the level by the robots
    drawn per robot. highest: highest friction drawn [-]; student: SHA-256 of the student's checkpoint; window: control
    steps of a window.
    """
    features, targets, robot, drawn, first = [], [], [], [], 0
    for per, walk in walks.items():
        means = windows(moments(walk.frames[:-1], walk.frames[1:]), window)
        rows, count = means.shape[:2]
        features.append(means.reshape(rows * count, -1))
        friction = np.column_stack([walk.friction, walk.friction.mean(axis=1)])
        # Windows first, robots within them, as in the features.
        targets.append(np.tile(friction, (rows, 1)))
        robot.append(np.tile(np.arange(count) + first, rows))
        drawn.append(np.full(rows * count, per))
        first += count
    x, y, number, how = (np.concatenate(parts) for parts in (features, targets, robot, drawn))
    # By robot, not by window: windows of one walk are nearly copies of each other.
    part = number % TEST_OF
    fit, calibrate, test = part < TEST_OF - 2, part == TEST_OF - 2, part == TEST_OF - 1
    ridge = fit_ridge(x[fit], y[fit], number[fit])
    error = np.abs(y - ridge.predict(x))
    reach = conformal_bound(error[calibrate], COVERED)
    distance = (ridge.standard(x) ** 2).mean(axis=1)
    values, low = np.zeros(y.shape[1]), np.zeros(y.shape[1])
    for per, columns in (("joint", slice(None, -1)), ("robot", slice(-1, None))):
        seen = test & (how == per)
        score = determination(y[seen, columns], ridge.predict(x[seen])[:, columns], number[seen], ridge.guess[columns])
        values[columns], low[columns] = score.each, score.each_interval[0]
    return WearModel(
        joint_names=joint_names,
        window=window,
        center=tuple(ridge.center.tolist()),
        scale=tuple(ridge.scale.tolist()),
        limit=LIMIT,
        weights=tuple(tuple(row) for row in ridge.weights.tolist()),
        intercept=tuple(ridge.intercept.tolist()),
        reach=tuple(reach.tolist()),
        estimated=tuple((low > LEAST_R2).tolist()),
        determination=tuple(values.tolist()),
        coverage=tuple((error[test] <= reach).mean(axis=0).tolist()),
        threshold=LEAST_R2,
        highest=highest,
        unusual=float(conformal_bound(distance[calibrate, None], USUAL)[0]),
        student=student,
    )


FIGURES = ("speed_ratio", "tracking_error")
"""Compared columns of results.csv."""


def latent_effects(
    run: Path, cfg: EvaluationCfg, threads: int, progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Evaluate a run's student on every kind of latent; return `rows` of results.csv and `effects`.

    An effect is the difference to the walk on its own latent at one friction level, of the means over commands. Episode
    e has the same initial state and noise in both walks, so the difference is taken episode by episode; its interval
    is a bootstrap over episodes, for this policy and no other.
    """
    walks: dict[str, Evaluation] = {}
    for number, latent in enumerate(LATENTS):
        walks[latent] = walk_run(run, "student", cfg, latent, threads)
        progress((number + 1) / len(LATENTS))
    effects = []
    for latent, (index, level), figure in product(LATENTS[1:], enumerate(cfg.friction_levels), FIGURES):
        own, other = (per_episode(walks[name], cfg, index, figure) for name in ("own", latent))
        effects.append(
            {
                "latent": latent,
                "level": level,
                "figure": figure,
                "own": float(own.mean()),
                "value": float(other.mean()),
                "difference": float((other - own).mean()),
                "interval95": list(mean_interval(other - own)),
            }
        )
    return {"rows": [asdict(row) for walk in walks.values() for row in walk.rows], "effects": effects}


def per_episode(walk: Evaluation, cfg: EvaluationCfg, level: int, figure: str) -> np.ndarray:
    """Return a figure of each episode at the level number `level`, means over the commands, shape (episodes,)."""
    count = len(cfg.commands)
    rows = walk.episodes[level * count : (level + 1) * count]
    return np.mean([[getattr(episode, figure) for episode in row] for row in rows], axis=0)


def over_seeds(runs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the effects of runs of one method, means over their seeds with t-intervals (null for a single seed).

    `runs`: what `latent_effects` returned for each, over the same levels.
    """
    pooled = []
    for same in zip(*(run["effects"] for run in runs), strict=True):
        means = {name: float(np.mean([effect[name] for effect in same])) for name in ("own", "value", "difference")}
        each = [effect["difference"] for effect in same]
        pooled.append(
            {name: same[0][name] for name in ("latent", "level", "figure")}
            | means
            | {"interval95": seeds_interval(each), "seeds": len(same), "each": each}
        )
    return pooled


def seeds_interval(values: Sequence[float]) -> list[float] | None:
    """Return the t-interval of the mean over seeds; None for a single one."""
    interval = t_interval(values)
    return None if interval is None else list(interval)
