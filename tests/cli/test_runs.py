"""`stiction runs` as a user runs it: a list on 80 columns, a comparison, and both as JSON."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from run_folders import CFG, make_run
from stiction.cli.main import main


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three runs of one hour, two and three days, and a damaged folder."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("time.time", lambda: 1e6)
    long = "a-run-with-quite-a-long-name-of-its-own"
    for name, age, rows in (("first", 3 * 86400, 5), (long, 3600, 30), ("cohort/second", 2 * 86400, 150)):
        run = make_run(tmp_path / name, rows=rows, cfg=replace(CFG, seed=rows))
        os.utime(run / "metrics.jsonl", (1e6 - age, 1e6 - age))
    (tmp_path / "cohort/second/summary.json").write_text("{}")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/config.json").write_text("{")
    return tmp_path


def test_the_newest_run_comes_first_on_80_columns(runs: Path, capsys: pytest.CaptureFixture) -> None:
    """Folds a long name alone; damage is a line below, and no error."""
    assert main(["runs", str(runs)]) == 0
    lines = capsys.readouterr().out.splitlines()
    *table, damaged = lines
    assert all(len(line) <= 80 for line in table)
    method = CFG.task.friction.method
    rows = [line.split() for line in table if method in line.split()]
    assert [row[-7:] for row in rows] == [
        ["30", "30/150", "stopped", "20.5000", "–", "1", "h"],
        ["150", "150/150", "finished", "140.5000", "–", "2", "d"],
        ["5", "5/150", "stopped", "3.0000", "–", "3", "d"],
    ]
    assert damaged.startswith(f"damaged: {runs / 'broken'}: config.json: not JSON")


def test_a_comparison_shows_settings_and_ends(runs: Path, capsys: pytest.CaptureFixture) -> None:
    """Shows the seed, which differs, and no setting that does not; end values of the curves stand side by side."""
    assert main(["runs", str(runs / "first"), str(runs / "cohort/second")]) == 0
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["setting", "first", "cohort/second"] in words and ["seed", "5", "150"] in words
    assert ["reward", "a", "step", "3", "140.5"] in words
    assert ["iterations", "5/150", "stopped", "150/150", "finished"] in words
    assert not any(word[0].startswith("teacher.") for word in words if word)


def test_both_are_json(runs: Path, capsys: pytest.CaptureFixture) -> None:
    """Prints nothing else on standard output, and null for a figure that is no number."""
    (runs / "first/metrics.jsonl").write_text('{"phase": "teacher", "iteration": 1, "reward": NaN}\n')
    assert main(["runs", str(runs), "--json"]) == 0

    def refuse(name: str) -> None:
        raise ValueError(name)

    listed = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert {Path(run["path"]).name: run["ends"]["reward"] for run in listed["runs"]}["first"] is None
    assert [Path(each["path"]).name for each in listed["damaged"]] == ["broken"]
    assert main(["runs", str(runs / "first"), str(runs / "cohort/second"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["settings"] == {"seed": [5, 150]}


def test_what_cannot_be_compared_is_one_line(runs: Path, capsys: pytest.CaptureFixture) -> None:
    """Names the file; an empty folder has no runs, and a missing one is an error."""
    assert main(["runs", str(runs / "first"), str(runs / "broken")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    (runs / "empty").mkdir()
    assert main(["runs", str(runs / "empty")]) == 0
    assert "no runs in" in capsys.readouterr().out
    assert main(["runs", str(runs / "none")]) == 1
