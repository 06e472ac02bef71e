"""From messages to arrays: stamps, and values with one column a joint, whatever the order of the joints in each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.formats.errors import LogError
from stiction.identify.logs.mcap_file import Message


@dataclass(frozen=True)
class Series:
    """The messages of one topic as arrays, in the order of the file."""

    stamps: np.ndarray
    """When each was made [ns], shape (num_messages,)."""
    by_receipt: bool
    """Whether the stamps are those of receipt, for want of others."""
    names: tuple[str, ...]
    """The joints."""
    values: dict[str, np.ndarray]
    """Field -> values, shape (num_messages, num_joints); fields that are empty are not there."""
    notes: tuple[str, ...] = ()
    """What a reader should know about them."""


def state_series(source: str, messages: list[Message]) -> Series:
    """Return position, velocity and effort of `JointState` messages; raise `LogError` where they do not fit together.

    source: file and topic, for messages.
    """
    if not messages:
        raise LogError(f"{source}: no messages")
    names = _names(source, messages[0].content.name)
    columns = [_columns(source, message.content.name, names) for message in messages]
    values = {}
    for field in ("position", "velocity", "effort"):
        rows = [getattr(message.content, field) for message in messages]
        if any(rows):
            values[field] = _stack(source, field, rows, columns)
    if "position" not in values:
        raise LogError(f"{source}: the messages have no positions")
    stamps, by_receipt = _stamps([message.content.header.stamp for message in messages], messages)
    note = f"{source.rpartition(' ')[2]}: the headers have no stamps; the times of receipt are used, jitter included"
    return Series(stamps, by_receipt, names, values, (note,) if by_receipt else ())


def command_series(source: str, schema: str, messages: list[Message], joints: tuple[str, ...]) -> Series:
    """Return the positions asked for.

    schema: the messages' type. joints: the states' joints, in whose order a `Float64MultiArray` must be. Raises
    `LogError`.
    """
    if not messages:
        raise LogError(f"{source}: no messages")
    if schema == "sensor_msgs/msg/JointState":
        return state_series(source, messages)
    topic = source.rpartition(" ")[2]
    if schema == "std_msgs/msg/Float64MultiArray":
        rows = [message.content.data for message in messages]
        order = [list(range(len(joints)))] * len(rows)
        note = (
            f"{topic}: the commands name no joints; they are taken in the states' order, {', '.join(joints[:3])}, ..."
        )
        receipt = np.array([message.received for message in messages], dtype=np.int64)
        return Series(receipt, True, joints, {"position": _stack(source, "data", rows, order)}, (note,))
    points = [message.content.points for message in messages]
    if any(len(point) != 1 for point in points):
        raise LogError(
            f"{source}: trajectories of several points: what the controller made of them is not in this topic; log the "
            "positions that it asked for"
        )
    names = _names(source, messages[0].content.joint_names)
    columns = [_columns(source, message.content.joint_names, names) for message in messages]
    values = _stack(source, "positions", [point[0].positions for point in points], columns)
    stamps, by_receipt = _stamps([message.content.header.stamp for message in messages], messages)
    after = [point[0].time_from_start for point in points]
    delay = np.array([wait.sec * 10**9 + wait.nanosec for wait in after], dtype=np.int64)
    return Series(stamps + delay, by_receipt, names, {"position": values})


def _names(source: str, listed: Any) -> tuple[str, ...]:
    """Return the joints of the first message."""
    names = tuple(listed)
    if not names or len(set(names)) != len(names) or not all(names):
        raise LogError(
            f"{source}: the first message names the joints {list(names)[:6]}; expected one different name each"
        )
    return names


def _columns(source: str, listed: Any, names: tuple[str, ...]) -> list[int]:
    """Return where each of `names` stands in a message."""
    if tuple(listed) == names:
        return list(range(len(names)))
    places = {name: index for index, name in enumerate(listed)}
    if len(places) != len(names) or places.keys() != set(names):
        raise LogError(f"{source}: a message names other joints than the first; expected one publisher on this topic")
    return [places[name] for name in names]


def _stack(source: str, field: str, rows: list[Any], columns: list[list[int]]) -> np.ndarray:
    """Return a field as a matrix, its columns in the order of the first message's joints."""
    wrong = next((index for index, row in enumerate(rows) if len(row) != len(columns[index])), None)
    if wrong is not None:
        raise LogError(
            f"{source}: {field} of message {wrong + 1} has {len(rows[wrong])} values for {len(columns[wrong])} joints"
        )
    return np.take_along_axis(np.array(rows, dtype=float), np.array(columns), axis=1)


def _stamps(headers: list[Any], messages: list[Message]) -> tuple[np.ndarray, bool]:
    """Return the headers' stamps [ns], or the times of receipt where some header has none; and which it was."""
    stamps = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in headers], dtype=np.int64)
    if stamps.all():
        return stamps, False
    return np.array([message.received for message in messages], dtype=np.int64), True
