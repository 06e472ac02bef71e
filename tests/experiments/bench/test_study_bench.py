"""The study of benches as a command: it writes what it says, goes on where it was, and refuses what it cannot do."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.deploy.control import Port
from stiction.files.bam import load_joints
from stiction.files.joints import read_training
from stiction.files.log import Log
from stiction.learning.arguments import parse
from stiction.learning.begin import with_friction
from stiction.robots.model import Robot
from stiction.virtual.bench import BenchCfg, bench_log
from stiction_experiments.bench import robots as bench_study

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

ROBOT = "saturn_lite--mujoco--all--0.05--5"
ARGUMENTS = ["study", "bench", "--engine", "mujoco", "--robots", "5", "--levels", "0.05", "--seconds", "4"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study of one robot, with short logs of its hips alone."""
    folder = tmp_path_factory.mktemp("study")

    def hips(port: Port, spec: Robot, cfg: BenchCfg) -> Log:
        return bench_log(port, spec, replace(cfg, kinds=("hip",)))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench_study, "bench_log", hips)
        assert main([*ARGUMENTS, "--out", str(folder), "--jobs", "1"]) == 0
    return folder


def test_it_writes_the_robots_folders_and_the_page_of_truths(out: Path) -> None:
    """Every joint that was logged stands in bench.csv with its truth, and in joints.json without."""
    with (out / "bench.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    joints = load_joints(out / ROBOT / "joints.json")
    assert [row["joint"] for row in rows] == list(joints.joints) and len(rows) == 6
    for row in rows:
        estimate = joints.joints[row["joint"]].coulomb_friction
        assert estimate is None or float(row["identified"]) == pytest.approx(estimate.value)
        assert float(row["friction"]) > 0.0 and float(row["strength"]) != 1.0
    page = (out / "report.html").read_text()
    assert ROBOT in page and "a perfect log would show" in page and "FL_hip" in page
    assert (out / "bench.png").stat().st_size > 1000 and (out / ROBOT / "bench.npz").is_file()


def test_the_same_command_again_makes_nothing_and_says_the_same(
    out: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The summary alone on standard output, with the score and the next step."""
    before = json.loads((out / "summary.json").read_text())
    monkeypatch.setattr(bench_study, "judge_bench", lambda *arguments: pytest.fail("made again"))
    assert main([*ARGUMENTS, "--out", str(out), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["scores"] == before["scores"] and summary["scores"]["all"]["joints"] == 6
    assert summary["next"][ROBOT] == f"stiction train --friction-from {out / ROBOT / 'training.json'}"


def test_the_next_step_is_one_that_training_takes(out: Path, capsys: pytest.CaptureFixture) -> None:
    """A printed command that fails is worse than none; which method it names is the advice's, not the test's."""
    assert main([*ARGUMENTS, "--out", str(out)]) == 0
    step = capsys.readouterr().out.splitlines()[-1].removeprefix("next: stiction train ").split()
    options = parse(step)
    assert options.friction_from is not None
    friction = with_friction(options.config, read_training(options.friction_from), "").task.friction
    assert friction.method == json.loads(options.friction_from.read_text())["friction"]["method"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--robots", "5", "5"], "each once"),
        (["--levels", "2"], "up to 0.9"),
        (["--levels", "0.1", "0.10"], "each once"),
        (["--cell", "wings"], "unknown group 'wings'"),
        (["--seconds", "1"], "expected 4 to 600 s"),
        (["--jobs", "0"], "at least 1"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Before the folder is made."""
    assert main(["study", "bench", *arguments, "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()
