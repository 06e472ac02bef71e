"""Link to a robot whose driver speaks ROS 2: `joint_states` and `imu/data` come, `joint_command` goes.

Needs a ROS 2 installation whose Python is the one that runs this (`rclpy` is on no package index). Gains and targets go
in one message: a driver that takes targets alone cannot be damped, and is not supported.

The driver publishes `sensor_msgs/msg/JointState` and `sensor_msgs/msg/Imu`, both with the stamp of their measurement.
A command is a `std_msgs/msg/Float64MultiArray` of four rows: target [rad], kp [N m/rad], kd [N m s/rad],
added torque [N m], each in the order of the joints that its layout names. Messages are dictionaries here, which
writers and readers of MCAP files take and give, so that a bag of them is a log.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from stiction.core.errors import ConfigurationError, RobotError
from stiction.deploy.control import JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.transports.arrivals import Arrivals
from stiction.deploy.transports.link import Ages, Bell, Peers, RobotState, Spare
from stiction.files.contract import Contract

STATE_TOPIC, IMU_TOPIC, COMMAND_TOPIC = "joint_states", "imu/data", "joint_command"

PERIOD = 0.002
"""Expected time between two states of a driver [s]; another rate only stretches means over time."""

MOST_WAITING = 64

PEERS_SECONDS = 0.1
"""Time between queries of ROS for peers [s]."""

APART = 0.02
"""Largest age of the IMU's message against the joints' [s]: one control period at 50 Hz."""


class Ros2Link:
    """`Link` over ROS 2: a state is each message of the joints with the newest one of the IMU."""

    def __init__(self, node: RclpyNode, contract: Contract, lock_name: str = "ros2") -> None:
        self._node, self.joint_names = node, contract.joint_names
        self.foot_names = () if contract.anatomy is None else contract.anatomy.foot_names
        self.period, self.lock_name = PERIOD, lock_name
        # A message does not say whose it is: a watchdog's could not be told from those of a second writer.
        self.spare: Spare | None = None
        self.writer = ""
        self._imu: Mapping[str, Any] | None = None
        self._first: float | None = None
        self._states = self.number = 0
        self._ages, self._peers, self._asked = Ages(), Peers(), -PEERS_SECONDS
        # Its messages have no numbers, and stamps of the system's clock alone.
        self.arrivals = Arrivals(math.nan)
        self.malformed, self.complaint = 0, ""

    def fileno(self) -> int:
        """Return the node's file."""
        return self._node.fileno()

    def receive(self) -> list[RobotState]:
        """Return the new states that have come, oldest first."""
        states: list[RobotState] = []
        now = time.monotonic()
        for topic, message in self._node.receive():
            if topic == IMU_TOPIC:
                self._imu = message
                continue
            try:
                state = self._state(message)
            except (ValueError, KeyError, TypeError, IndexError) as error:
                self.malformed, self.complaint = self.malformed + 1, " ".join(str(error).split())
                continue
            parts = (state.sensors.joint_position, state.sensors.joint_velocity, state.joint_torque)
            # As bytes: efforts that are not said are NaN, which equals nothing.
            at = self.arrivals.take(state.time, now, content=b"".join(part.tobytes() for part in parts))
            if at is not None:
                self._states += 1
                states.append(replace(state, number=self._states, time=at, age=self._ages.age(at, now)))
        return states

    def _state(self, message: Mapping[str, Any]) -> RobotState:
        """Return the state of a message of the joints; raise `ValueError` without one."""
        if self._imu is None:
            raise ValueError(f"no message on {IMU_TOPIC} yet")
        at = stamp_of(message)
        if not abs(lag := at - stamp_of(self._imu)) <= APART:
            raise ValueError(f"the IMU's message is {lag:.3f} s older than the joints'; at most {APART} s")
        first = at if self._first is None else self._first
        state = robot_state(message, self._imu, self.joint_names, len(self.foot_names), self._states + 1, first)
        self._first = first
        return state

    def peers(self) -> Peers:
        """Return the nodes at the topics. A message does not name its sender: they are counted, not told apart."""
        if (now := time.monotonic()) - self._asked >= PEERS_SECONDS:
            self._asked, self._peers = now, Peers(*self._node.nodes())
        return self._peers

    def know(self, writer: str) -> None:
        """Do nothing: there is no second writer of ours, see `spare`."""

    def send(self, command: JointCommand) -> int:
        """Send a command; return its number."""
        self.number += 1
        self._node.publish(command_message(command, self.joint_names))
        return self.number

    def close(self) -> None:
        """End the node."""
        self._node.close()


def ros2_link(namespace: str, contract: Contract) -> Ros2Link:
    """Return the link to the driver in a namespace; raise `RobotError` without ROS 2."""
    if not namespace.startswith("/") or not all(part.isidentifier() for part in namespace.split("/") if part):
        raise ConfigurationError(f"namespace {namespace!r}: expected such as /dog, or / for none")
    return Ros2Link(RclpyNode(namespace), contract, f"ros2{namespace.replace('/', '-')}")


