"""The link over UDP: one address, pinned; ages by the time of arrival; a second robot counted and not believed."""

from __future__ import annotations

import select
import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from deployed import JOINTS, PERIOD, state
from stiction.core.errors import RobotError
from stiction.deploy.runtime.processes import Death
from stiction.deploy.transports.link import state_layout, state_vectors
from stiction.deploy.transports.udp import HELLO, LOOPBACK, UdpLink

STATES = state_layout(JOINTS, 6)


@pytest.fixture
def robot() -> Iterator[socket.socket]:
    """A robot's port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind((LOOPBACK, 0))
        yield port


def link_to(robot: socket.socket) -> tuple[UdpLink, tuple[str, int]]:
    """A link to a robot, and the address at which it listens."""
    link = UdpLink(robot.getsockname(), [f"joint {n}" for n in range(JOINTS)], ["foot"] * 6, PERIOD)
    link.hello()
    data, address = robot.recvfrom(64)
    assert data == HELLO
    return link, address


def packed_state(number: int) -> bytes:
    """A whole state."""
    return STATES.pack(number, 0.002 * number, state_vectors(state(number, 0.002 * number)))


def test_a_second_robot_is_counted_and_its_states_are_not_believed(robot: socket.socket) -> None:
    """Whole states from another address name a second robot; noise from there names nobody; neither is a state."""
    link, address = link_to(robot)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((LOOPBACK, 0))
        for n in range(500):
            other.sendto(b"noise" if n % 2 else packed_state(7)[:-1], address)
        robot.sendto(packed_state(1), address)
        select.select([link.fileno()], [], [], 10.0)
        assert [each.number for each in link.receive()] == [1]
        while len(link.peers().robots) == 1 and select.select([link._strangers], [], [], 0)[0]:
            pass
        assert link.peers().robots == (f"{LOOPBACK}:{robot.getsockname()[1]}",) and link.malformed == 0
        other.sendto(packed_state(7), address)
        select.select([link._strangers], [], [], 10.0)
        assert link.peers().robots[1] == f"{LOOPBACK}:{other.getsockname()[1]}"
        assert link.receive() == []
    link.close()


@pytest.mark.skipif(sys.platform != "linux", reason="the time of arrival is asked of Linux alone")
def test_a_state_that_waited_says_for_how_long(robot: socket.socket) -> None:
    """States that waited in the queue are as old as their wait, each by itself."""
    link, address = link_to(robot)
    robot.sendto(packed_state(1), address)
    begin = time.time()
    while time.time() < begin + 0.05:
        time.sleep(0.01)
    robot.sendto(packed_state(2), address)
    first, second = link.receive()
    assert first.age >= 0.05 and 0.0 <= second.age <= first.age - 0.05
    link.close()


def test_a_state_that_comes_again_or_late_is_no_state(robot: socket.socket) -> None:
    """A duplicate, and a state behind a newer one, are counted and kept from whoever acts; a clock may be set."""
    link, address = link_to(robot)
    earlier = STATES.pack(6, -50.0, state_vectors(state(6, -50.0)))
    for data in (packed_state(1), packed_state(1), packed_state(4), packed_state(3), earlier):
        robot.sendto(data, address)
    until, states = time.monotonic() + 10.0, []
    while len(states) < 3 and time.monotonic() < until:
        states += link.receive()
    assert [each.number for each in states] == [1, 4, 6]
    # By numbers, however long they took.
    assert [each.time for each in states] == pytest.approx([0.002, 0.008, 0.008 + 2 * PERIOD])
    assert link.arrivals.counts.reported() == {
        **{"dropped": 2, "late": 0, "twice": 1, "reordered": 1, "clock_steps": 1}
    }
    link.close()


@pytest.mark.skipif(sys.platform != "linux", reason="how much a queue holds is the system's")
def test_a_burst_of_states_is_not_lost_before_it_is_read(robot: socket.socket) -> None:
    """A robot on a busy computer sends a third of a second at once; the queue of a socket as it is holds 92 states."""
    link, address = link_to(robot)
    for number in range(150):
        robot.sendto(packed_state(number + 1), address)
    assert len(link.receive()) == 150 and link.arrivals.counts.dropped == 0
    link.close()


@pytest.mark.skipif(sys.platform != "linux", reason="the time of arrival is asked of Linux alone")
def test_a_clock_that_is_set_here_makes_no_state_old(robot: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system says arrivals by a clock that may be set; no wait is longer than since the port was last empty."""
    link, address = link_to(robot)
    assert link.receive() == []
    robot.sendto(packed_state(1), address)
    set_by, clock = 3_600_000_000_000, time.time_ns
    monkeypatch.setattr("stiction.deploy.transports.udp.time.time_ns", lambda: clock() + set_by)
    begin, states = link._emptied, link.receive()
    assert len(states) == 1 and 0.0 < states[0].age <= time.monotonic() - begin
    link.close()


def test_an_address_to_which_there_is_no_way_is_one_sentence() -> None:
    """The address of no robot is refused before a port stays open."""
    with pytest.raises(RobotError, match=r"no way to a robot at 255\.255\.255\.255:9"):
        UdpLink(("255.255.255.255", 9), ["joint"], [], PERIOD)


def test_the_death_of_a_process_is_seen_once_and_for_good() -> None:
    """A process that lives is not called dead; one that was killed is, before and after it was waited for."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    death = Death(process)  # type: ignore[arg-type]
    assert not death.seen()
    process.kill()
    until = time.monotonic() + 60
    while not death.seen() and time.monotonic() < until:
        time.sleep(0.001)
    assert death.seen()
    process.communicate()
    assert death.seen()
    death.close()
