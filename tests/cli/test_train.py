"""`stiction train` as a user runs it, with good and with bad input."""

import json
from pathlib import Path

import pytest

from stiction.cli.main import main

SMALL = [
    *("--robot", "go1", "--num-envs", "4", "--json"),
    *("--teacher.iterations", "1", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
]


def test_a_run_leaves_what_the_design_says(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Config, metrics, TensorBoard, checkpoints, summary; standard output is JSON and nothing else."""
    out = tmp_path / "run"
    assert main(["train", *SMALL, "--method", "direct", "--friction-level", "0.1", "--out", str(out)]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["env_steps"] == 4 * 8 and summary["multiply_adds"]["actor"] > 0
    config = json.loads((out / "config.json").read_text())
    assert config["config"]["task"]["friction"] == {"method": "direct", "level": 0.1, "law": "coulomb", "per": "robot"}
    assert config["seed"] == 0 and config["command"].startswith("stiction train")
    assert len((out / "metrics.jsonl").read_text().splitlines()) == 2
    assert list((out / "tensorboard").iterdir()) and (out / "summary.json").exists() and (out / "curves.png").exists()
    assert sorted(p.suffix for p in (out / "checkpoints").iterdir()) == [
        ".json",
        ".json",
        ".safetensors",
        ".safetensors",
    ]
    assert main(["train", *SMALL, "--out", str(out)]) == 1
    assert "--resume" in capsys.readouterr().err


def test_bad_input_is_one_line_and_status_one(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """What came, what was expected; no traceback, and no folder left behind."""
    cases = [
        (["--robot", "nobody"], "nobody"),
        (["--joints", str(tmp_path / "none.json")], "none.json"),
        (["--friction-level", "1.5"], "1.5"),
        (["--method", "direct", "--friction-level", "0"], "--method none"),
        (["--resume", str(tmp_path / "nothing")], "config.json"),
    ]
    for arguments, word in cases:
        assert main(["train", *SMALL, "--out", str(tmp_path / "bad"), *arguments]) == 1, arguments
        error = capsys.readouterr().err
        assert word in error and error.count("\n") == 1, error
    assert not (tmp_path / "bad").exists()


def test_wrong_usage_is_status_two(capsys: pytest.CaptureFixture) -> None:
    """An option that does not exist."""
    with pytest.raises(SystemExit) as stop:
        main(["train", "--no-such-option"])
    assert stop.value.code == 2
