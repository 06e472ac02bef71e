"""Training in several processes: the same steps as one process takes, and what happens where one of them is gone."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
import torch

from rank_process import ROBOTS, keep, make, update
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.learning import ranks as ranks_module
from stiction.learning.ranks import ALONE, PeerGone, Ranks, named_ranks

TESTS = Path(__file__).parents[1] / "helpers"

TINY = [
    *("--robot", "go1", "--method", "deception", "--friction-level", "0.1", "--preset", "two-phase"),
    *("--num-envs", "8", "--teacher.steps", "4", "--student.steps", "4", "--set", "teacher.epochs=1"),
    *("--video-every", "0", "--checkpoint-every", "2", "--student.iterations", "2"),
]

MEETING = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": "29500"}
"""Where processes meet, as torchrun says it."""


def free_port() -> int:
    """Return a port at which nobody listens."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


def start(number: int, port: int, *words: str) -> subprocess.Popen:
    """Start one of two processes, as torchrun does."""
    names = {"RANK": str(number), "LOCAL_RANK": str(number), "WORLD_SIZE": "2"}
    place = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "PYTHONPATH": f"{TESTS}:{TESTS.parents[1] / 'src'}"}
    environment = os.environ | names | place | {"OMP_NUM_THREADS": "1", "STICTION_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, *words], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def both(*words: str) -> list[tuple[int, str]]:
    """Run two processes to their ends; return status and standard error of each."""
    port = free_port()
    started = [start(number, port, *words) for number in range(2)]
    printed = [process.communicate(timeout=120)[1] for process in started]
    return [(process.returncode, text) for process, text in zip(started, printed, strict=True)]


def until(reached: Callable[[], bool]) -> None:
    """Wait for something, not forever."""
    begun = time.monotonic()
    while not reached() and time.monotonic() - begun < 100:
        time.sleep(0.05)


def test_two_processes_take_the_step_of_one(tmp_path: Path) -> None:
    """PPO, adaptation, estimator and distillation, advantages and learning rate, over the same transitions."""
    expected = {phase: step_alone(tmp_path / phase, phase) for phase in ("teacher", "student")}
    ended = both(str(TESTS / "rank_process.py"), *(str(tmp_path / phase) for phase in expected))
    assert [status for status, printed in ended] == [0, 0], ended
    for phase, values in expected.items():
        first, second = (torch.load(tmp_path / phase / f"{number}.pt", weights_only=True) for number in range(2))
        for name, value in values.items():
            name_and_phase = f"{name} of the {phase}"
            torch.testing.assert_close(first["update"][name], value, atol=1e-6, rtol=0, msg=name_and_phase)
            torch.testing.assert_close(
                second["update"][name], first["update"][name], atol=0, rtol=0, msg=name_and_phase
            )
        assert first["figures"] == second["figures"] == {"walk/blown_up": 1.0, "both": 1.5, "one": 3.0}
        assert not first["suspicious"] and not second["suspicious"]
        assert first["any"] == second["any"] == [True, False]
        merged = np.array([1.0, 2.0, 4.0, 2.0, 4.0, 8.0])
        whole = (merged - merged.mean()) / merged.std(ddof=1)
        gathered = torch.cat([first["standardized"], second["standardized"]])
        np.testing.assert_allclose(gathered, whole, atol=1e-6)


def step_alone(folder: Path, phase: str) -> dict[str, torch.Tensor]:
    """Write a rollout and the networks that met it for `rank_process`; return what an update in one process makes."""
    runner = make(folder / "alone", phase, ALONE)
    with torch.no_grad():
        obs = runner.env.get_observations()
        for _ in range(runner.cfg["num_steps_per_env"]):
            obs, reward, dones, extras = runner.env.step(runner.alg.act(obs))
            runner.alg.process_env_step(obs, reward, dones, extras)
    names = ("actor", "critic") if phase == "teacher" else ("student", "teacher")
    torch.save(keep(runner, obs) | {"phase": phase}, folder / "rollout.pt")
    torch.save({name: getattr(runner.alg, name).state_dict() for name in names}, folder / "networks.pt")
    return update(runner, obs)


@pytest.mark.slow
def test_a_process_that_is_killed_ends_the_training_which_goes_on_later(tmp_path: Path) -> None:
    """One line from the one that is left, nothing lost up to the last checkpoint; then the same command resumes."""
    run, port = tmp_path / "run", free_port()
    words = ("-m", "stiction", "train", *TINY, "--teacher.iterations", "400", "--out", str(run))
    leader, follower = (start(number, port, *words) for number in range(2))
    until(lambda: (run / "checkpoints/teacher_000004.json").exists() or leader.poll() is not None)
    follower.send_signal(signal.SIGKILL)
    printed = leader.communicate(timeout=40)[1]
    follower.communicate()
    assert leader.returncode == 1
    lines = [line for line in printed.splitlines() if line.startswith("stiction train:")]
    assert len(lines) == 1 and "another of the 2 processes of this training is gone" in lines[0]
    done = max(int(path.stem[-6:]) for path in (run / "checkpoints").glob("teacher_*.json"))
    assert json.loads((run / "config.json").read_text())["processes"] == 2
    port = free_port()
    again = [start(number, port, "-m", "stiction", "train", "--resume", str(run)) for number in range(2)]
    until(lambda: (run / f"checkpoints/teacher_{done + 2:06d}.json").exists() or again[0].poll() is not None)
    again[1].send_signal(signal.SIGTERM)
    printed = [process.communicate(timeout=60)[1] for process in again]
    assert [process.returncode for process in again] == [143, 143]
    assert "torchrun --nproc-per-node 2 -m stiction train --resume" in printed[0] and not printed[1]
    rows = [json.loads(line)["iteration"] for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert rows == list(range(1, len(rows) + 1)) and len(rows) > done


def test_one_process_does_not_go_on_with_a_run_of_two(tmp_path: Path) -> None:
    """Its robots are in two checkpoints; those of the other process would be missing."""
    from stiction.learning.config import TrainCfg
    from stiction.learning.run import RunDirectory

    run = RunDirectory.create(tmp_path / "run", TrainCfg(), "stiction train", None, processes=2)
    run.check_processes(2)
    with pytest.raises(StictionError, match=r"begun in 2 processes, and there are 1; .* torchrun --nproc-per-node 2"):
        run.check_processes(1)
    assert run.robots_of(0) == run.checkpoints and run.robots_of(1) == run.checkpoints / "rank1"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--num-envs", "7"], "7 robots in 2 processes"),
        (["--method", "hinf", "--task.friction.range", "0", "1"], "hinf trains in one process"),
    ],
)
def test_what_cannot_be_shared_is_said_once(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """By the first process, before any folder is made."""
    for name, value in {"WORLD_SIZE": "2", **MEETING}.items():
        monkeypatch.setenv(name, value)
    run = tmp_path / "run"
    assert main(["train", "--preset", "quick", *words, "--out", str(run)]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and not run.exists()


@pytest.mark.parametrize("listens", [False, True], ids=["never listens", "ends while it answers"])
def test_a_leader_that_is_killed_while_all_start_is_said(listens: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Torch searches three times as long as it is told to, and the others wait on."""
    monkeypatch.setattr(ranks_module, "PATIENCE", timedelta(seconds=0.5))
    monkeypatch.setattr(ranks_module, "CONNECTING", timedelta(seconds=0.5))
    with socket.create_server(("127.0.0.1", 0)) as leader:
        monkeypatch.setenv("MASTER_ADDR", "127.0.0.1")
        monkeypatch.setenv("MASTER_PORT", str(leader.getsockname()[1]))

        def answer() -> None:
            """Take the first knock, and end at the second."""
            leader.accept()[0].close()
            with leader.accept()[0]:
                leader.shutdown(socket.SHUT_RDWR)

        answering = Thread(target=answer, daemon=True)
        answering.start() if listens else leader.close()
        with pytest.raises(PeerGone, match="another of the 2 processes of this training is gone"):
            Ranks(1, 2, 1).join("cpu")
        if listens:
            answering.join()


def test_the_environment_names_the_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reads torchrun's variables; rejects anything else before it trains half of the robots."""
    for name in MEETING:
        monkeypatch.delenv(name, raising=False)
    assert named_ranks() == ALONE and ALONE.leads and ALONE.share(ROBOTS) == ROBOTS
    monkeypatch.setenv("RANK", "3")
    monkeypatch.setenv("WORLD_SIZE", "4")
    monkeypatch.setenv("LOCAL_RANK", "1")
    with pytest.raises(StictionError, match=r"MASTER_ADDR=.*expected where 4 processes meet"):
        named_ranks()
    for name, value in MEETING.items():
        monkeypatch.setenv(name, value)
    assert named_ranks() == Ranks(3, 4, 1) and named_ranks().named("training") == "training 3"
    with pytest.raises(StictionError, match=r"10 robots in 4 processes: .* --num-envs 8"):
        named_ranks().share(10)
    for wrong in ("4", "-1", "x"):
        monkeypatch.setenv("RANK", wrong)
        with pytest.raises(StictionError, match=f"RANK={wrong}"):
            named_ranks()
