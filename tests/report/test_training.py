"""The curves of a run are drawn from its metrics alone."""

import json
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
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


def test_a_run_of_an_older_version_is_drawn(tmp_path: Path) -> None:
    """Its files have fewer figures: what is not there has no panel, and the rest is drawn."""
    old = [{"phase": "teacher", "iteration": i, "reward": 0.1, "walk/falls": 0.0} for i in range(3)]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in old))
    assert draw_training(tmp_path).read_bytes().startswith(b"\x89PNG")


def test_a_run_without_figures_is_named(tmp_path: Path) -> None:
    """One line that says which file was expected."""
    with pytest.raises(StictionError, match=r"metrics\.jsonl"):
        draw_training(tmp_path)
