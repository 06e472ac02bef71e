"""Actuators of a compiled model at the joint: torque limit, gains, and inertia and damping behind the gear.

An actuator's `armature` and `damping` are at its rotor. At the joint they count gear² times, since gear scales both
force and speed, and MuJoCo adds them to those of the joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
"""Transmissions that act on one joint."""

DIRECT = tuple(int(getattr(mujoco.mjtDyn, f"mjDYN_{name}")) for name in ("NONE", "FILTER", "FILTEREXACT"))
"""Dynamics that settle at the control itself."""

FIXED, PID, DCMOTOR = (int(getattr(mujoco.mjtGain, f"mjGAIN_{name}")) for name in ("FIXED", "PID", "DCMOTOR"))
"""Numbers of MuJoCo's kinds of gain."""


def _actuators(model: mujoco.MjModel, joint: int) -> list[tuple[int, float]]:
    """Return the number and the gear of each actuator that drives a joint."""
    # Controls and outputs have numbers of their own: an actuator may have several, or none.
    return [
        (number, float(model.actuator_gear[model.actuator_outadr[number], 0]))
        for number in range(model.nactuator)
        if int(model.actuator_trntype[number]) in ON_JOINT and int(model.actuator_trnid[number, 0]) == joint
    ]


def armature(model: mujoco.MjModel, joint: int) -> float:
    """Return the rotor inertia at a joint, with that of its actuators [kg m²]."""
    inertia = float(model.dof_armature[model.jnt_dofadr[joint]])
    return inertia + sum(gear**2 * float(model.actuator_armature[number]) for number, gear in _actuators(model, joint))


def damping(model: mujoco.MjModel, joint: int) -> tuple[float, bool]:
    """Return the damping at a joint, with that of its actuators [N m s/rad], and whether it grows with speed."""
    dof, driving = int(model.jnt_dofadr[joint]), _actuators(model, joint)
    linear = float(model.dof_damping[dof])
    linear += sum(gear**2 * float(model.actuator_damping[number]) for number, gear in driving)
    higher = (model.dof_dampingpoly[dof], *(model.actuator_dampingpoly[number] for number, _ in driving))
    return linear, bool(np.any(higher))


def torque_limit(model: mujoco.MjModel, joint: int) -> tuple[float, str]:
    """Return the smallest torque limit in the file, and its source; 0 where it has none."""
    stated: list[tuple[float, str]] = []
    if model.jnt_actfrclimited[joint]:
        stated.append((float(np.abs(model.jnt_actfrcrange[joint]).min()), "file: actuatorfrcrange, or effort"))
    for actuator, signed in _actuators(model, joint):
        gear, control = abs(signed), int(model.actuator_ctrladr[actuator])
        if model.actuator_forcelimited[actuator]:
            stated.append((gear * float(np.abs(model.actuator_forcerange[actuator]).min()), "file: forcerange"))
        # Without a bias the control is a torque; that of a servo is an angle, of a dcmotor a voltage.
        motor = model.actuator_gaintype[actuator] == FIXED and model.actuator_dyntype[actuator] in DIRECT
        if motor and not np.any(model.actuator_biasprm[actuator]) and model.actuator_ctrllimited[control]:
            gain = gear * abs(float(model.actuator_gainprm[actuator, 0]))
            stated.append(
                (gain * float(np.abs(model.actuator_ctrlrange[control]).min()), "file: ctrlrange of its motor")
            )
    return min((pair for pair in stated if pair[0] > 0), default=(0.0, "file: none"))


def gains(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Return kp and kd of the servo (position, pid, dcmotor) that drives a joint in the file; 0 without one."""
    for actuator, gear in _actuators(model, joint):
        kind, gain = int(model.actuator_gaintype[actuator]), model.actuator_gainprm[actuator]
        _, minus_kp, minus_kd = map(float, model.actuator_biasprm[actuator, :3])
        kp, kd = (float(gain[4]), float(gain[6])) if kind == DCMOTOR else (-minus_kp, -minus_kd)
        servo = kind in (PID, DCMOTOR) or (kind == FIXED and math.isclose(float(gain[0]), kp))
        # Its position is gear times the joint's angle, and its force gear times as much at the joint.
        if servo and kp * gear**2 > 0:
            return gear**2 * kp, gear**2 * kd
    return 0.0, 0.0


def unread(model: mujoco.MjModel) -> Iterator[str]:
    """Yield a sentence for every property of the actuators in a file that is not simulated."""
    kinds = model.actuator_gaintype
    integral = np.select([kinds == PID, kinds == DCMOTOR], model.actuator_gainprm[:, [0, 5]].T) != 0
    rotor = np.any((model.actuator_armature, model.actuator_damping, *model.actuator_dampingpoly.T), axis=0)
    for which, what in (
        (model.actuator_delay > 0, "delay their control; they act at once here, but for the delays that a task draws"),
        (
            (model.actuator_dyntype != DIRECT[0]) & ~np.isin(kinds, (PID, DCMOTOR)),
            "filter or integrate their control (dyntype); they act at once here",
        ),
        (integral, "have an integral gain ki, which is left out"),
        (
            kinds == DCMOTOR,
            "are dcmotors: of them gains and torque limit are read; back-EMF, inductance, cogging, heat and LuGre "
            "friction are not",
        ),
        (
            rotor & ~np.isin(model.actuator_trntype, ON_JOINT),
            "have armature or damping and drive no joint directly; both are left out",
        ),
    ):
        if np.any(which):
            yield f"the actuators {_named(model, np.flatnonzero(which).tolist())} {what}"


def _named(model: mujoco.MjModel, numbers: Sequence[int]) -> str:
    """Return the names of actuators, at most three of them."""
    names = [model.actuator(number).name or str(number) for number in numbers[:3]]
    return ", ".join(names) + (f" and {len(numbers) - 3} more" if len(numbers) > 3 else "")
