"""Trains the runs of the manifest that are missing, several at once, each in a process of its own."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from stiction.core.errors import StictionError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.core.provenance import THREADS_VARIABLE
from stiction.report.terminal import stop_requests
from stiction_experiments.friction.planned import EVALUATED, PlannedRun
from stiction_experiments.lab.cluster import Cluster, current_cluster
from stiction_experiments.lab.study import Stopped

Progress = Callable[[str, float], None]
"""Called with the name of a run, or `ALL`, and the share of it that is done."""

ALL = "all runs"
"""Name under which the progress of everything is reported."""

PATIENCE = 120.0
"""Time that an interrupted run has to end by itself [s]: it finishes its iteration and writes a checkpoint."""

POLL = 1.0
"""Time between two looks at the runs [s]."""

LOG = "train.log"
"""Printed output of a run, in its folder."""


def train_command(run: PlannedRun) -> list[str]:
    """Return the command that begins a run, or goes on with it."""
    if run.state() == "interrupted":
        return python_module("stiction", ["train", "--resume", run.path])
    return python_module("stiction", ["train", *run.run.arguments, "--out", run.path])


class Process(Protocol):
    """A process, here or on a node; as `subprocess.Popen`."""

    def poll(self) -> int | None:
        """Return its exit status, None while it runs."""

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; return its exit status. Raises `subprocess.TimeoutExpired`."""

    def send_signal(self, number: int) -> None:
        """Send it a signal."""

    def kill(self) -> None:
        """End it at once."""


class RemoteProcess:
    """A training on a node of a cluster. One whose node is lost goes on from its checkpoint on another one."""

    def __init__(self, cluster: Cluster, run: PlannedRun) -> None:
        """Begin, or go on with, a run."""
        self._cluster, self._task = cluster, cluster.start(train_on_node, run)

    def poll(self) -> int | None:
        """Return 0 for a training that has ended, 1 for one whose task is lost, None while it goes on."""
        if not self._cluster.finished(self._task):
            return None
        try:
            self._cluster.result(self._task)
        # A training that was asked to end does so by KeyboardInterrupt, which comes back as its task's error.
        except (StictionError, KeyboardInterrupt):
            return 1
        return 0

    def wait(self, timeout: float | None = None) -> int:
        """Wait as `Process.wait`."""
        end = time.monotonic() + (timeout or 1e9)
        while (status := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("stiction train", timeout or 0.0)
            time.sleep(POLL)
        return status

    def send_signal(self, number: int) -> None:
        """Ask the training to end with a checkpoint, whatever the signal."""
        self._cluster.cancel(self._task)

    def kill(self) -> None:
        """End it at once."""
        self._cluster.cancel(self._task, force=True)


def train_on_node(run: PlannedRun) -> None:
    """Train a run to its end, in a process of its own; where this is interrupted, that ends with a checkpoint."""
    job = Job(run, start_here(run))
    try:
        job.process.wait()
    finally:
        stop([job])


@dataclass
class Job:
    """A run in training."""

    run: PlannedRun
    process: Process

    def last_line(self) -> str:
        """Return the last line that the run printed: of one that failed, the reason."""
        lines = (self.run.path / LOG).read_text(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")


def start(run: PlannedRun, command: Callable[[PlannedRun], list[str]] = train_command) -> Job:
    """Start the training of a run, on a node where the work goes to a cluster."""
    cluster = current_cluster()
    return Job(run, start_here(run, command) if cluster is None else RemoteProcess(cluster, run))


def start_here(run: PlannedRun, command: Callable[[PlannedRun], list[str]] = train_command) -> subprocess.Popen:
    """Start the training of a run on one thread, by this very code.

    It ends itself where another process writes the run's folder; and, with a checkpoint, where this one is killed.
    """
    run.path.mkdir(parents=True, exist_ok=True)
    with (run.path / LOG).open("a") as log:
        # In a session of its own, so that Ctrl-C reaches it once, from `stop`: a second one would not wait.
        return subprocess.Popen(
            command(run),
            stdout=log,
            stderr=log,
            **tied(isolated_environment(**{THREADS_VARIABLE: "1"})),
            start_new_session=True,
        )


def train_missing(
    planned: Sequence[PlannedRun],
    jobs: int,
    progress: Progress = lambda name, share: None,
    command: Callable[[PlannedRun], list[str]] = train_command,
    poll: float = POLL,
    asked: Callable[[], bool] = lambda: False,
) -> dict[str, str]:
    """Train what is not finished, `jobs` at once, in the order given; return run -> why it is still not finished.

    A run that fails does not stop the others. Once `asked` to stop, or interrupted, all runs in training are asked to
    end and waited for: they go on from where they stopped next time.

    Raises:
        StictionError: a folder holds a run with another configuration; nothing was started then.

    """
    waiting = [run for run in planned if run.state() not in EVALUATED]
    before = sum(run.done() for run in waiting)
    every = list(waiting)
    running: list[Job] = []
    failed: dict[str, str] = {}
    try:
        while (waiting or running) and not asked():
            while waiting and len(running) < jobs:
                running.append(start(waiting.pop(0), command))
            time.sleep(poll)
            # Taken before those that have ended leave: their last share is reported too.
            trained = [job.run for job in running]
            for job in [job for job in running if job.process.poll() is not None]:
                running.remove(job)
                if job.run.state() != "finished":
                    failed[job.run.run.name] = f"{job.last_line()} (see {job.run.path / LOG})"
            for one in trained:
                progress(one.run.name, one.done() / one.iterations)
            gained = sum(one.done() for one in every) - before
            left = sum(one.iterations - one.done() for one in every if one.run.name not in failed)
            progress(ALL, gained / max(1, gained + left))
    finally:
        stop(running)
    return failed


def train(planned: Sequence[PlannedRun], jobs: int, progress: Progress, say: Callable[[str], None]) -> dict[str, str]:
    """Train as `train_missing` until it is done or Ctrl-C; `say` prints a line. Raises `Stopped` at Ctrl-C."""
    with stop_requests(say, "an iteration of each run") as asked:
        failed = train_missing(planned, jobs, progress, asked=asked)
    if asked():
        raise Stopped(asked.status)
    return failed


def stop(running: Sequence[Job]) -> None:
    """Ask every run to end as Ctrl-C does, and wait; one that does not end is killed: its checkpoints are whole."""
    # All are asked before any is waited for, so that they end side by side.
    for job in running:
        if job.process.poll() is None:
            job.process.send_signal(signal.SIGINT)
    for job in running:
        try:
            job.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            job.process.kill()
            job.process.wait()
