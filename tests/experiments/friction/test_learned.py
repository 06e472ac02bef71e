"""Table of a training's metrics of its code or disturber, which outlives the training's folder."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from stiction.core.records import read_rows
from stiction_experiments.friction import assemble
from stiction_experiments.friction.evaluation import BASE
from stiction_experiments.friction.learned import learned_figures, learned_sheets
from stiction_experiments.friction.page import report
from stiction_experiments.friction.planned import PlannedRun
from stiction_experiments.friction.records import LearnedFigure
from stiction_experiments.lab.study import write_report
from synthetic import condition_rows, place, write_run

MADE = {"command": "c", "revision": "abc", "machine": {"cpu": "a processor"}, "warnings": [], "failed": {}}


def test_means_are_of_the_last_iterations_by_hand() -> None:
    """The mean of the last 20 of 30 iterations, 10 to 29, is 19.5; other metrics are left out."""
    rows = [{"iteration": n, "hinf/eta": float(n), "loss/value": 1.0} for n in range(30)]
    assert learned_figures("a-s0", rows) == [LearnedFigure("a-s0", "hinf/eta", 20, 19.5)]
    assert learned_figures("a-s0", [{"loss/value": 1.0}]) == [] == learned_figures("a-s0", [])


def test_the_tables_have_a_row_a_training() -> None:
    """R² is the mean of both joints, 0.02; a training without a code is in the other table."""
    code = {"code/kl": 1.5, "code/friction/hip": 0.01, "code/friction/shank": 0.03}
    learned = [LearnedFigure("dream-s0", name, 20, mean) for name, mean in code.items()]
    learned += [LearnedFigure("hinf-s0", "hinf/eta", 20, 0.284)]
    sheets = learned_sheets(learned)
    assert sheets["learned-code"].rows == (("dream-s0", "1.5", "–", "–", "–", "0.02", "–"),)
    assert sheets["learned-disturber"].rows == (("hinf-s0", "–", "–", "–", "–", "0.284", "–"),)
    assert learned_sheets([]) == {}


def test_it_stays_where_the_run_has_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In learned.csv, on the page, and beside a policy whose folder is elsewhere: the numbers of a README have rows."""
    at, out = place(tmp_path, "coulomb20-deception", 0, "--friction-level", "0.2"), tmp_path / "out"
    write_run(at)
    file = at.path / "metrics.jsonl"
    lines = [json.loads(line) | {"hinf/eta": 0.25} for line in file.read_text().splitlines()]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    out.mkdir()
    rows = condition_rows("coulomb20-deception", {0.0: [1.0], 0.2: [0.9]})
    made = assemble.assemble([at], rows, BASE, MADE)
    write_report(out, report(made), MADE)
    kept = [LearnedFigure("coulomb20-deception-s0", "hinf/eta", 2, 0.25)]
    assert read_rows(out / "learned.csv", LearnedFigure) == kept
    assert "what the disturbance cost" in (out / "report.html").read_text()
    bundle = SimpleNamespace(contract=SimpleNamespace(revision="abc"))
    monkeypatch.setattr(PlannedRun, "bundle", lambda self: bundle)
    gone = replace(at, path=tmp_path / "elsewhere", policy=tmp_path)
    assert assemble.assemble([gone], [], BASE, MADE, assemble.read_experiment(out)).learned == kept
    assert assemble.assemble([at], [], BASE, MADE, assemble.read_experiment(out)).learned == kept
