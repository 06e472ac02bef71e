"""Which column is which signal of which joint: by a mapping, by the usual names, or refused with the nearest recipe.

A mapping gives a role a column, `position=qm`, for one joint; several, `position=1,2,3`; or a pattern,
`position=q_{joint}`, where `{joint}` stands for the joint's number or name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction.core.errors import LogError, unknown_name
from stiction.files.log import BODY, SIGNALS, UNNAMED, JointSignals, LogSetup, TorqueColumn, by_joint, listed
from stiction.files.tables import WIDEST_MATRIX, Columns, Table

PLACE = "{joint}"
"""What stands for the joint in a pattern."""

ROLES = ("time", *SIGNALS)
"""What a mapping may map in a table."""

TOPICS = ("state", "command", "imu")
"""What a mapping may map in a file of messages."""

WIDE = {
    "position": (
        *("joint_pos_{joint}", "dof_pos_{joint}", "observation.state_{joint}"),
        *("motor_state[{joint}].q", "motorState[{joint}].q", "position[{joint}]", "field.position{joint}"),
    ),
    "velocity": (
        *("joint_vel_{joint}", "dof_vel_{joint}"),
        *("motor_state[{joint}].dq", "motorState[{joint}].dq", "velocity[{joint}]", "field.velocity{joint}"),
    ),
    "target": (
        *("joint_pos_target_{joint}", "des_dof_pos_{joint}", "action_{joint}"),
        *("motor_cmd[{joint}].q", "motorCmd[{joint}].q"),
    ),
    "torque": (
        *("tau_est_{joint}", "tau_{joint}", "torques_{joint}", "torque_{joint}"),
        *("motor_state[{joint}].tau_est", "motorState[{joint}].tauEst", "effort[{joint}]", "field.effort{joint}"),
    ),
}
"""Role -> patterns, the first that fits counts. `joint_pos_0`, `tau_est_0` and so on are written by public scripts that
log for actuator networks, where `torques` is what the controller asked for and `tau_est` what the motor reports;
`dof_pos` and `des_dof_pos` are the matrices of PACE's files; `observation.state` and `action` the lists of LeRobot;
`motor_state` and `motor_cmd` Unitree's, `field.position0` what `rostopic echo -p` writes. In a name, [0] may be .0 or
/0, and what follows may begin with a slash; a topic may stand in front."""

MEASURED = ("position", "velocity", "torque")
"""Roles of which an idle motor, as makers' messages have them in numbers, says zero throughout."""

OF_TOPIC = {"position": "position", "velocity": "velocity", "effort": "torque"}
"""Field of a joint state -> role, in columns `/joint_states/JOINT/position`, as PlotJuggler has them."""

NOTED = {
    "observation.state_{joint}": "LeRobot's states are in degrees or percent as often as not: if so give "
    "--position-scale, and they have no torque, so that the gains must be known",
}
"""Pattern -> what whoever reads such a log should know."""

COMMAND_WORDS = ("command", "cmd", "target", "desired", "reference", "setpoint")
"""What a topic of joint states has in its name if it is the command."""

TIMES = ("time", "timestamps", "timestamp", "t")
"""Names that the time has where no mapping says otherwise, the first that fits counts."""

OTHER_TIMES = re.compile(
    r"(__|elapsed[_ ]?)?(time|timestamps?|t|stamp|tick|index_time)[_ ]*[\[(]?(s|sec|ms|us|µs|ns)?[\])]?"
)
"""What a column of time is called by others, in lower case, with its unit."""

TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
"""Unit in a column's name -> seconds."""

UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees", "°"), ("angle", np.pi / 180)),
    **dict.fromkeys(("deg/s", "deg/sec", "°/s", "dps", "degrees/s"), ("angle", np.pi / 180)),
    **dict.fromkeys(("rad", "rads", "radian", "radians", "rad/s", "rad/sec", "rads/s"), ("angle", 1.0)),
    **dict.fromkeys(("rev", "revs", "turn", "turns", "rev/s", "turns/s", "rps"), ("angle", 2 * np.pi)),
    "rpm": ("angle", 2 * np.pi / 60),
    "mrad": ("angle", 1e-3),
    **dict.fromkeys(("nm", "n m", "n*m", "n·m", "n-m", "n.m"), ("torque", 1.0)),
    **dict.fromkeys(("mnm", "mn m", "n mm", "nmm", "mn·m", "n·mm"), ("torque", 1e-3)),
    "knm": ("torque", 1e3),
    **dict.fromkeys(("a", "amp", "amps", "ampere"), ("current", 1.0)),
    "ma": ("current", 1e-3),
    **dict.fromkeys(("v", "volt", "volts"), ("voltage", 1.0)),
    "mv": ("voltage", 1e-3),
    **dict.fromkeys(("%", "percent"), ("duty", 0.01)),
    **dict.fromkeys(("s", "sec", "ms", "us", "µs", "ns", "n", "m", "m/s", "-", ""), ("", 1.0)),
}
"""Unit in brackets behind a title, in lower case -> kind of signal, and what one of it is in SI."""

