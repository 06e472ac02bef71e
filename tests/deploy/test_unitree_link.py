"""Unitree's states and commands against a bus that exists in memory: order, signs, zeros, held joints, refusals."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import ConfigurationError, RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.transports.config import HeldCfg
from stiction.deploy.transports.link import Ages, Peers
from stiction.deploy.transports.unitree import HELD_SPEED, Translation, UnitreeLink
from stiction.files.contract import Contract
from stiction.files.unitree import GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE, Structure
from stiction.robots.catalog import find_robot
from stiction.robots.model import Vendor

GO1, G1 = find_robot("go1"), find_robot("g1")
REVERSED = Vendor(tuple(reversed(GO1.joint_names)), (1.0,) * 11 + (-1.0,), (0.0,) * 11 + (0.5,))
"""The maker's first joint is our last one; its last is our first, turned round and 0.5 rad off."""
GO = make_contract("go1", anatomy=replace(GO1, vendor=REVERSED))
HG = make_contract("g1", anatomy=G1)
FREE, HELD = HeldCfg(), HeldCfg(kp=40.0, kd=2.0)


class Wires:
    """A bus in memory."""

    def __init__(self) -> None:
        """Begin with nothing on it."""
        self.waiting: list[tuple[int, bytes]] = []
        self.sent: list[bytes] = []
        self.others, self.there, self.missing, self.writer = False, Peers(), 0, ""

    def fileno(self) -> int:
        """Return no descriptor."""
        return -1

    def receive(self) -> list[tuple[int, bytes]]:
        """Return the stored messages."""
        waiting, self.waiting = self.waiting, []
        return waiting

    def lost(self) -> int:
        """Return the stored number of lost messages, once."""
        lost, self.missing = self.missing, 0
        return lost

    def foreign(self) -> bool:
        """Return True if another process commands."""
        return self.others

    def peers(self) -> Peers:
        """Whoever was put there."""
        return self.there

    def send(self, data: bytes) -> None:
        """Keep it."""
        self.sent.append(data)

    def close(self) -> None:
        """Do nothing: nothing is open."""


def connected(
    transport: str = "unitree-go", contract: Contract = GO, held: HeldCfg = FREE
) -> tuple[Wires, UnitreeLink]:
    """Return a bus, and the link of a robot over it."""
    bus = Wires()
    return bus, UnitreeLink(Translation(transport, contract, held), bus)


def state_message(structure: Structure, change: Callable[[np.ndarray], None] = lambda message: None) -> bytes:
    """A state of a robot that stands, with its checksum; `change`: before that is made."""
    message = structure.blank()
    message["imu_state"]["quaternion"], message["imu_state"]["accelerometer"] = (1, 0, 0, 0), (0, 0, 9.81)
    change(message)
    message["crc"] = structure.checksum(message)
    return structure.to_wire(message)


UNCHECKED = state_message(GO_STATE)[:-4] + bytes(4)
"""A state whose checksum was left at zero."""


def test_a_state_comes_in_our_order_and_sense() -> None:
    """The policy sees the left legs as the right ones, or a joint the wrong way round."""

    def change(message: np.ndarray) -> None:
        motors = message["motor_state"]
        motors["q"][:12] = np.arange(12) / 10
        motors["dq"][:12], motors["tau_est"][:12] = np.arange(12), 10 + np.arange(12)
        motors["temperature"][:12], motors["lost"][:12] = 30 + np.arange(12), 100 + np.arange(12)
        motors["reserve"][3, 0] = 4
        message["imu_state"]["quaternion"], message["power_v"] = (0.8, 0.0, 0.6, 0.0), 28.5
        message["imu_state"]["gyroscope"] = (0.1, 0.2, 0.3)

    bus, link = connected()
    bus.waiting = [(7_000_000_000, state_message(GO_STATE, change)), (7_002_000_000, state_message(GO_STATE, change))]
    first, state = link.receive()
    assert (first.time, state.time, state.number) == (0.0, pytest.approx(0.002), 2)
    # Our first joint is the maker's twelfth: 1.1 = -q + 0.5.
    assert state.sensors.joint_position[0] == pytest.approx(-0.6)
    np.testing.assert_allclose(state.sensors.joint_position[1:], np.arange(10, -1, -1) / 10, rtol=1e-6)
    assert (state.sensors.joint_velocity[0], state.joint_torque[0]) == (-11.0, -21.0)
    np.testing.assert_array_equal(state.sensors.joint_velocity[1:], np.arange(10, -1, -1))
    np.testing.assert_array_equal(state.temperature, np.arange(41, 29, -1))
    np.testing.assert_array_equal(state.lost, np.arange(111, 99, -1))
    np.testing.assert_array_equal(np.flatnonzero(state.motor_fault), [8])
    np.testing.assert_allclose(state.sensors.quaternion, (0.8, 0.0, 0.6, 0.0), rtol=1e-6)
    np.testing.assert_allclose(state.sensors.angular_velocity, (0.1, 0.2, 0.3), rtol=1e-6)
    assert state.battery == 28.5 and np.isnan(state.command)
    assert np.isnan([state.kp, state.kd, state.torque_limit]).all()


