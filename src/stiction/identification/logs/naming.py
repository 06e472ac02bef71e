"""Assignment of columns to signals of joints and of the body: by a mapping, by the usual names, or refused.

A mapping gives a role a column, `position=qm`, for one joint; several, `position=1,2,3`; or a pattern,
`position=q_{joint}`, where `{joint}` stands for the joint's number or name. A role of the body has its columns in their
order, `quaternion=qw,qx,qy,qz`, or what stands in front of the axes, `accelerometer=imu/acc`. By name it is
`quaternion.w`, `imu_state.gyroscope_0`, `/imu/data/orientation/x` and their like; a quaternion whose parts are numbered
is taken as w x y z, which `identify walk` checks against the gyroscope.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.files.log import BODY, SIGNALS, UNNAMED, BodySignals, JointSignals, LogSetup, listed
from stiction.files.tables import WIDEST_MATRIX, Columns, Table
from stiction.identification.logs.titles import PLACE, bare_titles, by_units, find_time, guess_columns

ROLES = ("time", *SIGNALS)
"""Roles that a mapping may map in a table, besides the body."""

TOPICS = ("state", "command", "imu")
"""Roles that a mapping may map in a file of messages."""

COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference", "setpoint")
"""Words in the name of a topic of joint states that make it the command."""

WIDE = {
    "position": "joint_pos_# dof_pos_# observation.state_# motor_state[#].q motorState[#].q position[#] "
    "field.position#",
    "velocity": "joint_vel_# dof_vel_# motor_state[#].dq motorState[#].dq velocity[#] field.velocity#",
    "target": "joint_pos_target_# des_dof_pos_# action_# motor_cmd[#].q motorCmd[#].q",
    "torque": "tau_est_# tau_# torques_# torque_# motor_state[#].tau_est motorState[#].tauEst effort[#] field.effort#",
}
"""Role -> patterns, # the joint's number, of which the first that fits counts. `joint_pos_0`, `tau_est_0` and so on are
written by public scripts that log for actuator networks, where `torques` is what the controller asked for and `tau_est`
what the motor reports; `dof_pos` and `des_dof_pos` are the matrices of PACE; `observation.state` and `action` the lists
of LeRobot; `motor_state` and `motor_cmd` Unitree's; `field.position0` is by `rostopic echo -p`. In a name, [0] may be
.0 or /0, and what follows may begin with a slash; a topic may stand in front."""

LEROBOT = "LeRobot's states are in degrees or percent as often as not: if so give --position-scale"

OF_TOPIC = {"position": "position", "velocity": "velocity", "effort": "torque"}
"""Field of a joint state -> role, in columns `/joint_states/JOINT/position`, as PlotJuggler has them."""

STEMS = {
    "quaternion": ("quaternion", "orientation", "quat", "base_quat", "imu_quat"),
    "gyroscope": ("gyroscope", "gyro", "angular_velocity", "base_ang_vel", "imu_gyro", "ang_vel"),
    "accelerometer": ("accelerometer", "linear_acceleration", "acc", "accel", "imu_acc", "specific_force"),
    "foot_force": ("foot_force", "foot_contact", "footForce", "contact", "contacts"),
}
"""Role of the body -> text in front of the axis in the usual names; the first that fits counts."""

AXES = {"quaternion": "wxyz", "gyroscope": "xyz", "accelerometer": "xyz"}
"""Role -> letters of its columns, in our order."""

MOST_FEET = 16
"""Largest number of feet of a robot."""

Chosen = dict[str, dict[str, str]]
"""Joint -> role -> title of its column."""


@dataclass(frozen=True)
class TableSignals:
    """Signals of a table, by joint; arrays of shape (num_samples,)."""

    time: np.ndarray | None
    """Time stamps, None where the table has none."""
    joints: dict[str, JointSignals]
    """Signals by joint."""
    time_name: str = ""
    """Name of the time's column."""
    used: tuple[str, ...] = ()
    """Columns in use, the time's too."""
    notes: tuple[str, ...] = ()
    """Notes on the choice for readers of the results."""
    setups: dict[str, LogSetup] = field(default_factory=dict)
    """Joint -> scales that follow from units in the titles; joints in SI have none."""


