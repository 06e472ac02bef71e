"""Processes besides the supervisor: policy, logger and watchdog, each at the other end of a socket pair."""

from __future__ import annotations

import json
import math
import os
import secrets
import select
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import RobotError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.core.records import make_folder
from stiction.deploy.plausibility import Violation
from stiction.deploy.runtime.channel import Channel, row_layout, socket_pair
from stiction.deploy.runtime.config import RunCfg, SupervisorCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.recorder import PART_SECONDS, Rows
from stiction.deploy.runtime.watchdog import (
    ACTED,
    BEAT,
    FAILED,
    HEARD,
    LIMIT,
    LOOKED,
    NUMBER,
    OVER,
    READY,
    mapped,
    shared_memory,
)
from stiction.deploy.transports.link import Link
from stiction.files.bundle import Bundle
from stiction.files.run_log import LOG, RunLogHeader, check_empty, write_run_header

WRITING_SECONDS = 10.0
"""Longest time in which the rest of the log is written, after the robot was damped [s]."""

WATCHDOG_SECONDS, ENDING_SECONDS = 60.0, 1.0
"""Longest time in which the watchdog comes up, and in which it ends once it has damped a robot [s]."""

UNWATCHED = 20.0
"""Time since the watchdog's last look above which it counts as halted, in longest silences of the supervisor: 1.2 s by
default, in which it looks a hundred times."""

LAST_WORDS = 2000
"""Most characters that are kept of a process's errors."""


@contextmanager
def child_process(
    module: str, words: list[object], place: int, files: Sequence[int] = (), errors: int | None = subprocess.PIPE
) -> Iterator[tuple[socket.socket, subprocess.Popen[bytes]]]:
    """Start one of our processes with one end of a socket pair; its arguments get the socket's file descriptor.

    files: further file descriptors that it inherits; errors: target of its standard error, None: that of ours.
    """
    ours, theirs = socket_pair()
    words = [*words[:place], theirs.fileno(), *words[place:]]
    command = python_module(f"stiction.deploy.runtime.{module}", words)
    process = subprocess.Popen(
        command,
        pass_fds=[theirs.fileno(), *files],
        stderr=errors,
        # Ctrl-C stops the robot by way of the supervisor; it must not end the policy or the log first.
        start_new_session=True,
        **tied(isolated_environment()),
    )
    # As long as we held it too, to send to a process that is gone would not fail.
    theirs.close()
    try:
        yield ours, process
    finally:
        # First: that is how the process learns that it is over.
        ours.close()
        _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    try:
        process.wait(timeout=0.2)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stderr is not None:
        process.stderr.close()


class Death:
    """Early detection of a process's end: when the system takes its memory away; freeing it takes 20 ms or more."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process, self._memory = process, -1
        with suppress(OSError):  # No Linux, or it has ended already.
            self._memory = os.open(f"/proc/{process.pid}/statm", os.O_RDONLY)

    def seen(self) -> bool:
        """Return True if the process ends or has ended; never waits."""
        try:
            if self._memory >= 0 and os.pread(self._memory, 32, 0).startswith(b"0 "):
                return True
        except OSError:  # Its entry has gone with it.
            return True
        return self._process.poll() is not None

    def close(self) -> None:
        """Watch no longer."""
        if self._memory >= 0:
            os.close(self._memory)


class Watchdog:
    """Process of the watchdog, as the supervisor sees it: it takes beats, and reports its takeover."""

    def __init__(self, memory: np.ndarray, silence: float, process: subprocess.Popen[bytes]) -> None:
        """Watch a process; memory: shared with it, see `runtime.watchdog`; silence: longest time between beats [s]."""
        self._memory, self._silence, self.pid = memory, silence, process.pid
        self._death = Death(process)
        self.close = self._death.close

    @property
    def acted(self) -> bool:
        """True if the watchdog has taken over: it damps the robot, or has done so."""
        return bool(self._memory[ACTED] > 0.0)

    def beat(self, now: float, guards: bool) -> None:
        """Send a beat; guards: True if the watchdog has to damp once beats end."""
        # In this order: a limit must not meet the beat of long ago.
        self._memory[BEAT] = now
        self._memory[LIMIT] = self._silence if guards else 0.0

    def guard(self) -> None:
        """Arm the watchdog from now on: before the first command with gains, not one turn behind it."""
        self._memory[LIMIT] = self._silence

    def sent(self, number: int) -> None:
        """Note the number of the last command: the watchdog's go on behind it."""
        self._memory[NUMBER] = number

    def broken(self, now: float) -> tuple[Violation, str] | None:
        """Return the rule that ends the run, with a detail: the watchdog has acted, or is gone.

        To be called before `beat`; never waits. A time in which the supervisor made no turn is not judged: the whole
        machine may have been halted.
        """
        if self.acted:
            silence = float(self._memory[ACTED] - self._memory[HEARD])
            return Violation(
                "supervisor silent", None, silence, self._silence, "s"
            ), "the watchdog has damped the robot"
        if self._death.seen():
            return Violation("watchdog gone", None, math.nan, math.nan), "its process has ended"
        unseen, longest = float(now - self._memory[LOOKED]), UNWATCHED * self._silence
        if unseen > longest and now - self._memory[BEAT] <= self._silence:
            return Violation("watchdog gone", None, unseen, longest, "s"), "its process is halted"
        return None


