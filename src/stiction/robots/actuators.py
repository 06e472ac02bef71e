"""What a robot's file says of its motors: torque limits from the places that MJCF has for them, and gains."""

from __future__ import annotations

import math

import mujoco
import numpy as np


def _actuators(model: mujoco.MjModel, joint: int) -> list[int]:
    """Return the numbers of the actuators that drive a joint."""
    return [
        number
        for number in range(model.nu)
        if int(model.actuator_trntype[number]) == int(mujoco.mjtTrn.mjTRN_JOINT)
        and int(model.actuator_trnid[number, 0]) == joint
    ]


def torque_limit(model: mujoco.MjModel, joint: int) -> tuple[float, str]:
    """Return the smallest torque limit that the file states, and where; 0 where it states none."""
    found: list[tuple[float, str]] = []
    if model.jnt_actfrclimited[joint]:
        found.append((float(np.abs(model.jnt_actfrcrange[joint]).min()), "file: actuatorfrcrange, or effort"))
    for actuator in _actuators(model, joint):
        gear = abs(float(model.actuator_gear[actuator, 0]))
        if model.actuator_forcelimited[actuator]:
            found.append((gear * float(np.abs(model.actuator_forcerange[actuator]).min()), "file: forcerange"))
        # Without a bias the control is a torque; that of a position actuator is an angle, and its range says nothing
        # here.
        motor = not np.any(model.actuator_biasprm[actuator])
        if motor and model.actuator_ctrllimited[actuator]:
            gain = gear * abs(float(model.actuator_gainprm[actuator, 0]))
            found.append(
                (gain * float(np.abs(model.actuator_ctrlrange[actuator]).min()), "file: ctrlrange of its motor")
            )
    return min((pair for pair in found if pair[0] > 0), default=(0.0, "file: none"))


def gains(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Return kp and kd of the position actuator that drives a joint in the file; 0 where there is none."""
    for actuator in _actuators(model, joint):
        kp, (_, minus_kp, minus_kd) = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator, :3]
        # Its position is gear times the joint's angle, and its force gear times as much at the joint.
        squared = math.prod([float(model.actuator_gear[actuator, 0])] * 2)
        if kp * squared > 0 and math.isclose(kp, -minus_kp):
            return squared * kp, squared * float(-minus_kd)
    return 0.0, 0.0
