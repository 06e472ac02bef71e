"""The curves of a run are drawn from its metrics alone."""

import json
from pathlib import Path

from stiction.files.results import read_metrics
from stiction.report.training import PANELS, draw_training


def rows(count: int) -> list[dict]:
    """Figures of `count` iterations of each phase."""
    names = [name for _, group in PANELS for name in group]
    return [
        {"phase": phase, "iteration": i + 1, **dict.fromkeys(names, 0.1 * i)}
        for phase in ("teacher", "student")
        for i in range(count)
    ]


def test_curves_are_a_picture(tmp_path: Path) -> None:
    """Both phases, and a line that was cut off by a kill does not matter."""
    text = "".join(json.dumps(row) + "\n" for row in rows(3))
    (tmp_path / "metrics.jsonl").write_text(text + '{"phase": "stud')
    assert len(read_metrics(tmp_path / "metrics.jsonl")) == 6
    assert draw_training(tmp_path).read_bytes().startswith(b"\x89PNG")
