"""A run folder of somebody else, or of a failing disk: one line, or the same run; never a traceback, never a crash."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from attacks import attack, copy_run
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import Interrupted, RunDirectory, load_checkpoint, save_checkpoint
from stiction.learning.runner import load_student, train
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

pytestmark = pytest.mark.usefixtures("undrawn")

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("deception", level=0.1)),
    network=NetworkCfg(actor=(8,), critic=(8,), privileged=(8,), history_frame=4, history=(8,), latent=3),
    teacher=TeacherCfg(iterations=2, steps=4, epochs=1, mini_batches=2, alternate=2),
    student=StudentCfg(iterations=2, steps=4, epochs=1, mini_batches=2),
    num_envs=2,
    checkpoint_every=1,
)

ATTACKS = int(os.environ.get("STICTION_ATTACKS", "8"))
"""How many; `tools/attacks.py` asks for more."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A run whose student has one iteration to go, and a finished one."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICTION_THREADS", "1")
        half = RunDirectory.create(folder / "half", CFG, "stiction train", None)
        asked: list[int] = []
        with pytest.raises(Interrupted):
            train(CFG, half, interrupted=lambda: asked.append(1) or len(asked) > 2)
        whole = RunDirectory(copy_run(half.path, folder / "whole"))
        train(CFG, whole)
    return half.path, whole.path


def test_an_attacked_run_is_refused_in_one_line_or_is_the_same(
    runs: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Whatever is changed in one of its files: resuming it, and loading its student, end with status 0 or one line."""
    monkeypatch.setenv("STICTION_THREADS", "1")
    refused = 0
    for seed in range(ATTACKS):
        half = copy_run(runs[0], tmp_path / "half")
        done = attack(half, seed)
        status = main(["train", "--resume", str(half)])
        printed = [line for line in capsys.readouterr().err.splitlines() if line.startswith("stiction train: ")]
        printed = [line for line in printed if "warning: " not in line]
        assert status in (0, 1) and "unforeseen" not in " ".join(printed) and len(printed) <= 1, (seed, done, printed)
        refused += status
        whole = copy_run(runs[1], tmp_path / "whole")
        done = attack(whole, seed)
        try:
            run = RunDirectory(whole)
            run.check_finished("student")
            load_student(run)
        except StictionError:
            refused += 1
        except Exception as error:
            raise AssertionError((seed, done)) from error
    assert refused > ATTACKS


@pytest.mark.parametrize("name", ["config.json", "metrics.jsonl", "summary.json", "*.json", "*.safetensors"])
def test_no_file_of_a_run_may_be_a_pipe(
    name: str, runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Opening one waits for ever: it is refused, whether the run goes on or its student is exported."""
    path = copy_run(runs["summary" in name], tmp_path / "run")
    file = max((path / "checkpoints").glob(f"student_{name}")) if "*" in name else path / name
    file.unlink()
    os.mkfifo(file)

    def waited(*_: object) -> None:
        raise AssertionError(f"{file.name} was opened")

    before = signal.signal(signal.SIGALRM, waited)
    signal.alarm(60)
    try:
        statuses = main(["train", "--resume", str(path)]), main(["export", str(path), "--out", str(tmp_path / "out")])
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    printed = capsys.readouterr().err
    assert statuses == (1, 1) and file.name in printed and "unforeseen" not in printed, printed


@pytest.mark.parametrize("part", ["exp_avg", "embed"])
def test_a_forged_checkpoint_with_a_number_for_a_tensor_is_refused(
    part: str, runs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Torch takes an optimizer's state as it is, and failed in the first step; a network's, in words of its own."""
    path = copy_run(runs[part == "embed"], tmp_path / "run")
    newest = max((path / "checkpoints").glob("student_*.safetensors"))
    tree = load_checkpoint(newest)
    verb = ["train", "--resume", str(path)]
    if part == "embed":
        tree["algorithm"]["student_state_dict"]["adaptation.embed.0.weight"] = 1.0
        verb = ["export", str(path), "--out", str(tmp_path / "out")]
    else:
        next(iter(tree["algorithm"]["optimizer_state_dict"]["state"].values()))["exp_avg"] = 1.0
    save_checkpoint(newest, tree)
    assert main(verb) == 1
    printed = capsys.readouterr().err.strip().splitlines()[-1]
    assert "unforeseen" not in printed and newest.name in printed, printed


def test_every_flipped_bit_of_a_checkpoint_is_found(runs: tuple[Path, Path], tmp_path: Path) -> None:
    """One bit made another policy, without a word."""
    half = copy_run(runs[0], tmp_path / "half")
    file = max((half / "checkpoints").glob("student_*.safetensors"))
    for path in (file, file.with_suffix(".json")):
        content = path.read_bytes()
        for at in range(len(content) // 40, len(content), len(content) // 20):
            path.write_bytes(content[:at] + bytes([content[at] ^ 4]) + content[at + 1 :])
            with pytest.raises(StictionError, match=file.stem):
                load_checkpoint(file)
        path.write_bytes(content)
    load_checkpoint(file)