TITLE = re.compile(r"\s*(.*?)[\s_]*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*")
"""A title with something in brackets behind it."""

DRIVEN: tuple[TorqueColumn, ...] = ("current", "voltage", "duty")
"""Kinds of unit that a torque column has where it holds what drives the motor."""

SUFFIX = re.compile(r".*_(deg|degrees|rpm|mnm)", re.IGNORECASE)
"""A title that ends in a unit which is not SI."""

DRIVES = {
    **dict.fromkeys(("pwm", "duty", "duty_cycle", "present_pwm"), "duty"),
    **dict.fromkeys(("voltage", "motor_voltage", "volts"), "voltage"),
}
"""Names of what drove a motor that are no torque -> what the column holds then."""

GUESSES = {
    "position": ("q", "qm", "qpos", "pos", "angle", "theta", "joint_position", "actual_position", "present_position"),
    "target": ("qg", "q_des", "q_ref", "q_cmd", "ref", "cmd", "command", "setpoint", "target", "goal_position", "des"),
    "torque": (
        "tau",
        "torque",
        "effort",
        "current",
        "iq",
        "load",
        "tau_est",
        "present_current",
        "motor_torque",
        *DRIVES,
    ),
    "velocity": ("dq", "qdot", "vel", "speed", "omega"),
}
"""Role -> names that it often has, in lower case: enough for a proposal, never for an answer. Not qd, which is the
target to some and the velocity to others."""

CURRENTS = ("current", "iq", "load", "present_current")
"""Names of torque that is not in N m."""


@dataclass(frozen=True)
class Found:
    """The signals of a table, by joint; arrays of shape (num_samples,)."""

    time: np.ndarray | None
    """The time stamps, None where there are none."""
    joints: dict[str, JointSignals]
    """Joint -> signals."""
    time_name: str = ""
    """The time's column."""
    used: tuple[str, ...] = ()
    """The columns that are in use, the time's too."""
    notes: tuple[str, ...] = ()
    """What a reader of the results should know about the choice."""
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


def find_signals(source: str, table: Table, columns: Mapping[str, str] | None, joint: str | None) -> Found:
    """Return the signals of a table, joint by joint.

    columns: role -> column or pattern, or None to go by names. joint: the name to give a joint whose columns carry
    none. Joints that have only a number are called `joint_0`, `joint_1`, ... Raises `LogError`, also where a column
    that is in use is none of numbers.
    """
    names, units = _without_units(table.columns, columns or {})
    notes: tuple[str, ...] = ()
    if columns:
        time_name, joints = _mapped(source, names, columns, joint)
    else:
        time_name, joints = find_time(names), by_joint(names, joint)
        if not joints:
            joints, notes = _by_usual_names(names)
        if not joints:
            joints = _by_topics(source, names)
        if not joints:
            raise LogError(f"{source}: no column position, velocity, target or torque; {recipe(table)}")
    time = names[time_name] if time_name else None
    # Signals hold the table's own arrays, so identity tells which columns are in use, however they were chosen.
    used = {id(array) for signals in joints.values() for array in vars(signals).values() if array is not None}
    chosen = tuple(
        name for name, array in table.columns.items() if id(array) in used or (time is not None and array is time)
    )
    for name in chosen:
        if name in table.faults:
            fault = table.faults[name]
            raise LogError(fault if fault.startswith(f"{source}:") else f"{source}: {fault}")
    setups = {}
    for name, signals in joints.items():
        joints[name], setup, said = _by_units(signals, units)
        if setup != LogSetup():
            setups[name] = setup
        notes += tuple(f"joint {name!r}: {one}" for one in said)
    return Found(time, joints, time_name or "", chosen, tuple(dict.fromkeys(notes)), setups)


def _without_units(table: Columns, mapped: Mapping[str, str]) -> tuple[Columns, dict[int, str]]:
    """Return the columns by titles without units in brackets, and id of array -> unit.

    mapped: role -> column, whose titles stay. A role's first letter may be a capital one.
    """
    names: Columns = {}
    units: dict[int, str] = {}
    kept = {word for name in mapped.values() for word in (name, *name.split(","))}
    for name, values in table.items():
        match, bare = TITLE.fullmatch(name), name
        if match and match[2].lower() in UNITS and not OTHER_TIMES.fullmatch(name.lower()):
            bare, units[id(values)] = match[1], match[2]
        elif suffix := SUFFIX.fullmatch(name):
            units[id(values)] = suffix[1]
        role, dot, owner = bare.partition(".")
        bare = f"{role.lower()}{dot}{owner}" if role.lower() in ROLES else bare
        names[name if name in kept or PLACE in "".join(kept) or bare in table or bare in names else bare] = values
    return names, units


