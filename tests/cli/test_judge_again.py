"""`--judge-again` of every verb that has it, on copies of the committed results: nothing is trained, nothing walks."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

from stiction.cli.main import main

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed")
pytest.importorskip("torch", reason="torch, of the extra 'train', is needed")

pytestmark = pytest.mark.usefixtures("undrawn")

RESULTS = Path(__file__).parents[2] / "results"


REDRAWN = {
    "adaptation": "adaptation/shipped",
    "compensation": "compensation",
    "damping": "damping",
    "engines": "engines",
    "wear": "wear",
}
"""Study -> folder of results whose page it can draw anew."""


def cells(path: Path) -> list[list[str | float]]:
    """Return the cells of a CSV, numbers as such: `0.0` and `0` are one."""
    with path.open(newline="") as file:
        return [[float(cell) if cell[:1].isdigit() else cell for cell in row] for row in csv.reader(file)]


@pytest.mark.parametrize("study", REDRAWN)
def test_a_page_is_drawn_anew_from_the_rows_of_its_folder(study: str, tmp_path: Path) -> None:
    """Without it an improvement of pages would reach no result before its hours of walks are walked again.

    The command that made the rows stays on the page, the one that drew it stands beside it, and no row changes.
    """
    out = tmp_path / "study"
    shutil.copytree(RESULTS / REDRAWN[study], out)
    rows = {path.name: cells(path) for path in out.glob("*.csv")}
    status = main(["study", study, "--judge-again", "--out", str(out)])
    assert status == (1 if study == "engines" else 0)  # two engines fail figures at long steps
    for name, before in rows.items():
        assert cells(out / name) == before, name
    summary, page = json.loads((out / "summary.json").read_text()), (out / "report.html").read_text()
    assert summary["command"] == json.loads((RESULTS / REDRAWN[study] / "summary.json").read_text())["command"]
    assert summary["judged"]["command"].startswith(f"stiction study {study} --judge-again")
    assert ('<img class="white"' in page) == (study == "engines")  # drawn from a file, on white
    assert "Judged and drawn anew, from the same rows" in page and '<nav aria-label="Contents">' in page
