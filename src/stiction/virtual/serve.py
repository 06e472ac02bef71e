"""Virtual robot as a separate process, in real time behind UDP on loopback, and the link to it.

It sends a state every 2 ms to its last sender, and acts on every command. Where it cannot keep up it runs slower than
real time, and reports that at its end. `python -m stiction.virtual.serve BUNDLE SETTINGS` prints a line of JSON.
"""

from __future__ import annotations

import json
import select
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import EngineError, RobotError, StictionError
from stiction.core.isolation import isolated_environment, python_module
from stiction.core.lifeline import follow_parent, tied
from stiction.core.provenance import limit_library_threads, seed_streams, stream_seed
from stiction.core.rotation import cross, into_frame
from stiction.deploy.control import JointCommand, Reading
from stiction.deploy.runtime.ticker import Ticker
from stiction.deploy.transports.link import RobotState, command_layout, command_of, state_layout, state_vectors
from stiction.deploy.transports.udp import HELLO, LOOPBACK, UdpLink
from stiction.engines.catalog import find_engine, make_engine
from stiction.engines.engine import BlownUp
from stiction.files.bundle import read_bundle
from stiction.files.contract import robot_of
from stiction.files.plain import parse_object
from stiction.robots.model import GRAVITY, Robot
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.faults import ASK, OF_ROBOT, OF_WAY, BrokenState
from stiction.virtual.robot import PERIOD, VirtualRobot
from stiction.virtual.trial import World

ROOM_TEMPERATURE = 30.0
"""Temperature of motors without a thermal model [°C]."""

NOISE = "deployed, sensors"

LOST = "deployed, lost commands"

OFTEN = 10
"""Period of the faults of the network: one of so many states is lost, doubled or delayed."""

CLOCK_STEPS = {"clock-back": -5.0, "clock-forward": 5.0}
"""Fault -> step of the robot's clock [s]."""

LOSS = 0.3
"""Share of the commands that are lost, by the fault of that name."""

BATTERY = 48.0
"""Nominal voltage [V]."""


@dataclass(frozen=True)
class VirtualCfg:
    """Choice and place of the virtual robot."""

    seed: int = 1000
    """Seed of the robot: its friction, motors, delays, gears, sensors and masses."""
    engine: str = "mujoco"
    """Physics engine of the robot."""
    level: str = "0.1"
    """Dry friction of its joints, as for `--robot-levels` of evaluate."""
    cell: str = "all"
    """Imperfections of the robot: all, none (nominal), or groups such as friction+delays."""
    stand: bool = False
    """True if it is bolted to a stand, its legs in the air."""

    def __post_init__(self) -> None:
        """Validate the settings; raise `StictionError` before anything is built."""
        find_engine(self.engine)
        _ = self.case, stream_seed(self.seed, NOISE)

    @property
    def case(self) -> Case:
        """Case of the experiments for this robot."""
        return Case(self.seed, self.cell, parse_level(self.level))


