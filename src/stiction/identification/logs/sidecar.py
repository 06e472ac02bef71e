"""The sidecar to fill in: every field that a log cannot say, with what can be guessed from it, and why.

What is null is not known and may stay so: `stiction identify` reads the file as it is. A guess is written down so that
somebody looks at it; it is not evidence.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import FileError, LogError
from stiction.core.files import write_text
from stiction.files.log import LARGEST_NUMBER, JointSignals, Log, LogSetup, sidecar_of, suffix_of
from stiction.identification.checks import LARGEST_REACH
from stiction.identification.logs.naming import CURRENTS, DRIVES, guess_columns
from stiction.identification.logs.opening import BAGS, open_log, read_rows

WHOLE = (
    *("torque_source", "test_condition", "axis", "torque_calibrated", "torque_scale", "position_scale"),
    *("torque_column", "duty_voltage"),
)
"""What is usually the same for all joints."""

EACH = (
    *("kp", "kd", "torque_limit", "gravity", "hanging_angle", "velocity_delay", "kt", "resistance", "ke"),
    *("pendulum_mass", "pendulum_length", "pendulum_angle"),
)
"""What joints differ in."""

EXPLAINED = 0.99
"""Share of the torque's variance from which on it is the controller's own, and its gains are known."""

AT_LIMIT, SHARE_AT_LIMIT = 1 - 1e-6, 0.005
"""Share of the largest torque that counts as the largest, for a sine stays near its peak too; and share of samples
there from which on it is a limit."""


def write_sidecar(path: Path, declared: LogSetup | None = None, joint: str | None = None) -> str:
    """Write the sidecar of a log beside it; return what was guessed, for people. Raises `StictionError`.

    declared: what is known of the log, which is written as it is; joint: the name to give the joint of a log without
    names.
    """
    # The folder that one stands in has no name to call a sidecar by.
    target = sidecar_of(path if path.name else path.absolute())
    if target.exists():
        raise FileError(f"{target} is there already; fill it in, or move it away and ask again")
    data, said = propose(path, declared, joint)
    write_text(target, json.dumps(data, indent=2, ensure_ascii=False) + "\n")
    command = f"stiction identify {path}" + (f" --joint {joint}" if joint else "")
    lines = [f"{target}: fill in what is null, look at what was guessed, then: {command}"]
    return "\n".join([*lines, *(f"  {line}" for line in said)])


def propose(path: Path, declared: LogSetup | None = None, joint: str | None = None) -> tuple[dict[str, Any], list[str]]:
    """Return the sidecar's content and what was guessed, a sentence each. Raises `LogError` where nothing fits.

    What was declared goes before every guess, of each joint too.
    """
    declared = declared or LogSetup()
    said: list[str] = []
    log, columns = _opened(path, declared, joint, said)
    if joint is not None and list(log.joints) != [joint]:
        raise LogError(
            f"{log.source}: its joints are {', '.join(log.joints)}, and a sidecar is of all of them; leave --joint out"
        )
    data: dict[str, Any] = dict.fromkeys(WHOLE)
    data["axis"] = "rotary"
    if columns:
        data["columns"] = columns
    known = declared.to_dict()
    drive = None if "torque_column" in known else _drive(declared, columns, said)
    if drive is not None:
        data["torque_column"] = drive
    elif _is_current(declared, columns):
        data["torque_calibrated"] = False
        said.append("torque_calibrated: a current is not in N m; with a torque_scale make it true")
    if not declared.names and all(name.startswith("joint_") for name in log.joints):
        data["names"] = list(log.joints)
        said.append("names: the log numbers its joints; give them their names, in its order")
    reach = max(
        (float(np.ptp(finite)) for values in _positions(log) if len(finite := values[np.isfinite(values)])), default=0.0
    )
    if reach > LARGEST_REACH and declared.position_scale is None and declared.axis != "linear":
        data["position_scale"] = 0.0174533
        said.append(f"position_scale: the positions cover {reach:.4g}, so they are taken for degrees")
    found = _joints(log, replace(declared, position_scale=(data | known)["position_scale"]), drive, said)
    if len(found) == 1:
        data |= next(iter(found.values()))
    else:
        data["joints"] = found
    said += [f"read: {note}" for note in log.notes]
    return data | known, said


def _opened(path: Path, declared: LogSetup, joint: str | None, said: list[str]) -> tuple[Log, dict[str, str]]:
    """Return a log and the mapping of its columns, guessed from their names where it cannot be read without one."""
    columns = dict(declared.columns)
    given: dict[str, Any] = {name: getattr(declared, name) for name in ("names", "rate", "time_scale", "begin", "end")}
    try:
        return open_log(path, columns, joint, **given), columns
    except LogError:
        if columns or suffix_of(path) in BAGS or not path.is_file():
            raise
        # Without a mapping its names say nothing, so that it is read by those that such columns often have.
        table = read_rows(path)
        columns = guess_columns([name for name in table.columns if name not in table.faults])
        if not columns:
            raise
    log = open_log(path, columns, joint, **given)
    said.append(
        f"columns: guessed from their names, {', '.join(f'{role} is {name}' for role, name in columns.items())}"
    )
    return log, columns


def _drive(declared: LogSetup, columns: Mapping[str, str], said: list[str]) -> str | None:
    """Return what the torque column holds by the name that was guessed for it, other than torque; None for torque."""
    if declared.columns:
        return None
    drive = DRIVES.get(columns.get("torque", "").lower().replace("{joint}", "").strip("_. "))
    if drive is not None:
        said.append(
            f"torque_column: {columns['torque']} is taken for a {drive}; give kt and resistance at the joint"
            + (", and duty_voltage, without which it is not read; torque_scale 0.01 for percent" * (drive == "duty"))
        )
    return drive


def _is_current(declared: LogSetup, columns: Mapping[str, str]) -> bool:
    """Return whether the torque column was guessed to be a current, and nobody said how many N m it is."""
    if declared.columns or declared.torque_scale is not None or declared.torque_calibrated is not None:
        return False
    return any(word in columns.get("torque", "").lower() for word in CURRENTS)


def _joints(log: Log, declared: LogSetup, drive: str | None, said: list[str]) -> dict[str, dict[str, float | None]]:
    """Return the fields of each joint that were not declared of all, guessed where the log shows them."""
    declared_drive = declared.torque_column or ("torque" if declared.duty_voltage is None else "duty")
    is_torque = drive is None and declared_drive == "torque"
    angle, torque = declared.position_scale or 1.0, declared.torque_scale or 1.0
    known, found = declared.to_dict().keys(), {}
    for name, signals in log.joints.items():
        scaled = replace(
            signals,
            **{role: _times(angle, getattr(signals, role)) for role in ("position", "velocity", "target")},
            # A voltage or a duty is no torque, and shows neither its gains nor its limit.
            torque=_times(torque, signals.torque) if is_torque else None,
        )
        found[name] = _guess(name, scaled, log.time, known, said)
    return found


def _times(scale: float, values: np.ndarray | None) -> np.ndarray | None:
    """Return a signal in SI units."""
    return None if values is None else scale * values


def _positions(log: Log) -> list[np.ndarray]:
    """Return the positions of the joints that have one; raise `LogError` if none has."""
    found = [signals.position for signals in log.joints.values() if signals.position is not None]
    if not found:
        raise LogError(f"{log.source}: no joint has a position; map a column to it: position=NAME")
    return found


def _guess(
    name: str, signals: JointSignals, time: np.ndarray, known: Collection[str], said: list[str]
) -> dict[str, float | None]:
    """Return the fields of one joint that are not known, with gains and limit where its torque shows them.

    signals: in SI units.
    """
    fields: dict[str, float | None] = {field: None for field in EACH if field not in known}
    if signals.torque is None:
        return fields
    size = np.abs(signals.torque[np.isfinite(signals.torque)])
    at_limit = np.mean(size > AT_LIMIT * size.max()) if len(size) and size.max() > 0 else 0.0
    if "torque_limit" in fields and at_limit > SHARE_AT_LIMIT:
        fields["torque_limit"] = _rounded(float(size.max()))
        said.append(f"torque_limit of {name}: {at_limit:.1%} of the torques are its largest")
    asked = [field for field in ("kp", "kd") if field in fields]
    gains = _gains(signals, time) if asked else None
    if gains is not None:
        fields |= {field: _rounded(value) for field, value in zip(("kp", "kd"), gains, strict=True) if field in asked}
        law = "the torque is kp (target - position) - kd velocity to within a tenth"
        said.append(f"{', '.join(asked)} of {name}: {law}")
    return fields


def _gains(signals: JointSignals, time: np.ndarray) -> tuple[float, float] | None:
    """Return the gains of the PD law that the torque follows; None where it follows none."""
    if signals.target is None or signals.position is None or signals.torque is None or len(time) < 100:
        return None
    # Squares of what is beyond are no numbers.
    given = [one for one in (signals.target, signals.position, signals.velocity, signals.torque) if one is not None]
    if not all((np.abs(one) < LARGEST_NUMBER).all() for one in given):
        return None
    velocity = signals.velocity
    if velocity is None:
        if (np.diff(time) <= 0).any():
            return None
        velocity = np.gradient(signals.position, time)
    columns = np.column_stack([signals.target - signals.position, -velocity])
    gains, *_ = np.linalg.lstsq(columns, signals.torque, rcond=None)
    rest = float(np.var(signals.torque - columns @ gains))
    if rest > (1 - EXPLAINED) * float(np.var(signals.torque)) or gains[0] <= 0 or gains[1] < 0:
        return None
    return float(gains[0]), float(gains[1])


def _rounded(value: float) -> float:
    """Return a number to three digits: it is a guess."""
    return float(f"{value:.3g}")
