"""No verb writes over a file of the name of its result that it did not write, and none takes one input for another."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.cli.main import main

POLICY = "saturn_lite-flat-none-0.2"

SHORT = ("--friction-levels", "0", "--commands", "vx=0.5", "--episodes", "1", "--seconds", "3")

CASES = {
    "results.csv": ("evaluate", POLICY, *SHORT),
    "friction_budget.png": ("evaluate", POLICY, *SHORT),
    "report.json": ("deploy", POLICY, "--robot", "virtual", "--armed", "--duration", "1"),
    "trajectory.csv": ("excite", "--robot", "go2", "--joint", "FL_calf_joint"),
    "actuator.npz": ("train-actuator", "pyproject.toml"),
    "evaluation/results.csv": ("demo",),
    "loop.json": ("demo", "--loop"),
    "walks.csv": ("study", "compensation", POLICY),
    "summary.json": ("study", "compensation", POLICY),
    "damping.png": ("study", "damping"),
    "bench.csv": ("study", "bench"),
    "sentences.csv": ("replicate",),
}
"""Result -> what would write it, and is refused before it does anything."""


@pytest.mark.parametrize("name", CASES)
def test_somebody_elses_file_stays(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """`evaluate` and others replaced a results.csv that nobody's `evaluate` had written, and said nothing."""
    file = tmp_path / "out" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    assert main([*CASES[name], "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert f"out has {name} and no settings.json; choose another --out" in error
    assert error.count("\n") == 1 and file.read_text() == "mine"
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == [file]
