"""The runner: trains what is missing, survives what fails, leaves everything resumable. Training itself is made up."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from processes import is_alive, wait_until
from stiction.core.lock import output_folder
from stiction_experiments.friction.planned import PlannedRun
from stiction_experiments.friction.training import ALL, start, stop, train_command, train_missing
from synthetic import place, run_files, write_run

WRITE = """
import json, pathlib, sys
files, folder = json.loads(sys.argv[1]), pathlib.Path(sys.argv[2])
for name, text in files.items():
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
"""


def succeed(at: PlannedRun) -> list[str]:
    """A training that leaves a finished run at once."""
    return [sys.executable, "-c", WRITE, json.dumps(run_files(at)), str(at.path)]


def sleep(at: PlannedRun) -> list[str]:
    """A training that does not end."""
    return [sys.executable, "-c", "import time; time.sleep(60)"]


def locks_first(at: PlannedRun) -> list[str]:
    """A training that makes sure that nobody else writes its folder, as the real one does."""
    lock = "import sys; from pathlib import Path; from stiction.core.lock import output_folder\n"
    lock += "with output_folder(Path(sys.argv[2])):\n" + WRITE.replace("\n", "\n    ")
    return [sys.executable, "-c", lock, json.dumps(run_files(at)), str(at.path)]


def test_only_what_is_missing_is_trained_and_a_failure_stops_nobody(tmp_path: Path) -> None:
    """Trains missing runs alone; one that fails is named, and the others go on."""
    places = [place(tmp_path, "toy", seed) for seed in range(4)]
    write_run(places[0])
    started, shares = [], []

    def command(at: PlannedRun) -> list[str]:
        started.append(at.run.seed)
        if at.run.seed == 1:
            return [sys.executable, "-c", "print('training diverged in iteration 7'); raise SystemExit(1)"]
        return succeed(at)

    failed = train_missing(places, 2, lambda *share: shares.append(share), command, poll=0.02)
    assert started == [1, 2, 3] and [p.state() for p in places] == ["finished", "missing", "finished", "finished"]
    assert list(failed) == ["toy-s1"] and failed["toy-s1"].startswith("training diverged in iteration 7 (see ")
    assert shares[-1] == (ALL, 1.0) and ("toy-s3", 1.0) in shares


def test_an_interrupt_ends_every_run_and_frees_its_lock(tmp_path: Path) -> None:
    """An interrupt stops every training, and the next call can start them."""
    places = [place(tmp_path, "toy", seed) for seed in range(3)]
    running = []

    def interrupt(name: str, share: float) -> None:
        raise KeyboardInterrupt

    def command(at: PlannedRun) -> list[str]:
        running.append(at.run.seed)
        return sleep(at)

    with pytest.raises(KeyboardInterrupt):
        train_missing(places, 2, interrupt, command, poll=0.02)
    assert running == [0, 1]
    assert train_missing(places, 2, command=command, poll=0.02, asked=lambda: len(running) > 3) == {}
    assert running == [0, 1, 0, 1]
    job = start(places[0], sleep)
    stop([job])
    assert job.process.poll() is not None


def test_a_run_in_training_is_left_alone(tmp_path: Path) -> None:
    """Skips a run whose folder another process writes."""
    at = place(tmp_path)
    with output_folder(at.path):
        failed = train_missing([at], 1, command=locks_first, poll=0.02)
    assert f"is being written by process {os.getpid()} on " in failed["toy-s0"] and at.state() == "missing"
    assert train_missing([at], 1, command=locks_first, poll=0.02) == {}


def test_a_training_ends_with_the_study_that_started_it(tmp_path: Path) -> None:
    """After kill -9 of a study its trainings would go on unseen, and hold their folders."""
    script = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1]); from synthetic import place; "
        "from stiction_experiments.friction.training import start; at = place(Path(sys.argv[2])); "
        "command = [sys.executable, '-c', 'import signal, time; from stiction.core.lifeline import follow_parent; "
        "follow_parent(signal.SIGTERM); print(1, flush=True); time.sleep(60)']; "
        "print(start(at, lambda _: command).process.pid, flush=True); import time; time.sleep(60)"
    )
    words = [sys.executable, "-c", script, str(Path(__file__).parents[2] / "helpers"), str(tmp_path)]
    study = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert study.stdout is not None
    training = int(study.stdout.readline())
    study.kill()
    study.wait()
    wait_until(lambda: not is_alive(training), "the training goes on without its study")


def test_commands_begin_and_resume(tmp_path: Path) -> None:
    """A missing run begins, an interrupted one resumes."""
    at = place(tmp_path)
    begin = ["train", *at.run.arguments, "--out", str(at.path)]
    assert train_command(at)[4:] == begin and begin[1:3] == ["--preset", "two-phase"]
    write_run(at, "summary.json")
    assert train_command(at)[4:] == ["train", "--resume", str(at.path)]
