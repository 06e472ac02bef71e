"""No verb writes over a file of the name of its result that it did not write, and none takes one input for another."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.files.bundle import shipped_bundles

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
    "gaits.csv": ("study", "gait", POLICY),
    "summary.json": ("study", "gait", POLICY),
    "speed.png": ("study", "actuator"),
    "bench.csv": ("study", "bench"),
    "tables.md": ("replicate",),
}
"""Result -> what would write it, and is refused before it does anything."""


@pytest.mark.parametrize("name", CASES)
def test_somebody_elses_file_stays(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """`evaluate` and others replaced a results.csv that nobody's `evaluate` had written, and said nothing."""
    file = tmp_path / "out" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    assert main([*CASES[name], "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert f"out has {name}, and no settings.json that says what of; choose another --out" in said
    assert said.count("\n") == 1 and file.read_text() == "mine"
    assert [path for path in (tmp_path / "out").rglob("*") if path.is_file()] == [file]


def test_another_policy_of_the_same_name_is_another_setting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """A bundle that was trained anew under the same path replaced the results of the one before."""
    monkeypatch.chdir(tmp_path)
    words = ["evaluate", POLICY, *SHORT, "--out", "out"]
    assert main(words) == 0
    results = Path("out/results.csv").read_bytes()
    other = next(path for name, path in shipped_bundles().items() if name == "saturn_lite-flat-deception-0.2")
    shutil.copytree(other, POLICY)
    capsys.readouterr()
    assert main(words) == 1
    said = capsys.readouterr().err
    assert f"with other settings: bundles {POLICY} had another content;" in said and said.count("\n") == 1
    assert Path("out/results.csv").read_bytes() == results
    shutil.rmtree(POLICY)
    assert main(words) == 0


def test_a_failure_of_a_study_names_the_study(capsys: pytest.CaptureFixture) -> None:
    """If this failed, a line of `stiction study` would not say which of fifteen studies it is of."""
    assert main(["study", "gait", "nothing"]) == 1
    assert capsys.readouterr().err.startswith("stiction study gait: unknown policy 'nothing'")
