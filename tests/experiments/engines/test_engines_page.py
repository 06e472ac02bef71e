"""The files of the page of engines: what a study leaves, and what it does not leave of the one before."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction_experiments.engines.page import EnginesResult, report
from stiction_experiments.engines.run import FigureRow, PaceRow, Traces
from stiction_experiments.lab.study import write_report

LINE = np.array([0.1, 0.2])
MOTIONS = Traces(LINE, LINE, LINE, {"ode": LINE}, {"ode": LINE}, {"ode": LINE}, LINE)
FIGURE = FigureRow("ode", 0.002, "terrain", "height", 1e-3, "m", 3e-3, passed=True)
RESULT = EnginesResult((FIGURE,), (PaceRow("ode", 0.002, 2000.0, 1.0),), (), (), MOTIONS, {})


def test_a_study_without_walks_leaves_none_of_an_earlier_one(tmp_path: Path) -> None:
    """Removes the tables and the figure of earlier walks."""
    for name in ("walks.csv", "episodes.csv", "walks.png"):
        (tmp_path / name).touch()
    made = {
        "command": "c",
        "revision": "r",
        "warnings": ["The code changed."],
        "machine": {"cpu": "p"},
    }
    write_report(tmp_path, report(RESULT, {"policies": {}, "robot": "go1", "seconds": 1.0}), made)
    assert "The code changed." in (tmp_path / "report.html").read_text()
    assert {file.name for file in tmp_path.iterdir()} == {
        *("conformance.csv", "pace.csv", "motions.png", "summary.json", "report.html")
    }
