"""The watchdog: acts on silence and on nothing else, damps as a stop does, and is known as ours."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from deployed import CONTRACT, PERIOD, SHORT, STANDING, state
from stiction.core.errors import RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.runtime.config import OperatorCfg
from stiction.deploy.runtime.operator import Operator
from stiction.deploy.runtime.processes import UNWATCHED, Watchdog, watchdog_process
from stiction.deploy.runtime.report import Timing
from stiction.deploy.runtime.runtime import Injected, _Loop
from stiction.deploy.runtime.supervisor import Stage, Supervisor
from stiction.deploy.runtime.watchdog import ACTED, AGAIN, BEAT, HEARD, LIMIT, LOOK, LOOKED, Takeover, Vigil
from stiction.deploy.transports.link import RobotState
from stiction.deploy.transports.udp import UdpLink
from stiction.files.bundle import find_bundle, read_bundle

GAP = SHORT.gap


def test_it_acts_on_two_silent_looks_and_never_while_beats_come() -> None:
    """Damps a robot whose supervisor is well, or one look after it was itself halted; or later than 20 ms after."""
    vigil, now, beat = Vigil(), 0.0, 0.0
    for _ in range(1000):
        beat = now if now - beat > 0.9 * GAP else beat
        assert not vigil.look(beat, GAP, now)
        now += vigil.wait(beat, GAP, now)
    # Halted itself: the first look finds an old beat, the second a new one.
    assert not vigil.look(beat, GAP, beat + 1.0) and vigil.wait(beat, GAP, beat + 1.0) == AGAIN
    assert not vigil.look(beat + 1.0 + AGAIN / 2, GAP, beat + 1.0 + AGAIN)
    beat = now = beat + 1.0
    while not vigil.look(beat, GAP, now):
        now += vigil.wait(beat, GAP, now)
    assert GAP < now - beat <= GAP + 3 * AGAIN
    # Nothing is guarded before the robot stands up.
    assert not any(vigil.look(0.0, 0.0, at) for at in (1.0, 2.0, 3.0)) and vigil.wait(0.0, 0.0, 3.0) == LOOK


class Numbers:
    """A link to a robot that is somewhere and says so."""

    def __init__(self) -> None:
        self.sent: list[JointCommand] = []
        self.states: list[RobotState] = []

    def receive(self) -> list[RobotState]:
        """Return the messages since the last call."""
        states, self.states = self.states, []
        return states

    def send(self, command: JointCommand) -> int:
        """Keep a command."""
        self.sent.append(command)
        return len(self.sent)


@pytest.mark.parametrize(("falls_for", "silent", "expected"), [(0.0, False, 0.3), (0.7, False, 0.9), (9.0, False, 2.0),
                                                               (0.0, True, 2.0)])  # fmt: skip
def test_it_damps_as_a_stop_does(falls_for: float, silent: bool, expected: float) -> None:
    """Sends a command with gains, ends while the robot moves or says nothing, or never ends."""
    cfg, link, now = replace(SHORT, settle=0.3, settle_limit=2.0), Numbers(), 0.0
    takeover = Takeover(link, cfg, CONTRACT.array("kd"), now)  # type: ignore[arg-type]
    while not takeover.step(now):
        now += PERIOD
        position = STANDING - 0.5 * min(now, falls_for)
        link.states = [] if silent else [state(1, now, joint_position=position)]
    assert now == pytest.approx(expected, abs=0.05) and len(link.sent) == pytest.approx(now / PERIOD, abs=2)
    for command in link.sent:
        assert not command.kp.any() and not command.forward.any() and (command.kd == CONTRACT.array("kd")).all()


def test_a_watchdog_that_acted_or_is_gone_ends_the_run() -> None:
    """Names the rule: acted, halted, ended; a halt of the whole machine is not the watchdog's."""
    memory, longest = np.zeros(8), UNWATCHED * GAP
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        watchdog = Watchdog(memory, GAP, process)
        memory[LOOKED] = 10.0
        watchdog.beat(10.0, guards=False)
        assert (memory[BEAT], memory[LIMIT]) == (10.0, 0.0) and not watchdog.acted
        watchdog.guard()
        assert (memory[BEAT], memory[LIMIT]) == (10.0, GAP)
        assert watchdog.broken(10.1 + longest) is None  # The supervisor made no turn either.
        watchdog.beat(10.0 + longest, guards=True)
        assert (memory[BEAT], memory[LIMIT]) == (10.0 + longest, GAP) and watchdog.broken(10.0 + longest) is None
        halted, detail = watchdog.broken(10.01 + longest) or pytest.fail("it is not missed")
        assert (halted.rule, halted.limit, detail) == ("watchdog gone", longest, "its process is halted")
        memory[LOOKED] = 10.0 + longest
        process.kill()
        process.wait()
        assert (watchdog.broken(10.0 + longest) or pytest.fail("it is not missed"))[1] == "its process has ended"
    memory[ACTED], memory[HEARD] = 20.0, 19.93
    silent, _ = watchdog.broken(30.0) or pytest.fail("it is called idle")
    assert watchdog.acted and silent.rule == "supervisor silent" and silent.value == pytest.approx(0.07)
    watchdog.close()


