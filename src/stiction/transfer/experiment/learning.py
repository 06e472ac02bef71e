"""Learning curves: how fast a run came to walk, from its metrics.jsonl."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stiction.formats.experiment import CurvePoint
from stiction.formats.results import FOLLOWS
from stiction.transfer.experiment.manifest import condition_of
from stiction.transfer.experiment.table import Points

Rows = Sequence[dict[str, Any]]
"""The lines of one run's metrics.jsonl."""

WALKS = FOLLOWS[0]
"""Speed ratio in training from which a teacher counts as walking, however fast [-]."""

WINDOW = 10
"""Iterations that are averaged: 240 control steps of 512 robots."""

FORWARD, BACKWARD = "walk/forward_ratio", "walk/backward_ratio"


def learning_curve(run: str, rows: Rows) -> list[CurvePoint]:
    """Return the speed ratios of a run, means of `WINDOW` iterations; a rest that is shorter is left out."""
    points = []
    for phase in ("teacher", "student"):
        own = [row for row in rows if row["phase"] == phase]
        for end in range(WINDOW, len(own) + 1, WINDOW):
            part = own[end - WINDOW : end]
            forward, backward = (float(np.mean([row[name] for row in part])) for name in (FORWARD, BACKWARD))
            points.append(CurvePoint(run, phase, int(part[-1]["iteration"]), forward, backward))
    return points


def iterations_to_walk(curve: Sequence[CurvePoint], iterations: int) -> int:
    """Return the iteration from which the teacher first walks both ways; `iterations` where it never does.

    A run that never walks counts as the whole budget, which is less than the truth.
    """
    for point in curve:
        if point.phase == "teacher" and min(point.forward_ratio, point.backward_ratio) >= WALKS:
            return point.iteration
    return iterations


def iterations_by_seed(condition: str, curves: Mapping[str, Sequence[CurvePoint]], iterations: int) -> Points:
    """Return `iterations_to_walk` of every seed of a condition. `curves`: run -> its learning curve."""
    found = {condition_of(run): curve for run, curve in curves.items()}
    return {
        seed: float(iterations_to_walk(curve, iterations))
        for (name, seed), curve in sorted(found.items())
        if name == condition
    }