def test_ages_are_by_the_robot_s_stamps_and_forget_drifting_clocks() -> None:
    """A message that waited is as old as it is late beside the fastest; a clock that drifts makes nothing old."""
    ages, drift = Ages(), 1e-4
    for n in range(5000):
        assert ages.age(1e9 + 0.002 * n * (1 - drift), 5.0 + 0.002 * n) <= 1e-3
    # Halted for 200 ms, and read at once then: the first came at once, the last just now.
    read = 5.0 + 0.002 * 5000 + 0.2
    waited = [ages.age(1e9 + 0.002 * n * (1 - drift), read) for n in range(5000, 5101)]
    assert waited[0] == pytest.approx(0.2, abs=1e-3) and waited[-1] == pytest.approx(0.0, abs=1e-3)


def test_a_command_goes_in_the_maker_s_order_and_sense() -> None:
    """A joint is driven the wrong way, or another one is driven."""
    bus, link = connected()
    bus.waiting = [(0, state_message(GO_STATE))]
    link.receive()
    angles = np.arange(12) / 10 + 0.2
    number = link.send(JointCommand(angles, np.full(12, 35.0), np.arange(12) + 1.0, np.arange(12) + 0.5))
    message = GO_COMMAND.from_wire(bus.sent[0])
    motors = message["motor_cmd"]
    assert number == 1 and tuple(message["head"]) == (0xFE, 0xEF) and message["level_flag"] == 0xFF
    assert message["crc"] == GO_COMMAND.checksum(message)
    assert motors["q"][11] == pytest.approx(-0.2 + 0.5) and motors["tau"][11] == -0.5
    np.testing.assert_allclose(motors["q"][:11], angles[:0:-1], rtol=1e-6)
    np.testing.assert_array_equal(motors["kd"][:12], np.arange(12, 0, -1))
    np.testing.assert_array_equal(motors["kp"][:12], 35.0)
    np.testing.assert_array_equal(motors["mode"], [1] * 12 + [0] * 8)
    assert not motors["dq"].any() and not any(motors[name][12:].any() for name in ("q", "kp", "kd", "tau"))


def test_held_joints_go_slowly_and_are_damped_with_the_others() -> None:
    """An arm strikes out when the policy begins, or stays stiff when the legs are damped."""
    bus, link = connected("unitree-hg", HG, HELD)
    names = G1.vendor.order if G1.vendor else ()
    elbow, still = names.index("left_elbow_joint"), names.index("left_knee_joint")

    def change(message: np.ndarray) -> None:
        message["mode_machine"] = 6
        message["motor_state"]["q"][elbow] = 0.3
        message["motor_state"]["temperature"][still] = (40, 55)
        message["tick"] = 100 * n

    gains = np.full(12, 100.0), np.full(12, 3.0)
    stiff = JointCommand(np.zeros(12), *gains, np.zeros(12))
    damped = JointCommand(np.zeros(12), np.zeros(12), gains[1], np.zeros(12))
    asked = []
    for n, command in enumerate((damped, stiff, stiff, stiff, damped)):
        bus.waiting = [(n * 100_000_000, state_message(HG_STATE, change))]
        state = link.receive()[0]
        link.send(command)
        message = HG_COMMAND.from_wire(bus.sent[-1])
        assert (message["mode_pr"], message["mode_machine"]) == (0, 6)
        motor = message["motor_cmd"][elbow]
        asked.append((float(motor["q"]), float(motor["kp"]), float(motor["kd"])))
    assert max(state.temperature) == 55 and np.isnan(state.lost).all() and np.isnan(state.battery)
    # It is held at 1.28 rad and was found at 0.3: by 0.05 rad in each 0.1 s.
    step = HELD_SPEED * 0.1
    expected = [0.3, 0.3 + step, 0.3 + 2 * step, 0.3 + 3 * step, 0.3]
    np.testing.assert_allclose([q for q, _, _ in asked], expected, rtol=1e-6)
    assert [kp for _, kp, _ in asked] == [0.0, 40.0, 40.0, 40.0, 0.0] and {kd for _, _, kd in asked} == {2.0}
    np.testing.assert_array_equal(message["motor_cmd"]["mode"], [1] * 29 + [0] * 6)


