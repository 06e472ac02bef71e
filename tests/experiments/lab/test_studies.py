"""The studies of damping and physics as commands: they write what they say, and refuse what they cannot do."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from stiction.cli.main import main

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


def read(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_damping_writes_tables_figure_and_page(bundle: Path, tmp_path: Path, capsys) -> None:
    """The page leads with the answer."""
    out = tmp_path / "damping"
    options = [
        "--bundles",
        str(bundle),
        "--episodes",
        "1",
        "--draws",
        "2",
        "--robots",
        "go1",
        "--seconds",
        "2.1",
        "--out",
        str(out),
    ]
    assert main(["study", "damping", *options]) == 0
    assert "B + k·kd" in capsys.readouterr().out
    assert {row["case"] for row in read(out / "swaps.csv")} >= {"dry friction", "torque limit", "sampled"}
    assert {row["policy"] for row in read(out / "robots.csv")} == {"in the air", "toy"}
    assert (out / "damping.png").stat().st_size > 1000
    page = (out / "report.html").read_text()
    assert "Actuator Net" in page and "http" not in page.replace("http://www.w3.org", "")


def test_physics_writes_its_rows_and_says_how_far_they_are(bundle: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    """The numbers behind the sentence, a row a policy, level, direction and physics."""
    from stiction.robots.physics import EXACT, FAST
    from stiction_experiments.physics import walks as physics_study

    settings = {physics_study.REFERENCE: (EXACT, 0.005), "rows": (EXACT, 0.005), "plastic": (FAST, 0.005)}
    monkeypatch.setattr(physics_study, "SETTINGS", settings)
    out = tmp_path / "physics"
    options = ["--friction-levels", "0", "0.1", "--episodes", "2", "--seconds", "3", "--out", str(out)]
    assert main(["study", "physics", str(bundle), *options]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert [line.partition("  ")[0] for line in printed] == list(settings)
    rows = read(out / "physics.csv")
    assert len(rows) == 3 * 2 * 2 and {row["policy"] for row in rows} == {"toy"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["walks"]["episodes"] == 2 and summary["bias"].keys() == settings.keys()
    assert main(["study", "physics", *options]) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["study", "physics", "--seconds", "nan"], "16 walks of nan s at 0.5 m/s: expected at least 2"),
        (["study", "paper", "--out", "{file}"], "is a file; choose another --out"),
        (["study", "wear", "--out", "{file}/in"], "is a file; choose another --out"),
        (["replicate", "--out", "{file}/in"], "is a file; choose another --out"),
    ],
)
def test_what_cannot_be_done_is_said_before_any_work(words: list[str], message: str, tmp_path: Path, capsys) -> None:
    """NaN passes every comparison with `<`, and a folder that cannot be made is no news after an hour."""
    file = tmp_path / "file"
    file.write_text("")
    words = [word.format(file=file) for word in words]
    names = [] if words[0] == "replicate" or words[1] == "paper" else ["no-such-bundle"]
    out = [] if "--out" in words else ["--out", str(tmp_path / "out")]
    assert main([*words[:2], *names, *words[2:], *out] if names else [*words, *out]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and "unforeseen" not in printed
    assert [*tmp_path.iterdir()] == [file]
