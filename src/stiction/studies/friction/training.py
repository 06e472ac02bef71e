"""Trains the runs of the manifest that are missing, several at once, each in a process of its own."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import TextIOWrapper

from stiction.core.provenance import PACKAGE, THREADS_VARIABLE
from stiction.studies.friction.manifest import Place

Progress = Callable[[str, float], None]
"""Called with the name of a run, or `ALL`, and the share of it that is done."""

ALL = "all runs"
"""Name under which the progress of everything is reported."""

PATIENCE = 120.0
"""Time that an interrupted run has to end by itself [s]: it finishes its iteration and writes a checkpoint."""

POLL = 1.0
"""Time between two looks at the runs [s]."""

LOG = "train.log"
"""What a run printed, in its folder."""


def train_command(place: Place) -> list[str]:
    """Return the command that begins a run, or goes on with it."""
    program = [sys.executable, "-m", "stiction", "train"]
    if place.state() == "interrupted":
        return [*program, "--resume", str(place.path)]
    return [*program, *place.run.arguments, "--out", str(place.path)]


@dataclass
class Job:
    """A run in training."""

    place: Place
    process: subprocess.Popen
    lock: TextIOWrapper

    def last_words(self) -> str:
        """Return the last line that the run printed: of one that failed, the reason."""
        lines = (self.place.path / LOG).read_text(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")


def start(place: Place, command: Callable[[Place], list[str]] = train_command) -> Job | None:
    """Start the training of a run on one thread, by this very code; None where another process trains it.

    The lock passes to the run's own process, so that it holds as long as the training goes on, whoever is interrupted.
    """
    place.path.mkdir(parents=True, exist_ok=True)
    lock = (place.path / ".lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        lock.close()
        return None
    path = os.pathsep.join(filter(None, (str(PACKAGE.parent), os.environ.get("PYTHONPATH"))))
    environment = {**os.environ, THREADS_VARIABLE: "1", "PYTHONPATH": path}
    with (place.path / LOG).open("a") as log:
        # In a session of its own, so that Ctrl-C reaches it once, from `stop`: a second one would not wait.
        process = subprocess.Popen(
            command(place),
            stdout=log,
            stderr=log,
            stdin=subprocess.DEVNULL,
            env=environment,
            pass_fds=[lock.fileno()],
            start_new_session=True,
        )
    return Job(place, process, lock)


def train_missing(
    places: Sequence[Place],
    jobs: int,
    progress: Progress = lambda name, share: None,
    command: Callable[[Place], list[str]] = train_command,
    poll: float = POLL,
    asked: Callable[[], bool] = lambda: False,
) -> dict[str, str]:
    """Train what is not finished, `jobs` at once, in the order given; return run -> why it is still not finished.

    A run that fails does not stop the others. Once `asked` to stop, or interrupted, all runs in training are asked to
    end and waited for: they go on from where they stopped next time.

    Raises:
        StictionError: a folder holds a run with another configuration; nothing was started then.

    """
    waiting = [place for place in places if place.state() != "finished"]
    share = Shares(waiting, progress)
    running: list[Job] = []
    failed: dict[str, str] = {}
    try:
        while (waiting or running) and not asked():
            while waiting and len(running) < jobs:
                place = waiting.pop(0)
                job = start(place, command)
                if job is None:
                    failed[place.run.name] = "another process trains it"
                else:
                    running.append(job)
            time.sleep(poll)
            trained = [job.place for job in running]
            for job in [job for job in running if job.process.poll() is not None]:
                running.remove(job)
                job.lock.close()
                if job.place.state() != "finished":
                    failed[job.place.run.name] = f"{job.last_words()} (see {job.place.path / LOG})"
            share.report(trained, failed)
    finally:
        stop(running)
    return failed


def stop(running: Sequence[Job]) -> None:
    """Ask every run to end as Ctrl-C does, and wait; one that does not end is killed: its checkpoints are whole."""
    for job in running:
        job.process.send_signal(signal.SIGINT)
    for job in running:
        try:
            job.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            job.process.kill()
            job.process.wait()
        job.lock.close()


class Shares:
    """How far the runs are, each and together, by iterations; what was done before does not count as progress."""

    def __init__(self, places: Sequence[Place], progress: Progress) -> None:
        """Remember where every run stands."""
        self.places = {place.run.name: place for place in places}
        self.before = {name: place.done() for name, place in self.places.items()}
        self.done = dict(self.before)
        self.told: dict[str, float] = {}
        self.progress = progress

    def report(self, trained: Sequence[Place], failed: Mapping[str, str]) -> None:
        """Report runs that are or were in training, and all together: a run that failed has nothing left to do."""
        for place in trained:
            self.done[place.run.name] = place.done()
            self._tell(place.run.name, self.done[place.run.name] / place.iterations)
        left = sum(place.iterations - self.done[name] for name, place in self.places.items() if name not in failed)
        gained = sum(self.done.values()) - sum(self.before.values())
        if gained + left:
            self._tell(ALL, gained / (gained + left))

    def _tell(self, name: str, share: float) -> None:
        """Report a share that has changed."""
        if self.told.get(name) != share:
            self.told[name] = share
            self.progress(name, share)
