"""The virtual robot as a process of its own, in real time behind UDP on loopback: what `deploy` drives for want of one.

It sends a state every 2 ms to whoever asked for it last, and acts on every command that comes, from whomever, as motors
on a bus do. Where it cannot keep up with the clock it runs slower than real time, and says so at its end. Started as a
module; prints one line of JSON when it is there:

    python -m stiction.virtual.serve BUNDLE SETTINGS
"""

from __future__ import annotations

import json
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import EngineError, StictionError
from stiction.core.lifeline import follow_parent
from stiction.core.provenance import limit_library_threads, seed_streams, stream_seed
from stiction.core.rotation import cross, into_frame
from stiction.deploy.control import JointCommand, Reading
from stiction.deploy.runtime.ticker import Ticker
from stiction.deploy.transports.link import RobotState, command_layout, command_of, state_layout, state_vectors
from stiction.deploy.transports.udp import HELLO, LOOPBACK
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
"""Of motors that were not modelled [°C]."""

NOISE = "deployed, sensors"
"""Name of the random stream of its sensors' noise."""

LOST = "deployed, lost commands"
"""Name of the random stream of what is lost on the way to it."""

LOSS = 0.3
"""Share of the commands that are lost on the way, by the fault of that name."""

BATTERY = 48.0
"""Nominal voltage [V]."""


@dataclass(frozen=True)
class VirtualCfg:
    """Which virtual robot is played, and where it stands."""

    seed: int = 1000
    """Of the robot: its friction, motors, delays, gears, sensors and masses."""
    engine: str = "mujoco"
    """Physics engine that it lives in."""
    level: str = "0.1"
    """Dry friction of its joints, as `--robot-levels` of evaluate."""
    cell: str = "all"
    """What of it is real: all, nominal, or groups such as friction+delays."""
    stand: bool = False
    """Whether it is bolted to a stand, its legs in the air."""

    def __post_init__(self) -> None:
        """Refuse a robot that there is not; raise `StictionError` before anything of it is built."""
        find_engine(self.engine)
        _ = self.case, stream_seed(self.seed, NOISE)

    @property
    def case(self) -> Case:
        """The robot among those of the experiments."""
        return Case(self.seed, self.cell, parse_level(self.level))


class RobotProcess:
    """A virtual robot at the end of a UDP port."""

    def __init__(self, spec: Robot, cfg: VirtualCfg, port: socket.socket) -> None:
        """Build the robot; raise `StictionError` where its engine or its friction cannot be."""
        streams = seed_streams(cfg.seed, [NOISE, LOST])
        noise, self._chance = streams[NOISE], streams[LOST]
        self._world = World(partial(make_engine, cfg.engine))
        build = self._world.on_bench if cfg.stand else self._world.robot
        self._robot: VirtualRobot = build(cfg.case, spec, noise)
        self._port, self._spec = port, spec
        self._peer: tuple[str, int] | None = None
        self._commands = command_layout(spec.num_joints)
        self._states = state_layout(spec.num_joints, len(spec.foot_names))
        limp = np.zeros(spec.num_joints)
        self._command = JointCommand(spec.joint_values("default_position"), limp, limp, limp)
        self._taken, self._number = np.nan, 0
        self._velocity = np.zeros(3)
        self._broken: BrokenState | None = None
        self._loss = 0.0
        self._second: socket.socket | None = None
        self._last: RobotState | None = None
        self.slow = 0
        """Periods that it was late by."""
        self._good = np.nan
        self._start = (np.nan, np.zeros(3))

    def period(self) -> None:
        """Take what has come, let a period pass, and say what is measured then."""
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
        if state is not None and self._peer is not None:
            self._number += 1
            data = self._states.pack(self._number, state.time, state_vectors(state))
            with suppress(OSError):
                self._port.sendto(data, self._peer)
                if self._second is not None:
                    self._second.sendto(data, self._peer)

    def _take(self, data: bytes, sender: tuple[str, int]) -> None:
        """Take one datagram."""
        if data == HELLO:
            self._peer = sender
        elif data.startswith(ASK) and (name := data[len(ASK) :].decode(errors="replace")) in OF_ROBOT | OF_WAY:
            self._begin_fault(name)
        elif self._loss and self._chance.random() < self._loss:
            pass
        elif (message := self._commands.unpack(data)) is not None and np.isfinite(message.values).all():
            command = command_of(self._commands, message)
            if not command.kp.any() and self._command.kp.any():
                self._say_damped()
            if command.kp.any() and not self._command.kp.any():
                self._start = (time.monotonic(), self._robot.ground_truth().motion.base_position)
            self._command, self._taken = command, float(message.number)

    def _begin_fault(self, name: str) -> None:
        """Begin a fault of the robot, or of the way to it."""
        if name in OF_WAY:
            self._loss = LOSS
        elif self._last is not None:
            self._broken = BrokenState(name, self._last)
            if name == "second-robot":
                self._second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def _say_damped(self) -> None:
        """Print when the first damping frame came, and what the robot had done by then."""
        now, motion = time.monotonic(), self._robot.ground_truth().motion
        moved = motion.base_position - self._start[1]
        said = {"damped": now, "last_good": self._good, "slow": self.slow, "moved": moved[:2].tolist()}
        said |= {"seconds": now - self._start[0], "upright": not self._world.fallen(motion, self._spec)}
        print(json.dumps(said), flush=True)

    def _state(self, reading: Reading) -> RobotState:
        """Return what the robot says of itself."""
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
            temperature=np.full(self._spec.num_joints, ROOM_TEMPERATURE),
            lost=np.zeros(self._spec.num_joints),
            motor_fault=np.zeros(self._spec.num_joints),
            foot_contact=reading.foot_contact.astype(float),
            battery=BATTERY,
            kp=self._command.kp,
            kd=self._command.kd,
            torque_limit=self._spec.joint_values("torque_limit"),
            command=self._taken,
        )
        return self._last


def main(path: str, settings: str) -> int:
    """Serve until the parent is gone; return the exit status."""
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
    said = {"port": port.getsockname()[1], "joints": spec.joint_names, "feet": spec.foot_names, "period": PERIOD}
    print(json.dumps(said), flush=True)
    ticker = Ticker(PERIOD)
    try:
        while True:
            robot.slow += ticker.wait()[1]
            robot.period()
    except (BlownUp, EngineError) as error:
        print(json.dumps({"error": f"the physics gave up: {error}"}), flush=True)
        return 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
