"""Webots: `staticFriction` and `dampingConstant` of a `HingeJointParameters`.

Webots' `staticFriction` has no effect while a motor is under position or velocity control; under torque control it is
Coulomb friction (https://github.com/cyberbotics/webots/issues/2483). Webots has no rotor inertia.
"""

from __future__ import annotations

from stiction.formats.errors import StictionError
from stiction.identify.convert.physics import Conversion, JointPhysics, beyond_coulomb, number, one_line


def webots_snippet(joints: list[JointPhysics]) -> Conversion:
    """Return `jointParameters` fields, one a joint, for a PROTO or a world; raise `StictionError` for a linear axis."""
    linear = next((joint.recorded for joint in joints if joint.record.axis == "linear"), None)
    if linear is not None:
        raise StictionError(f"record {linear!r} is of a linear axis; HingeJointParameters are for rotary ones")
    notes = _notes(joints)
    lines = [f"# {note}" for note in notes]
    for joint in joints:
        known = {"staticFriction": joint.friction, "dampingConstant": joint.damping}
        fields = [f"  {name} {number(value)}" for name, value in known.items() if value is not None]
        lines += [f"# {one_line(joint.name)}", "jointParameters HingeJointParameters {", *fields, "}"]
    return Conversion("\n".join(lines) + "\n", {joint.name: joint.recorded for joint in joints}, tuple(notes))


def _notes(joints: list[JointPhysics]) -> list[str]:
    """Say under which control this acts, then what was left out of each joint."""
    notes = [
        "written by `stiction convert` from an identification",
        "staticFriction acts only under torque control (setTorque); under position or velocity control Webots ignores "
        "it: let the controller run its own PD at every basicTimeStep and set torques",
        "add the fields to each joint's own HingeJointParameters, beside its axis and anchor",
    ]
    for joint in joints:
        rotor = []
        if joint.armature is not None:
            rotor = [
                f"Webots has no rotor inertia: {number(joint.armature)} is left out, a physics plugin could add it"
            ]
        notes += [f"{joint.name}: {note}" for note in (*joint.notes, *rotor, *beyond_coulomb(joint.record))]
    return [one_line(note) for note in notes]
