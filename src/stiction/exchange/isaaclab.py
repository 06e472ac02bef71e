"""Isaac Lab: actuator groups with joint friction as an effort, and the coefficient of the older PhysX on request.

On PhysX from 5.6 on (Isaac Sim 5, 6) `friction`, `dynamic_friction` [N m] and `viscous_friction` [N m s/rad] of an
actuator are what their names say. Before, `friction` was a unitless coefficient c, friction at most c (|F| + |T|) of
the force and torque that the joint transmits, so that no number in N m can be converted without saying under which
load. Newton, the other backend of Isaac Lab 3, has MuJoCo's row: `friction` alone, for rest and motion.
"""

from __future__ import annotations

from stiction.exchange.physics import (
    Conversion,
    JointPhysics,
    Which,
    breakaway_text,
    headline,
    known,
    notes_of,
    number,
)


def isaaclab_snippet(
    joints: list[JointPhysics], assumed_load: float | None = None, which: Which = "moving", newton: bool = False
) -> Conversion:
    """Return Python with one actuator group a joint; its name is the group's joint expression, a regular expression.

    assumed_load: |F| + |T| that the joint transmits [N + N m], for the coefficients of the older PhysX; without it none
    are written; which: friction of a coefficient, and on Newton; newton: True for that backend.
    """
    notes, held = _notes(joints, assumed_load, newton), frozenset() if newton else frozenset({"static_friction"})
    told = [headline(joints, held)]
    lines = [f"# {told[0]}", "", "from isaaclab.actuators import IdealPDActuatorCfg", "", "IDENTIFIED_ACTUATORS = {"]
    for joint in joints:
        lines += _group(joint, newton)
    lines.append("}")
    if assumed_load is not None:
        lines += ["", f"# unitless, PhysX before 5.6 only, at an assumed load of {number(assumed_load)} N + N m"]
        lines.append("FRICTION_COEFFICIENTS = {")
        for joint in joints:
            if joint.friction is not None:
                friction = joint.friction if which == "moving" else _at_rest(joint, joint.friction)
                lines.append(f"    {joint.name!r}: {number(friction / assumed_load)},")
        lines.append("}")
    return Conversion.of("\n".join(lines) + "\n", joints, notes, told)


def _group(joint: JointPhysics, newton: bool) -> list[str]:
    """Return the lines of one actuator group."""
    friction = {"friction": joint.friction}
    if not newton:
        rest = None if joint.friction is None else _at_rest(joint, joint.friction)
        friction = {"friction": rest, "dynamic_friction": joint.friction}
    values = known(
        effort_limit=joint.record.torque_limit, **friction, viscous_friction=joint.damping, armature=joint.armature
    )
    gains = {"stiffness": joint.record.kp, "damping": joint.record.kd}
    lines = [f"    {joint.name!r}: IdealPDActuatorCfg(", f"        joint_names_expr=[{joint.name!r}],"]
    for name, gain in gains.items():
        lines.append(f"        {name}={'None' if gain is None else number(gain)},  # of the test; put the policy's own")
    lines += [f"        {name}={value}," for name, value in values.items()]
    return [*lines, "    ),"]


def _at_rest(joint: JointPhysics, moving: float) -> float:
    """Return friction at rest [N m]; at least that in motion, which two noisy estimates may exceed."""
    static = joint.record.static_friction
    return moving if static is None else max(static.value, moving)


def _notes(joints: list[JointPhysics], assumed_load: float | None, newton: bool) -> list[str]:
    """Return notes on the versions that read this, then on the values left out of each joint."""
    if newton:
        return notes_of(joints, "for Newton, the other backend of Isaac Lab 3: one number for rest and motion")
    general = [
        "friction as an effort [N m] needs PhysX 5.6 or later (Isaac Sim 5 or 6): there friction holds at rest, "
        "dynamic_friction brakes in motion; for Newton (Isaac Lab 3) convert --to isaaclab_newton",
        "before that, friction is a unitless coefficient of the load on the joint: these numbers would mean something "
        "else; set friction to 0 there, or use coefficients for one load",
    ]
    if assumed_load is None:
        general.append(
            "no coefficient is written: it is f / (|F| + |T|), and the load is not known; give --assumed-load"
        )
    else:
        general.append(
            "the coefficients are right at the assumed load alone; viscous friction goes to the actuator there"
        )
    both = [
        f"{joint.recorded}: {breakaway_text(joint.record)}"
        for joint in joints
        if joint.record.static_friction is not None
    ]
    return notes_of(joints, *general, *both, represented=frozenset({"static_friction"}))
