"""Process of the watchdog: does nothing while the supervisor lives, and damps the robot when it falls silent.

    supervisor ──a beat each turn──▶ shared memory ──▶ watchdog ──damping, where beats end──▶ robot

It has its own link to the robot (`open_spare`), sends only damping, and nothing while beats come. The
limit is the supervisor's own (`gap`): a supervisor that made no turn for longer stops by itself when it goes on, so
that no run ends by the watchdog that would have gone on without it. Started as a module:

    python -m stiction.deploy.runtime.watchdog BUNDLE SOCKET DIGEST MEMORY SETTINGS
"""

from __future__ import annotations

import gc
import json
import mmap
import os
import select
import signal
import socket
import sys
import tempfile
import time

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import StictionError
from stiction.core.lifeline import parent_pipe
from stiction.core.provenance import limit_library_threads
from stiction.deploy.control import JointCommand
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.operator import SIGNALS
from stiction.deploy.runtime.settling import Settling
from stiction.deploy.transports.config import HeldCfg
from stiction.deploy.transports.link import Link, Spare
from stiction.files.bundle import reread_bundle
from stiction.files.contract import Contract

BEAT, LIMIT, NUMBER, ACTED, HEARD, LOOKED = range(6)
"""Places in the shared memory. Of the supervisor: begin of its last turn [s]; longest silence [s], 0 while
nothing is guarded, `OVER` once the run is over; number of its last command. Of the watchdog: time of its takeover, 0
without one; last beat by then; time of its last look [s]."""

OVER = -1.0

LOOK = 0.01
"""Longest time between two looks [s]."""

AGAIN = 0.002
"""Time between the two looks that must both show a silent supervisor [s]: a watchdog that was halted looks twice."""

READY, FAILED = b"+", b"-"
"""First byte of its only message, before its writer's name, or the reason of a failure."""


def open_spare(spare: Spare, contract: Contract) -> Link:
    """Return a link to the robot that another process of ours drives; nothing is sent. Errors as of the transport's."""
    if spare.transport == "udp":
        from stiction.deploy.transports.udp import LOOPBACK, UdpLink

        return UdpLink((LOOPBACK, 0), **spare.settings, file=spare.files[0])
    from stiction.deploy.transports.unitree import unitree_link

    held = HeldCfg(**spare.settings["held"])
    return unitree_link(spare.transport, spare.settings["interface"], spare.settings["domain"], contract, held)


def shared_memory() -> int:
    """Return the file of new shared memory, all zeros; on Linux on no disk, which could make a beat late."""
    if hasattr(os, "memfd_create"):
        file = os.memfd_create("stiction-watchdog")
    else:
        with tempfile.TemporaryFile() as unnamed:
            file = os.dup(unnamed.fileno())
    os.ftruncate(file, mmap.PAGESIZE)
    return file


def mapped(file: int) -> np.ndarray:
    """Return the numbers in shared memory; each is read and written whole."""
    return np.frombuffer(mmap.mmap(file, mmap.PAGESIZE), dtype=np.float64)


class Vigil:
    """Judge of the supervisor's beats; has no clock of its own."""

    def __init__(self) -> None:
        self._silent = False

    def look(self, beat: float, limit: float, now: float) -> bool:
        """Return True if the supervisor is silent: its last beat was older than the limit [s] in two looks in a row.

        limit: 0 or less: nothing is guarded.
        """
        before, self._silent = self._silent, limit > 0 and now - beat > limit
        return before and self._silent

    def wait(self, beat: float, limit: float, now: float) -> float:
        """Return the time until the next look [s]."""
        if self._silent or limit <= 0:
            return AGAIN if self._silent else LOOK
        return min(max(beat + limit - now + 1e-4, AGAIN), LOOK)


class Takeover:
    """Damping of a robot in the supervisor's place; has no clock of its own."""

    def __init__(self, link: Link, cfg: SupervisorCfg, kd: np.ndarray, now: float) -> None:
        """Start at `now` [s]; kd: gains of the damping frame [N m s/rad], shape (J,)."""
        self._link, self._begin = link, now
        self._settling, zero = Settling(cfg, len(kd), now), np.zeros(len(kd))
        self._frame = JointCommand(zero, zero, kd, zero)

    def step(self, now: float) -> bool:
        """Send a damping frame, once a period; return True if it was the last."""
        states = self._link.receive()  # First: some robots can be sent nothing before their first state.
        self._link.send(self._frame)
        if states:
            self._settling.look(states[-1].sensors, now)
        return self._settling.over(now - self._begin, now)


def watch(memory: np.ndarray, link: Link, cfg: SupervisorCfg, kd: np.ndarray, parent: int) -> float | None:
    """Watch until the run is over, or damp; return the time of damping [s], None without damping.

    parent: file that is readable once the supervisor's process is gone, see `parent_pipe`.
    """
    vigil = Vigil()
    while True:
        beat, limit, now = memory[BEAT], memory[LIMIT], time.monotonic()
        memory[LOOKED] = now
        if limit == OVER:
            return None
        if vigil.look(beat, limit, now):
            break
        if select.select([parent], [], [], vigil.wait(beat, limit, now))[0]:
            if memory[LIMIT] <= 0:
                return None
            break
    begin, memory[HEARD] = time.monotonic(), memory[BEAT]
    memory[ACTED] = begin
    link.number, takeover = int(memory[NUMBER]), Takeover(link, cfg, kd, begin)
    while not takeover.step(time.monotonic()):
        time.sleep(0.9 * link.period)
    return time.monotonic() - begin


def main(path: str, number: str, digest: str, memory: str, settings: str) -> int:
    """Watch until the run is over; return the exit status."""
    # A signal to the whole group, or to each of its processes, must not end this one first.
    for name in SIGNALS:
        signal.signal(name, signal.SIG_IGN)
    limit_library_threads()
    parent, end = parent_pipe(), socket.socket(fileno=int(number))
    try:
        values = json.loads(settings)
        cfg, contract = from_plain(SupervisorCfg, values["cfg"], "settings"), reread_bundle(path, digest).contract
        link = open_spare(Spare(**values["spare"]), contract)
    except (StictionError, OSError) as error:
        end.send(FAILED + str(error).encode())
        return 1
    end.send(READY + link.writer.encode())
    gc.collect()
    gc.freeze()
    damped = watch(mapped(int(memory)), link, cfg, contract.array("kd"), parent)
    if damped is not None:
        print(f"stiction deploy: the supervisor was silent; the watchdog damped the robot for {damped:.1f} s",
              file=sys.stderr)  # fmt: skip
    link.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:6]))
