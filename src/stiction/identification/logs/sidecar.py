"""Sidecar to fill in: every field that a log cannot state, with guesses from the log, and their reasons.

A null field is not known and may stay so: `stiction identify` reads the file as it is. A guess is written down for
somebody to look at; it is not evidence.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import FileError, LogError
from stiction.core.files import write_text
from stiction.files.log import LARGEST_NUMBER, JointSignals, Log, LogSetup, sidecar_of, suffix_of
from stiction.identification.checks import LARGEST_REACH
from stiction.identification.logs.opening import BAGS, open_log, read_rows
from stiction.identification.logs.titles import CURRENTS, DRIVES, guess_columns

WHOLE = (
    *("torque_source", "test_condition", "axis", "torque_calibrated", "torque_scale", "position_scale"),
    *("torque_column", "duty_voltage"),
)
"""Fields that are usually the same for all joints."""

EACH = (
    *("kp", "kd", "torque_limit", "gravity", "hanging_angle", "velocity_delay", "kt", "resistance", "ke"),
    *("pendulum_mass", "pendulum_length", "pendulum_angle"),
)
"""Fields that differ between joints."""


def write_sidecar(path: Path, declared: LogSetup | None = None, joint: str | None = None) -> str:
    """Write the sidecar of a log next to it; return the guesses, for people. Raises `StictionError`.

    declared: known facts about the log, which are written as they are; joint: name for the joint of a log without
    names.
    """
    # The folder that one stands in has no name to call a sidecar by.
    target = sidecar_of(path if path.name else path.absolute())
    if target.exists():
        raise FileError(f"{target} is there already; fill it in, or move it away and ask again")
    data, guesses = propose(path, declared, joint)
    write_text(target, json.dumps(data, indent=2, ensure_ascii=False) + "\n")
    command = f"stiction identify {path}" + (f" --joint {joint}" if joint else "")
    lines = [f"{target}: fill in what is null, look at what was guessed, then: {command}"]
    return "\n".join([*lines, *(f"  {line}" for line in guesses)])


def propose(path: Path, declared: LogSetup | None = None, joint: str | None = None) -> tuple[dict[str, Any], list[str]]:
    """Return the sidecar's content and the guesses, a sentence each. Raises `LogError` where nothing fits.

    Declared values go before every guess, for each joint too.
    """
    declared = declared or LogSetup()
    log, columns = _opened(path, declared, joint)
    if joint is not None and list(log.joints) != [joint]:
        raise LogError(
            f"{log.source}: its joints are {', '.join(log.joints)}, and a sidecar is of all of them; leave --joint out"
        )
    positions = [signals.position for signals in log.joints.values() if signals.position is not None]
    if not positions:
        raise LogError(f"{log.source}: no joint has a position; map a column to it: position=NAME")
    known, guesses = declared.to_dict(), []
    data: dict[str, Any] = dict.fromkeys(WHOLE) | {"axis": "rotary"} | ({"columns": columns} if columns else {})
    if columns != declared.columns:
        listing = ", ".join(f"{role} is {name}" for role, name in columns.items())
        guesses.append(f"columns: guessed from their names, {listing}")
        guesses += _of_torque(columns.get("torque", ""), data, known)
    if not declared.names and all(name.startswith("joint_") for name in log.joints):
        data["names"] = list(log.joints)
        guesses.append("names: the log numbers its joints; give them their names, in its order")
    finite = [values[np.isfinite(values)] for values in positions]
    reach = max((float(np.ptp(values)) for values in finite if len(values)), default=0.0)
    if reach > LARGEST_REACH and declared.position_scale is None and declared.axis != "linear":
        data["position_scale"] = 0.0174533
        guesses.append(f"position_scale: the positions cover {reach:.4g}, so they are taken for degrees")
    angle, torque = (data | known)["position_scale"] or 1.0, declared.torque_scale or 1.0
    # A voltage or a duty is no torque, and shows neither its gains nor its limit.
    held = (data | known)["torque_column"] or ("torque" if declared.duty_voltage is None else "duty")
    scales = {"position": angle, "velocity": angle, "target": angle, "torque": torque if held == "torque" else None}
    joints: dict[str, dict[str, float | None]] = {}
    for name, signals in log.joints.items():
        scaled = {
            role: None if scale is None or (values := getattr(signals, role)) is None else scale * values
            for role, scale in scales.items()
        }
        joints[name] = {field: None for field in EACH if field not in known}
        for field, value, why in _guesses(JointSignals(**scaled), log.time):
            if field in joints[name]:
                joints[name][field] = float(f"{value:.3g}")  # it is a guess
                guesses.append(f"{field} of {name}: {why}")
    data |= next(iter(joints.values())) if len(joints) == 1 else {"joints": joints}
    return data | known, guesses + [f"read: {note}" for note in log.notes]


def _opened(path: Path, declared: LogSetup, joint: str | None) -> tuple[Log, dict[str, str]]:
    """Return a log and the mapping of its columns, guessed from their names where it cannot be read without one."""
    columns = dict(declared.columns)
    options: dict[str, Any] = {
        name: getattr(declared, name) for name in ("names", "rate", "time_scale", "begin", "end")
    }
    try:
        return open_log(path, columns, joint, **options), columns
    except LogError:
        if columns or suffix_of(path) in BAGS or not path.is_file():
            raise
        table = read_rows(path)
        columns = guess_columns([name for name in table.columns if name not in table.faults])
        if not columns:
            raise
    return open_log(path, columns, joint, **options), columns


def _of_torque(title: str, data: dict[str, Any], known: dict[str, Any]) -> list[str]:
    """Set the content of the torque column by its guessed name, where it was not declared; return the reason."""
    drive = DRIVES.get(title.lower().replace("{joint}", "").strip("_. "))
    if drive is not None and "torque_column" not in known:
        data["torque_column"] = drive
        duty = ", and duty_voltage, without which it is not read; torque_scale 0.01 for percent" * (drive == "duty")
        return [f"torque_column: {title} is taken for a {drive}; give kt and resistance at the joint{duty}"]
    if any(word in title.lower() for word in CURRENTS) and not {"torque_scale", "torque_calibrated"} & set(known):
        data["torque_calibrated"] = False
        return ["torque_calibrated: a current is not in N m; with a torque_scale make it true"]
    return []


def _guesses(signals: JointSignals, time: np.ndarray) -> list[tuple[str, float, str]]:
    """Return field, value and reason for a joint's torque limit, and for the gains of its torque's PD law.

    signals: in SI units, of which those at `time` [s] that are no numbers show nothing.
    """
    guesses: list[tuple[str, float, str]] = []
    position, torque, velocity = signals.position, signals.torque, signals.velocity
    if torque is None:
        return guesses
    size = np.abs(torque[np.isfinite(torque)])
    # Little less than the largest is not the largest: a sine stays near its peak, too.
    at_limit = np.mean(size > (1 - 1e-6) * size.max()) if len(size) and size.max() > 0 else 0.0
    if at_limit > 0.005:
        guesses.append(("torque_limit", float(size.max()), f"{at_limit:.1%} of the torques are its largest"))
    if signals.target is None or position is None or len(time) < 100:
        return guesses
    if velocity is None and (np.diff(time) > 0).all():
        velocity = np.gradient(position, time)
    # Squares of what is beyond are no numbers.
    if velocity is None or not (np.abs([signals.target, position, velocity, torque]) < LARGEST_NUMBER).all():
        return guesses
    columns = np.column_stack([signals.target - position, -velocity])
    gains, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    rest = float(np.var(torque - columns @ gains))
    # Of a torque that is explained so far it is the controller's own.
    if rest <= 0.01 * float(np.var(torque)) and gains[0] > 0 and gains[1] >= 0:
        law = "the torque is kp (target - position) - kd velocity to within a tenth"
        guesses += [("kp", float(gains[0]), law), ("kd", float(gains[1]), law)]
    return guesses
