"""The log of a walk on a virtual robot: what its sensors said, in the form in which every robot logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.formats.bundle import Bundle
from stiction.formats.walk import WalkHeader, WalkLog
from stiction.robots.spec import RobotSpec
from stiction.transfer.robot.pilot import Turn


def walk_log(turns: Sequence[Turn], bundle: Bundle, spec: RobotSpec, recorded_in: str, command: str = "") -> WalkLog:
    """Return the log of a walk; it knows what the policy's side knows, and nothing of the robot's truth.

    Args:
        turns: what the pilot saw and did, T control periods, at least one.
        bundle: the policy that walked.
        spec: the robot's data sheet.
        recorded_in: name of the engine.
        command: the command in words, where it did not change: `vx=0.5`.

    """
    contract = bundle.contract
    each = len(turns[0].readings)
    readings = [turns[0].before, *(reading for turn in turns for reading in turn.readings)]
    before, after = readings[:-1], readings[1:]

    def sensed(name: str) -> np.ndarray:
        return np.stack([getattr(reading.sensors, name) for reading in before])

    header = WalkHeader(
        robot=contract.robot,
        joint_names=contract.joint_names,
        foot_names=spec.foot_names,
        period=contract.control_period / each,
        kp=contract.kp,
        kd=contract.kd,
        torque_limit=contract.torque_limit,
        torque_source="motor_side",
        recorded_in=recorded_in,
        policy=bundle.name,
        command=command,
    )
    return WalkLog(
        header,
        time=np.array([reading.time for reading in before]),
        **{name: sensed(name) for name in Sensors.__dataclass_fields__},
        joint_target=np.repeat([turn.policy.target for turn in turns], each, axis=0),
        joint_torque=np.stack([reading.joint_torque for reading in after]),
        foot_contact=np.stack([reading.foot_contact for reading in before]),
        velocity_command=np.repeat([turn.velocity for turn in turns], each, axis=0),
    )
