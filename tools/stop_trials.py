"""Trials of how a run is stopped, for `tools/faults.py --stops`: halts, lost commands, two robots, signals.

Each trial is the whole program in a process of its own, forked from one that has everything imported, on a robot that
is no simulation: its joints go where they are asked to at 3 rad/s, and stay where they are when they are damped. Such a
robot costs a tenth of a processor core, so that many trials fit into some minutes. It says when the first damping frame
came and whether the last command was stiff. Over UDP it is `--robot virtual` with another process behind it, over DDS
`--robot unitree-go:lo`, on a domain of its own.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from stiction.cli.main import main as program
from stiction.deploy.check import check_bundle
from stiction.deploy.observation import Sensors
from stiction.deploy.runtime import runtime
from stiction.deploy.transports.link import RobotState, command_layout, command_of, state_layout, state_vectors
from stiction.deploy.transports.udp import HELLO, LOOPBACK, UdpLink
from stiction.files.bundle import find_bundle
from stiction.files.contract import Contract

BUNDLE = "saturn_lite-flat-deception-0.2"
PERIOD, FASTEST, LOSS = 0.002, 3.0, 0.3
HALT, LONG_HALT = 0.2, 2.0
"""Time for which a supervisor is halted; on a busy machine [s]."""

PATIENCE = 60.0
"""Longest time to wait for a robot to become stiff, or for a run to end [s]."""

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGUSR1", "SIGUSR2", "SIGABRT", "SIGALRM")
TRIES = 3

PATIENT = ("--stale", "3", "--gap", "1")
"""Options of runs on a machine that does other work, for a first look: its times say nothing."""

REALTIME = ("--realtime", "50")
"""Options of runs, and priority of their robots, on a machine that does other work, where times count."""

WHILE_WALKING = 2.7
"""Time from the first stiff command at which the policy has taken over [s]."""

OF_POLICY = ("policy killed", "supervisor killed", "supervisor halted")
"""Situations in which a policy runs; in all others a motion is played."""

SITUATIONS = (*OF_POLICY, "stop with lost commands", "second robot joins (UDP)", "two robots (DDS)")
SITUATIONS += ("second robot joins (DDS)", *(f"signal {name}" for name in SIGNALS))

COLUMNS = ("situation", "trial", "outcome", "rule", "status", "event_to_damping_ms", "damped_s")
COLUMNS += ("second_stiff", "probe_ms", "line")
"""Outcome: damped, refused (nothing stiff was ever sent), stiff (the last command was) or before (the run ended before
its event). The event is that of the situation: the signal, the kill, the halt (SIGSTOP) of the supervisor,
when the second robot says its first state (UDP) or opens the network (DDS: it is known by that). damped_s: from the
first damping frame to the last [s]; second_stiff: 1 where a second robot ever heard a stiff command, 0 where not."""


class Body:
    """Joints that follow stiff commands and stay where they are under all others."""

    def __init__(self, standing: np.ndarray) -> None:
        """`standing`: angles at the begin [rad]."""
        self.position, self._goal, self._moved = np.array(standing, float), np.array(standing, float), 0.0 * standing
        self.stiff, self.ever, self.first_damped, self.last_damped = False, False, None, None

    def take(self, target: np.ndarray, stiff: bool) -> None:
        """Obey a command."""
        now = time.monotonic()
        if not stiff and self.ever:
            self.first_damped, self.last_damped = self.first_damped or now, now
        if stiff and not self.ever:
            print("stiff", flush=True)
        self.stiff, self.ever = stiff, self.ever or stiff
        self._goal = np.array(target, float) if stiff else self.position

    def move(self) -> tuple[np.ndarray, np.ndarray]:
        """Let a period pass; return angles [rad] and velocities [rad/s]."""
        moved = np.clip(self._goal - self.position, -FASTEST * PERIOD, FASTEST * PERIOD)
        self.position = self.position + moved
        return self.position, moved / PERIOD

    def said(self) -> str:
        """Return what the robot saw, as a line."""
        seen = {"stiff": self.stiff, "ever": self.ever, "first": self.first_damped, "last": self.last_damped}
        return json.dumps(seen)


def beats() -> Iterator[float]:
    """Yield the time since the begin [s] once a period, until standard input ends or says something (yielded as -1)."""
    begin, number = time.monotonic(), 0
    while True:
        number += 1
        while (left := begin + number * PERIOD - time.monotonic()) > 0:
            if select.select([0], [], [], left)[0]:
                if not os.read(0, 64):
                    return
                yield -1.0
        yield number * PERIOD


def udp_robot(contract: Contract, seed: int, lossy: bool, realtime: bool) -> None:
    """Be a robot at a UDP port, which is printed; a word on standard input: states come from a second port too."""
    if realtime:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(REALTIME[1])))
    joints, feet = contract.num_joints, len(contract.anatomy.foot_names) if contract.anatomy else 0
    states, commands, chance = state_layout(joints, feet), command_layout(joints), np.random.default_rng(seed)
    port, second = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    port.bind((LOOPBACK, 0))
    port.setblocking(False)
    print(json.dumps({"port": port.getsockname()[1]}), flush=True)
    body, peer, taken, gains, joined = Body(contract.array("standing")), None, np.nan, np.zeros((2, joints)), False
    for number, at in enumerate(beats(), 1):
        joined = joined or at < 0
        with suppress(OSError):
            while True:
                data, sender = port.recvfrom(commands.bytes + 1)
                if data == HELLO:
                    peer = sender
                elif (message := commands.unpack(data)) and not (lossy and chance.random() < LOSS):
                    command = command_of(commands, message)
                    body.take(command.target, bool(command.kp.any()))
                    taken, gains = float(message.number), np.array([command.kp, command.kd])
        if at < 0 or peer is None:
            continue
        position, velocity = body.move()
        sensors = Sensors(np.array([1.0, 0, 0, 0]), 1e-3 * np.sin(np.arange(3) + 40 * at), position, velocity)
        zero, up = np.zeros(joints), np.array([0.0, 0.0, 9.81])
        limits = contract.array("torque_limit")
        state = RobotState(
            number, at, sensors, up, zero, zero + 30, zero, zero, np.ones(feet), 48.0, gains[0], gains[1], limits, taken
        )
        data = states.pack(number, at, state_vectors(state))
        for each in (port, second) if joined else (port,):
            each.sendto(data, peer)
    print(body.said(), flush=True)


def dds_robot(contract: Contract, domain: int) -> None:
    """Be a Go2 on a DDS domain."""
    from cyclonedds.domain import Domain, DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from stiction.deploy.transports.dds import domain_settings, wire_type
    from stiction.files.unitree import GO_COMMAND, GO_STATE

    kind, at = wire_type(GO_STATE), time.monotonic()
    settings = Domain(domain, domain_settings("lo"))
    participant = DomainParticipant(domain)
    writer = DataWriter(participant, Topic(participant, "rt/lowstate", kind))
    reader = DataReader(participant, Topic(participant, "rt/lowcmd", wire_type(GO_COMMAND)))
    state, count = GO_STATE.blank(), contract.num_joints
    state["imu_state"]["quaternion"], state["imu_state"]["accelerometer"] = (1, 0, 0, 0), (0, 0, 9.81)
    body = Body(contract.array("standing"))
    print(json.dumps({"at": at}), flush=True)
    for at in beats():
        for sample in reader.take(64):
            if hasattr(sample, "data"):
                motors = GO_COMMAND.from_wire(sample.data)["motor_cmd"][:count]
                body.take(motors["q"], bool(motors["kp"].any()))
        position, velocity = body.move()
        state["motor_state"]["q"][:count], state["motor_state"]["dq"][:count] = position, velocity
        state["imu_state"]["gyroscope"] = 1e-3 * np.sin(np.arange(3) + 40 * at)
        state["crc"] = GO_STATE.checksum(state)
        writer.write(kind(GO_STATE.to_wire(state)))
    print(body.said(), flush=True)
    del settings


class Child:
    """A forked process with pipes at its standard streams."""

    def __init__(self, work: Callable[[], int | None]) -> None:
        """Begin to work; what it returns is the exit status."""
        inward, outward, errors = os.pipe(), os.pipe(), tempfile.TemporaryFile()  # noqa: SIM115
        self.number = os.fork()
        if self.number == 0:
            status = 70
            try:
                os.setsid()
                for here, place in ((inward[0], 0), (outward[1], 1), (errors.fileno(), 2)):
                    os.dup2(here, place)
                os.closerange(3, 64)
                sys.stdin, sys.stdout, sys.stderr = (os.fdopen(n, mode) for n, mode in ((0, "r"), (1, "w"), (2, "w")))
                status = work() or 0
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                os._exit(status)
        os.close(inward[0])
        os.close(outward[1])
        self.stdin, self.stdout, self._errors = inward[1], os.fdopen(outward[0]), errors

    def line(self, unless: Child | None = None) -> str:
        """Return the next line that it says; empty: it, or another child, has ended, or it says nothing."""
        ready = select.select([self.stdout, *([] if unless is None else [unless.stdout])], [], [], PATIENCE)[0]
        return self.stdout.readline() if self.stdout in ready else ""

    def end(self) -> tuple[int, str, str]:
        """Wait for it; return its status, its output and its last line of errors."""
        os.close(self.stdin)
        output = self.stdout.read()
        status = os.waitstatus_to_exitcode(os.waitpid(self.number, 0)[1])
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        self.stdout.close()
        self._errors.close()
        return status, output, lines[-1] if lines else ""


def deploy(folder: Path, bundle: Path, robot: list[str], port: int, policy: bool) -> int:
    """Run the program on a robot; return its status. The bundle was checked once, before this process was forked."""
    import stiction.virtual.serve as behind

    checked, contract = CHECKED[bundle], CHECKED[bundle].bundle.contract

    @contextmanager
    def robot_at(*_: object) -> Iterator[Any]:
        feet = contract.anatomy.foot_names if contract.anatomy else ()
        link = UdpLink((LOOPBACK, port), contract.joint_names, feet, PERIOD)
        link.hello()
        yield SimpleNamespace(link=link, address=(LOOPBACK, port), report=dict)
        link.close()

    behind.virtual_robot = robot_at  # type: ignore[assignment]
    sys.modules["stiction.deploy.check"].check_bundle = lambda *_: checked  # type: ignore[attr-defined]
    if not policy:
        runtime.PROBE_SECONDS = 0.2
    motion = folder / "trajectory.csv"
    motion.write_text(f"time,target.{contract.joint_names[0]}\n0,0\n30,0\n")
    words = ["deploy", str(bundle), *robot, "--armed", "--json", "--duration", "30", "--keep-minutes", "0"]
    words += [] if policy else ["--excitation", str(motion)]
    words += ["--silence", "5"] if policy and "--stale" in robot else []
    return program([*words, "--out", str(folder / "run")])


CHECKED: dict[Path, Any] = {}
"""Bundle -> what its check found."""


def prepare(folder: Path) -> dict[str, Path]:
    """Check the bundles of all trials; return them by transport."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests/helpers"))
    from bundles import make_bundle, make_contract
    from stiction.robots.catalog import find_robot

    made = make_bundle(folder / "toy", make_contract("go1", anatomy=find_robot("go1")))
    bundles = {"udp": find_bundle(Path(BUNDLE)), "dds": made}
    CHECKED.update({bundle: check_bundle(bundle) for bundle in bundles.values()})
    return bundles


