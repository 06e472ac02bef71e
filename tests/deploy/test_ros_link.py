"""ROS 2 without ROS: its messages as plain data, a node that exists in memory, and rclpy played by a stand-in."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bundles import make_contract
from stiction.core.errors import ConfigurationError, RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.transports.link import Peers
from stiction.deploy.transports.ros2 import IMU_TOPIC, STATE_TOPIC, Ros2Link, read_command, ros2_link

CONTRACT = make_contract()
JOINTS = CONTRACT.joint_names
COUNT = len(JOINTS)


def header(at: float) -> dict[str, Any]:
    """A header with a stamp [s]."""
    return {"stamp": {"sec": int(at), "nanosec": round(1e9 * (at - int(at)))}, "frame_id": "base"}


def joints(at: float, **changed: Any) -> dict[str, Any]:
    """Joints in the reverse of our order, each position a tenth of its number there."""
    names = list(reversed(JOINTS))
    message = {"header": header(at), "name": names, "position": [n / 10 for n in range(COUNT)]}
    return message | {"velocity": [float(n) for n in range(COUNT)], "effort": []} | changed


def imu(at: float, **changed: Any) -> dict[str, Any]:
    """An IMU that leans about y: 0.8, 0, 0.6, 0 in our order."""
    message: dict[str, Any] = {"header": header(at), "orientation": {"x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8}}
    for name, values in (("angular_velocity", (0.1, 0.2, 0.3)), ("linear_acceleration", (0.0, 0.0, 9.81))):
        message[name] = dict(zip("xyz", values, strict=True))
    zeros = [0.0] * 9
    covariances = ("orientation_covariance", "angular_velocity_covariance", "linear_acceleration_covariance")
    return message | dict.fromkeys(covariances, zeros) | changed


@dataclass
class Memory:
    """A node in memory."""

    waiting: list[tuple[str, Mapping[str, Any]]] = field(default_factory=list)
    sent: list[Mapping[str, Any]] = field(default_factory=list)
    there: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]] = ((), (), ())

    def fileno(self) -> int:
        """Return no descriptor."""
        return -1

    def receive(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Return the stored messages."""
        waiting, self.waiting = self.waiting, []
        return waiting

    def nodes(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Whoever was put there."""
        return self.there

    def publish(self, message: Mapping[str, Any]) -> None:
        """Keep it."""
        self.sent.append(message)

    def close(self) -> None:
        """Do nothing: nothing is open."""


def test_joints_come_by_name_and_quaternions_with_w_first() -> None:
    """ROS drivers have any order of joints, and w last: the robot walks with its neighbour's legs, or seems to lie."""
    node = Memory([(IMU_TOPIC, imu(100.0)), (STATE_TOPIC, joints(100.0)), (STATE_TOPIC, joints(100.002))])
    link = Ros2Link(node, CONTRACT)
    first, state = link.receive()
    assert (first.time, state.number) == (0.0, 2) and state.time == pytest.approx(0.002, abs=1e-6)
    np.testing.assert_allclose(state.sensors.joint_position, np.arange(COUNT)[::-1] / 10)
    np.testing.assert_allclose(state.sensors.joint_velocity, np.arange(COUNT)[::-1])
    np.testing.assert_allclose(state.sensors.quaternion, (0.8, 0.0, 0.6, 0.0))
    np.testing.assert_allclose(state.sensors.angular_velocity, (0.1, 0.2, 0.3))
    assert np.isnan(state.joint_torque).all() and np.isnan(state.temperature).all() and link.malformed == 0


@pytest.mark.parametrize(
    ("messages", "why"),
    [
        ([(STATE_TOPIC, joints(1.0))], "imu/data"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(1.5))], "older"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(0.0))], "stamp"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(1.0, name=["x"] * COUNT))], "is not in it"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(1.0, name=[*JOINTS, JOINTS[0]]))], "twice"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(1.0, velocity=[]))], "0 numbers of velocity"),
        ([(IMU_TOPIC, imu(1.0)), (STATE_TOPIC, joints(1.0, name=["x"] * 5000))], "at most"),
        ([(IMU_TOPIC, imu(1.0, orientation_covariance=[-1.0] + [0.0] * 8)), (STATE_TOPIC, joints(1.0))], "orientation"),
        ([(IMU_TOPIC, {}), (STATE_TOPIC, joints(1.0))], "header"),
    ],
)
def test_messages_that_are_no_state_are_counted_and_named(messages: list, why: str) -> None:
    """A driver without an IMU, or with clocks that differ, is acted upon."""
    link = Ros2Link(Memory(messages), CONTRACT)
    assert link.receive() == [] and link.malformed == 1 and why in link.complaint


def test_messages_that_come_again_or_late_are_counted_and_not_acted_on() -> None:
    """By stamp and content, since ROS 2 does not number messages; efforts that are not said are the same again."""
    node = Memory([(IMU_TOPIC, imu(100.0))])
    node.waiting += [(STATE_TOPIC, joints(at)) for at in (100.0, 100.004, 100.004, 100.002, 100.006)]
    link = Ros2Link(node, CONTRACT)
    states = link.receive()
    assert [state.time for state in states] == pytest.approx([0.0, 0.004, 0.006], abs=1e-6)
    counts = link.arrivals.counts
    assert (counts.twice, counts.reordered, counts.clock_steps) == (1, 1, 0) and np.isnan(counts.dropped)
    # Other numbers at the same time: a clock that stands still, which the rules stop.
    node.waiting = [(STATE_TOPIC, joints(100.006, velocity=[0.5] * COUNT))]
    assert [state.time for state in link.receive()] == [states[-1].time]


