"""Which columns are the IMU and the feet: by a mapping, or by the usual names.

A mapping gives a role its columns in their order, `quaternion=qw,qx,qy,qz`, `gyroscope=3,4,5`, or what stands in front
of the axes, `accelerometer=imu/acc`. By name: `quaternion.w`, `imu_state.gyroscope_0`, `/imu/data/orientation/x` and
their like. A quaternion whose parts are numbered is taken as w x y z; whether it is, `identify.walking` asks of the
gyroscope.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from stiction.core.errors import LogError
from stiction.files.log import BODY, BodySignals, listed
from stiction.files.tables import Columns, Table

STEMS = {
    "quaternion": ("quaternion", "orientation", "quat", "base_quat", "imu_quat"),
    "gyroscope": ("gyroscope", "gyro", "angular_velocity", "base_ang_vel", "imu_gyro", "ang_vel"),
    "accelerometer": ("accelerometer", "linear_acceleration", "acc", "accel", "imu_acc", "specific_force"),
    "foot_force": ("foot_force", "foot_contact", "footForce", "contact", "contacts"),
}
"""Role -> what stands in front of the axis in the usual names, the first that fits counts."""

AXES = {"quaternion": "wxyz", "gyroscope": "xyz", "accelerometer": "xyz"}
"""Role -> the letters of its columns, in our order."""

MOST_FEET = 16
"""No robot has more."""


def find_body(source: str, table: Table, columns: Mapping[str, str]) -> tuple[BodySignals, tuple[str, ...]]:
    """Return what a table holds of the body, and the columns that are in use.

    columns: role -> columns, of roles in `BODY` alone. Raises `LogError` for a mapping that fits nothing, for two
    sensors of a kind, and for a column that is none of numbers.
    """
    names = table.columns
    chosen = {role: _asked(source, names, role, columns[role]) for role in columns}
    for role in BODY:
        if role not in chosen and (found := _usual(source, names, role)):
            chosen[role] = found
    for name in (name for matches in chosen.values() for name in matches.values()):
        if name in table.faults:
            fault = table.faults[name]
            raise LogError(fault if fault.startswith(f"{source}:") else f"{source}: {fault}")
    arrays: dict[str, Any] = {
        role: np.stack([names[name] for name in matches.values()], axis=1) for role, matches in chosen.items()
    }
    labels = tuple(chosen.get("foot_force", {}))
    feet = () if all(label.isdigit() for label in labels) else labels
    used = tuple(name for matches in chosen.values() for name in matches.values())
    return BodySignals(**arrays, foot_names=feet), used


def _asked(source: str, table: Columns, role: str, asked: str) -> dict[str, str]:
    """Return label -> column as a mapping has it."""
    words = asked.split(",")
    if len(words) == 1 and asked not in table:
        if found := _labelled(table, re.escape(asked), role):
            return found
        raise LogError(f"{source}: no columns of {role}={asked}; the columns are {listed(table)}")
    missing = [name for name in words if name not in table]
    if missing:
        raise LogError(f"{source}: no column {missing[0]!r} for {role}; the columns are {listed(table)}")
    expected = len(AXES[role]) if role in AXES else len(words)
    if len(words) != expected or len(set(words)) != len(words) or len(words) > MOST_FEET:
        order = " ".join(AXES.get(role, "")) or "one a foot"
        raise LogError(f"{source}: {role}={asked} names {len(words)} columns; expected different ones, {order}")
    return dict(zip(AXES.get(role, map(str, range(len(words)))), words, strict=True))


def _usual(source: str, table: Columns, role: str) -> dict[str, str]:
    """Return label -> column by the usual names; nothing where there are none."""
    for stem in STEMS[role]:
        fronts = {
            match[1]
            for name in table
            if (match := re.fullmatch(rf"((?:.*[/.])?{stem})[\[./_](?:\w+)\]?", name)) is not None
        }
        complete = {front: found for front in fronts if (found := _labelled(table, re.escape(front), role))}
        if len(complete) > 1:
            listing = ", ".join(sorted(complete))
            raise LogError(
                f"{source}: several columns could be the {role}, {listing}; say which: --columns {role}=NAME"
            )
        if complete:
            return next(iter(complete.values()))
    return {}


def _labelled(table: Columns, front: str, role: str) -> dict[str, str]:
    """Return label -> column of names that begin so, in order; nothing unless all axes are there."""
    letters = AXES.get(role)
    found = {match[1]: name for name in table if (match := re.fullmatch(rf"{front}[\[./_]?(\w+)\]?", name))}
    if letters is None:
        numbers = [label for label in found if label.isdigit()]
        labels = sorted(numbers, key=int) if numbers else list(found)
        return {label: found[label] for label in labels} if 1 <= len(labels) <= MOST_FEET else {}
    for labels in (list(letters), [str(index) for index in range(len(letters))]):
        if set(labels) <= set(found):
            return {label: found[label] for label in labels}
    return {}