def test_a_clock_that_is_set_and_states_that_come_again_are_not_acted_on() -> None:
    """By the robot's ticks, which go on through the end of their range, whatever the stamps of DDS say."""
    bus, link = connected()
    first, hour = 2**32 - 4, 3_600_000_000_000
    # Ticks of 2 ms; the clock is set back by an hour, then the third comes again, and the second too.
    for ticks, stamp in ((0, 0), (2, 2_000_000), (4, 4_000_000 - hour), (4, 4_000_000 - hour), (2, 2_000_000)):
        message = state_message(GO_STATE, lambda message, at=ticks: message.__setitem__("tick", (first + at) % 2**32))  # type: ignore[misc]
        bus.waiting.append((hour + stamp, message))
    bus.missing = 3
    states = link.receive()
    assert [state.number for state in states] == [1, 2, 3]
    assert [state.time for state in states] == pytest.approx([0.0, 0.002, 0.004], abs=1e-4)
    counted = {"dropped": 3, "late": 0, "twice": 1, "reordered": 1, "clock_steps": 1}
    assert link.arrivals.counts.reported() == counted


@pytest.mark.parametrize(
    ("damaged", "why"),
    [
        (state_message(GO_STATE)[:-2] + b"xx", r"checksum: got \d+, expected \d+$"),
        (state_message(GO_STATE)[:-40], "expected 1176"),
        (b"", "CDR"),
        (UNCHECKED, r"checksum: got 0, expected \d+; unitree_mujoco in Python sends none"),
    ],
)
def test_a_state_that_is_not_whole_is_none(damaged: bytes, why: str) -> None:
    """Noise on the wire is acted upon."""
    bus, link = connected()
    bus.waiting = [(0, damaged)]
    assert link.receive() == [] and link.malformed == 1 and re.search(why, link.complaint)


def test_ankles_in_numbers_of_motors_are_refused() -> None:
    """In mode AB the numbers of ankle and waist are of two motors beside each other, and look like angles."""
    bus, link = connected("unitree-hg", HG, HELD)
    bus.waiting = [(0, state_message(HG_STATE, lambda message: message.__setitem__("mode_pr", 1)))]
    assert link.receive() == [] and "mode_pr is 1" in link.complaint


def test_nothing_is_sent_to_a_robot_that_has_said_nothing() -> None:
    """A command without the robot's own mode_machine, held joints asked to be at zero."""
    bus = Wires()
    UnitreeLink(Translation("unitree-hg", HG, HELD), bus).send(JointCommand(*np.zeros((4, 12))))
    assert bus.sent == []


def test_what_cannot_be_driven_is_refused() -> None:
    """Arms without gains hang; joints in an order that nobody said are other joints."""
    with pytest.raises(ConfigurationError, match=r"left_elbow_joint.*--held\.kp"):
        Translation("unitree-hg", HG, HeldCfg(kp=40.0))
    with pytest.raises(RobotError, match="29 joints"):
        Translation("unitree-go", HG, HELD)
    with pytest.raises(RobotError, match="maker's order"):
        Translation("unitree-go", make_contract(), HeldCfg())
    with pytest.raises(ConfigurationError, match="gain"):
        HeldCfg(kp=-1.0)
