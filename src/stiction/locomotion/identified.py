"""From an identification to the nominal joints of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.joints import Estimate, JointRecord, JointsFile


@dataclass(frozen=True)
class IdentifiedJoints:
    """What an identification says about each joint of a robot; None where the robot's own value stays."""

    armature: tuple[float | None, ...]
    """Rotor inertia [kg m²]: the identified inertia less that of the links it was measured with."""
    damping: tuple[float | None, ...]
    """Viscous friction [N m s/rad]."""
    frictionloss: tuple[float | None, ...]
    """Coulomb friction [N m]."""
    warnings: tuple[str, ...]
    """What was not used, and why."""


def identified_joints(
    file: JointsFile, joint_names: tuple[str, ...], link_inertia: np.ndarray, torque_limit: np.ndarray
) -> IdentifiedJoints:
    """Read the nominal joints of a robot from an identification.

    A record stands for the joint of its name, `FL_shank`, or for all of its kind, `shank`. Quantities that are null
    stay as the robot has them. The simulator adds the links' inertia itself, so it is taken off what was measured on a
    leg in the air; the inertia of a loaded or unstated test says nothing about the rotor, and is not used. Where no
    torque was measured, friction is known as a share of the torque limit alone, in units of the command, and that share
    of the robot's own limit is taken.

    `link_inertia`: what the links put on each joint [kg m²], (joints,); `torque_limit` [N m], (joints,). Raises
    `StictionError` where the file holds nothing that can be used for this robot, a linear axis, or an inertia smaller
    than the links' own.
    """
    armature: list[float | None] = []
    damping: list[float | None] = []
    frictionloss: list[float | None] = []
    warnings: dict[str, None] = {}
    for name, links, limit in zip(joint_names, link_inertia, torque_limit, strict=True):
        key = file.key(name)
        record = file.joints[key] if key is not None else JointRecord()
        if record.axis != "rotary":
            raise StictionError(f"joint {key!r} was identified as a linear axis (kg, N); expected a rotary one")
        armature.append(_armature(name, key, record, float(links), warnings))
        damping.append(_value(record.viscous_friction))
        frictionloss.append(_friction(key, record, float(limit), warnings))
    if all(value is None for value in (*armature, *damping, *frictionloss)):
        raise StictionError(
            f"the file has {', '.join(file.joints)}, and nothing that can be used for {', '.join(joint_names[:3])} and "
            "so on; name the joint, or its kind, when you identify it"
        )
    return IdentifiedJoints(tuple(armature), tuple(damping), tuple(frictionloss), tuple(warnings))


def _value(estimate: Estimate | None) -> float | None:
    """Return an estimate of friction as simulators take it: what is below zero is zero."""
    return None if estimate is None else max(0.0, estimate.value)


def _friction(key: str | None, record: JointRecord, limit: float, warnings: dict[str, None]) -> float | None:
    """Return the Coulomb friction [N m] of a joint whose motor gives `limit`, from newton metres or from the ratio."""
    if record.coulomb_friction is not None or record.friction_ratio is None:
        return _value(record.coulomb_friction)
    ratio = max(0.0, record.friction_ratio.value)
    warnings[
        f"the friction of {key!r} is known in units of the command only, no torque was measured: {100 * ratio:.3g} % "
        "of the robot's own torque limit is taken, as if the motor had its nominal strength"
    ] = None
    return ratio * limit


def _armature(name: str, key: str | None, record: JointRecord, links: float, warnings: dict[str, None]) -> float | None:
    """Return the rotor inertia of joint `name` that its record, `key`, implies, or None where it implies none."""
    if record.inertia is None:
        return None
    if record.test_condition not in ("bare_motor", "in_air"):
        stated = f"was measured {record.test_condition}" if record.test_condition else "has no test condition"
        warnings[f"the inertia of {key!r} {stated}: it is not used, and the robot's own rotor inertia stays"] = None
        return None
    measured = record.inertia.value
    if measured <= 0:
        raise StictionError(f"joint {name!r}: an inertia of {measured:.4g} kg m²; expected a positive number")
    if record.test_condition == "bare_motor":
        return measured
    if measured <= links:
        raise StictionError(
            f"joint {name!r}: {measured:.4g} kg m² was measured in the air, and the robot's links alone have "
            f"{links:.4g}; expected more: correct the robot's masses, or identify the bare motor"
        )
    return measured - links
