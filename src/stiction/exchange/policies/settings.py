"""Our own few lines about a policy of others: whatever its file does not say.

control_period: 0.02
default_position: {.*_hip_pitch_joint: -0.3, .*_knee_joint: 0.7, .*: 0}     # or a list, or one number
action_scale: 0.25
action_clip: 100                      # or none
last_action: clipped
history: {length: 1}                  # layout, direction and fill where it is longer
clock: {period: 1.0, offsets: [0, 3.14159], first: 1, standing: 3.14159}
observation:                          # in the order of the network's input
- {term: last_action}
- {term: angular_velocity, scale: 0.25}
- {term: phase_cos}
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from stiction.core.errors import FileError, unknown_name
from stiction.exchange.policies import values as take
from stiction.exchange.policies.description import Said, SaidTerm
from stiction.files.observation import GaitClock, HeightScan

FIELDS = (
    *("joints", "control_period", "physics_timestep", "kp", "kd", "default_position", "action_scale", "torque_limit"),
    *("action_clip", "last_action", "history", "clock", "heights", "observation"),
)
"""What can be said."""

OF_TERM = ("term", "scale", "clip", "clip_before_scale", "history", "offset")
OF_HISTORY = ("length", "layout", "direction", "fill")
OF_CLOCK = ("period", "offsets", "first", "standing", "standing_below")
OF_HEIGHTS = ("points", "offset")


def said_in_settings(content: Mapping[str, Any], where: str) -> Said:
    """Return what our settings say; `where`: the file, for messages. Raises `FileError`, naming the entry."""
    _known(content, FIELDS, where, "field")
    found: dict[str, Any] = {}
    for name in ("control_period", "physics_timestep"):
        if name in content:
            found[name] = take.number(content[name], f"{where}: {name}")
    for name in ("kp", "kd", "default_position", "action_scale", "torque_limit"):
        if name in content:
            found[name] = take.by_joint(content[name], f"{where}: {name}")
    if "joints" in content:
        found["joint_names"] = take.names(content["joints"], f"{where}: joints")
    if "action_clip" in content:
        bound = take.bounds(content["action_clip"], f"{where}: action_clip")
        found["action_clip"] = math.inf if bound is None else bound[1]
    if "last_action" in content:
        found["last_action"] = take.choice(content["last_action"], f"{where}: last_action", "clipped", "raw")
    if "history" in content:
        found |= _history(take.mapping(content["history"], f"{where}: history"), f"{where}: history")
    if "clock" in content:
        found["clock"] = _clock(take.mapping(content["clock"], f"{where}: clock"), f"{where}: clock")
    if "heights" in content:
        found["heights"] = _heights(take.mapping(content["heights"], f"{where}: heights"), f"{where}: heights")
    if "observation" in content:
        entries = take.sequence(content["observation"], f"{where}: observation")
        found["observation"] = tuple(_term(entry, f"{where}: observation") for entry in entries)
    return Said(**found)


def _known(content: Mapping[str, Any], known: tuple[str, ...], where: str, kind: str) -> None:
    """Refuse a field that there is not."""
    for name in content:
        if name not in known:
            raise FileError(f"{where}: {unknown_name(kind, name, known)}")


def _history(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return how frames are stacked."""
    _known(content, OF_HISTORY, where, "field")
    found: dict[str, Any] = {}
    if "length" in content:
        found["history_length"] = take.whole(content["length"], f"{where}.length")
    for name, words in (
        ("layout", ("term_major", "frame_major")),
        ("direction", ("oldest_first", "newest_first")),
        ("fill", ("first", "zero")),
    ):
        if name in content:
            found[f"history_{name}"] = take.choice(content[name], f"{where}.{name}", *words)
    return found


def _clock(content: Mapping[str, Any], where: str) -> GaitClock:
    """Return the gait clock; what it does while the robot stands has to be said, if only by null."""
    _known(content, OF_CLOCK, where, "field")
    for name in ("period", "offsets", "first", "standing"):
        if name not in content:
            raise FileError(
                f"{where}: {name!r} is missing; expected period [s], offsets [rad], first (0 or 1, its step at the "
                "first observation), and standing (angle while the robot stands [rad], or null where the clock runs on)"
            )
    standing = content["standing"]
    return GaitClock(
        take.number(content["period"], f"{where}.period"),
        take.numbers(content["offsets"], f"{where}.offsets"),
        take.whole(content["first"], f"{where}.first"),
        None if standing is None else take.number(standing, f"{where}.standing"),
        take.number(content.get("standing_below", 0.01), f"{where}.standing_below"),
    )


def _heights(content: Mapping[str, Any], where: str) -> HeightScan:
    """Return the points of a height scan."""
    _known(content, OF_HEIGHTS, where, "field")
    points = tuple(
        (forward, left)
        for forward, left in (
            take.numbers(point, f"{where}.points", 2)
            for point in take.sequence(content.get("points"), f"{where}.points")
        )
    )
    return HeightScan(points, take.number(content.get("offset", 0.0), f"{where}.offset"))


def _term(content: Any, where: str) -> SaidTerm:
    """Return one term of the observation."""
    entry = take.mapping(content, where)
    _known(entry, OF_TERM, where, "field")
    name = take.word(entry.get("term"), f"{where}: term")
    where = f"{where}: {name}"
    if not isinstance(entry.get("clip_before_scale", False), bool):
        raise FileError(f"{where}: clip_before_scale: expected true or false")
    return SaidTerm(
        name,
        scale=take.one_or_all(entry.get("scale", 1.0), f"{where}: scale"),
        clip=take.bounds(entry.get("clip"), f"{where}: clip"),
        clip_first=entry.get("clip_before_scale", False),
        history=take.whole(entry["history"], f"{where}: history") if "history" in entry else None,
        offset=take.choice(entry["offset"], f"{where}: offset", "standing", "none") if "offset" in entry else None,
    )