def _by_units(signals: JointSignals, units: Mapping[int, str]) -> tuple[JointSignals, LogSetup, tuple[str, ...]]:
    """Return signals whose angles have the position's unit, the scales of a setup, and what the titles said."""
    found = {
        role: (unit, *UNITS[unit.lower()])
        for role, values in vars(signals).items()
        if values is not None and (unit := units.get(id(values)))
    }
    setup, changed = LogSetup(), {}
    of_position = found["position"][2] if "position" in found else 1.0
    if of_position != 1.0:
        setup = replace(setup, position_scale=of_position)
    for role, (_, kind, factor) in found.items():
        if role in ("velocity", "target") and kind == "angle" and factor != of_position:
            changed[role] = factor / of_position * getattr(signals, role)
        elif role in ("disturbance", "feedforward") and factor != 1.0:
            changed[role] = factor * getattr(signals, role)
        elif role == "torque" and kind in ("torque", *DRIVEN):
            setup = replace(setup, torque_scale=None if factor == 1.0 else factor)
            setup = replace(setup, torque_column=next((one for one in DRIVEN if one == kind), None))
    odd: dict[str, list[str]] = {}
    for role, (unit, _, factor) in found.items():
        if factor != 1.0:
            odd.setdefault(unit, []).append(role)
    said = tuple(f"{' and '.join(roles)} in {unit}, as the title says" for unit, roles in odd.items())
    return replace(signals, **changed), setup, said


def find_time(columns: Mapping[str, np.ndarray]) -> str | None:
    """Return the column of time by its usual names; None where there is none."""
    exact = next((name for name in TIMES if name in columns), None)
    return exact or next((name for name in columns if OTHER_TIMES.fullmatch(name.lower())), None)


def unit_of_time(name: str) -> float | None:
    """Return the seconds in one unit of a column of time, if its name says so."""
    match = OTHER_TIMES.fullmatch(name.lower())
    return TIME_UNITS.get(match[3]) if match and match[3] else None


def recipe(table: Table) -> str:
    """Return what the columns are and how they could be mapped, nearest to what their names look like."""
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


def guess_columns(names: Sequence[str]) -> dict[str, str]:
    """Return role -> the column, or the pattern of columns, that is called as such a thing often is."""
    found: dict[str, str] = {}
    time = find_time(dict.fromkeys(names, np.zeros(0)))
    for role, guesses in GUESSES.items():
        for name in names:
            bare = re.sub(r"\s*[\[(].*[\])]$", "", name).strip().lower()
            number = re.search(r"\d{1,3}$", bare)
            stem = bare[: number.start()].rstrip("_. ") if number else bare
            if bare in guesses:
                found.setdefault(role, name)
            elif number and stem in guesses:
                place = name.lower().index(stem) + len(stem)
                found.setdefault(role, re.sub(r"\d{1,3}", PLACE, name[place:], count=1).join([name[:place], ""]))
    kinds = {PLACE in name for name in found.values()}
    if "position" not in found or len(kinds) != 1:
        return {}
    return ({"time": time} if time and time not in TIMES else {}) | found


def _mapped(
    source: str, table: Columns, columns: Mapping[str, str], joint: str | None
) -> tuple[str | None, dict[str, JointSignals]]:
    """Follow a mapping."""
    unknown = set(columns) - set(ROLES)
    if unknown:
        raise LogError(unknown_name("role", min(unknown), ROLES))
    signals = {role: name for role, name in columns.items() if role != "time"}
    patterns = {role: name for role, name in signals.items() if PLACE in name}
    if patterns and len(patterns) != len(signals):
        plain = next(role for role in signals if role not in patterns)
        raise LogError(f"{source}: {plain}={signals[plain]} names one column, the others patterns; expected one kind")
    lists = {role: [name] if name in table else name.split(",") for role, name in signals.items() if not patterns}
    asked = [*([columns["time"]] if "time" in columns else []), *(name for names in lists.values() for name in names)]
    missing = [name for name in asked if name not in table]
    if missing:
        raise LogError(f"{source}: no column {missing[0]!r}; the columns are {listed(table)}")
    time = columns.get("time") or find_time(table)
    if patterns:
        return time, _by_patterns(source, table, patterns)
    if not signals:
        raise LogError(f"{source}: the mapping names no signal; expected one of {', '.join(SIGNALS)}, as position=NAME")
    counts = {role: len(names) for role, names in lists.items()}
    if len(set(counts.values())) > 1 or max(counts.values()) > WIDEST_MATRIX:
        raise LogError(f"{source}: columns of {counts} joints; expected as many of each role")
    if max(counts.values()) == 1:
        return time, {joint or UNNAMED: JointSignals(**{role: table[names[0]] for role, names in lists.items()})}
    several = zip(*([table[name] for name in names] for names in lists.values()), strict=True)
    return time, {
        f"joint_{index}": JointSignals(**dict(zip(lists, arrays, strict=True))) for index, arrays in enumerate(several)
    }


