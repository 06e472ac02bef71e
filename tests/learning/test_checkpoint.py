"""Checkpoints: whole or absent, nothing unpickled, and a killed run resumes to the same bits."""

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest
import torch

from processes import stiction
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.learning.run import keep_newest, latest_checkpoint, load_checkpoint, save_checkpoint

TREE = {
    "weights": {"a.b": torch.arange(6.0).reshape(2, 3)},
    "optimizer": {"state": {0: {"step": torch.tensor(3.0)}}, "param_groups": [{"lr": 1e-3, "params": [0]}]},
    "count": 7,
    "flags": torch.tensor([True, False]),
}


def test_tree_comes_back_as_it_was(tmp_path: Path) -> None:
    """Numbered keys, nested lists, scalars and every dtype survive."""
    save_checkpoint(tmp_path / "c.safetensors", TREE)
    back = load_checkpoint(tmp_path / "c.safetensors")
    assert torch.equal(back["weights"]["a.b"], TREE["weights"]["a.b"])
    assert back["optimizer"]["state"][0]["step"] == 3.0 and back["optimizer"]["param_groups"] == [
        {"lr": 1e-3, "params": [0]}
    ]
    assert back["count"] == 7 and back["flags"].dtype == torch.bool
    assert not list(tmp_path.glob(".*"))


def test_a_cut_or_altered_checkpoint_is_refused(tmp_path: Path) -> None:
    """One line that names the file; never a half-loaded network."""
    path = tmp_path / "c.safetensors"
    save_checkpoint(path, TREE)
    whole, header = path.read_bytes(), path.with_suffix(".json").read_text()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(StictionError, match=r"c\.safetensors"):
        load_checkpoint(path)
    path.write_bytes(whole)
    path.with_suffix(".json").write_text(header[: len(header) // 2])
    with pytest.raises(StictionError, match=r"c\.safetensors"):
        load_checkpoint(path)
    path.with_suffix(".json").write_text(json.dumps(json.loads(header) | {"tensors": 99}))
    with pytest.raises(StictionError, match="incomplete"):
        load_checkpoint(path)


def test_only_complete_checkpoints_count(tmp_path: Path) -> None:
    """Tensors without their JSON were cut off by a kill between the two writes."""
    for iteration in (5, 50, 100):
        save_checkpoint(tmp_path / f"teacher_{iteration:06d}.safetensors", {"n": iteration})
    (tmp_path / "teacher_000100.json").unlink()
    assert latest_checkpoint(tmp_path, "teacher") == tmp_path / "teacher_000050.safetensors"
    assert latest_checkpoint(tmp_path, "student") is None
    save_checkpoint(tmp_path / "teacher_000150.safetensors", {"n": 150})
    keep_newest(tmp_path, "teacher", keep=1)
    assert [p.name for p in sorted(tmp_path.glob("*.safetensors"))] == ["teacher_000150.safetensors"]


SMALL = [
    *("--robot", "go1", "--num-envs", "4", "--checkpoint-every", "1", "--friction-level", "0.1"),
    *("--preset", "two-phase", "--video-every", "0"),
    *("--teacher.iterations", "2", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--set", "teacher.alternate=2"),
    *("--student.iterations", "10", "--student.steps", "4", "--student.mini-batches", "2"),
]


def final_parameters(run: Path) -> dict[str, torch.Tensor]:
    """Networks of the last student checkpoint."""
    path = latest_checkpoint(run / "checkpoints", "student")
    assert path is not None
    return load_checkpoint(path)["algorithm"]["student_state_dict"]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_killed_run_resumes_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kill -9 in the student: the result is an undisturbed run's (other moments, and the teacher: `test_resume`)."""
    monkeypatch.setenv("STICTION_THREADS", "1")
    assert main(["train", *SMALL, "--out", str(tmp_path / "whole")]) == 0

    killed = tmp_path / "killed"
    process = subprocess.Popen(stiction("train", *SMALL, "--out", str(killed)), stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and process.poll() is None:
        if latest_checkpoint(killed / "checkpoints", "student") is not None:
            break
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL, "the run ended before it could be killed"
    assert main(["train", "--resume", str(killed)]) == 0

    whole, resumed = final_parameters(tmp_path / "whole"), final_parameters(killed)
    assert whole.keys() == resumed.keys()
    assert all(torch.equal(whole[name], resumed[name]) for name in whole)
    rows = [json.loads(line) for line in (killed / "metrics.jsonl").read_text().splitlines()]
    assert [(r["phase"], r["iteration"]) for r in rows] == [
        *(("teacher", i) for i in range(1, 3)),
        *(("student", i) for i in range(1, 11)),
    ]
    assert (killed / "summary.json").exists()
