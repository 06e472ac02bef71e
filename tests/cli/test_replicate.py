"""`stiction replicate` from the command line, with good and with bad input."""

import csv
import json
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.formats.results import read_results

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


def test_a_part_is_walked_judged_and_gone_on_with(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One file a table, a verdict a sentence; the same command again walks nothing."""
    arguments = ["replicate", "--policies", str(bundle), "--parts", "load", "--no-clips", "--jobs", "1"]
    assert main([*arguments, "--out", str(tmp_path), "--json"]) == 0
    verdicts = json.loads(capsys.readouterr().out)
    assert verdicts["X1"] == "not tested"  # one seed
    rows = read_results(tmp_path / "results.csv")
    assert {(row.friction_law, row.engine, row.method) for row in rows} == {("load", "mujoco", "none")}
    with (tmp_path / "verdicts.csv").open() as file:
        told = {row["id"]: row["evidence"] for row in csv.DictReader(file)}
    assert "(one seed)" in told["X1"]
    monkeypatch.setattr("stiction.transfer.grid.run.walk_unit", lambda *rest: pytest.fail("walked again"))
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    assert "report.html" in capsys.readouterr().out
    assert "One training seed" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--parts", "moon"], "expected some of training, engines, robot"),
        (["--policies", "nothing"], "does not exist"),
        (["--policies", "{bundle}", "{bundle}"], "two bundles"),
        (["--policies", "{bundle}", "--parts", "stairs"], "no policy fits"),
        (["--jobs", "0"], "at least 1"),
        (["--robots", "0"], "at least 1"),
        (["--out", "{bundle}/card.md"], "--out"),
    ],
)
def test_bad_input_is_one_line(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture, arguments: list[str], message: str
) -> None:
    """Status 1, what came, what was expected."""
    given = [argument.replace("{bundle}", str(bundle)) for argument in arguments]
    assert main(["replicate", "--no-clips", "--out", str(tmp_path / "out"), *given]) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""
