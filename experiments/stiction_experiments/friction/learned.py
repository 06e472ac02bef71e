"""Metrics of a training's code or disturber in its last iterations: no evaluation can tell them afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stiction.report.page import Sheet
from stiction_experiments.friction.records import LearnedFigure

LAST = 20
"""Iterations of which the mean is taken."""

KINDS = ("code/", "bootstrap/", "hinf/")
"""How the names of such figures begin in a run's metrics."""

FRICTION = "code/friction/"
"""How the name of R² of one joint's friction begins; the page has the mean of all joints."""

COLUMNS: dict[str, tuple[str, dict[str, str]]] = {
    "code": (
        "DreamWaQ: what the code tells",
        {
            "code/kl": "KL [nat]",
            "code/active": "active dimensions",
            "code/reconstruction": "error of the next observation",
            "code/repeat": "of the present one in its place",
            FRICTION: "R² of a joint's friction",
            "bootstrap/share": "on the estimate",
        },
    ),
    "disturber": (
        "H∞: what the disturbance cost",
        {
            "hinf/cost": "cost",
            "hinf/intensity": "intensity",
            "hinf/constraint": "constraint",
            "hinf/lambda": "λ",
            "hinf/eta": "η",
            "hinf/limit": "limit",
        },
    ),
}
"""Table -> its title, and figure -> heading of its column."""


def learned_figures(run: str, rows: Sequence[Mapping[str, Any]]) -> list[LearnedFigure]:
    """Return the means of such figures of a run over its last iterations; rows: the lines of its metrics.jsonl."""
    last = rows[-LAST:]
    names = dict.fromkeys(name for row in last for name in row if name.startswith(KINDS))
    values = {name: [float(row[name]) for row in last if name in row] for name in names}
    return [LearnedFigure(run, name, len(series), float(np.mean(series))) for name, series in values.items()]


def learned_sheets(learned: Sequence[LearnedFigure]) -> dict[str, Sheet]:
    """Return the tables of those figures that there are, a row a run."""
    runs: dict[str, dict[str, list[float]]] = {}
    for one in learned:
        name = FRICTION if one.figure.startswith(FRICTION) else one.figure
        runs.setdefault(one.run, {}).setdefault(name, []).append(one.mean)
    sheets = {}
    for table, (title, columns) in COLUMNS.items():
        own = {run: figures for run, figures in runs.items() if any(name in figures for name in columns)}
        if own:
            rows = tuple((run, *(_text(figures.get(name, ())) for name in columns)) for run, figures in own.items())
            note = f"Means of the last {LAST} iterations of each training."
            sheets[f"learned-{table}"] = Sheet(title, ("training", *columns.values()), rows, note)
    return sheets


def _text(values: Sequence[float]) -> str:
    return f"{np.mean(values):.3g}" if values else "–"