@contextmanager
def watchdog_process(bundle: Bundle, folder: Path, link: Link, cfg: SupervisorCfg) -> Iterator[Watchdog | None]:
    """Start the watchdog of an armed run, where the transport has a second way to the robot.

    Raises `RobotError` where it does not come up: nothing was sent.
    """
    if link.spare is None or not cfg.armed:
        yield None
        return
    file = shared_memory()
    try:
        settings = json.dumps({"cfg": asdict(cfg), "spare": vars(link.spare)})
        # Its one line is for people whose supervisor is gone, and goes where that one's lines went.
        words = [folder, bundle.digest, file, settings]
        started = child_process("watchdog", words, 1, (file, *link.spare.files), errors=None)
        with started as (end, process):
            memory = mapped(file)
            answer = end.recv(1000) if select.select([end], [], [], WATCHDOG_SECONDS)[0] else b""
            if not answer.startswith(READY):
                why = answer.removeprefix(FAILED).decode(errors="replace") or "its process said nothing"
                raise RobotError(f"the watchdog did not come up: {why}")
            link.know(answer.removeprefix(READY).decode())
            try:
                yield (watchdog := Watchdog(memory, cfg.gap, process))
            finally:
                # Guarded to the last: an error kept the supervisor from damping, and the watchdog does so now.
                if memory[LIMIT] > 0.0:
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(cfg.gap + cfg.settle_limit + ENDING_SECONDS)
                memory[LIMIT] = OVER
                watchdog.close()
    finally:
        os.close(file)


class Logger:
    """Process of the logger, as the supervisor sees it: takes rows, and may end before the run does."""

    def __init__(self, rows: Rows, process: subprocess.Popen[bytes]) -> None:
        self.rows, self._process = rows, process
        self.end: str | None = None
        """Reason why the log ended before the run, in words; None where it did not."""

    def ended_now(self) -> bool:
        """Return True once: when the logger is first found to have ended. Never waits."""
        if self.rows.alive or self.end is not None:
            return False
        self.end = last_line(self._process) or "the logger has ended"
        return True

    def finish(self) -> None:
        """Wait until all is written, at most `WRITING_SECONDS`; note where it was not."""
        try:
            if self._process.wait(timeout=WRITING_SECONDS) != 0 and self.end is None:
                self.end = last_line(self._process) or f"the logger ended with status {self._process.returncode}"
        except subprocess.TimeoutExpired:
            self.end = f"the disk did not take the rest within {WRITING_SECONDS:g} s"

    def summary(self) -> dict[str, Any]:
        """Return the log's part of the report."""
        return {"log": LOG, "log_lost": self.rows.lost + (self.end is not None), "log_end": self.end}


def last_line(process: subprocess.Popen[bytes]) -> str:
    """Return the last line of a process's standard error; empty: none. Never waits."""
    if process.stderr is None:
        return ""
    os.set_blocking(process.stderr.fileno(), False)
    lines = (process.stderr.read() or b"").decode(errors="replace").strip().splitlines()
    return lines[-1][:LAST_WORDS] if lines else ""


@contextmanager
def logging_process(
    bundle: Bundle, folder: Path, link: Link, cfg: RunCfg, source: Motion | None
) -> Iterator[Logger | None]:
    """Start the logger, if a log is wanted; at the end wait until all of it is written."""
    if cfg.keep_minutes == 0:
        yield None
        return
    contract, log = bundle.contract, cfg.out / LOG
    check_empty(log)
    make_folder(log, "--out")
    kp, kd = (contract.kp, contract.kd) if source is None else (tuple(source.kp), tuple(source.kd))
    header = RunLogHeader(
        robot=contract.robot,
        joint_names=contract.joint_names,
        foot_names=link.foot_names,
        period=link.period,
        control_period=contract.control_period,
        kp=tuple(map(float, kp)),
        kd=tuple(map(float, kd)),
        torque_limit=contract.torque_limit,
        policy=bundle.name if source is None else "",
        digest=bundle.digest if source is None else "",
        armed=cfg.supervisor.armed,
        run=secrets.token_hex(8),
        walking_kp=contract.kp,
    )
    write_run_header(log, header)
    keep = round(60 * cfg.keep_minutes / PART_SECONDS)
    words = [log, keep, len(link.foot_names), folder, bundle.digest]
    with child_process("recorder", words, 1) as (end, process):
        readings = row_layout(contract.num_joints, len(link.foot_names))
        logger = Logger(Rows(Channel(end, readings), readings), process)
        yield logger
        logger.finish()
