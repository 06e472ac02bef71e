"""Titles of columns: their units, the column of time, and usual names of signals."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from stiction.files.log import JointSignals, LogSetup

PLACE = "{joint}"
"""Placeholder for the joint in a pattern."""

TIMES = ("time", "timestamps", "timestamp", "t")
"""Usual names of the time's column; the first that fits counts."""

OTHER_TIMES = re.compile(
    r"(__|elapsed[_ ]?)?(time|timestamps?|t|stamp|tick|index_time)[_ ]*[\[(]?(s|sec|ms|us|µs|ns)?[\])]?"
)
"""Other names of a column of time, in lower case, with its unit."""

TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
"""Unit in a column's name -> seconds."""

UNITS = {
    unit: (kind, factor)
    for kind, factor, units in (
        ("angle", np.pi / 180, "deg degree degrees ° deg/s deg/sec °/s dps degrees/s"),
        ("angle", 1.0, "rad rads radian radians rad/s rad/sec rads/s"),
        ("angle", 2 * np.pi, "rev revs turn turns rev/s turns/s rps"),
        *(("angle", 2 * np.pi / 60, "rpm"), ("angle", 1e-3, "mrad")),
        *(("torque", 1.0, "nm n*m n·m n-m n.m"), ("torque", 1e-3, "mnm nmm mn·m n·mm"), ("torque", 1e3, "knm")),
        *(("current", 1.0, "a amp amps ampere"), ("current", 1e-3, "ma")),
        *(("voltage", 1.0, "v volt volts"), ("voltage", 1e-3, "mv"), ("duty", 0.01, "% percent")),
        ("", 1.0, "s sec ms us µs ns n m m/s -"),
    )
    for unit in units.split()
}
"""Unit in brackets behind a title, in lower case and without blanks -> kind of signal, and its size in SI."""

TITLE = re.compile(r"\s*(.*?)[\s_]*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*")
"""Title with something in brackets behind it."""

SUFFIX = re.compile(r".*_(deg|degrees|rpm|mnm)", re.IGNORECASE)
"""Title that ends in a unit which is not SI."""

DRIVES = dict.fromkeys(("pwm", "duty", "duty_cycle", "present_pwm"), "duty")
DRIVES |= dict.fromkeys(("voltage", "motor_voltage", "volts"), "voltage")
"""Names of a motor's drive other than torque -> content of the column."""

CURRENTS = ("current", "iq", "load", "present_current")
"""Names of torque columns that are not in N m."""

GUESSES = {
    "position": ["q", "qm", "qpos", "pos", "angle", "theta", "joint_position", "actual_position", "present_position"],
    "target": ["qg", "q_des", "q_ref", "q_cmd", "ref", "cmd", "command", "setpoint", "target", "goal_position", "des"],
    "torque": ["tau", "torque", "effort", "tau_est", "motor_torque", *CURRENTS, *DRIVES],
    "velocity": ["dq", "qdot", "vel", "speed", "omega"],
}
"""Role -> names that it often has, in lower case: enough for a proposal, never for an answer. Not qd, which is the
target to some and the velocity to others."""


def find_time(names: Collection[str]) -> str | None:
    """Return the column of time by its usual names; None where there is none."""
    exact = next((name for name in TIMES if name in names), None)
    return exact or next((name for name in names if OTHER_TIMES.fullmatch(name.lower())), None)


def unit_of_time(name: str) -> float | None:
    """Return the seconds in one unit of a column of time, if its name says so."""
    match = OTHER_TIMES.fullmatch(name.lower())
    return TIME_UNITS.get(match[3]) if match and match[3] else None


def _plain(unit: str) -> str:
    """Return a unit as `UNITS` has it."""
    return unit.lower().replace(" ", "")


def bare_titles(names: Collection[str], roles: Collection[str], mapped: Collection[str]) -> dict[str, tuple[str, str]]:
    """Return title without a unit -> its column and that unit, which may be empty.

    The first letter of a role, one of `roles`, may be a capital one. mapped: columns or patterns of a mapping, which
    names titles as they are.
    """
    whole = {word for name in mapped for word in (name, *name.split(","))}
    as_they_are = any(PLACE in name for name in mapped)
    titles: dict[str, tuple[str, str]] = {}
    for name in names:
        title, unit = name, ""
        match = TITLE.fullmatch(name)
        if match and (_plain(match[2]) or "-") in UNITS and not OTHER_TIMES.fullmatch(name.lower()):
            title, unit = match[1], match[2]
        elif suffix := SUFFIX.fullmatch(name):
            unit = suffix[1]
        role, dot, owner = title.partition(".")
        if role.lower() in roles:
            title = f"{role.lower()}{dot}{owner}"
        taken = as_they_are or name in whole or title in names or title in titles
        titles[name if taken else title] = name, unit
    return titles


def by_units(signals: JointSignals, units: Mapping[str, str]) -> tuple[JointSignals, LogSetup, tuple[str, ...]]:
    """Return signals whose angles have the position's unit, the scales of a setup, and notes on the units.

    units: role -> unit in its title.
    """
    known = {role: UNITS[_plain(unit)] for role, unit in units.items() if unit}
    setup, changed = LogSetup(), {}
    of_position = known["position"][1] if "position" in known else 1.0
    if of_position != 1.0:
        setup = replace(setup, position_scale=of_position)
    for role, (kind, factor) in known.items():
        if role in ("velocity", "target") and kind == "angle" and factor != of_position:
            changed[role] = factor / of_position * getattr(signals, role)
        elif role in ("disturbance", "feedforward") and factor != 1.0:
            changed[role] = factor * getattr(signals, role)
        elif role == "torque" and kind not in ("angle", ""):
            drive: Any = None if kind == "torque" else kind
            setup = replace(setup, torque_scale=None if factor == 1.0 else factor, torque_column=drive)
    odd: dict[str, list[str]] = {}
    for role, (_, factor) in known.items():
        if factor != 1.0:
            odd.setdefault(units[role], []).append(role)
    notes = tuple(f"{' and '.join(roles)} in {unit}, as the title says" for unit, roles in odd.items())
    return replace(signals, **changed), setup, notes


def guess_columns(names: Collection[str]) -> dict[str, str]:
    """Return role -> column, or pattern of columns, with a usual name of that role."""
    guessed: dict[str, str] = {}
    for role, guesses in GUESSES.items():
        for name in names:
            bare = re.sub(r"\s*[\[(].*[\])]$", "", name).strip().lower()
            number = re.search(r"\d{1,3}$", bare)
            stem = bare[: number.start()].rstrip("_. ") if number else bare
            if bare in guesses:
                guessed.setdefault(role, name)
            elif number and stem in guesses:
                place = name.lower().index(stem) + len(stem)
                guessed.setdefault(role, re.sub(r"\d{1,3}", PLACE, name[place:], count=1).join([name[:place], ""]))
    if "position" not in guessed or len({PLACE in name for name in guessed.values()}) != 1:
        return {}
    time = find_time(names)
    return ({"time": time} if time and time not in TIMES else {}) | guessed
