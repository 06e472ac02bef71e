"""Fits the wear monitor of a policy and tests it on robots that it was neither fitted nor calibrated on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stiction.deploy.wear import Moments
from stiction.formats.wear import WearModel
from stiction.transfer.adaptation.friction_walk import FrictionWalk, Per
from stiction.transfer.adaptation.probes import TEST_OF, windows
from stiction.transfer.adaptation.ridge import LIMIT, determination, fit_ridge

WINDOW = 500
"""Control steps of a window: 10 s at 50 Hz, two commands or more."""

TOLD = 0.5
"""R² on unseen robots whose lower end must be above this: the error is then under 0.71 of the spread that a guess has.
Below it an estimate is hardly better than none, and none is given."""

COVERED, USUAL = 0.95, 0.99
"""Shares of calibration windows within the interval, and under the bound of what is usual."""


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
    A joint is judged by the robots drawn per joint: there no other joint gives it away. The level is judged by the
    robots drawn per robot.

    Args:
        walks: one for each way of drawing friction.
        moments: makes the features.
        joint_names: the joints, in order.
        highest: highest friction drawn [-].
        student: SHA-256 of the student's checkpoint.
        window: control steps of a window.

    """
    features, targets, robot, drawn, first = [], [], [], [], 0
    for per, walk in walks.items():
        means = windows(moments(walk.frames[:-1], walk.frames[1:]), window)
        rows, count = means.shape[:2]
        features.append(means.reshape(rows * count, -1))
        friction = np.column_stack([walk.friction, walk.friction.mean(axis=1)])
        targets.append(np.tile(friction, (rows, 1)))
        robot.append(np.tile(np.arange(count) + first, rows))
        drawn.append(np.full(rows * count, per))
        first += count
    x, y, number, how = (np.concatenate(parts) for parts in (features, targets, robot, drawn))
    part = number % TEST_OF
    fit, calibrate, test = part < TEST_OF - 2, part == TEST_OF - 2, part == TEST_OF - 1
    ridge = fit_ridge(x[fit], y[fit], number[fit])
    error = np.abs(y - ridge.predict(x))
    reach = upper(error[calibrate], COVERED)
    distance = (ridge.standard(x) ** 2).mean(axis=1)
    values, low = np.zeros(y.shape[1]), np.zeros(y.shape[1])
    for per, columns in (("joint", slice(None, -1)), ("robot", slice(-1, None))):
        seen = test & (how == per)
        found = determination(y[seen, columns], ridge.predict(x[seen])[:, columns], number[seen], ridge.guess[columns])
        values[columns], low[columns] = found.each, found.each_interval[0]
    return WearModel(
        joint_names=joint_names,
        window=window,
        center=tuple(ridge.center.tolist()),
        scale=tuple(ridge.scale.tolist()),
        limit=LIMIT,
        weights=tuple(tuple(row) for row in ridge.weights.tolist()),
        intercept=tuple(ridge.intercept.tolist()),
        reach=tuple(reach.tolist()),
        told=tuple((low > TOLD).tolist()),
        determination=tuple(values.tolist()),
        coverage=tuple((error[test] <= reach).mean(axis=0).tolist()),
        threshold=TOLD,
        highest=highest,
        unusual=float(upper(distance[calibrate, None], USUAL)[0]),
        student=student,
    )


def upper(values: np.ndarray, share: float) -> np.ndarray:
    """Return, for each column of (n, columns), what a new value is under with probability `share`, if it is of a kind.

    The ⌈share (n + 1)⌉-th smallest (split conformal prediction); the largest where n is too small for that.
    """
    rank = min(int(np.ceil(share * (len(values) + 1))), len(values))
    return np.sort(values, axis=0)[rank - 1]