def parse_columns(words: Sequence[str]) -> dict[str, str]:
    """Turn `position=qm` words into role -> column, pattern or topic; raise `LogError` for anything else."""
    mapping: dict[str, str] = {}
    for word in words:
        role, equals, name = word.partition("=")
        known = (*ROLES, *BODY, *TOPICS)
        if equals and role not in known:
            raise LogError(f"column mapping {word!r}: {unknown_name('role', role, known)}")
        if not equals or not name or role in mapping:
            raise LogError(
                f"column mapping {word!r}: expected ROLE=NAME, once each, ROLE one of {', '.join((*ROLES, *BODY))}, or "
                "state, command and imu for topics"
            )
        mapping[role] = name
    return mapping


def find_signals(source: str, table: Table, columns: Mapping[str, str] | None, joint: str | None) -> TableSignals:
    """Return the signals of a table, joint by joint.

    columns: role -> column or pattern, or None to go by names. joint: the name to give a joint whose columns carry
    none. Joints that have only a number are called `joint_0`, `joint_1`, ... Raises `LogError`, also where a column
    in use does not hold numbers.
    """
    titles = bare_titles(table.columns, ROLES, (columns or {}).values())
    values = {title: table.columns[column] for title, (column, _) in titles.items()}
    notes: tuple[str, ...] = ()
    time = find_time(titles)
    if columns:
        time = columns.get("time") or time
        chosen = _mapped(source, values, columns, joint)
    else:
        chosen, notes = _by_names(source, values, joint)
        if not chosen:
            raise LogError(f"{source}: no column position, velocity, target or torque; {recipe(table)}")
    used = [titles[title][0] for roles in chosen.values() for title in roles.values()]
    used += [titles[time][0]] if time else []
    _check(source, table, used)
    joints, setups = {}, {}
    for name, roles in chosen.items():
        signals = JointSignals(**{role: values[title] for role, title in roles.items()})
        joints[name], setup, unit_notes = by_units(signals, {role: titles[title][1] for role, title in roles.items()})
        if setup != LogSetup():
            setups[name] = setup
        notes += tuple(f"joint {name!r}: {note}" for note in unit_notes)
    return TableSignals(
        values[time] if time else None, joints, time or "", tuple(used), tuple(dict.fromkeys(notes)), setups
    )


def _check(source: str, table: Table, used: Iterable[str]) -> None:
    """Raise `LogError` for the first column in use that does not hold numbers."""
    for name in used:
        if fault := table.faults.get(name):
            raise LogError(fault if fault.startswith(f"{source}:") else f"{source}: {fault}")


def recipe(table: Table) -> str:
    """Return the names of the columns and a mapping for them, as near as their names allow."""
    names = [name for name in table.columns if name not in table.faults]
    numbered = all(name.isdigit() for name in names)
    guessed = guess_columns(names)
    if guessed and not numbered:
        words = " ".join(f"{role}={name}" if " " not in name else f"'{role}={name}'" for role, name in guessed.items())
        nearest = f"perhaps --columns {words}"
    elif numbered and len(names) > 1:
        nearest = "say which is which: --columns time=0 position=1 torque=2, or position=1,2,3 for several joints"
    else:
        nearest = "map them: position=NAME, or position=NAME_{joint} for several joints"
    return f"the columns are {listed(table.columns)}; name them position.<joint> and so on, or {nearest}"


def _mapped(source: str, titles: Columns, columns: Mapping[str, str], joint: str | None) -> Chosen:
    """Apply a mapping."""
    if unknown := set(columns) - set(ROLES):
        raise LogError(unknown_name("role", min(unknown), ROLES))
    signals = {role: name for role, name in columns.items() if role != "time"}
    patterns = {role: name for role, name in signals.items() if PLACE in name}
    if patterns and len(patterns) != len(signals):
        plain = next(role for role in signals if role not in patterns)
        raise LogError(f"{source}: {plain}={signals[plain]} names one column, the others patterns; expected one kind")
    lists = {role: [name] if name in titles else name.split(",") for role, name in signals.items() if not patterns}
    asked = [*([columns["time"]] if "time" in columns else []), *(name for names in lists.values() for name in names)]
    if missing := [name for name in asked if name not in titles]:
        raise LogError(f"{source}: no column {missing[0]!r}; the columns are {listed(titles)}")
    if patterns:
        return _by_patterns(source, titles, patterns)
    if not signals:
        raise LogError(f"{source}: the mapping names no signal; expected one of {', '.join(SIGNALS)}, as position=NAME")
    counts = {role: len(names) for role, names in lists.items()}
    count = max(counts.values())
    if len(set(counts.values())) > 1 or count > WIDEST_MATRIX:
        raise LogError(f"{source}: columns of {counts} joints; expected as many of each role")
    owners = [joint or UNNAMED] if count == 1 else [f"joint_{index}" for index in range(count)]
    return {owner: {role: names[index] for role, names in lists.items()} for index, owner in enumerate(owners)}