class RobotProcess:
    """Virtual robot behind a UDP port."""

    def __init__(self, spec: Robot, cfg: VirtualCfg, port: socket.socket) -> None:
        """Build the robot; raise `StictionError` for an unavailable engine or an invalid friction."""
        streams = seed_streams(cfg.seed, [NOISE, LOST])
        noise, self._chance = streams[NOISE], streams[LOST]
        self._world = World(partial(make_engine, cfg.engine))
        build = self._world.on_bench if cfg.stand else self._world.robot
        self._robot: VirtualRobot = build(cfg.case, spec, noise)
        self._port, self._spec, self._limits = port, spec, spec.joint_values("torque_limit")
        self._warm, self._still = np.full(spec.num_joints, ROOM_TEMPERATURE), np.zeros(spec.num_joints)
        self._peer: tuple[str, int] | None = None
        self._commands = command_layout(spec.num_joints)
        self._states = state_layout(spec.num_joints, len(spec.foot_names))
        limp = np.zeros(spec.num_joints)
        self._command = JointCommand(spec.joint_values("default_position"), limp, limp, limp)
        self._taken, self._number = np.nan, 0
        self._velocity = np.zeros(3)
        self._broken: BrokenState | None = None
        self._loss = self._clock = 0.0
        self._way, self._behind = "", b""
        self._second: socket.socket | None = None
        self._last: RobotState | None = None
        self.slow = 0
        """Number of late periods."""
        self._good = np.nan
        self._start = (np.nan, np.zeros(3))
        self._damped = False

    def period(self) -> None:
        """Process the received messages, advance a period, and send the readings."""
        # All that has come, and the last command counts; bounded, so that a flood of datagrams cannot stop the physics.
        for _ in range(64):
            try:
                # A byte more than a command: a longer datagram would else be cut to one that looks whole.
                data, sender = self._port.recvfrom(self._commands.bytes + 1)
            except OSError:
                break
            self._take(data, sender)
        reading = self._robot.handle.exchange(self._command)
        measured = self._state(reading)
        state = measured if self._broken is None else self._broken(measured)
        if self._broken is None:
            self._good = time.monotonic()
        self._number += 1
        if state is not None and self._peer is not None:
            data = self._states.pack(self._number, state.time + self._clock, state_vectors(state))
            with suppress(OSError):
                for each in self._delivered(data):
                    self._port.sendto(each, self._peer)
                if self._second is not None:
                    self._second.sendto(data, self._peer)

    def _delivered(self, data: bytes) -> list[bytes]:
        """Return the messages that the network delivers when a state is sent."""
        behind, self._behind = self._behind, b""
        if self._way and self._number % OFTEN == 0:
            self._behind = data if self._way == "swapped-states" else b""
            return [data, data] if self._way == "double-states" else []
        return [data, behind] if behind else [data]

    def _take(self, data: bytes, sender: tuple[str, int]) -> None:
        """Take one datagram."""
        if data == HELLO:
            self._peer = sender
        elif data.startswith(ASK) and (name := data[len(ASK) :].decode(errors="replace")) in (*OF_ROBOT, *OF_WAY):
            self._begin_fault(name)
        elif self._loss and self._chance.random() < self._loss:
            pass
        elif (message := self._commands.unpack(data)) is not None and np.isfinite(message.values).all():
            command = command_of(self._commands, message)
            if not (command.kp.any() or self._damped) and self._command.kp.any():
                self._report_damped()
            if command.kp.any() and not self._command.kp.any():
                self._start = (time.monotonic(), self._robot.ground_truth().motion.base_position)
            self._command, self._taken = command, float(message.number)

    def _begin_fault(self, name: str) -> None:
        """Begin a fault of the robot, or of the connection to it."""
        if name in CLOCK_STEPS:
            self._clock += CLOCK_STEPS[name]
        elif name == "lost-commands":
            self._loss = LOSS
        elif name in OF_WAY:
            self._way = name
        elif self._last is not None:
            self._broken = BrokenState(name, self._last)
            if name == "second-robot":
                self._second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def _report_damped(self) -> None:
        """Print the time of the first damping frame, and the robot's motion until then."""
        self._damped = True
        now, motion = time.monotonic(), self._robot.ground_truth().motion
        moved = motion.base_position - self._start[1]
        report = {"damped": now, "last_good": self._good, "slow": self.slow, "moved": moved[:2].tolist()}
        report |= {"seconds": now - self._start[0], "upright": not self._world.fallen(motion, self._spec)}
        print(json.dumps(report), flush=True)

    def _state(self, reading: Reading) -> RobotState:
        """Return the state message of the robot."""
        truth = self._robot.ground_truth()
        motion = truth.motion
        # The accelerometer measures the mean over a period, as its filter does.
        change = (motion.base_linear_velocity - self._velocity) / PERIOD
        self._velocity = np.array(motion.base_linear_velocity)
        # The velocity is seen in a frame that turns: its derivative there lacks ω × v.
        turn = cross(motion.base_angular_velocity, motion.base_linear_velocity)
        force = change + turn - into_frame(motion.base_quaternion, np.array([0.0, 0.0, -GRAVITY]))
        self._last = RobotState(
            number=self._number,
            time=reading.time,
            sensors=reading.sensors,
            acceleration=force,
            joint_torque=reading.joint_torque,
            temperature=self._warm,
            lost=self._still,
            motor_fault=self._still,
            foot_contact=reading.foot_contact.astype(float),
            battery=BATTERY,
            kp=self._command.kp,
            kd=self._command.kd,
            torque_limit=self._limits,
            command=self._taken,
        )
        return self._last


def main(path: str, settings: str) -> int:
    """Serve until the parent ends; return the exit status."""
    # First: a robot without its parent would go on for ever.
    follow_parent()
    limit_library_threads()
    try:
        cfg = from_plain(VirtualCfg, parse_object(settings, "settings", "those of a virtual robot"), "settings")
        spec = robot_of(read_bundle(path).contract)
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.bind((LOOPBACK, 0))
        port.setblocking(False)
        robot = RobotProcess(spec, cfg, port)
    except (StictionError, ImportError) as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 1
    # Only now, for whoever reads this line sends at once.
    greeting = {"port": port.getsockname()[1], "joints": spec.joint_names, "feet": spec.foot_names, "period": PERIOD}
    print(json.dumps(greeting), flush=True)
    ticker = Ticker(PERIOD)
    try:
        while True:
            robot.slow += ticker.wait()[1]
            robot.period()
    except (BlownUp, EngineError) as error:
        print(json.dumps({"error": f"the physics failed: {error}"}), flush=True)
        return 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))


LAST_LINE = 1.0
"""Timeout of its report on a run [s]."""


class VirtualProcess:
    """Virtual robot in a separate process."""

    def __init__(self, bundle: Path, cfg: VirtualCfg) -> None:
        """Start it for the robot of a bundle; raise `RobotError` where it fails to start."""
        command = python_module("stiction.virtual.serve", [bundle, json.dumps(asdict(cfg))])
        # What it writes on its standard error is for people, and goes where ours does.
        # Ctrl-C is for the supervisor: a robot does not end by it.
        tie = tied(isolated_environment()) | {"start_new_session": True}
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, **tie)
        assert self._process.stdout is not None
        greeting = self._read()
        if greeting is None or "error" in greeting:
            self.close()
            why = "it ended at once" if greeting is None else greeting["error"]
            raise RobotError(f"the virtual robot could not be started: {why}")
        self.address = (LOOPBACK, int(greeting["port"]))
        self.link = UdpLink(self.address, greeting["joints"], greeting["feet"], greeting["period"])
        # The robot sends its states to whoever greeted it last.
        self.link.hello()

    def report(self) -> dict[str, Any]:
        """Return the robot's report on a run that ended in damping, or an empty one.

        `damped`, `last_good`: first damping frame, last true state [s, monotonic]; `slow`: late periods; `moved` [m] in
        so many `seconds`; `upright`.
        """
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], LAST_LINE)
        return (self._read() or {}) if ready else {}

    def _read(self) -> dict[str, Any] | None:
        """Return the next line of its output, None after its end."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        return json.loads(line) if line else None

    def close(self) -> None:
        """End the process."""
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
