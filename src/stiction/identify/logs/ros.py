"""MCAP files of ROS 2: joint states and the commands that the joints were given, brought onto the states' stamps.

Needs `pip install "stiction[logs]"`. A state is a `sensor_msgs/msg/JointState`; a command is one too, or a
`std_msgs/msg/Float64MultiArray`, or a `trajectory_msgs/msg/JointTrajectory` of one point. The definitions of these are
ROS's own and known here: those in the file are not parsed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stiction.core.errors import LogError
from stiction.formats.log import JointSignals, Log
from stiction.identify.logs.mcap_file import Message, Series, Topic, command_series, decode, read_packets, state_series

STATE = "sensor_msgs/msg/JointState"
COMMANDS = (STATE, "std_msgs/msg/Float64MultiArray", "trajectory_msgs/msg/JointTrajectory")

COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference", "setpoint")
"""What a topic of joint states has in its name if it is the command."""


def read_ros(path: Path, topics: Mapping[str, str]) -> Log:
    """Read the joints of an MCAP file.

    topics: `state` and `command` -> topic; what is not named is chosen if there is only one candidate. The log's time
    is that of the states' headers, or of their receipt where the headers have none, in seconds from the first; the
    command is held from its stamp to the next. Raises `LogError`.
    """
    wrong = sorted(set(topics) - {"state", "command"})
    if wrong:
        raise LogError(f"{path.name}: {wrong[0]}= maps a column; an MCAP file has topics: state=TOPIC command=TOPIC")
    packets = read_packets(path)
    found = list(dict.fromkeys(packet.topic for packet in packets))
    state, command = choose_topics(path.name, found, topics)
    states = state_series(f"{path.name}: {state.name}", decode(path.name, packets, state))
    notes = list(states.notes)
    joints = {
        name: JointSignals(
            position=states.values["position"][:, index],
            velocity=states.values["velocity"][:, index] if "velocity" in states.values else None,
            torque=states.values["effort"][:, index] if "effort" in states.values else None,
        )
        for index, name in enumerate(states.names)
    }
    stamps = states.stamps
    if command is None:
        notes.append("the file has no command: what the joints were asked for is not known")
    else:
        stamps, joints, said = _with_targets(path.name, states, joints, command, decode(path.name, packets, command))
        notes += said
    return Log(path.name, (stamps - stamps.min()) * 1e-9, joints, notes=tuple(notes))


def _with_targets(
    source: str, states: Series, joints: dict[str, JointSignals], command: Topic, messages: list[Message]
) -> tuple[np.ndarray, dict[str, JointSignals], list[str]]:
    """Return stamps [ns], joints and notes with the command held onto the states' stamps.

    States before the first command are left out: nobody knows what the joint was asked for then.
    """
    commands = command_series(f"{source}: {command.name}", command.schema, messages, states.names)
    notes = list(commands.notes)
    if commands.by_receipt != states.by_receipt:
        notes.append(
            "states and commands are stamped by different clocks (header and receipt): a delay between them is not real"
        )
    order = np.argsort(commands.stamps, kind="stable")
    place = np.searchsorted(commands.stamps[order], states.stamps, side="right") - 1
    known = place >= 0
    if not known.any():
        raise LogError(f"{source}: every state is older than the first command on {command.name}; are the clocks set?")
    if not known.all():
        lost = int(np.count_nonzero(~known))
        notes.append(f"the first {lost} states came before the first command and are left out")
    held = commands.values["position"][order][place[known]]
    columns = {name: held[:, index] for index, name in enumerate(commands.names)}
    cut = {}
    for name, signals in joints.items():
        kept = {key: None if value is None else value[known] for key, value in vars(signals).items()}
        cut[name] = JointSignals(**{**kept, "target": columns.get(name)})
    return states.stamps[known], cut, notes


def choose_topics(source: str, found: list[Topic], asked: Mapping[str, str]) -> tuple[Topic, Topic | None]:
    """Return the topic of states and that of commands, None where there is none; raise `LogError` if it is not clear.

    Of several topics of joint states, those with a word for command in their name are commands.
    """
    listing = ", ".join(f"{topic.name} ({topic.schema})" for topic in found[:20]) or "none"
    by_name = {topic.name: topic for topic in found}
    for role, name in asked.items():
        allowed = (STATE,) if role == "state" else COMMANDS
        if name not in by_name or by_name[name].schema not in allowed:
            raise LogError(f"{source}: {role}={name}: expected a topic of {' or '.join(allowed)}; there are {listing}")
    named = {role: by_name[name] for role, name in asked.items()}
    states = [topic for topic in found if topic.schema == STATE and topic.name not in asked.values()]
    orders = [topic for topic in states if any(word in topic.name.lower() for word in COMMAND_WORDS)]
    others = [topic for topic in found if topic.schema in COMMANDS[1:] and topic.name not in asked.values()]
    candidates = {
        "state": [topic for topic in states if topic not in orders] or states,
        "command": [*orders, *others],
    }
    for role in ("state", "command"):
        if role not in named and len(candidates[role]) > 1:
            raise LogError(f"{source}: which topic is the {role}? Say {role}=TOPIC; there are {listing}")
        if role not in named and candidates[role]:
            named[role] = candidates[role][0]
    if "state" not in named:
        raise LogError(f"{source}: no topic of {STATE}; there are {listing}")
    command = named.get("command")
    return named["state"], None if command == named["state"] else command
