"""The watchdog: acts on silence and on nothing else, damps as a stop does, and is known as ours."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deployed import CONTRACT, PERIOD, SHORT, STANDING, state
from stiction.core.errors import RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.runtime.processes import UNWATCHED, Watchdog, watchdog_process
from stiction.deploy.runtime.watchdog import ACTED, AGAIN, BEAT, HEARD, LIMIT, LOOK, LOOKED, Takeover, Vigil
from stiction.deploy.transports.link import RobotState
from stiction.deploy.transports.udp import UdpLink
from stiction.files.bundle import find_bundle

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
        self.said: list[RobotState] = []

    def receive(self) -> list[RobotState]:
        """Return what was said since the last call."""
        said, self.said = self.said, []
        return said

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
        link.said = [] if silent else [state(1, now, joint_position=position)]
    assert now == pytest.approx(expected, abs=0.05) and len(link.sent) == pytest.approx(now / PERIOD, abs=2)
    for command in link.sent:
        assert not command.kp.any() and not command.forward.any() and (command.kd == CONTRACT.array("kd")).all()


def test_the_supervisor_s_end_says_what_happened() -> None:
    """A watchdog that has ended is not missed, or one that has acted is called dead."""
    memory = np.zeros(8)
    watchdog = Watchdog(memory, GAP, 1)
    memory[LOOKED] = 10.0
    watchdog.beat(10.0, guards=False)
    assert (memory[BEAT], memory[LIMIT]) == (10.0, 0.0) and not watchdog.acted
    watchdog.beat(10.1, guards=True)
    assert (memory[BEAT], memory[LIMIT]) == (10.1, GAP)
    assert not watchdog.ended_now(10.0 + UNWATCHED) and watchdog.summary() == {"acted": False, "end": None}
    assert watchdog.ended_now(10.1 + UNWATCHED) and not watchdog.ended_now(10.2 + UNWATCHED)
    assert "halted" in str(watchdog.summary()["end"])
    acted = Watchdog(memory, GAP, 1)
    memory[ACTED], memory[HEARD] = 20.0, 19.93
    assert acted.acted and not acted.ended_now(30.0)
    assert acted.silent().rule == "supervisor silent" and acted.silent().value == pytest.approx(0.07)


ROBOT = """
import json, socket, sys, time
from stiction.deploy.transports.link import command_layout, command_of
port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
port.bind(("127.0.0.1", 0))
port.settimeout(20)
print(port.getsockname()[1], flush=True)
layout, numbers = command_layout(int(sys.argv[1])), []
while len(numbers) < 20:
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
folder, port = Path(sys.argv[1]), int(sys.argv[2])
contract = read_bundle(folder).contract
link = UdpLink(("127.0.0.1", port), contract.joint_names, contract.anatomy.foot_names, 0.002)
ones = np.ones(contract.num_joints)
with watchdog_process(folder, link, SupervisorCfg(armed=True, settle=0.1, settle_limit=0.5)) as watchdog:
    for _ in range(5):
        watchdog.sent(link.send(JointCommand(ones, ones, ones, ones)))
    watchdog.beat(time.monotonic(), guards=True)
    os.kill(os.getpid(), signal.Signals[sys.argv[3]])
    time.sleep(20)
"""


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSTOP"])
def test_a_supervisor_that_is_killed_or_halted_is_relieved_from_its_own_port(name: str) -> None:
    """No damping comes, it comes from a second writer, or with numbers that came before."""
    bundle = find_bundle(Path("saturn_lite-flat-deception-0.2"))
    words = [sys.executable, "-c", ROBOT, str(len(json.loads((bundle / "contract.json").read_text())["joint_names"]))]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        port = robot.stdout.readline().strip()
        command = [sys.executable, "-c", SUPERVISOR, str(bundle), port, name]
        supervisor = subprocess.Popen(command, stderr=subprocess.PIPE)
        heard = json.loads(robot.stdout.readline())
        supervisor.kill()
        supervisor.communicate()
    assert [stiff for _, stiff, _ in heard] == 5 * [True] + 15 * [False]
    assert [number - heard[0][0] for number, _, _ in heard] == list(range(20))
    assert len({sender for _, _, sender in heard}) == 1


def test_a_watchdog_that_does_not_come_up_refuses_the_run(tmp_path: Path) -> None:
    """A run begins that nobody guards, though its transport would let it be guarded."""
    link = UdpLink(("127.0.0.1", 9), CONTRACT.joint_names, (), PERIOD)
    with (
        pytest.raises(RobotError, match=r"the watchdog did not come up: .*nowhere"),
        watchdog_process(tmp_path / "nowhere", link, SHORT),
    ):
        raise AssertionError("it came up")
    with watchdog_process(tmp_path / "nowhere", link, replace(SHORT, armed=False)) as none:
        assert none is None
    link.close()
