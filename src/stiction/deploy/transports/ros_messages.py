"""ROS 2's standard messages as plain data, and what they say of a robot: no ROS here.

A robot's driver publishes `sensor_msgs/msg/JointState` and `sensor_msgs/msg/Imu`, both with the stamp of when they were
measured. A command is a `std_msgs/msg/Float64MultiArray` of four rows, which ROS has no message of its own for: target
[rad], kp [N m/rad], kd [N m s/rad], torque that is added [N m], each in the order of the joints that its layout names.
As dictionaries these are what writers and readers of MCAP files take and give, so that a bag of them is a log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stiction.deploy.control import JointCommand
from stiction.deploy.observation import Sensors
from stiction.deploy.transports.link import RobotState

ROWS = ("target", "kp", "kd", "forward")
"""Rows of a command, fields of `JointCommand`."""

MOST_JOINTS = 1000
"""Joints of a message that are looked at."""


def stamp_of(message: Mapping[str, Any]) -> float:
    """Return when a message was measured, by its header [s]; raise `ValueError` where it does not say."""
    stamp = message["header"]["stamp"]
    time = float(stamp["sec"]) + 1e-9 * float(stamp["nanosec"])
    if not time > 0:
        raise ValueError("its header has no stamp; the driver must say when it measured")
    return time


def joint_vectors(message: Mapping[str, Any], joints: Sequence[str]) -> dict[str, np.ndarray]:
    """Return position [rad], velocity [rad/s] and effort [N m] in an order of joints, each of shape (J,).

    Effort that is not there is NaN. Raises `ValueError`: a joint is missing or named twice, or lengths differ.
    """
    names = list(message["name"])
    if len(names) > MOST_JOINTS:
        raise ValueError(f"{len(names)} joints; at most {MOST_JOINTS}")
    place = {name: number for number, name in enumerate(names)}
    missing = [name for name in joints if name not in place]
    if missing or len(place) != len(names):
        raise ValueError(f"joint {missing[0]!r} is not in it" if missing else "a joint is in it twice")
    order, found = [place[name] for name in joints], {}
    for field in ("position", "velocity", "effort"):
        values = np.asarray(message[field], dtype=np.float64)
        if values.shape == (0,) and field == "effort":
            values = np.full(len(names), np.nan)
        if values.shape != (len(names),):
            raise ValueError(f"{values.size} numbers of {field} for {len(names)} joints")
        found[field] = values[order]
    return found


def imu_vectors(message: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return quaternion w x y z, angular velocity [rad/s] and acceleration [m/s²]; ROS has the quaternion's w last.

    Raises `ValueError` where the IMU says that it has no orientation (first covariance of -1).
    """
    if float(message["orientation_covariance"][0]) == -1.0:
        raise ValueError("the IMU says that it has no orientation")
    orders = {"orientation": "wxyz", "angular_velocity": "xyz", "linear_acceleration": "xyz"}
    found = [np.array([float(message[field][axis]) for axis in order]) for field, order in orders.items()]
    return dict(zip(("quaternion", "angular_velocity", "acceleration"), found, strict=True))


def robot_state(
    joint_state: Mapping[str, Any], imu: Mapping[str, Any], joints: Sequence[str], feet: int, number: int, first: float
) -> RobotState:
    """Return what the two messages say; `first`: stamp from which time is counted [s]. Raises `ValueError`."""
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

    Raises `ValueError`: other rows or joints than expected, another number of values, or what is no number.
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
