"""Settings file of ours on a policy of others, for whatever its own file lacks.

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

from stiction.core.decode import from_plain
from stiction.core.errors import FileError, unknown_name
from stiction.exchange.policies.description import PolicySpec, TermSpec
from stiction.exchange.policies.values import take
from stiction.files.observation import GaitClock, HeightScan

FIELDS = (
    *("joints", "control_period", "physics_timestep", "kp", "kd", "default_position", "action_scale", "torque_limit"),
    *("action_clip", "last_action", "history", "clock", "heights", "observation"),
)
"""Fields of the settings."""

OF_TERM = ("term", "scale", "clip", "clip_before_scale", "history", "offset")
OF_HISTORY = ("length", "layout", "direction", "fill")


def read_settings(content: Mapping[str, Any], where: str) -> PolicySpec:
    """Return the description in our settings; where: the file, for messages. Raises `FileError`, naming the entry."""
    _known(content, FIELDS, where)
    fields: dict[str, Any] = {}
    for name in ("control_period", "physics_timestep"):
        if name in content:
            fields[name] = take.number(content[name], f"{where}: {name}")
    for name in ("kp", "kd", "default_position", "action_scale", "torque_limit"):
        if name in content:
            fields[name] = take.by_joint(content[name], f"{where}: {name}")
    if "joints" in content:
        fields["joint_names"] = take.names(content["joints"], f"{where}: joints")
    if "action_clip" in content:
        bound = take.bounds(content["action_clip"], f"{where}: action_clip")
        fields["action_clip"] = math.inf if bound is None else bound[1]
    if "last_action" in content:
        fields["last_action"] = take.choice(content["last_action"], f"{where}: last_action", "clipped", "raw")
    if "history" in content:
        fields |= _history(take.mapping(content["history"], f"{where}: history"), f"{where}: history")
    if "clock" in content:
        # Its behaviour while the robot stands has to be stated, if only by null.
        fields["clock"] = from_plain(GaitClock, content["clock"], f"{where}: clock", required=("first", "standing"))
    if "heights" in content:
        fields["heights"] = from_plain(HeightScan, content["heights"], f"{where}: heights")
    if "observation" in content:
        entries = take.sequence(content["observation"], f"{where}: observation")
        fields["observation"] = tuple(_term(entry, f"{where}: observation") for entry in entries)
    return PolicySpec(**fields)


def _known(content: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Reject an unknown field."""
    for name in content:
        if name not in known:
            raise FileError(f"{where}: {unknown_name('field', name, known)}")


def _history(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the stacking of frames."""
    _known(content, OF_HISTORY, where)
    history: dict[str, Any] = {}
    if "length" in content:
        history["history_length"] = take.whole(content["length"], f"{where}.length")
    for name, words in (
        ("layout", ("term_major", "frame_major")),
        ("direction", ("oldest_first", "newest_first")),
        ("fill", ("first", "zero")),
    ):
        if name in content:
            history[f"history_{name}"] = take.choice(content[name], f"{where}.{name}", *words)
    return history


def _term(content: Any, where: str) -> TermSpec:
    """Return one term of the observation."""
    entry = take.mapping(content, where)
    _known(entry, OF_TERM, where)
    name = take.word(entry.get("term"), f"{where}: term")
    where = f"{where}: {name}"
    if not isinstance(entry.get("clip_before_scale", False), bool):
        raise FileError(f"{where}: clip_before_scale: expected true or false")
    return TermSpec(
        name,
        scale=take.one_or_all(entry.get("scale", 1.0), f"{where}: scale"),
        clip=take.bounds(entry.get("clip"), f"{where}: clip"),
        clip_first=entry.get("clip_before_scale", False),
        history=take.whole(entry["history"], f"{where}: history") if "history" in entry else None,
        offset=take.choice(entry["offset"], f"{where}: offset", "standing", "none") if "offset" in entry else None,
    )