def test_a_command_comes_back_as_it_went_whatever_the_order() -> None:
    """The driver gives one joint the gains of another."""
    command = JointCommand(*np.arange(4.0 * COUNT).reshape(4, COUNT))
    node = Memory()
    assert Ros2Link(node, CONTRACT).send(command) == 1
    again = read_command(node.sent[0], tuple(reversed(JOINTS)))
    for name in ("target", "kp", "kd", "forward"):
        np.testing.assert_array_equal(getattr(again, name)[::-1], getattr(command, name))
    for wrong in ({"data": [0.0] * 3}, {"data": [np.nan] * 4 * COUNT}):
        with pytest.raises(ValueError, match="expected"):
            read_command({**node.sent[0], **wrong}, JOINTS)
    with pytest.raises(ValueError, match="rows"):
        read_command(node.sent[0], ("other",))


class Message:
    """A stand-in for ROS's generated messages: fields by name, and no others."""

    fields: tuple[str, ...] = ()

    def __init__(self, **fields: Any) -> None:
        """Take the fields that are given."""
        for name, value in fields.items():
            if name not in self.fields:
                raise AssertionError(f"no field {name}")
            setattr(self, name, value)

    def get_fields_and_field_types(self) -> dict[str, str]:
        """The fields that were given."""
        return {name: "" for name in self.fields if hasattr(self, name)}


def message_of(values: Any) -> Any:
    """A stand-in's message of plain data."""
    if isinstance(values, Mapping):
        kind = type("Any", (Message,), {"fields": tuple(values)})
        return kind(**{name: message_of(value) for name, value in values.items()})
    return values


class FakeRos:
    """Substitute for the used part of rclpy."""

    def __init__(self) -> None:
        """Begin without subscribers."""
        self.heard: dict[str, Callable[[Any], None]] = {}
        self.published: list[Any] = []
        self.asked: list[str] = []
        self.there = {"publishers": ["driver"], "subscriptions": ["driver"]}

    def create_node(self, name: str, namespace: str, context: Any) -> FakeRos:
        """The node."""
        self.asked.append(namespace)
        return self

    def create_subscription(self, kind: type, topic: str, hear: Callable[[Any], None], qos: Any) -> None:
        """Remember who listens."""
        self.heard[topic] = hear

    def get_fully_qualified_name(self) -> str:
        """The name of the one node."""
        return "/dog/stiction"

    def _infos(self, kind: str, names: list[str]) -> list[Any]:
        """Endpoints of nodes."""
        info = type("Info", (Message,), {"fields": ("node_name", "node_namespace")})
        return [info(node_name=name, node_namespace="/dog") for name in names]

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        """Return the publishers of a topic."""
        ours = ["stiction"] if topic == "/dog/joint_command" else ["driver"]
        return self._infos(topic, ours + self.there["publishers"][1:])

    def get_subscriptions_info_by_topic(self, topic: str) -> list[Any]:
        """Return the subscribers of a topic."""
        assert topic == "/dog/joint_command"
        return self._infos(topic, self.there["subscriptions"])

    def create_publisher(self, kind: type, topic: str, depth: int) -> FakeRos:
        """The publisher."""
        return self

    def publish(self, message: Any) -> None:
        """Keep it."""
        self.published.append(message)

    def destroy_node(self) -> None:
        """Do nothing: nothing is allocated."""


def spin_without_a_turn(context: Any) -> SimpleNamespace:
    """Return an executor that takes nodes and spins at once."""
    return SimpleNamespace(add_node=lambda node: None, spin=lambda: None, shutdown=lambda: None)


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> FakeRos:
    """rclpy, played."""
    fake = FakeRos()
    context = type("Context", (), {"shutdown": lambda self: None})
    kinds = {"Imu": Message, "JointState": Message}
    layout = type("MultiArrayLayout", (Message,), {"fields": ("dim", "data_offset")})
    dimension = type("MultiArrayDimension", (Message,), {"fields": ("label", "size", "stride")})
    array = type("Float64MultiArray", (Message,), {"fields": ("layout", "data")})
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"Context": context, "init": lambda context: None, "create_node": fake.create_node},
        "rclpy.executors": {"SingleThreadedExecutor": spin_without_a_turn},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "sensor_msgs": {},
        "sensor_msgs.msg": kinds,
        "std_msgs": {},
        "std_msgs.msg": {each.__name__: each for each in (layout, dimension, array)},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return fake


def test_messages_of_rclpy_arrive_and_commands_leave(ros: FakeRos) -> None:
    """Messages are converted to states, and commands have the fields of the ROS message."""
    link = ros2_link("/dog", CONTRACT)
    assert ros.asked == ["/dog"] and link.lock_name == "ros2-dog"
    ros.heard[IMU_TOPIC](message_of(imu(5.0)))
    ros.heard[STATE_TOPIC](message_of(joints(5.0)))
    assert len(link.receive()) == 1 and link.receive() == []
    link.send(JointCommand(*np.ones((4, COUNT))))
    sent = ros.published[0]
    assert sent.layout.dim[0].label == "target kp kd forward" and sent.data == [1.0] * 4 * COUNT
    assert link.peers() == Peers(("/dog/driver",), ("/dog/driver",), ())
    link.close()


def test_without_ros_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing installation and an invalid namespace each give one clear line."""
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(RobotError, match=r"ROS 2 is not here.*setup\.bash"):
        ros2_link("/dog", CONTRACT)
    for wrong in ("dog", "/do g", "/dog/.."):
        with pytest.raises(ConfigurationError, match="namespace"):
            ros2_link(wrong, CONTRACT)
