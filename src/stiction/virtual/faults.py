"""Faults injected into a run on a virtual robot, each at a time since its policy took over: `NAME@SECOND`.

Faults of the robot are requested from its process; the others are real faults of the supervisor's machine.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.isolation import bare_python
from stiction.core.rotation import about
from stiction.deploy.control import JointCommand
from stiction.deploy.runtime.config import OperatorCfg
from stiction.deploy.runtime.operator import ALIVE
from stiction.deploy.runtime.policy_process import FAULTS as OF_POLICY
from stiction.deploy.runtime.runtime import Injected
from stiction.deploy.transports.link import RobotState, command_layout
from stiction.deploy.transports.udp import LOOPBACK
from stiction.files.velocity import AXES

OF_WAY = {
    "lost-commands": "three of ten commands are lost on the way",
    "lost-states": "one of ten states is lost on the way",
    "double-states": "one of ten states comes twice",
    "swapped-states": "one of ten states comes behind the next one",
    "clock-back": "the robot's clock is set back by 5 s",
    "clock-forward": "the robot's clock is set forward by 5 s",
}
"""Faults of the connection to the robot, and of its clock: they break no rule by themselves."""

SIGNALS = {
    "policy-kill": signal.SIGKILL,
    "policy-stop": signal.SIGSTOP,
    **{f"sig{name}": signal.Signals[f"SIG{name.upper()}"] for name in ("term", "int", "hup", "quit", "tstp", "abrt")},
    **{f"sig{name}": signal.Signals[f"SIG{name.upper()}"] for name in ("usr1", "usr2", "alrm")},
}

OF_MACHINE = {
    "policy-kill": "the policy's process is killed (SIGKILL)",
    "policy-stop": "the policy's process is halted (SIGSTOP)",
    **{name: f"{name.upper()} comes" for name in SIGNALS if name.startswith("sig")},
    "supervisor-halt": "the supervisor is halted for 200 ms (SIGSTOP, then SIGCONT)",
    "stop-file": "the stop file appears",
    "second-writer": "another process sends commands",
    "heartbeat": "the second machine falls silent",
    "command-loss": "velocity commands stop coming",
}

POLICY = {
    "policy-exception": "the policy raises an error",
    "policy-nan": "it asks for no number",
    "policy-hang": "it hangs",
    "policy-exit": "its process ends by itself",
}

WITH_POLICY = (*POLICY, "policy-kill", "policy-stop", "command-loss")
"""Faults of a policy or its command, without an effect where a motion is played."""

MESSAGE_INTERVAL = 0.05
"""Time between two messages of the second machine [s]."""

HALT_SECONDS = 0.2
"""Time for which the supervisor is halted [s]."""

HALT = f"""
import os, signal, sys, time
sys.stdin.readline()
print(time.monotonic(), flush=True)
os.kill(os.getppid(), signal.SIGSTOP)
time.sleep({HALT_SECONDS})
os.kill(os.getppid(), signal.SIGCONT)
"""
"""Program of the process that halts its parent once, and prints the time."""

ASK = b"STCNfault "
"""Request for a fault to the robot's process."""


@dataclass(frozen=True)
class Fault:
    """Fault and its time."""

    name: str
    second: float
    """Time since the policy took over [s]."""


def parse_fault(text: str) -> Fault:
    """Return the fault of `NAME@SECOND`; raise `ConfigurationError` for another text."""
    name, at, second = text.partition("@")
    try:
        number = float(second) if at else 1.0
    except ValueError:
        number = np.nan
    if not 0 <= number <= 86400:
        raise ConfigurationError(f"fault {text!r}: expected NAME@SECOND, such as tilt@3")
    if name not in FAULTS:
        raise ConfigurationError(unknown_name("fault", name, FAULTS))
    return Fault(name, number)


def with_operators(operator: OperatorCfg, faults: Sequence[Fault], stop_file: Path) -> OperatorCfg:
    """Return the operators of a run with those that its faults need; stop_file: path that may appear."""
    needed = {fault.name for fault in faults}
    if "stop-file" in needed and operator.stop_file is None:
        operator = replace(operator, stop_file=stop_file)
    if "heartbeat" in needed and operator.heartbeat is None:
        operator = replace(operator, heartbeat=_free_address())
    if "command-loss" in needed and operator.command_from is None:
        operator = replace(operator, command_from=_free_address())
    return operator


def _free_address() -> str:
    """Return a free address on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind((LOOPBACK, 0))
        return f"{LOOPBACK}:{port.getsockname()[1]}"


class SecondMachine:
    """Second machine that sends heartbeats, velocity commands or joint commands, until it falls silent."""

    def __init__(self, address: str, words: bytes) -> None:
        """Start to send messages to HOST:PORT."""
        host, _, port = address.rpartition(":")
        self._address, self._words = (host, int(port)), words
        self._silent = threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True, name="second machine")
        self._thread.start()

    def _speak(self) -> None:
        """Send until told to stop."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            while not self._silent.is_set():
                port.sendto(self._words, self._address)
                self._silent.wait(MESSAGE_INTERVAL)

    def fall_silent(self) -> None:
        """Stop sending."""
        self._silent.set()
        self._thread.join()


