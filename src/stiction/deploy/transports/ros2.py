"""A robot whose driver speaks ROS 2: `joint_states` and `imu/data` come, `joint_command` goes, see `ros_messages`.

Needs a ROS 2 installation whose Python is the one that runs this (`rclpy` is on no package index). Gains and targets go
in one message: a driver that takes targets alone cannot be damped, and is no robot for this.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

from stiction.core.errors import ConfigurationError, RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.transports.bell import Bell
from stiction.deploy.transports.link import Ages, Peers, RobotState
from stiction.deploy.transports.ros_messages import command_message, robot_state, stamp_of
from stiction.files.contract import Contract

STATE_TOPIC, IMU_TOPIC, COMMAND_TOPIC = "joint_states", "imu/data", "joint_command"

PERIOD = 0.002
"""Time between two states that is expected of a driver [s]; another rate only stretches means over time."""

MOST_WAITING = 64
"""Messages that may wait; more are lost, the oldest first."""

PEERS_SECONDS = 0.1
"""Time after which ROS is asked again who is there [s]."""

APART = 0.02
"""Longest that an IMU's message may be older than the joints' [s]: one control period at 50 Hz."""


class Node(Protocol):
    """What is needed of a ROS node, or of what stands in for one: messages as plain data."""

    def fileno(self) -> int:
        """Return the file that is readable when a message has come."""

    def receive(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Return topics and messages that have come, oldest first; never waits."""

    def nodes(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Return the nodes that publish joint states, that read commands, and that publish commands beside ours."""

    def publish(self, message: Mapping[str, Any]) -> None:
        """Send a command."""

    def close(self) -> None:
        """End the node."""


class Ros2Link:
    """`Link` over ROS 2: a state is each message of the joints with the newest one of the IMU."""

    def __init__(self, node: Node, contract: Contract, lock_name: str = "ros2") -> None:
        """Drive the joints of a contract, by their names."""
        self._node, self.joint_names = node, contract.joint_names
        self.foot_names = () if contract.anatomy is None else contract.anatomy.foot_names
        self.period, self.lock_name = PERIOD, lock_name
        self._imu: Mapping[str, Any] | None = None
        self._first: float | None = None
        self._states = self._number = 0
        self._ages, self._peers, self._asked = Ages(), Peers(), -PEERS_SECONDS
        self.malformed, self.complaint = 0, ""

    def fileno(self) -> int:
        """Return the node's file."""
        return self._node.fileno()

    def receive(self) -> list[RobotState]:
        """Return the states that have come, oldest first."""
        found = []
        for topic, message in self._node.receive():
            if topic == IMU_TOPIC:
                self._imu = message
                continue
            try:
                found.append(self._state(message))
            except (ValueError, KeyError, TypeError, IndexError) as error:
                self.malformed, self.complaint = self.malformed + 1, " ".join(str(error).split())
        return found

    def _state(self, message: Mapping[str, Any]) -> RobotState:
        """Return the state of a message of the joints; raise `ValueError` where there is none."""
        if self._imu is None:
            raise ValueError(f"no message on {IMU_TOPIC} yet")
        at = stamp_of(message)
        if not abs(lag := at - stamp_of(self._imu)) <= APART:
            raise ValueError(f"the IMU's message is {lag:.3f} s older than the joints'; at most {APART} s")
        first = at if self._first is None else self._first
        state = robot_state(message, self._imu, self.joint_names, len(self.foot_names), self._states + 1, first)
        self._first, self._states = first, self._states + 1
        return replace(state, age=self._ages.age(state.time, time.monotonic()))

    def peers(self) -> Peers:
        """Return the nodes at the topics. A message does not say whose it is: they are counted, not told apart."""
        if (now := time.monotonic()) - self._asked >= PEERS_SECONDS:
            self._asked, self._peers = now, Peers(*self._node.nodes())
        return self._peers

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number."""
        self._number += 1
        self._node.publish(command_message(command, self.joint_names))
        return self._number

    def close(self) -> None:
        """End the node."""
        self._node.close()


def ros2_link(namespace: str, contract: Contract) -> Ros2Link:
    """Return the link to the driver in a namespace; raise `RobotError` where there is no ROS 2."""
    if not namespace.startswith("/") or not all(part.isidentifier() for part in namespace.split("/") if part):
        raise ConfigurationError(f"namespace {namespace!r}: expected such as /dog, or / for none")
    return Ros2Link(RclpyNode(namespace), contract, f"ros2{namespace.replace('/', '-')}")


class RclpyNode:
    """`Node` by rclpy, which spins in a thread of its own."""

    def __init__(self, namespace: str) -> None:
        """Subscribe and advertise; nothing is sent. Raises `RobotError` where ROS 2 is not there."""
        try:
            import rclpy
            from rclpy.executors import SingleThreadedExecutor
            from rclpy.qos import qos_profile_sensor_data
            from sensor_msgs.msg import Imu, JointState
            from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
        except ImportError as error:
            raise RobotError(
                f"ROS 2 is not here ({error}): install it, source its setup.bash, and use the Python that it is for"
            ) from error
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("stiction", namespace=namespace, context=self._context)
        self._bell = Bell()
        self._waiting: deque[tuple[str, Mapping[str, Any]]] = deque(maxlen=MOST_WAITING)
        for topic, kind in ((STATE_TOPIC, JointState), (IMU_TOPIC, Imu)):
            self._node.create_subscription(kind, topic, self._hear(topic), qos_profile_sensor_data)
        self._kinds = Float64MultiArray, MultiArrayLayout, MultiArrayDimension
        self._publisher = self._node.create_publisher(Float64MultiArray, COMMAND_TOPIC, 1)
        self._topics = tuple(f"{namespace.rstrip('/')}/{topic}" for topic in (STATE_TOPIC, COMMAND_TOPIC))
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True, name="ros2")
        self._thread.start()

    def _hear(self, topic: str) -> Callable[[Any], None]:
        """Return what is called with every message of a topic."""

        def hear(message: Any) -> None:
            self._waiting.append((topic, plain(message)))
            # Behind it: who is woken has to find the message.
            self._bell.ring()

        return hear

    def fileno(self) -> int:
        """Return the file that the spinning thread makes readable."""
        return self._bell.fileno()

    def receive(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Return what has come."""
        # First: what comes from here on rings again.
        self._bell.silence()
        # As many as there are now: the other thread goes on adding to them.
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def nodes(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Return the nodes at the topics."""
        states, commands = self._topics
        ask_writers, ask_readers = self._node.get_publishers_info_by_topic, self._node.get_subscriptions_info_by_topic
        robots, readers, writers = (
            [f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in ask(topic)]
            for ask, topic in ((ask_writers, states), (ask_readers, commands), (ask_writers, commands))
        )
        if (ours := self._node.get_fully_qualified_name()) in writers:
            writers.remove(ours)
        return tuple(robots), tuple(readers), tuple(writers)

    def publish(self, message: Mapping[str, Any]) -> None:
        """Send a command."""
        array, layout, dimension = self._kinds
        dim = [dimension(**given) for given in message["layout"]["dim"]]
        self._publisher.publish(array(layout=layout(dim=dim, data_offset=0), data=message["data"]))

    def close(self) -> None:
        """End the node and the thread."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        self._context.shutdown()
        self._bell.close()


def plain(message: Any) -> Any:
    """Return a ROS message as dictionaries, lists and numbers."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if isinstance(message, str) or not hasattr(message, "__len__"):
        return message
    return [plain(value) for value in message]