def _by_usual_names(table: Columns) -> tuple[dict[str, JointSignals], tuple[str, ...]]:
    """Group columns by joint as `WIDE` has them, and say what should be known; nothing where there is no position."""
    found: dict[int, Columns] = {}
    notes = []
    for role, patterns in WIDE.items():
        for pattern in patterns:
            if matches := _match(_usual(pattern), table):
                notes += [NOTED[pattern]] if pattern in NOTED else []
                for label, name in matches.items():
                    found.setdefault(int(label), {})[role] = table[name]
                break
    if not any("position" in signals for signals in found.values()):
        return {}, ()
    idle = [index for index, signals in found.items() if not any(np.any(signals.get(role, 0)) for role in MEASURED)]
    if 0 < len(idle) < len(found):
        found = {index: signals for index, signals in found.items() if index not in idle}
        notes.append(f"{len(idle)} motors say zero in every row and are left out: numbers {', '.join(map(str, idle))}")
    return {f"joint_{index}": JointSignals(**found[index]) for index in sorted(found)}, tuple(notes)


def _usual(pattern: str) -> str:
    """Return the regular expression of a usual pattern, with what may stand in front and in place of brackets."""
    before, _, after = pattern.partition(PLACE)
    if before.endswith("["):
        field = re.escape(after[1:]).replace(r"\.", "[./]")
        return rf"(?:.*[/.])?{re.escape(before[:-1])}[\[./](\d{{1,4}})\]?{field}"
    return rf"(?:.*/)?{re.escape(before)}(\d{{1,4}}){re.escape(after)}"


def _by_topics(source: str, table: Columns) -> dict[str, JointSignals]:
    """Group columns `/TOPIC/JOINT/position` by joint; a topic with a word for command in its name has the targets."""
    found: dict[str, Columns] = {}
    topics: dict[str, str] = {}
    for name, values in table.items():
        topic, _, rest = name.rpartition("/")[0].rpartition("/")
        role = OF_TOPIC.get(name.rpartition("/")[2])
        if role is None or not rest:
            continue
        if any(word in topic.lower() for word in COMMAND_WORDS):
            role = "target" if role == "position" else None
        if role is None:
            continue
        kind = "command" if role == "target" else "state"
        if topics.setdefault(kind, topic) != topic:
            raise LogError(
                f"{source}: positions of the topics {topics[kind]} and {topic}: say which, "
                f"--columns position={topic}/{PLACE}/position, and so on"
            )
        found.setdefault(rest, {})[role] = values
    return {name: JointSignals(**signals) for name, signals in found.items() if "position" in signals}


def _match(pattern: str, table: Columns) -> dict[str, str]:
    """Return label -> column for the columns that fit a regular expression with the label as its group."""
    expression = re.compile(pattern)
    return {match[1]: name for name in table if (match := expression.fullmatch(name))}


def _fitting(pattern: str, table: Columns, label: str) -> dict[str, str]:
    """Return label -> column for the columns that fit a pattern; label: regular expression of what stands there."""
    before, _, after = pattern.partition(PLACE)
    return _match(f"{re.escape(before)}({label}){re.escape(after)}", table)


def _by_patterns(source: str, table: Columns, patterns: Mapping[str, str]) -> dict[str, JointSignals]:
    """Group columns by joint. A pattern stands for numbered joints if some column has a number there, else for names.

    A column that fits several patterns by a name belongs to the longest one.
    """
    found: dict[str, Columns] = {}
    taken: set[str] = set()
    # The longest first: `q_{joint}` would fit the columns of `q_ref_{joint}`, with joints called `ref_...`.
    for role, pattern in sorted(patterns.items(), key=lambda item: -len(item[1])):
        if pattern.count(PLACE) != 1:
            raise LogError(f"{source}: {role}={pattern} has {PLACE} more than once; expected one place for the joint")
        numbered = _fitting(pattern, table, r"\d{1,4}")
        named = {} if numbered else _fitting(pattern, table, ".+")
        matches = numbered or {label: name for label, name in named.items() if name not in taken}
        if not matches:
            raise LogError(f"{source}: no column fits {role}={pattern}; the columns are {listed(table)}")
        taken |= set(matches.values())
        for label, name in matches.items():
            found.setdefault(f"joint_{int(label)}" if numbered else label, {})[role] = table[name]
    # Numbers by size, joint_2 before joint_10; names stay as the table has them, since sorting is stable.
    order = sorted(found, key=lambda name: (len(name), name) if name.startswith("joint_") else (0, ""))
    return {name: JointSignals(**found[name]) for name in order}