class Faults(Injected):
    """Injector of due faults; a context, since some need an operator that sends messages until then."""

    obeyed = True

    def __init__(
        self, faults: Sequence[Fault], robot: tuple[str, int], operator: OperatorCfg, joints: int, velocity: np.ndarray
    ) -> None:
        """Prepare the faults of a virtual robot at a port on this machine.

        operator: see `with_operators`; velocity: remote command that a fault ends, (3,) [m/s, rad/s].
        """
        self._waiting = sorted(faults, key=lambda fault: fault.second)
        self._robot, self._stop_file, self._joints = robot, operator.stop_file, joints
        message = json.dumps(dict(zip(AXES, map(float, velocity), strict=True))).encode()
        places = {"heartbeat": (operator.heartbeat, ALIVE), "command-loss": (operator.command_from, message)}
        needed = {fault.name for fault in faults}
        self._speak = {name: place for name, place in places.items() if name in needed}
        self._elsewhere: dict[str, SecondMachine] = {}
        self._of_policy, self._halts = 0, "supervisor-halt" in needed
        self._halting: subprocess.Popen[str] | None = None
        self.times: dict[str, float] = {}
        """Fault -> time of its injection, on the monotonic clock [s]; for a halt: begin of the halt."""

    def __enter__(self) -> Faults:
        """Start the operator that a fault will silence."""
        for name, (address, words) in self._speak.items():
            assert address is not None, "see with_operators"
            self._elsewhere[name] = SecondMachine(address, words)
        if self._halts:
            pipe = subprocess.PIPE
            self._halting = subprocess.Popen(bare_python(HALT), stdin=pipe, stdout=pipe, text=True)
        return self

    def __exit__(self, *_: object) -> None:
        """Silence all senders."""
        for machine in self._elsewhere.values():
            machine.fall_silent()
        if self._halting is not None:
            halted = self._halting.communicate("")[0]
            if halted and "supervisor-halt" in self.times:
                self.times["supervisor-halt"] = float(halted)

    def due(self, elapsed: float, policy: subprocess.Popen[bytes] | None) -> int:
        """Inject due faults; see `Injected.due`."""
        while self._waiting and self._waiting[0].second <= elapsed:
            self._inject(self._waiting.pop(0).name, policy)
        return self._of_policy

    def _inject(self, name: str, policy: subprocess.Popen[bytes] | None) -> None:
        """Inject one fault."""
        self.times[name] = time.monotonic()
        if name in OF_ROBOT or name in OF_WAY:
            self._tell(ASK + name.encode())
        elif name in POLICY:
            self._of_policy = OF_POLICY.index(name)
        elif name == "second-writer":
            zero = np.zeros(self._joints)
            # With a number that the supervisor sent long ago: it sees in the next state that the robot acts on a
            # command not its own. One that the supervisor overwrites within the same period is never acted on.
            stiff = command_layout(self._joints).pack(1, 0.0, vars(JointCommand(zero, zero + 1.0, zero, zero)))
            self._elsewhere[name] = SecondMachine("{}:{}".format(*self._robot), stiff)
        elif name in self._elsewhere:
            self._elsewhere[name].fall_silent()
        elif name == "supervisor-halt" and self._halting is not None and self._halting.stdin is not None:
            self._halting.stdin.write("\n")
            self._halting.stdin.flush()
        elif name == "stop-file" and self._stop_file is not None:
            self._stop_file.touch()
        elif name in SIGNALS and (target := os.getpid() if name.startswith("sig") else policy and policy.pid):
            os.kill(target, SIGNALS[name])

    def _tell(self, data: bytes) -> None:
        """Send the robot a datagram from a separate port."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.sendto(data, self._robot)


class BrokenState:
    """Function from a robot's state to the faulty state that it sends."""

    def __init__(self, name: str, state: RobotState) -> None:
        """Start without states. `state`: the last good one."""
        self._change = OF_ROBOT[name][1]
        self._first, self._count = state, 0

    def __call__(self, state: RobotState) -> RobotState | None:
        """Return the faulty state; None: none is sent."""
        self._count += 1
        return self._change(state, self._first, self._count)


def _with(state: RobotState, **changed: Any) -> RobotState:
    """Return a state with some vectors of the sensors or of the state changed."""
    sensors = {name: changed.pop(name) for name in list(changed) if hasattr(state.sensors, name)}
    entries = vars(state) | changed | {"sensors": type(state.sensors)(**(state.sensors.arrays() | sensors))}
    return RobotState(**entries)


def _one(values: np.ndarray, value: float, place: int = 0) -> np.ndarray:
    """Return an array with one entry changed, the first one by default."""
    changed = np.array(values, float)
    changed[place] = value
    return changed