ROBOT = """
import json, socket, sys, time
from stiction.deploy.transports.link import command_layout, command_of
port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
port.bind(("127.0.0.1", 0))
port.settimeout(120)
print(port.getsockname()[1], flush=True)
layout, numbers = command_layout(int(sys.argv[1])), []
while len(numbers) < int(sys.argv[2]):
    data, sender = port.recvfrom(10000)
    message = layout.unpack(data)
    if message is not None:
        command = command_of(layout, message)
        numbers.append([message.number, bool(command.kp.any()), sender[1]])
print(json.dumps(numbers), flush=True)
"""

SUPERVISOR = """
import json, os, signal, sys, time
from pathlib import Path
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.runtime.processes import watchdog_process
from stiction.deploy.transports.udp import UdpLink
from stiction.deploy.control import JointCommand
from stiction.files.bundle import read_bundle
import numpy as np
folder, port, ending = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
bundle = read_bundle(folder)
contract = bundle.contract
link = UdpLink(("127.0.0.1", port), contract.joint_names, contract.anatomy.foot_names, 0.002)
ones = np.ones(contract.num_joints)
cfg = SupervisorCfg(armed=True, settle=0.1, settle_limit=3.0, gap=10.0 if ending == "done" else 0.06)
with watchdog_process(bundle, folder, link, cfg) as watchdog:
    # A beat of three minutes ahead: before the robot gives up, only the end of the process can be noticed.
    watchdog.beat(time.monotonic() + (180.0 if ending == "SIGKILL" else 0.0), guards=False)
    watchdog.guard()
    for _ in range(5):
        watchdog.sent(link.send(JointCommand(ones, ones, ones, ones)))
    if ending == "done":
        watchdog.beat(time.monotonic() - 60.0, guards=False)
        time.sleep(1)
        sys.exit()
    if ending == "error":
        raise ValueError("an error that kept the supervisor from damping")
    os.kill(os.getpid(), signal.Signals[ending])
    time.sleep(600)
"""


@pytest.mark.parametrize("acts", [False, True])
def test_a_frame_with_gains_is_guarded_and_does_not_follow_a_takeover(acts: bool) -> None:
    """The watchdog guards when the first one goes out; one that was decided in the turn of a takeover stays here."""
    memory, sent = np.zeros(8), list[tuple[bool, float]]()
    memory[LOOKED] = np.inf

    def receive() -> list[RobotState]:
        memory[ACTED] = acts
        return [state(1, 1.0)]

    def send(command: JointCommand) -> int:
        sent.append((bool(command.kp.any()), memory[LIMIT]))
        return len(sent)

    link = UdpLink(("127.0.0.1", 9), CONTRACT.joint_names, (), PERIOD)
    link.receive, link.send = receive, send  # type: ignore[method-assign]
    watchdog = Watchdog(memory, GAP, SimpleNamespace(pid=os.getpid(), poll=lambda: None))  # type: ignore[arg-type]
    patient = replace(SHORT, stale=10.0, silence=10.0, gap=10.0)
    supervisor, operator = Supervisor(CONTRACT, patient, PERIOD, time.monotonic()), Operator(OperatorCfg(), 0.0)
    supervisor.policy_waits(time.monotonic())
    loop = _Loop(supervisor, link, None, None, None, watchdog, operator, Timing(), Injected(), lambda text: None)
    loop._run_once()
    assert supervisor.stage is Stage.STAND and sent == ([] if acts else [(True, GAP)])
    if acts:
        loop._run_once()
        assert supervisor.stage is Stage.DAMP and sent and not any(stiff for stiff, _ in sent)
    link.close()
    watchdog.close()


