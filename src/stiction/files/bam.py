"""BAM's parameter files (better-actuator-models 1.0): one servo per JSON, read as a record of `joints.json`, and
written.

BAM's friction is b + e s + (c + e c_s) |τ_e − τ_m| + B |θ'| with e = exp(−|θ'/v_s|^α), by its models m1 (b, B), m2 (and
s), m3 (and c) and m4 (all); τ_m is the motor's torque, τ_e that from outside. At rest τ_e = −τ_m, so that its load is
twice the motor's torque, on which our load coefficient is defined: ours is 2 c. Models m5 and m6 have a coefficient for
each direction of the load, for which a record has no place: they are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stiction.core.decode import is_number
from stiction.core.errors import FileError
from stiction.files.joints import (
    ARMATURE,
    BRAKE,
    LOAD_REGRESSORS,
    Estimate,
    JointRecord,
    JointsFile,
    read_joints,
    warning,
)
from stiction.files.plain import read_object

STRIBECK = ("friction_stribeck", "dtheta_stribeck", "alpha")
"""Fields of the models m2 and m4."""

FIELDS: dict[str, tuple[str, ...]] = {
    "m1": (),
    "m2": STRIBECK,
    "m3": ("load_friction_base",),
    "m4": (*STRIBECK, "load_friction_base", "load_friction_stribeck"),
}
"""Model -> fields in addition to `armature`, `friction_base` and `friction_viscous`."""

BASE = ("armature", "friction_base", "friction_viscous")
"""Fields of every model."""

LAWS = {"m1": "coulomb", "m2": "stribeck", "m3": "effort", "m4": "stribeck"}
"""Model -> friction law of the record."""

ACTUATOR = "unitree_go1"
"""BAM's motor driven by torque, in N m: used for a record without a servo of BAM."""

LOAD = 2.0
"""BAM's load over the motor's torque, at rest."""


def is_bam(data: dict[str, Any]) -> bool:
    """Return whether a JSON object is a parameter file of BAM."""
    return isinstance(data.get("model"), str) and "friction_base" in data and "actuator" in data


def load_joints(path: Path) -> JointsFile:
    """Read and validate a `joints.json`, or a parameter file of BAM, whose servo is then the one record.

    Raises `FileError` naming the invalid field.
    """
    data = read_object(path, "the joints.json of identify")
    return JointsFile(dict([record_of_bam(data, path.name)])) if is_bam(data) else read_joints(data, path.name)


def load_all_joints(paths: Sequence[Path]) -> JointsFile:
    """Return the records of several files; raise `FileError` for two with one name."""
    records: dict[str, JointRecord] = {}
    for path in paths:
        for name, record in load_joints(path).joints.items():
            if name in records:
                raise FileError(f"{path.name}: got a second {name!r}, expected each name once; leave one of them out")
            records[name] = record
    return JointsFile(records)


def record_of_bam(data: dict[str, Any], where: str) -> tuple[str, JointRecord]:
    """Return a servo's name and its record; messages name `where`. Raises `FileError` for an unsupported file.

    BAM states no intervals: each is the value itself, with a warning in the record.
    """
    if not is_bam(data):
        raise FileError(f"{where}: got no 'model', 'actuator' and 'friction_base', expected a parameter file of BAM")
    model, name = data["model"], data["actuator"]
    if model not in FIELDS:
        more = ", which has a load coefficient for each direction" if model in ("m5", "m6") else ""
        raise FileError(f"{where}: got BAM's model {model[:20]!r}{more}, expected one of {', '.join(FIELDS)}")
    if not (isinstance(name, str) and name and name.isprintable()):
        raise FileError(f"{where}: got actuator {name!r}, expected a name")
    for field in (*BASE, *FIELDS[model]):
        if not (is_number(data.get(field)) and data[field] >= 0):
            raise FileError(f"{where}: got {field} {data.get(field)!r}, expected a number that is not negative")
    value = {field: float(data[field]) for field in (*BASE, *FIELDS[model])}
    if any(value.get(field, 1.0) == 0 for field in ("armature", "dtheta_stribeck", "alpha")):
        raise FileError(f"{where}: got 0 for armature, dtheta_stribeck or alpha, expected positive numbers")
    known = {"coulomb_friction": value["friction_base"], "viscous_friction": value["friction_viscous"]}
    findings = [warning("bam", "BAM states no intervals: each is the value itself")]
    if "alpha" in value:
        known["static_friction"] = value["friction_base"] + value["friction_stribeck"]
        known["stribeck_velocity"] = value["dtheta_stribeck"]
    if "load_friction_base" in value:
        known["load_coefficient"] = LOAD * value["load_friction_base"]
        text = "the load coefficient is of the motor's torque, at rest; BAM's load is |external - motor|"
        findings.append(warning("bam_load", text))
    combinations = {ARMATURE: _exact(value["armature"])}
    if is_number(data.get("kt")) and is_number(data.get("R")) and data["R"] > 0:
        # kt and ke are one number in SI units.
        combinations[BRAKE] = _exact(value["friction_viscous"] + data["kt"] ** 2 / data["R"])
    estimates: dict[str, Any] = {field: _exact(number) for field, number in known.items()}
    law: dict[str, Any] = {
        "law": LAWS[model],
        "parameters": {field: number.to_dict() for field, number in estimates.items()},
        "text": f"{LAWS[model]} friction, from BAM's {model} of {name}",
        "bam": {field: number for field, number in data.items() if is_number(number) or field in ("model", "actuator")},
    }
    if "load_coefficient" in known:
        law |= {"regressor": "motor_torque", "load": LOAD_REGRESSORS["motor_torque"]}
    record = JointRecord(
        **estimates,
        combinations=combinations,
        friction_law=law,
        test_condition="loaded",
        torque_source="motor_side",
        findings=tuple(findings),
    )
    return name, record