def trial(
    situation: str, number: int, bundles: dict[str, Path], domain: int, patience: tuple[str, ...]
) -> dict[str, object]:
    """Make one trial, up to three times where the run ends before its event; return its row. patience: its options."""
    for _ in range(TRIES):
        row = attempt(situation, number, bundles, domain, patience)
        if row["outcome"] != "before":
            break
    return row


def attempt(
    situation: str, number: int, bundles: dict[str, Path], domain: int, patience: tuple[str, ...]
) -> dict[str, object]:
    """Make one trial; return its row. patience: options of a run on a busy machine."""
    bundle = bundles["dds" if "DDS" in situation else "udp"]
    contract, wait = CHECKED[bundle].bundle.contract, 0.1 + 0.02 * (number % 20)
    wait += WHILE_WALKING if situation in OF_POLICY else 0.0
    if bundle == bundles["dds"]:
        robots, port = [Child(lambda: dds_robot(contract, domain))], 0
        robots += [Child(lambda: dds_robot(contract, domain))] if situation.startswith("two") else []
        for robot in robots:
            robot.line()
        words = ["--robot", "unitree-go:lo", "--domain", str(domain)]
    else:
        robot = partial(udp_robot, contract, number, "lost" in situation, "--realtime" in patience)
        robots, words = [Child(robot)], ["--robot", "virtual"]
        port = json.loads(robots[0].line())["port"]
    with tempfile.TemporaryDirectory() as name:
        run = Child(lambda: deploy(Path(name), bundle, [*words, *patience], port, situation in OF_POLICY))
        event = np.nan
        if not situation.startswith("two") and robots[0].line(run) == "stiff\n":
            time.sleep(wait)
            event = happen(situation, run.number, robots, contract, domain, LONG_HALT if patience == PATIENT else HALT)
        status, output, line = run.end()
    seen = [json.loads((robot.end()[1].strip().splitlines() or ["{}"])[-1]) for robot in robots]
    row: dict[str, object] = {"situation": situation, "trial": number, "status": status, "line": line[:160]}
    with suppress(ValueError):
        report = json.loads(output)
        row |= {"rule": (report["stop"] or {"rule": "none"})["rule"], "probe_ms": report["probe_ms"]["p99"]}
    ever, stiff = (any(each.get(name) for each in seen) for name in ("ever", "stiff"))
    row["outcome"] = "stiff" if stiff else "damped" if ever else "refused"
    first = seen[0].get("first")
    if not situation.startswith("two") and (np.isnan(event) or (first or event) < event):
        return row | {"outcome": "before"}
    if len(seen) > 1:
        row["second_stiff"] = int(bool(seen[1].get("ever")))
    if first:
        row |= {"event_to_damping_ms": round(1e3 * (first - event), 2), "damped_s": round(seen[0]["last"] - first, 2)}
    return row


def happen(situation: str, run: int, robots: list[Child], contract: Contract, domain: int, halt: float) -> float:
    """Let happen what a situation names, or a halt of so many seconds; return when it did [s]."""
    if situation == "policy killed":
        processes = Path(f"/proc/{run}/task/{run}/children").read_text().split()
        event = time.monotonic() if processes else np.nan
        for process in map(int, processes[:1]):
            os.kill(process, signal.SIGKILL)
    elif situation == "supervisor killed":
        event = time.monotonic()
        os.kill(run, signal.SIGKILL)
    elif situation == "supervisor halted":
        event = time.monotonic()
        os.kill(run, signal.SIGSTOP)
        time.sleep(halt)
        os.kill(run, signal.SIGCONT)
    elif situation == "second robot joins (UDP)":
        event = time.monotonic()
        os.write(robots[0].stdin, b"join")
    elif situation == "second robot joins (DDS)":
        robots.append(Child(lambda: dds_robot(contract, domain)))
        event = float(json.loads(robots[-1].line())["at"])
    else:
        name = situation.removeprefix("signal ") if situation.startswith("signal") else "SIGTERM"
        event = time.monotonic()
        os.kill(run, signal.Signals[name])
    return event
