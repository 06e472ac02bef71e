"""Values that a record gives a simulated joint, and their gaps: the part that every simulator shares."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from stiction.core.errors import FileError
from stiction.files.joints import ARMATURE, LOAD_REGRESSORS, Estimate, JointRecord
from stiction.identification.advice import CONDITIONS


@dataclass(frozen=True)
class JointPhysics:
    """Joint of a model, from one record. A value of None is left as the simulator has it."""

    name: str
    """Name of the joint in the model."""
    recorded: str
    """Name of its record."""
    record: JointRecord
    """Record of the joint."""
    friction: float | None
    """Coulomb friction, not negative [N m, or N]."""
    damping: float | None
    """Viscous friction, not negative [N m s/rad, or N s/m]."""
    armature: float | None
    """Inertia of rotor and gear at the joint [kg m², or kg]: from a bare motor alone."""
    notes: tuple[str, ...]
    """Notes on values left out, with their reasons; one line each."""
    represented: frozenset[str] = frozenset()
    """Quantities of the record beyond Coulomb friction that `friction` holds."""


@dataclass(frozen=True)
class Conversion:
    """Result of a converter."""

    text: str
    """Contents of the file."""
    joints: dict[str, str]
    """Joint of the model -> record."""
    notes: tuple[str, ...]
    """Notes on what the simulator cannot hold, what was left out, and what to mind; complete, for programs."""
    told: tuple[str, ...]
    """Summary of the notes in one line, and further changes of a model: the comment of the text."""
    files: dict[str, str] = field(default_factory=dict)
    """Name -> contents, where a target has a file a joint; the text is then that of the first."""

    @classmethod
    def of(cls, text: str, joints: list[JointPhysics], notes: list[str], told: list[str]) -> Conversion:
        """Return the conversion of some joints."""
        return cls(text, {joint.name: joint.recorded for joint in joints}, tuple(notes), tuple(told))


PAGE = 'the page "Which value goes where" of the documentation'
"""Page with the traps of every target."""

RICHER = ("static_friction", "stribeck_velocity", "load_coefficient")
"""Quantities of a record beyond Coulomb and viscous friction."""

Which = Literal["moving", "static"]
"""Dry friction for a place with one number: in motion, or at rest where that is more."""


def joint_physics(recorded: str, record: JointRecord, name: str | None = None, which: Which = "moving") -> JointPhysics:
    """Return the physics that the record `recorded` gives the joint `name` of a model (by default of the same name).

    Raises `StictionError` for a record without a usable value.
    """
    notes: list[str] = []
    if (objection := record.objection_to("inertia")) is not None:
        raise FileError(f"the fit of record {recorded!r} is not valid, nothing of it is written: {objection.text}")
    coulomb, viscous = _in_motion(record)
    held, represented = record.static_friction, frozenset[str]()
    if which == "static" and held is not None and coulomb is not None and held.value > coulomb.value:
        notes.append(
            f"dry friction is what holds the joint at rest, {number(held.value)}, {breakaway_text(record)}: in motion "
            f"it has {number(coulomb.value)}, and the model is braked by too much"
        )
        coulomb, represented = held, frozenset({"static_friction"})
    if (objection := record.objection_to("coulomb_friction")) is not None:
        coulomb = None
        notes.append(f"dry friction is left out: {objection.text}")
    friction, damping = _size(coulomb, "dry friction", notes), _size(viscous, "viscous friction", notes)
    armature = _armature(record, notes)
    # A known inertia that is no armature is not missing: `_armature` has noted why it is left out.
    inertia = record.inertia if armature is None else armature
    missing = [
        label
        for label, value in (("dry friction", friction), ("viscous friction", damping), ("inertia", inertia))
        if value is None
    ]
    if missing:
        notes.append(f"{' and '.join(missing)} not known, left out{_known_instead(record)}")
    if friction is None and damping is None and armature is None:
        raise FileError(
            f"record {recorded!r} holds nothing that a simulator takes: {'; '.join(notes)}; identify with measured "
            "torque"
        )
    if record.test_condition != "loaded" and friction is not None:
        stated = CONDITIONS.get(record.test_condition or "", "under no stated condition")
        notes.append(f"dry friction was measured {stated}: a lower bound for a joint that carries load")
    return JointPhysics(name or recorded, recorded, record, friction, damping, armature, tuple(notes), represented)


def beyond_coulomb(record: JointRecord, represented: frozenset[str] = frozenset()) -> list[str]:
    """Return notes on the record's quantities beyond symmetric Coulomb and viscous friction, without `represented`."""
    # Three laws have a load coefficient, and no target has friction that follows one.
    regressor = record.load_regressor
    load = "" if regressor is None else f" of {LOAD_REGRESSORS[regressor]}"
    notes = [
        f"{quantity} {number(estimate.value)}{load if quantity == 'load_coefficient' else ''} is not represented"
        + (f", {breakaway_text(record)} (--friction static writes it)" if quantity == "static_friction" else "")
        for quantity in RICHER
        if quantity not in represented and (estimate := getattr(record, quantity)) is not None
    ]
    law = (record.friction_law or {}).get("law")
    if law not in (None, "coulomb"):
        instead = "its Coulomb and viscous part" if stribeck_law(record) else "the symmetric Coulomb and viscous fit"
        notes.append(f"the friction law that fitted best, {law}, is replaced by {instead}")
    offset = record.offset
    if offset is not None and not offset.interval95[0] <= 0 <= offset.interval95[1]:
        notes.append(f"the constant torque that the motor had to supply, {number(offset.value)}, is not represented")
    return notes