def bam_of_record(name: str, record: JointRecord) -> dict[str, Any]:
    """Return a record as a parameter file of BAM: m1, or m2 to m4 with friction at rest or under load.

    Raises `FileError` for a law that BAM does not have, and for a value that BAM would replace with a default.
    """
    record = record.usable()
    law = record.friction_law or {}
    kind = law.get("law", "coulomb")
    origin = law["bam"] if isinstance(law.get("bam"), dict) else {}
    numbers = {field: number for field, number in origin.items() if is_number(number)}
    if kind not in {*LAWS.values(), "load"} or law.get("over_strength"):
        raise FileError(f"record {name!r}: got the law {kind!r}, expected coulomb, stribeck, load or effort, in N m")
    chosen = {
        field: Estimate.from_dict(law["parameters"][field], f"{name}: {field}")
        for field in ("coulomb_friction", "viscous_friction")
        if field in law.get("parameters", {})
    }
    friction, viscous = (
        chosen.get(field, getattr(record, field)) for field in ("coulomb_friction", "viscous_friction")
    )
    armature = record.combinations.get(ARMATURE) or (record.inertia if record.test_condition == "bare_motor" else None)
    for field, estimate in (("dry friction", friction), ("viscous friction", viscous), ("rotor inertia", armature)):
        if estimate is None:
            raise FileError(
                f"record {name!r}: got no {field}, expected one, for BAM would take a number of its own; identify a "
                "bare motor, or a whole limb"
            )
    assert friction is not None and viscous is not None and armature is not None
    static, load = record.static_friction, record.load_coefficient
    if static is not None and record.stribeck_velocity is None:
        raise FileError(f"record {name!r}: got friction at rest and no Stribeck velocity, expected both for BAM's m2")
    written: dict[str, Any] = {field: numbers[field] for field in ("kt", "R", "q_offset") if field in numbers}
    if not numbers and record.torque_limit is not None:
        written |= {"ratio": 1.0, "max_torque": record.torque_limit}
    written |= {"armature": armature.value, "friction_base": max(0.0, friction.value)}
    if static is not None and record.stribeck_velocity is not None:
        written["friction_stribeck"] = max(0.0, static.value - friction.value)
        written |= {"dtheta_stribeck": record.stribeck_velocity.value, "alpha": numbers.get("alpha", 2.0)}
    if load is not None:
        written["load_friction_base"] = max(0.0, load.value) / LOAD
        if static is not None:
            written["load_friction_stribeck"] = numbers.get("load_friction_stribeck", 0.0)
    written["friction_viscous"] = max(0.0, viscous.value)
    model = {(False, False): "m1", (True, False): "m2", (False, True): "m3", (True, True): "m4"}
    return written | {
        "model": model[static is not None, load is not None],
        "actuator": origin.get("actuator", ACTUATOR),
    }


def _exact(value: float) -> Estimate:
    """Return a number as an estimate with an interval of zero width."""
    return Estimate(value, 0.0, (value, value))
