"""The study of engines as a command: what it writes, what it returns, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from stiction.cli.main import main

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

from stiction.engines.catalog import ENGINES
from stiction_experiments.engines.conformance import flight
from stiction_experiments.engines.conformance.rig import Figure

GONE = "the engine 'physx' needs the package sapien; install it with: pip install 'stiction[engines]'"


@pytest.fixture
def value(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A suite of two checks, a real one and one that measures the number that this list holds, within 1 m."""
    wanted = [0.5]
    checks = {
        "long fall": flight.long_fall,
        "the list": lambda make, spec, timestep: (Figure("its number", wanted[0], "m", 1.0),),
    }
    for module in ("run", "conformance.suite"):
        monkeypatch.setattr(f"stiction_experiments.engines.{module}.CHECKS", checks)
    return wanted


@pytest.fixture
def only_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make MuJoCo the only installed engine."""
    monkeypatch.setattr(
        "stiction_experiments.engines.run.missing_engine", lambda name, spec: None if name == "mujoco" else GONE
    )


def rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_suite_and_walks_are_written(value: list[float], bundle: Path, tmp_path: Path, capsys) -> None:
    """Everything that the page shows can be had as numbers, and the summary is all of standard output."""
    out = tmp_path / "engines"
    walk = ["--policies", str(bundle), "--commands", "vx=0.5", "--episodes", "2", "--seconds", "3"]
    walk += ["--friction-levels", "0", "--jobs", "1"]
    assert main(["study", "engines", "--engines", "mujoco", *walk, "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["failures"] == 0 and summary["engines"] == ["mujoco"] and not summary["missing"]
    assert summary["answers"][0] == "mujoco passes 2 of 2 figures at steps of 2 ms."
    assert json.loads((out / "summary.json").read_text()) == summary
    assert summary["pace"][0]["share"] == 1.0 and list(summary["policies"]) == ["toy"]
    first, second = rows(out / "conformance.csv")
    assert (first["check"], second["check"], second["value"], second["passed"]) == (
        "long fall",
        "the list",
        "0.5",
        "True",
    )
    assert len(rows(out / "walks.csv")) == 5 and len(rows(out / "episodes.csv")) == 10
    page = (out / "report.html").read_text()
    assert "its number" in page and "The same policies in every simulator" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert all((out / name).stat().st_size > 1000 for name in ("motions.png", "walks.png"))


@pytest.mark.parametrize("wrong", [1.5, float("nan")])
def test_a_figure_out_of_bounds_is_a_failure(
    wrong: float, value: list[float], only_mujoco: None, undrawn: None, tmp_path: Path, capsys
) -> None:
    """A script that runs the suite would go on with an engine that is wrong."""
    value[0] = wrong
    out = tmp_path / "engines"
    assert main(["study", "engines", "--no-walks", "--out", str(out)]) == 1
    printed = capsys.readouterr().out
    assert "FAIL" in printed and "mujoco passes 1 of 2 figures at steps of 2 ms, not the list: its number." in printed
    assert "mujoco at 2 ms fails the list: its number" in (out / "report.html").read_text()
    assert not (out / "walks.csv").exists()


def test_an_engine_that_is_not_here_is_named(
    value: list[float], only_mujoco: None, undrawn: None, tmp_path: Path, capsys
) -> None:
    """Three engines would look like four, or one like all."""
    out = tmp_path / "engines"
    assert main(["study", "engines", "--no-walks", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"physx was not tested: {GONE}." in printed
    page = (out / "report.html").read_text()
    assert all(f"{name} was not tested" in page for name in ENGINES if name != "mujoco")


def test_an_engine_that_was_asked_for_and_is_not_here_is_an_error(only_mujoco: None, tmp_path: Path, capsys) -> None:
    """Whoever names an engine wants that one."""
    out = tmp_path / "engines"
    assert main(["study", "engines", "--engines", "mujoco", "physx", "--no-walks", "--out", str(out)]) == 1
    assert GONE in capsys.readouterr().err and not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--engines", "bullet"], "unknown engine 'bullet'; known: mujoco"),
        (["--engines", "mujoco", "mujoco"], "each once"),
        (["--timesteps", "0.003"], "whole number of steps"),
        (["--timesteps", "0.002", "0.002"], "each once"),
        (["--commands", "stand"], "asks for motion"),
        (["--friction-levels", "2"], "outside [0, 0.9]"),
        (["--episodes", "0"], "at least one episode"),
        (["--jobs", "0"], "--jobs 0"),
        (["--policies", "no-such-policy"], "no-such-policy"),
    ],
)
def test_what_cannot_be_studied_is_refused_before_any_work(
    arguments: list[str], message: str, tmp_path: Path, capsys
) -> None:
    """Minutes later, or in a page, is too late."""
    out = tmp_path / "engines"
    assert main(["study", "engines", *arguments, "--out", str(out)]) == 1
    assert message in capsys.readouterr().err and not out.exists()