def _by_patterns(source: str, titles: Columns, patterns: Mapping[str, str]) -> Chosen:
    """Group columns by joint. A pattern stands for numbered joints if some column has a number there, else for names.

    A column that fits several patterns by a name belongs to the longest one.
    """
    chosen: Chosen = {}
    taken: set[str] = set()
    # The longest first: `q_{joint}` would fit the columns of `q_ref_{joint}`, with joints called `ref_...`.
    for role, pattern in sorted(patterns.items(), key=lambda item: -len(item[1])):
        if pattern.count(PLACE) != 1:
            raise LogError(f"{source}: {role}={pattern} has {PLACE} more than once; expected one place for the joint")
        before, after = map(re.escape, pattern.split(PLACE))
        matches = {f"joint_{int(label)}": name for label, name in _match(rf"{before}(\d{{1,4}}){after}", titles)}
        if not matches:
            matches = {label: name for label, name in _match(f"{before}(.+){after}", titles) if name not in taken}
        if not matches:
            raise LogError(f"{source}: no column fits {role}={pattern}; the columns are {listed(titles)}")
        taken |= set(matches.values())
        for owner, name in matches.items():
            chosen.setdefault(owner, {})[role] = name
    return _by_number(chosen)


def _by_number(chosen: Chosen) -> Chosen:
    """Return numbered joints by size, joint_2 before joint_10; names stay as the table has them."""
    order = sorted(chosen, key=lambda name: (len(name), name) if name.startswith("joint_") else (0, ""))
    return {name: chosen[name] for name in order}


def _match(pattern: str, titles: Iterable[str]) -> list[tuple[str, str]]:
    """Return label and column of those that fit a regular expression with the label as its group."""
    expression = re.compile(pattern)
    return [(match[1], name) for name in titles if (match := expression.fullmatch(name))]


def _by_names(source: str, columns: Columns, joint: str | None) -> tuple[Chosen, tuple[str, ...]]:
    """Group columns by joint as their usual names have it, and return notes; empty where none fits."""
    chosen: Chosen = {}
    for name in columns:
        role, _, owner = name.partition(".")
        if role in SIGNALS:
            chosen.setdefault(owner or joint or UNNAMED, {})[role] = name
    if chosen:
        return chosen, ()
    notes = []
    for role, patterns in WIDE.items():
        fitting = (
            (candidate, labels) for candidate in patterns.split() if (labels := _match(_usual(candidate), columns))
        )
        pattern, matches = next(fitting, ("", []))
        notes += [LEROBOT] if pattern.startswith("observation.state") else []
        for label, name in matches:
            chosen.setdefault(f"joint_{int(label)}", {})[role] = name
    if not any("position" in roles for roles in chosen.values()):
        return _by_topics(source, columns), ()
    # Makers' messages have room for more motors than most robots have; an idle one measures zero throughout.
    chosen = _by_number(chosen)
    idle = [
        owner
        for owner, roles in chosen.items()
        if not any(np.any(columns[name]) for role, name in roles.items() if role != "target")
    ]
    if 0 < len(idle) < len(chosen):
        numbers = ", ".join(owner.removeprefix("joint_") for owner in idle)
        notes.append(f"{len(idle)} motors say zero in every row and are left out: numbers {numbers}")
        chosen = {owner: roles for owner, roles in chosen.items() if owner not in idle}
    return chosen, tuple(notes)


def _usual(pattern: str) -> str:
    """Return the regular expression of a usual pattern, with optional text in front and in place of brackets."""
    name = re.escape(pattern).replace(r"\#", r"(\d{1,4})")
    if "[" not in pattern:
        return f"(?:.*/)?{name}"
    return "(?:.*[/.])?" + name.replace(r"\[", r"[\[./]").replace(r"\]", r"\]?").replace(r"\.", "[./]")