def _in_motion(record: JointRecord) -> tuple[Estimate | None, Estimate | None]:
    """Return Coulomb and viscous friction; those of the law where that has friction at rest."""
    if not stribeck_law(record):
        return record.coulomb_friction, record.viscous_friction
    # The best symmetric fit of such a joint has too much dry friction and too little viscous.
    parameters = (record.friction_law or {}).get("parameters", {})
    coulomb, viscous = (
        # Not known where a motor's brake hides it.
        None
        if name not in parameters and getattr(record, name) is None
        else Estimate.from_dict(parameters.get(name), f"friction_law.parameters.{name}")
        for name in ("coulomb_friction", "viscous_friction")
    )
    return coulomb, viscous


def breakaway_text(record: JointRecord) -> str:
    """Return friction at rest over that in motion in words."""
    static, moving = record.static_friction, _in_motion(record)[0]
    if static is None or moving is None or moving.value <= 0:
        return "breakaway over moving: not known"
    return f"breakaway over moving: {static.value / moving.value:.3g}"


def stribeck_law(record: JointRecord) -> bool:
    """Return True if friction at rest was identified in N m: Coulomb and viscous friction are then the law's own."""
    law = record.friction_law or {}
    return (
        law.get("law") in ("stribeck", "breakaway")
        and not law.get("over_strength")
        and record.static_friction is not None
    )


def notes_of(
    joints: list[JointPhysics], *general: str, represented: frozenset[str] = frozenset(), rotor: str | None = None
) -> list[str]:
    """Return the origin of a file, notes that hold for all its joints, and notes on each record, once.

    general: notes that hold for all joints; represented: see `beyond_coulomb`; rotor: text on a rotor inertia that
    the simulator has no place for.
    """
    notes = dict.fromkeys(("written by `stiction convert` from an identification", *general))
    for joint in joints:
        joint_notes = [*joint.notes, *beyond_coulomb(joint.record, represented | joint.represented)]
        if rotor is not None and joint.armature is not None:
            joint_notes.append(f"{rotor}: {number(joint.armature)} is left out")
        notes |= dict.fromkeys(one_line(f"{joint.recorded}: {note}") for note in joint_notes)
    return list(notes)


