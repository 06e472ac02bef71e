"""`stiction study wear` as a user runs it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from stiction.cli.main import main
from words import but

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SHORT = ("--engine", "mujoco", "--seconds", "3", "--window", "0.5", "--jobs", "1", "--robots", "3")


def test_it_writes_tables_figure_and_page_and_does_nothing_twice(tmp_path: Path, capsys) -> None:
    """A shipped bundle by its name; the second call reads the robot's file."""
    out = tmp_path / "wear"
    words = ["study", "wear", "saturn_lite-flat-none-0.2", *SHORT, "--levels", "0.3", "--out", str(out)]
    assert main([*words, "--json"]) == 0
    printed = capsys.readouterr()
    summary = json.loads(printed.out)
    assert "stiction study wear: Exploratory: virtual robots with seeds below 1000 (3)" in printed.err
    assert [one["steady"] for one in summary["groups"][0]["controls"]] == [0.3, 1.0]
    assert [group["friction_level"] for group in summary["groups"]] == ["0.3"]
    assert len(summary["warnings"]) == 1 and summary["policies"]["saturn_lite-flat-none-0.2"]["monitor"] is False
    with (out / "lives.csv").open(newline="") as file:
        assert [(row["robot"], row["steady"]) for row in csv.DictReader(file)] == [("3", ""), ("3", "0.3"), ("3", "1")]
    files = {file: file.stat().st_mtime_ns for file in (out / "robots").iterdir()}
    assert len(files) == 6 and (out / "wear.png").stat().st_size > 1000
    assert main([*words, "--no-control", "--overwrite"]) == 0
    output = capsys.readouterr().out
    assert "saturn_lite-flat-none-0.2 at level 0.3: " in output
    assert files == {file: file.stat().st_mtime_ns for file in (out / "robots").iterdir()}
    page = (out / "report.html").read_text()
    assert "None of these bundles has a wear monitor" in page and "false alarms are not known" in page


def test_a_command_beyond_the_training_is_said_to_be(tmp_path: Path, capsys) -> None:
    """It walks all the same; that it does not follow there says nothing of its friction."""
    words = ["study", "wear", "saturn_lite-flat-none-0.2", *SHORT, "--no-control", "--levels", "0.3"]
    assert main([*words, "--commands", "vx=1.50", "--out", str(tmp_path)]) == 0
    assert "command vx=1.5: the policy was trained for vx -0.9 to 0.9" in capsys.readouterr().err
    assert main(["study", "wear", "--judge-again", "--out", str(tmp_path)]) == 0
    assert "command vx=1.5: the policy was trained for" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("--joint", "knee"), "unknown joint 'knee'; known: "),
        (("--levels", "2"), "friction level '2'"),
        (("--commands", "stand"), "asks for motion"),
        (("--engine", "bullet"), "unknown engine 'bullet'"),
        (("--start", "0"), "three positive numbers"),
        (("--jobs", "0"), "--jobs 0"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(words: tuple[str, ...], text: str, tmp_path: Path, capsys) -> None:
    """Before a robot walks."""
    assert main(["study", "wear", "saturn_lite-flat-none-0.2", *but((*SHORT, "--out", str(tmp_path)), *words)]) == 1
    error = capsys.readouterr().err
    assert text in error and error.count("\n") == 1


def test_no_bundle_is_wrong_usage_and_one_that_is_not_there_a_failure(tmp_path: Path, capsys) -> None:
    """Exit status 2 and 1."""
    assert main(["study", "wear"]) == 2
    assert "no bundle given" in capsys.readouterr().err
    assert main(["study", "wear", str(tmp_path / "nosuch"), "--out", str(tmp_path / "out")]) == 1
    assert "nosuch" in capsys.readouterr().err and not (tmp_path / "out").exists()
