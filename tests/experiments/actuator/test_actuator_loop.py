"""The loop f0, log, f_motor, f1 at a tiny budget: every stage is there, done stages are not done again."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")

from stiction.cli.main import main
from stiction.core import cache
from stiction.core.errors import StictionError
from stiction.files.actuator import read_actuator
from stiction.files.bundle import find_bundle, read_bundle
from stiction.files.results import read_results
from stiction.files.walk import read_walk
from stiction_experiments.actuator.config import RUNS, VARIANTS, LoopCfg
from stiction_experiments.actuator.page import mean_table
from stiction_experiments.actuator.robots import loop_robots, plan_logs
from stiction_experiments.actuator.run import ActuatorLoop

pytestmark = pytest.mark.usefixtures("undrawn")

TINY = [
    *("--num-envs", "2", "--teacher.iterations", "1", "--teacher.steps", "2", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "2", "--student.mini-batches", "2"),
    *("--variants", "three-robots", "--log-seconds", "1", "--set", "net.epochs=1", "--set", "net.hidden=[4]"),
    *("--episodes", "1", "--seconds", "3", "--commands", "vx=-0.5"),
]


def test_every_data_set_has_as_many_runs() -> None:
    """A control with more data would not be one."""
    for repeats in (1, 3):
        for variant in VARIANTS:
            plan = plan_logs(variant, LoopCfg(repeats=repeats))
            assert sum(len(commands) * runs for _, commands, runs in plan) == RUNS * repeats


def test_robots_are_drawn_from_the_seed(contract) -> None:
    """robot-0 is nominal but for its friction; the others are the same for one seed, within what is said of them."""
    first, *others = loop_robots(0.2, 0)
    assert first.level == 0.2 and replace(first.joints(contract), anatomy=None) == contract
    assert loop_robots(0.2, 0) == (first, *others) != loop_robots(0.2, 1) and len(others) == 3
    for robot in others:
        assert 0.1 <= robot.level <= 0.3 and min(robot.strength, robot.damping, robot.armature) >= 0.8
        assert robot.joints(contract).kp[0] == pytest.approx(robot.strength * contract.kp[0])
        assert robot.joints(contract).torque_limit == contract.torque_limit


def test_evaluations_count_by_the_code_that_walks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of an earlier physics would stand beside those of today."""
    loop = ActuatorLoop(tmp_path, LoopCfg(), "a test")
    loop.robots, bundle = (), read_bundle(find_bundle(Path("saturn_lite-flat-none-0.2")))
    keys = []
    for code in ("one", "other", "one"):
        monkeypatch.setattr(cache, "fingerprint", lambda *files, code=code: [code, "sim/*.py" in files])
        loop._evaluate("f0", bundle)
        keys.append(json.loads((tmp_path / "evaluation" / "f0.json").read_text())["key"])
    assert keys[0] == keys[2] != keys[1]


def test_the_loop_from_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """f1 was trained with the net of the logs, a lost stage is made again to the same numbers, and nothing else is."""
    out, policy = tmp_path / "study", find_bundle(Path("saturn_lite-flat-none-0.2"))
    arguments = ["study", "actuator", "--policy", str(policy), "--out", str(out), "--json", *TINY]
    assert main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    logs = sorted((out / "logs" / "three-robots").glob("*.npz"))
    assert len(logs) == RUNS and {path.name.partition("--")[0] for path in logs} == {"robot-1", "robot-2", "robot-3"}
    header = read_walk(logs[0]).header
    assert header.torque_source == "output_side" and header.kp == read_bundle(policy).contract.kp
    net = read_actuator(out / "nets" / "three-robots-default")
    used = read_bundle(out / "bundles" / "f1-three-robots").contract.actuator
    assert used is not None and used["name"] == "three-robots-default" and len(net.training) == 9
    assert set(summary["nets"]) == {"three-robots-default", "three-robots-paper"}
    rows = read_results(out / "results.csv")
    assert [row.policy for row in rows[:3]] == ["f0 on robot-0", "f0 on robot-0", "f0 on robot-1"] and len(rows) == 10
    page = (out / "report.html").read_text()
    assert "no verdict" in page and "on the drawn robots" in page

    stamps = {path: path.stat().st_mtime_ns for path in (out / "runs").rglob("*.safetensors")}
    before = (out / "evaluation" / "f1-three-robots.json").read_bytes(), (out / "results.csv").read_bytes()
    (out / "evaluation" / "f1-three-robots.json").unlink()
    shutil.rmtree(out / "nets" / "three-robots-paper")
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out)["nets"] == summary["nets"]
    assert before == ((out / "evaluation" / "f1-three-robots.json").read_bytes(), (out / "results.csv").read_bytes())
    assert stamps == {path: path.stat().st_mtime_ns for path in (out / "runs").rglob("*.safetensors")}

    assert main([*arguments, "--level", "0.1"]) == 1
    assert "holds this study with another level" in capsys.readouterr().err


def test_a_mistake_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A mistyped --policy must not tie the folder to it; a folder that cannot be made, and one that holds something
    else, are a line each.
    """
    out = tmp_path / "study"
    assert main(["study", "actuator", "--policy", str(tmp_path / "typo"), "--out", str(out), *TINY]) == 1
    assert "does not exist" in capsys.readouterr().err and not out.exists()
    policy = ["--policy", str(find_bundle(Path("saturn_lite-flat-none-0.2")))]
    assert main(["study", "actuator", *policy, "--robot", "go1", "--out", str(out), *TINY]) == 1
    assert "is for saturn_lite" in capsys.readouterr().err and not out.exists()
    (tmp_path / "file").write_text("")
    assert main(["study", "actuator", *policy, "--out", str(tmp_path / "file" / "study"), *TINY]) == 1
    assert "choose another --out" in capsys.readouterr().err
    out.mkdir()
    (out / "study.json").write_text("{}")
    assert main(["study", "actuator", *policy, "--out", str(out), *TINY]) == 1
    assert "is not what this study writes" in capsys.readouterr().err


def test_means_are_over_commands_with_and_without_friction() -> None:
    """0.3 and 0.5 of the speed are 0.40; a robot that falls in a quarter of the episodes at one command has 25 %."""
    names = ("policy", "robot", "friction_level", "speed_ratio", "fall_rate")
    values = [("f0", "robot-0", 0.2, 0.3, 0.25), ("f0", "robot-0", 0.2, 0.5, 0.0), ("f0", "robot-0", 0.0, 1.0, 0.0)]
    rows = [dict(zip(names, one, strict=True)) for one in (*values, ("f1", "robot-1", 0.1, 0.9, 0.0))]
    header, lines = mean_table(rows, ["robot-1"])
    assert header == (
        "policy",
        "on robot-0",
        "falls",
        "on the drawn robots",
        "falls",
        "without joint friction",
        "falls",
    )
    assert lines == [["f0", "0.40", "25%", "–", "–", "1.00", "0%"], ["f1", "–", "–", "0.90", "0%", "–", "–"]]


@pytest.mark.parametrize(
    "change",
    [{"level": 0.0}, {"repeats": 0}, {"variants": ("sideways",)}, {"variants": ()}, {"variants": ("backward",) * 2}],
)
def test_a_study_that_cannot_be_run_is_refused(change: dict) -> None:
    """Before hours of training."""
    with pytest.raises(StictionError, match="expected"):
        LoopCfg(**change)


def test_a_training_that_is_not_conventional_is_refused() -> None:
    """f0 with friction in training would not be the paper's f0."""
    with pytest.raises(StictionError, match="trained conventionally"):
        LoopCfg(train=replace(LoopCfg().train, actuator="net"))