class RclpyNode:
    """Node of ROS by rclpy, which spins in a thread of its own: messages as plain data."""

    def __init__(self, namespace: str) -> None:
        """Subscribe and advertise; nothing is sent. Raises `RobotError` without ROS 2."""
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
            self._node.create_subscription(kind, topic, partial(self._hear, topic), qos_profile_sensor_data)
        self._kinds = Float64MultiArray, MultiArrayLayout, MultiArrayDimension
        self._publisher = self._node.create_publisher(Float64MultiArray, COMMAND_TOPIC, 1)
        self._topics = tuple(f"{namespace.rstrip('/')}/{topic}" for topic in (STATE_TOPIC, COMMAND_TOPIC))
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True, name="ros2")
        self._thread.start()

    def _hear(self, topic: str, message: Any) -> None:
        self._waiting.append((topic, plain(message)))
        # Behind it: the process that is woken has to find the message.
        self._bell.ring()

    def fileno(self) -> int:
        """Return the file that the spinning thread makes readable."""
        return self._bell.fileno()

    def receive(self) -> list[tuple[str, Mapping[str, Any]]]:
        """Return topics and messages that have come, oldest first; never waits."""
        # First: what comes from here on rings again.
        self._bell.silence()
        # As many as there are now: the other thread goes on adding to them.
        return [self._waiting.popleft() for _ in range(len(self._waiting))]

    def nodes(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Return the nodes that publish joint states, that read commands, and that publish commands besides ours."""
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
        dim = [dimension(**fields) for fields in message["layout"]["dim"]]
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


ROWS = ("target", "kp", "kd", "forward")
"""Rows of a command, fields of `JointCommand`."""

MOST_JOINTS = 1000
"""Most joints of a message."""


def stamp_of(message: Mapping[str, Any]) -> float:
    """Return the time of a message's measurement, by its header [s]; raise `ValueError` without a stamp."""
    stamp = message["header"]["stamp"]
    time = float(stamp["sec"]) + 1e-9 * float(stamp["nanosec"])
    if not time > 0:
        raise ValueError("its header has no stamp; the driver must say when it measured")
    return time


def joint_vectors(message: Mapping[str, Any], joints: Sequence[str]) -> dict[str, np.ndarray]:
    """Return position [rad], velocity [rad/s] and effort [N m] in an order of joints, each of shape (J,).

    Missing effort is NaN. Raises `ValueError`: a joint is missing or named twice, or lengths differ.
    """
    names = list(message["name"])
    if len(names) > MOST_JOINTS:
        raise ValueError(f"{len(names)} joints; at most {MOST_JOINTS}")
    place = {name: number for number, name in enumerate(names)}
    missing = [name for name in joints if name not in place]
    if missing or len(place) != len(names):
        raise ValueError(f"joint {missing[0]!r} is not in it" if missing else "a joint is in it twice")
    order, vectors = [place[name] for name in joints], {}
    for field in ("position", "velocity", "effort"):
        values = np.asarray(message[field], dtype=np.float64)
        if values.shape == (0,) and field == "effort":
            values = np.full(len(names), np.nan)
        if values.shape != (len(names),):
            raise ValueError(f"{values.size} numbers of {field} for {len(names)} joints")
        vectors[field] = values[order]
    return vectors


def imu_vectors(message: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return quaternion w x y z, angular velocity [rad/s] and acceleration [m/s²]; ROS has the quaternion's w last.

    Raises `ValueError` where the IMU says that it has no orientation (first covariance of -1).
    """
    if float(message["orientation_covariance"][0]) == -1.0:
        raise ValueError("the IMU says that it has no orientation")
    orders = {"orientation": "wxyz", "angular_velocity": "xyz", "linear_acceleration": "xyz"}
    arrays = [np.array([float(message[field][axis]) for axis in order]) for field, order in orders.items()]
    return dict(zip(("quaternion", "angular_velocity", "acceleration"), arrays, strict=True))


def robot_state(
    joint_state: Mapping[str, Any], imu: Mapping[str, Any], joints: Sequence[str], feet: int, number: int, first: float
) -> RobotState:
    """Return the state of two messages; first: stamp from which time is counted [s]. Raises `ValueError`."""
    vectors, body = joint_vectors(joint_state, joints), imu_vectors(imu)
    unknown = np.full(len(joints), np.nan)
    sensors = Sensors(body["quaternion"], body["angular_velocity"], vectors["position"], vectors["velocity"])
    return RobotState(
        number=number,
        time=stamp_of(joint_state) - first,
        sensors=sensors,
        acceleration=body["acceleration"],
        joint_torque=vectors["effort"],
        foot_contact=np.full(feet, np.nan),
        battery=np.nan,
        command=np.nan,
        temperature=unknown,
        lost=unknown,
        motor_fault=unknown,
        kp=unknown,
        kd=unknown,
        torque_limit=unknown,
    )


def command_message(command: JointCommand, joints: Sequence[str]) -> dict[str, Any]:
    """Return the message of a command."""
    count = len(joints)
    labels = ((" ".join(ROWS), len(ROWS), len(ROWS) * count), (" ".join(joints), count, count))
    dim = [{"label": label, "size": size, "stride": stride} for label, size, stride in labels]
    data = [float(value) for row in ROWS for value in getattr(command, row)]
    return {"layout": {"dim": dim, "data_offset": 0}, "data": data}


def read_command(message: Mapping[str, Any], joints: Sequence[str]) -> JointCommand:
    """Return the command that a message holds, for the driver at the other end.

    Raises `ValueError`: other rows or joints than expected, another number of values, or one that is not finite.
    """
    rows, columns = (dim["label"] for dim in message["layout"]["dim"])
    data = np.asarray(message["data"], dtype=np.float64)
    if tuple(rows.split()) != ROWS or sorted(columns.split()) != sorted(joints):
        raise ValueError(
            f"rows {rows[:60]!r} of joints {columns[:60]!r}; expected {' '.join(ROWS)!r} of {list(joints)}"
        )
    if data.shape != (len(ROWS) * len(joints),) or not np.isfinite(data).all():
        raise ValueError(f"{data.size} values; expected {len(ROWS) * len(joints)} finite ones")
    order = [columns.split().index(name) for name in joints]
    return JointCommand(**dict(zip(ROWS, data.reshape(len(ROWS), -1)[:, order], strict=True)))