def exchanged(state: RobotState, joint: int = 1) -> RobotState:
    """Return a state in which a joint of the first two legs, by its number, has the other's angle, velocity, torque."""
    order = np.arange(len(state.joint_torque))
    pair = [joint, joint + len(order) // len(state.foot_contact)]
    order[pair] = pair[::-1]
    names = ("joint_position", "joint_velocity")
    sensed = {name: getattr(state.sensors, name)[order] for name in names}
    return _with(state, joint_torque=state.joint_torque[order], **sensed)


def _turned(state: RobotState, angle: float, rate: float) -> RobotState:
    """Return a state that leans by an angle about the base's x axis, and turns at an additional rate."""
    turning = np.add(
        state.sensors.angular_velocity, (rate, 0.0, 0.0)
    )  # With its noise: a gyroscope without is a dead one.
    return _with(state, quaternion=about(0, angle), angular_velocity=turning)


Change = Callable[[RobotState, RobotState, int], "RobotState | None"]
"""State, the last good state, number of states since then -> faulty state."""

OF_ROBOT: dict[str, tuple[str, Change]] = {
    "stale": ("the robot says nothing any more", lambda s, f, n: None),
    "frozen": ("it says the same numbers again and again", lambda s, f, n: _with(s, **f.sensors.arrays())),
    "frozen-clock": ("its time stands still", lambda s, f, n: _with(s, time=f.time)),
    "nan": (
        "a joint's angle is no number",
        lambda s, f, n: _with(s, joint_position=_one(s.sensors.joint_position, np.nan)),
    ),
    "inf": ("an angular velocity is infinite", lambda s, f, n: _with(s, angular_velocity=np.array([np.inf, 0.0, 0.0]))),
    "degrees": ("angles are in degrees", lambda s, f, n: _with(s, joint_position=np.degrees(s.sensors.joint_position))),
    "jump": (
        "a joint's angle jumps by 1 rad",
        lambda s, f, n: _with(s, joint_position=_one(s.sensors.joint_position, s.sensors.joint_position[0] + 1.0)),
    ),
    "quaternion": ("the orientation is no quaternion", lambda s, f, n: _with(s, quaternion=np.zeros(4))),
    "xyzw": (
        "the quaternion's order is x y z w",
        lambda s, f, n: _with(s, quaternion=np.roll(s.sensors.quaternion, -1)),
    ),
    "tilt": ("it leans by 1.2 rad at once", lambda s, f, n: _turned(s, 1.2, 0.0)),
    "tilting": ("it tips over at 3 rad/s", lambda s, f, n: _turned(s, min(3.0 * 0.002 * n, 1.5), 3.0)),
    "joint-speed": (
        "a joint moves at 60 rad/s",
        lambda s, f, n: _with(s, joint_velocity=_one(s.sensors.joint_velocity, 60.0)),
    ),
    "torque": (
        "a motor gives twice its limit",
        lambda s, f, n: _with(s, joint_torque=_one(s.joint_torque, 2 * s.torque_limit[0])),
    ),
    "temperature": ("a motor has 120 °C", lambda s, f, n: _with(s, temperature=_one(s.temperature, 120.0))),
    "flailing": (
        "all joints move at 15 rad/s",
        lambda s, f, n: _with(s, joint_velocity=15.0 * np.where(np.arange(len(s.kp)) % 2, 1.0, -1.0)),
    ),
    "motor-lost": (
        "the robot's own bus loses every message of a motor",
        lambda s, f, n: _with(s, lost=_one(s.lost, n)),
    ),
    "motor-fault": (
        "a motor says that something is wrong with it",
        lambda s, f, n: _with(s, motor_fault=_one(s.motor_fault, 4.0)),
    ),
    "drive-gains": ("the drives act with other gains than they were given", lambda s, f, n: _with(s, kp=1.5 * s.kp)),
    "frozen-angle": (
        "a joint's angle stands still, its velocity goes on",
        lambda s, f, n: _with(s, joint_position=_one(s.sensors.joint_position, f.sensors.joint_position[1], 1)),
    ),
    "frozen-angles": (
        "all joints' angles stand still, their velocities go on",
        lambda s, f, n: _with(s, joint_position=f.sensors.joint_position),
    ),
    "dead-gyroscope": ("the gyroscope says zero", lambda s, f, n: _with(s, angular_velocity=np.zeros(3))),
    "swapped-joints": ("the second joints of two legs are taken for each other", lambda s, f, n: exchanged(s)),
    "offset-joint": (
        "a joint's angle is off by 0.15 rad at once",
        lambda s, f, n: _with(s, joint_position=_one(s.sensors.joint_position, s.sensors.joint_position[1] + 0.15, 1)),
    ),
    "slow-clock": ("its clock runs at half its speed", lambda s, f, n: _with(s, time=f.time + 0.5 * (s.time - f.time))),
    "second-robot": ("states of a second robot come, from another address", lambda s, f, n: s),
    "lossy": ("every second state is lost on the way", lambda s, f, n: s if n % 2 else None),
    "nan-torque": (
        "a motor's torque is no number",
        lambda s, f, n: _with(s, joint_torque=_one(s.joint_torque, np.nan)),
    ),
}
"""Faults of the robot and of its sensors: description, and the faulty state."""

FAULTS = {name: text for name, (text, _) in OF_ROBOT.items()} | OF_WAY | POLICY | OF_MACHINE
"""Description of every fault."""
