"""The body of a walking robot in a bag of ROS 2: its IMU and feet, brought onto the stamps of the joints' states.

`sensor_msgs/msg/Imu`, of fixed size but for the frame's name, or Unitree's `LowState`, which has both in one message.
"""

from __future__ import annotations

import struct
from array import array
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.core.memory import claim
from stiction.core.rotation import continuous
from stiction.files.log import BodySignals
from stiction.identification.logs.bags import Bag, Packet, Topic
from stiction.identification.logs.unitree import STATE_KINDS, decode_body

IMU = "sensor_msgs/msg/Imu"

KINDS = (IMU, *STATE_KINDS)
"""Types that say how the body moves."""

WIDTHS = {"quaternion": 4, "gyroscope": 3, "accelerometer": 3, "foot_force": 4}


def choose_imu(source: str, found: list[Topic], asked: str | None, state: Topic) -> Topic | None:
    """Return the topic of the body, None where there is none; raise `LogError` where it is not clear which."""
    fitting = [topic for topic in found if topic.schema in KINDS]
    listing = ", ".join(f"{topic.name} ({topic.schema})" for topic in found[:20])
    if asked is not None:
        chosen = next((topic for topic in fitting if topic.name == asked), None)
        if chosen is None:
            raise LogError(f"{source}: imu={asked}: expected a topic of {' or '.join(KINDS)}; there are {listing}")
        return chosen
    if state in fitting:
        return state
    if len(fitting) > 1:
        raise LogError(f"{source}: which topic is the IMU? Say imu=TOPIC; there are {listing}")
    return fitting[0] if fitting else None


def read_body(
    source: str, bag: Bag, topic: Topic, stamps: np.ndarray, by_receipt: bool
) -> tuple[BodySignals, np.ndarray, tuple[str, ...]]:
    """Return the body's signals at the stamps of the states [ns], shape (T,), which of those they cover, and notes.

    by_receipt: whether those stamps are of receipt. Raises `LogError` for messages that are damaged.
    """
    numbers: dict[str, array] = {name: array("d") for name in WIDTHS}
    headers, received = array("q"), array("q")
    for packet in bag.packets(topic):
        try:
            stamp, values = _content(bag, packet)
        except (struct.error, ValueError, IndexError) as error:
            raise LogError(f"{source}: a message on {topic.name} is damaged ({str(error)[:80]})") from error
        headers.append(stamp)
        received.append(packet.received)
        for name, samples in values.items():
            numbers[name].extend(samples)
        claim(source, 120 * len(received), f"{len(received)} messages or more take", LogError)
    count = len(received)
    if not count:
        raise LogError(f"{source}: {topic.name}: no messages")
    stamped = bool(np.all(headers))
    times = np.array(headers if stamped else received, dtype=np.int64)
    order = np.argsort(times, kind="stable")
    times = times[order]
    arrays: dict[str, Any] = {
        name: np.array(values).reshape(count, WIDTHS[name])[order]
        for name, values in numbers.items()
        if len(values) == count * WIDTHS[name]
    }
    if not arrays["quaternion"].any():
        del arrays["quaternion"]  # how the types say that the orientation is not known
    else:
        # q and -q are one attitude; interpolated between the two, it would pass through zero.
        arrays["quaternion"] = continuous(arrays["quaternion"])
    notes = []
    # One of them by headers, the other by receipt.
    if stamped == by_receipt:
        notes.append(f"{topic.name} and the joints are stamped by different clocks: a delay between them is not seen")
    covered = (stamps >= times[0]) & (stamps <= times[-1])
    if not covered.any():
        raise LogError(f"{source}: {topic.name} and the joints do not overlap in time; are the clocks set?")
    since, wanted = (times - times[0]) * 1e-9, (stamps - times[0]) * 1e-9
    body = BodySignals(**arrays, period=float(np.median(np.diff(since))) if count > 1 else None)
    moved = body.each(lambda values: np.stack([np.interp(wanted, since, one) for one in values.T], axis=1))
    return moved, covered, tuple(notes)


def _content(bag: Bag, packet: Packet) -> tuple[int, dict[str, list[float]]]:
    """Return stamp [ns], 0 where there is none, and field -> numbers."""
    if packet.topic.schema != IMU:
        return 0, decode_body(packet.topic.schema, packet.data)
    message = bag.decode(packet)
    attitude, rate, force = message.orientation, message.angular_velocity, message.linear_acceleration
    values = {
        "quaternion": [attitude.w, attitude.x, attitude.y, attitude.z],
        "gyroscope": [rate.x, rate.y, rate.z],
        "accelerometer": [force.x, force.y, force.z],
    }
    if message.orientation_covariance[0] == -1:  # the type's word for no orientation
        values["quaternion"] = [0.0] * 4
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, values