@pytest.mark.parametrize("broken", [False, True])
def test_only_a_robot_that_was_damped_is_guarded_no_more(broken: bool) -> None:
    """The watchdog ends only after damping was sent; until then it guards the robot."""
    memory, link = np.zeros(8), UdpLink(("127.0.0.1", 9), CONTRACT.joint_names, (), PERIOD)
    memory[LOOKED] = np.inf
    watchdog = Watchdog(memory, GAP, SimpleNamespace(pid=os.getpid(), poll=lambda: None))  # type: ignore[arg-type]
    supervisor, operator = Supervisor(CONTRACT, SHORT, PERIOD, time.monotonic()), Operator(OperatorCfg(), 0.0)
    # It walks, and no policy answers: it is stopped.
    supervisor.stage = Stage.RUN
    if broken:
        link.send = Mock(side_effect=ValueError("no way"))  # type: ignore[method-assign]
    loop = _Loop(supervisor, link, None, None, None, watchdog, operator, Timing(), Injected(), lambda text: None)
    with suppress(ValueError):
        loop.run(np.zeros(3))
    assert supervisor.stop_record is not None and memory[LIMIT] == (GAP if broken else 0.0)
    link.close()
    watchdog.close()


BUNDLE = find_bundle(Path("saturn_lite-flat-deception-0.2"))


@pytest.mark.parametrize("ending", ["SIGKILL", "SIGSTOP", "error", "done"])
def test_a_supervisor_that_did_not_damp_is_relieved_from_its_own_port(ending: str) -> None:
    """Damping comes from its port, numbered behind its last, when it is killed at once; none after a proper end."""
    words = [str(read_bundle(BUNDLE).contract.num_joints), "5" if ending == "done" else "20"]
    with subprocess.Popen([sys.executable, "-c", ROBOT, *words], stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        port = robot.stdout.readline().strip()
        command = [sys.executable, "-c", SUPERVISOR, str(BUNDLE), port, ending]
        supervisor = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        heard = json.loads(robot.stdout.readline())
        if ending.startswith("SIG"):
            supervisor.kill()
        # To its end of file, which is there once the watchdog, which has the same standard error, has ended too.
        errors = supervisor.communicate()[1]
    assert [stiff for _, stiff, _ in heard] == 5 * [True] + (len(heard) - 5) * [False]
    assert [number - heard[0][0] for number, _, _ in heard] == list(range(len(heard)))
    assert len({sender for _, _, sender in heard}) == 1
    assert errors.count("the watchdog damped the robot") == (ending != "done"), errors


def test_a_watchdog_that_does_not_come_up_refuses_the_run(tmp_path: Path) -> None:
    """Refuses a bundle that is gone, or another one since it was checked; unarmed, nothing is guarded."""
    link, bundle = UdpLink(("127.0.0.1", 9), CONTRACT.joint_names, (), PERIOD), read_bundle(BUNDLE)
    changed = replace(bundle, digest="0" * 64)
    for checked, folder, message in ((bundle, tmp_path / "nowhere", "nowhere"), (changed, BUNDLE, "has changed since")):
        with (
            pytest.raises(RobotError, match=f"the watchdog did not come up: .*{message}"),
            watchdog_process(checked, folder, link, SHORT),
        ):
            raise AssertionError("it came up")
    with watchdog_process(bundle, tmp_path / "nowhere", link, replace(SHORT, armed=False)) as none:
        assert none is None
    link.close()
