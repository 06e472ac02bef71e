"""Processes beside the supervisor, policy and logger, each at the other end of a socket pair."""

from __future__ import annotations

import os
import secrets
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.core.records import make_folder
from stiction.deploy.runtime.channel import Channel, row_layout, socket_pair
from stiction.deploy.runtime.config import RunCfg
from stiction.deploy.runtime.motion import Motion
from stiction.deploy.runtime.recorder import PART_SECONDS, Rows
from stiction.deploy.transports.link import Link
from stiction.files.bundle import Bundle
from stiction.files.run_log import LOG, RunLogHeader, check_empty, write_run_header

WRITING_SECONDS = 10.0
"""Longest time in which the rest of the log is written, after the robot was damped [s]."""

LAST_WORDS = 2000
"""Characters of a process's errors that are kept."""


@contextmanager
def beside(module: str, words: list[object], place: int) -> Iterator[tuple[socket.socket, subprocess.Popen[bytes]]]:
    """Start one of our processes with one end of a socket pair; its arguments get the socket's file descriptor."""
    own, other = socket_pair()
    words = [*words[:place], other.fileno(), *words[place:]]
    command = python_module(f"stiction.deploy.runtime.{module}", words)
    process = subprocess.Popen(
        command,
        pass_fds=[other.fileno()],
        stderr=subprocess.PIPE,
        # Ctrl-C stops the robot by way of the supervisor; it must not end the policy or the log first.
        start_new_session=True,
        **tied(isolated_environment()),
    )
    # As long as we held it too, to send to a process that is gone would not fail.
    other.close()
    try:
        yield own, process
    finally:
        # First: that is how the process learns that it is over.
        own.close()
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
    """Tells that a process ends as soon as the system takes its memory away: to free it all takes 20 ms and more."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process, self._memory = process, -1
        with suppress(OSError):  # No Linux, or it has ended already.
            self._memory = os.open(f"/proc/{process.pid}/statm", os.O_RDONLY)

    def seen(self) -> bool:
        """Return whether the process ends or has ended; never waits."""
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


class Logger:
    """The logger's process, as the supervisor sees it: takes rows, and may end before the run does."""

    def __init__(self, rows: Rows, process: subprocess.Popen[bytes]) -> None:
        self.rows, self._process = rows, process
        self.end: str | None = None
        """Why the log ended before the run did, in words; None where it did not."""

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
        """Return what the report has of the log."""
        return {"log": LOG, "log_lost": self.rows.lost + (self.end is not None), "log_end": self.end}


def last_line(process: subprocess.Popen[bytes]) -> str:
    """Return what a process said last on its standard error; empty: nothing. Never waits."""
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
    )
    write_run_header(log, header)
    keep = round(60 * cfg.keep_minutes / PART_SECONDS)
    words = [log, keep, len(link.foot_names), folder]
    with beside("recorder", words, 1) as (end, process):
        readings = row_layout(contract.num_joints, len(link.foot_names))
        logger = Logger(Rows(Channel(end, readings), readings), process)
        yield logger
        logger.finish()