def headline(joints: list[JointPhysics], represented: frozenset[str] = frozenset(), rotor: bool = True) -> str:
    """Return one line: the quantities that are left out, by record, and where the file explains the rest.

    represented: see `beyond_coulomb`; rotor: True if the simulator has a place for a rotor's inertia.
    """
    left: dict[str, list[str]] = {}
    for joint in joints:
        parts = {"dry friction": joint.friction, "viscous friction": joint.damping}
        parts["armature"] = joint.armature if rotor else None
        out = [name for name, value in parts.items() if value is None]
        held = represented | joint.represented
        out += [name for name in RICHER if name not in held and getattr(joint.record, name) is not None]
        for name in out:
            left.setdefault(name, []).append(joint.recorded)
    records = {joint.recorded for joint in joints}
    told = ", ".join(
        f"{name} ({f'all {len(records)}' if 1 < len(records) == len({*names}) else ', '.join(dict.fromkeys(names))})"
        for name, names in left.items()
    )
    return one_line(
        f"written by `stiction convert`{f'; left out: {told}' if told else ''}; why, and what to mind: {PAGE}"
    )


def check_axis(joint: JointPhysics, kind: str, allowed: tuple[str, ...]) -> None:
    """Raise `StictionError` unless the `kind` of a model's joint is one of those `allowed` for the record's axis."""
    if kind not in allowed:
        raise FileError(
            f"joint {joint.name!r} is of type {kind or 'none'}, and the record {joint.recorded!r} of a "
            f"{joint.record.axis} axis; expected {' or '.join(allowed)}"
        )


def number(value: float) -> str:
    """Return a number as a simulator's file has it, six digits."""
    return f"{value:.6g}"


def known(**values: float | None) -> dict[str, str]:
    """Return name -> number as text, of the values that are not None."""
    return {name: number(value) for name, value in values.items() if value is not None}


def one_line(text: str) -> str:
    """Return text that cannot end the comment it is put into: no line breaks, no control characters."""
    return " ".join("".join(c if c.isprintable() or c.isspace() else "?" for c in text).split())


def _size(estimate: Estimate | None, label: str, notes: list[str]) -> float | None:
    """Return an estimate of friction as simulators take it: zero if it is below zero, with a note."""
    if estimate is None:
        return None
    if estimate.value < 0:
        notes.append(f"the estimate of the {label}, {number(estimate.value)}, is below zero: written as 0")
    return max(0.0, estimate.value)


def _armature(record: JointRecord, notes: list[str]) -> float | None:
    """Return the rotor's inertia at the joint: from a whole limb without the links, or from a bare motor."""
    if (rotor := record.combinations.get(ARMATURE)) is not None and rotor.interval95[0] > 0:
        return rotor.value
    if record.inertia is None:
        return None
    value = record.inertia.value
    if record.test_condition == "bare_motor" and value > 0:
        return value
    if record.test_condition == "bare_motor":
        notes.append(f"the inertia is {number(value)}, which no rotor has: left out")
    elif record.test_condition == "in_air":
        notes.append(
            f"the inertia {number(value)} was measured in the air and includes the link's, which the model adds too: "
            "armature left out; it is that less the model's link inertia about the joint"
        )
    else:
        stated = "measured loaded" if record.test_condition else "measured under no stated condition"
        notes.append(f"the inertia {number(value)} was {stated} and says nothing about the rotor: armature left out")
    return None


def _known_instead(record: JointRecord) -> str:
    """Return the combinations that were identified in place of the parameters, in words."""
    known = [f"{name} = {number(estimate.value)}" for name, estimate in record.combinations.items()]
    ratios = {"friction over torque limit": record.friction_ratio, "dead band": record.dead_band}
    if record.coulomb_friction is None:
        known += [f"{name} = {number(estimate.value)}" for name, estimate in ratios.items() if estimate is not None]
    return f"; known instead: {', '.join(known)}" if known else ""
