"""The virtual robot's process, seen from the one that starts it, and the link to it."""

from __future__ import annotations

import json
import select
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stiction.core.errors import RobotError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import tied
from stiction.deploy.transports.udp import LOOPBACK, UdpLink
from stiction.virtual.serve import VirtualCfg

LAST_LINE = 1.0
"""Time to wait for what it says of a run [s]."""


class VirtualProcess:
    """A virtual robot in a process of its own."""

    def __init__(self, bundle: Path, cfg: VirtualCfg) -> None:
        """Start it for the robot of a bundle; raise `RobotError` where it does not come up."""
        command = python_module("stiction.virtual.serve", [bundle, json.dumps(asdict(cfg))])
        # What it writes on its standard error is for people, and goes where ours does.
        # Ctrl-C is for the supervisor: a robot does not end by it.
        tie = tied(isolated_environment()) | {"start_new_session": True}
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, **tie)
        assert self._process.stdout is not None
        said = self._read()
        if said is None or "error" in said:
            self.close()
            why = "it ended at once" if said is None else said["error"]
            raise RobotError(f"the virtual robot could not be started: {why}")
        self.address = (LOOPBACK, int(said["port"]))
        """Its port."""
        self.link = UdpLink(self.address, said["joints"], said["feet"], said["period"])
        """The way to it."""
        # The robot sends its states to whoever greeted it last.
        self.link.hello()

    def said(self) -> dict[str, Any]:
        """Return what the robot saw of a run that ended in damping; empty where there was none.

        `damped`: when the first damping frame came; `last_good`: when it had said something true last, both on the
        machine's monotonic clock [s]; `slow`: periods that it was behind real time; `moved`: way of its base since the
        first command with gains, x and y [m], in so many `seconds`; `upright`: whether it had not fallen.
        """
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], LAST_LINE)
        return (self._read() or {}) if ready else {}

    def _read(self) -> dict[str, Any] | None:
        """Return the next line that it says, None where it has ended."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        return json.loads(line) if line else None

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()


@contextmanager
def virtual_robot(bundle: Path, cfg: VirtualCfg) -> Iterator[VirtualProcess]:
    """Start a virtual robot, and end it."""
    process = VirtualProcess(bundle, cfg)
    try:
        yield process
    finally:
        process.link.close()
        process.close()