def _by_topics(source: str, columns: Columns) -> Chosen:
    """Group columns `/TOPIC/JOINT/position` by joint; a topic with a word for command in its name has the targets."""
    chosen: Chosen = {}
    topics: dict[str, str] = {}
    for name in columns:
        front, _, field = name.rpartition("/")
        topic, _, owner = front.rpartition("/")
        commanded = any(word in topic.lower() for word in COMMAND_WORDS)
        role = {"position": "target"}.get(field) if commanded else OF_TOPIC.get(field)
        if role is None or not owner:
            continue
        kind = "command" if commanded else "state"
        if topics.setdefault(kind, topic) != topic:
            raise LogError(
                f"{source}: positions of the topics {topics[kind]} and {topic}: say which, "
                f"--columns position={topic}/{PLACE}/position, and so on"
            )
        chosen.setdefault(owner, {})[role] = name
    return {owner: roles for owner, roles in chosen.items() if "position" in roles}


def find_body(source: str, table: Table, columns: Mapping[str, str]) -> tuple[BodySignals, tuple[str, ...]]:
    """Return the signals of the body in a table, and the columns in use.

    columns: role -> columns, of roles in `BODY` alone. Raises `LogError` for a mapping that fits nothing, for two
    sensors of a kind, and for a column that does not hold numbers.
    """
    names = table.columns
    chosen = {role: _asked(source, names, role, columns[role]) for role in columns}
    for role in BODY:
        if role not in chosen and (usual := _usual_body(source, names, role)):
            chosen[role] = usual
    used = tuple(name for labels in chosen.values() for name in labels.values())
    _check(source, table, used)
    arrays: dict[str, Any] = {
        role: np.stack([names[name] for name in labels.values()], axis=1) for role, labels in chosen.items()
    }
    feet = tuple(chosen.get("foot_force", {}))
    return BodySignals(**arrays, foot_names=() if all(map(str.isdigit, feet)) else feet, period=table.period), used


def _asked(source: str, names: Columns, role: str, asked: str) -> dict[str, str]:
    """Return label -> column as a mapping has it."""
    words = asked.split(",")
    if len(words) == 1 and asked not in names:
        if labels := _in_order(role, dict(_match(rf"{re.escape(asked)}[\[./_]?(\w+)\]?", names))):
            return labels
        raise LogError(f"{source}: no columns of {role}={asked}; the columns are {listed(names)}")
    if missing := [name for name in words if name not in names]:
        raise LogError(f"{source}: no column {missing[0]!r} for {role}; the columns are {listed(names)}")
    letters = AXES.get(role)
    if len(words) != len(letters or words) or len(set(words)) != len(words) or len(words) > MOST_FEET:
        order = " ".join(letters or "") or "one a foot"
        raise LogError(f"{source}: {role}={asked} names {len(words)} columns; expected different ones, {order}")
    return dict(zip(letters or map(str, range(len(words))), words, strict=True))


def _usual_body(source: str, names: Columns, role: str) -> dict[str, str]:
    """Return label -> column of a role of the body by the usual names; nothing where there are none."""
    for stem in STEMS[role]:
        fronts: dict[str, dict[str, str]] = {}
        for name in names:
            if match := re.fullmatch(rf"((?:.*[/.])?{stem})[\[./_](\w+)\]?", name):
                fronts.setdefault(match[1], {})[match[2]] = name
        complete = {front: ordered for front, labels in fronts.items() if (ordered := _in_order(role, labels))}
        if len(complete) > 1:
            raise LogError(
                f"{source}: several columns could be the {role}, {', '.join(sorted(complete))}; say which: --columns "
                f"{role}=NAME"
            )
        if complete:
            return next(iter(complete.values()))
    return {}


def _in_order(role: str, labels: dict[str, str]) -> dict[str, str]:
    """Return label -> column in the order of a role of the body; nothing unless all axes are there."""
    letters = AXES.get(role)
    if letters is None:
        numbers = sorted((label for label in labels if label.isdigit()), key=int) or list(labels)
        return {label: labels[label] for label in numbers} if len(numbers) <= MOST_FEET else {}
    for order in (letters, "0123"[: len(letters)]):
        if set(order) <= set(labels):
            return {label: labels[label] for label in order}
    return {}
