"""The sidecar to fill in: every field that a log cannot say, with what can be guessed from it, and why.

What is null is not known and may stay so: `stiction identify` reads the file as it is. A guess is written down so that
somebody looks at it; it is not evidence.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.errors import FileError, LogError
from stiction.core.files import write_text
from stiction.formats.log import LARGEST_NUMBER, JointSignals, Log, sidecar_of, suffix_of
from stiction.identify.checks import LARGEST_REACH
from stiction.identify.logs.naming import CURRENTS, DRIVES, guess_columns
from stiction.identify.logs.opening import BAGS, open_log, read_rows

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


def write_sidecar(
    path: Path,
    columns: Mapping[str, str],
    joint: str | None = None,
    names: tuple[str, ...] = (),
    rate: float | None = None,
    time_scale: float | None = None,
) -> str:
    """Write the sidecar of a log beside it; return what was guessed, for people. Raises `StictionError`."""
    # The folder that one stands in has no name to call a sidecar by.
    target = sidecar_of(path if path.name else path.absolute())
    if target.exists():
        raise FileError(f"{target} is there already; fill it in, or move it away and ask again")
    data, said = propose(path, columns, joint, names, rate, time_scale)
    write_text(target, json.dumps(data, indent=2, ensure_ascii=False) + "\n")
    lines = [f"{target}: fill in what is null, look at what was guessed, then: stiction identify {path}"]
    return "\n".join([*lines, *(f"  {line}" for line in said)])


def propose(
    path: Path,
    columns: Mapping[str, str],
    joint: str | None = None,
    names: tuple[str, ...] = (),
    rate: float | None = None,
    time_scale: float | None = None,
) -> tuple[dict[str, Any], list[str]]:
    """Return the sidecar's content and what was guessed, a sentence each. Raises `LogError` where nothing fits."""
    said: list[str] = []
    chosen = dict(columns)
    given = {"names": names, "rate": rate, "time_scale": time_scale}
    current, drive = False, None
    try:
        log = open_log(path, chosen, joint, **given)  # type: ignore[arg-type]
    except LogError:
        if chosen or suffix_of(path) in BAGS or not path.is_file():
            raise
        # Without a mapping its names say nothing, so that it is read by those that such columns often have.
        table = read_rows(path)
        chosen = guess_columns([name for name in table.columns if name not in table.faults])
        if not chosen:
            raise
        log = open_log(path, chosen, joint, **given)  # type: ignore[arg-type]
        words = ", ".join(f"{role} is {name}" for role, name in chosen.items())
        said.append(f"columns: guessed from their names, {words}")
        words = chosen.get("torque", "").lower().replace("{joint}", "").strip("_. ")
        drive = DRIVES.get(words)
        current = any(word in chosen.get("torque", "").lower() for word in CURRENTS)
    data: dict[str, Any] = dict.fromkeys(WHOLE)
    data["axis"] = "rotary"
    if chosen:
        data["columns"] = chosen
    if current:
        data["torque_calibrated"] = False
        said.append("torque_calibrated: a current is not in N m; with a torque_scale make it true")
    if drive is not None:
        data["torque_column"] = drive
        said.append(
            f"torque_column: {chosen['torque']} is taken for a {drive}; give kt and resistance at the joint"
            + (", and duty_voltage, without which it is not read; torque_scale 0.01 for percent" * (drive == "duty"))
        )
    if rate is not None:
        data["rate"] = rate
    if time_scale is not None:
        data["time_scale"] = time_scale
    if all(name.startswith("joint_") for name in log.joints):
        data["names"] = list(log.joints)
        said.append("names: the log numbers its joints; give them their names, in its order")
    found = {
        # A voltage or a duty is no torque, and shows neither its gains nor its limit.
        name: _guess(name, signals if drive is None else replace(signals, torque=None), log, said)
        for name, signals in log.joints.items()
    }
    if len(found) == 1:
        data |= next(iter(found.values()))
    else:
        data["joints"] = found
    reach = max(
        (float(np.ptp(finite)) for values in _positions(log) if len(finite := values[np.isfinite(values)])), default=0.0
    )
    if reach > LARGEST_REACH:
        data["position_scale"] = 0.0174533
        said.append(f"position_scale: the positions cover {reach:.4g}, so they are taken for degrees")
    said += [f"read: {note}" for note in log.notes]
    return data, said


def _positions(log: Log) -> list[np.ndarray]:
    """Return the positions of the joints that have one; raise `LogError` if none has."""
    found = [signals.position for signals in log.joints.values() if signals.position is not None]
    if not found:
        raise LogError(f"{log.source}: no joint has a position; map a column to it: position=NAME")
    return found


def _guess(name: str, signals: JointSignals, log: Log, said: list[str]) -> dict[str, float | None]:
    """Return the fields of one joint, with the gains and the limit where its torque shows them."""
    fields: dict[str, float | None] = dict.fromkeys(EACH)
    if signals.torque is None:
        return fields
    size = np.abs(signals.torque[np.isfinite(signals.torque)])
    if len(size) and size.max() > 0 and np.mean(size > AT_LIMIT * size.max()) > SHARE_AT_LIMIT:
        fields["torque_limit"] = _rounded(float(size.max()))
        said.append(
            f"torque_limit of {name}: {np.mean(size > AT_LIMIT * size.max()):.1%} of the torques are its largest"
        )
    gains = _gains(signals, log.time)
    if gains is not None:
        fields["kp"], fields["kd"] = (_rounded(value) for value in gains)
        said.append(f"kp, kd of {name}: the torque is kp (target - position) - kd velocity to within a tenth")
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
