"""A whole run on MuJoCo Warp, on the processor: train, resume, export."""

import json
import shutil
from pathlib import Path

import pytest
import torch

from stiction.cli.main import main
from stiction.learning.run import load_checkpoint

pytest.importorskip("mujoco_warp", reason="mujoco_warp, of the extra 'gpu', is not installed")
import warp

pytestmark = pytest.mark.usefixtures("undrawn")

warp.config.optimization_level = 0  # Compiling takes longer than all that is computed here.

SMALL = [
    *("--robot", "go1", "--num-envs", "4", "--friction-level", "0.1", "--checkpoint-every", "1"),
    *("--preset", "two-phase", "--video-every", "0"),
    *("--teacher.iterations", "2", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
]


@pytest.mark.slow
def test_a_run_on_warp_trains_resumes_and_exports(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A checkpoint must hold all that matters, with the task on the device."""
    whole, resumed = tmp_path / "whole", tmp_path / "resumed"
    assert main(["train", *SMALL, "--device", "warp-cpu", "--json", "--out", str(whole)]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["env_steps"] == 3 * 4 * 4
    assert "stays on the host" not in printed.err
    shutil.copytree(whole, resumed)
    (resumed / "summary.json").unlink()
    for name in ("teacher_000002", "student_000001"):
        for file in (resumed / "checkpoints").glob(f"{name}.*"):
            file.unlink()
    assert main(["train", "--resume", str(resumed), "--json"]) == 0
    capsys.readouterr()
    first, second = (load_checkpoint(run / "checkpoints" / "student_000001.safetensors") for run in (whole, resumed))
    for name, value in first["algorithm"]["student_state_dict"].items():
        assert torch.equal(value, second["algorithm"]["student_state_dict"][name]), name
    for name, value in first["environment"]["simulation"].items():
        assert torch.equal(value, second["environment"]["simulation"][name]), name
    assert main(["export", str(whole), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["path"] == str(whole / "bundle")
