"""Motors of a running mjlab robot: torque limits and gains, as its compiled model has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mjlab.actuator import BuiltinDcMotorActuator, BuiltinPdActuator, BuiltinPositionActuator, IdealPdActuator
from mjlab.actuator.actuator import TransmissionType

from stiction.core.errors import ConfigurationError
from stiction.files.log import Axis

KINDS: dict[str, Axis] = {"mjJNT_HINGE": "rotary", "mjJNT_SLIDE": "linear"}
"""Type of a joint in MuJoCo -> axis of its record."""


@dataclass(frozen=True)
class Motor:
    """Motor of one joint."""

    joint: int
    """Index among the robot's joints."""
    axis: Axis
    limit: float | None
    """Torque limit [N m]; None where there is none."""
    kp: float | None = None
    """Proportional gain [N m/rad]; None of an actuator that has no such gain."""
    kd: float | None = None
    """Derivative gain [N m s/rad]."""
    lag: int | None = 0
    """Physics steps by which the target comes late; None where it varies."""


def motors_of(env: Any, asset: Any, world: int = 0) -> dict[str, Motor]:
    """Return joint -> its motor, in the order of the robot's joints.

    env: mjlab's `ManagerBasedRlEnv`; asset: its `Entity`; world: robot of the gains, where those are drawn.
    """
    motors: dict[int, tuple[str, Motor]] = {}
    for actuator in asset.actuators:
        if actuator.transmission_type != TransmissionType.JOINT:
            continue
        for number, (name, joint) in enumerate(zip(actuator.target_names, actuator.target_ids.tolist(), strict=True)):
            control, number_of_all = int(actuator.global_ctrl_ids[number]), int(asset.indexing.joint_ids[joint])
            limit, gains = _limit(env.sim.mj_model, number_of_all, control), _gains(env, actuator, number, world)
            least, most = actuator.cfg.delay_min_lag, actuator.cfg.delay_max_lag
            lag = most if least == most else None
            motors[joint] = name, Motor(joint, KINDS[asset.indexing.joints[joint].type.name], limit, *gains, lag)
    return {name: motor for _, (name, motor) in sorted(motors.items())}


def limits_of(motors: dict[str, Motor]) -> list[float]:
    """Return the torque limits of all motors; raise `ConfigurationError` for one that has none."""
    limits = []
    for name, motor in motors.items():
        if motor.limit is None:
            raise ConfigurationError(
                f"joint {name!r}: got no torque limit, of which friction is a share; set effort_limit of its actuator"
            )
        limits.append(motor.limit)
    return limits


def _limit(model: Any, joint: int, actuator: int) -> float | None:
    """Return the least of the limits that a compiled model has on an actuator and on its joint [N m]."""
    limits = []
    if model.actuator_forcelimited[actuator]:
        limits.append(model.actuator_gear[actuator, 0] * model.actuator_forcerange[actuator, 1])
    if model.jnt_actfrclimited[joint]:
        limits.append(model.jnt_actfrcrange[joint, 1])
    least = min(limits, default=np.inf)
    return float(least) if np.isfinite(least) else None


def _gains(env: Any, actuator: Any, number: int, world: int) -> tuple[float | None, float | None]:
    """Return kp and kd of one joint of an actuator, as they are in a world; None without gains."""
    if (gains := gains_of(env, actuator)) is None:
        return None, None
    return float(gains[0][world, number]), float(gains[1][world, number])


def gains_of(env: Any, actuator: Any, default: bool = False) -> tuple[Any, Any] | None:
    """Return kp and kd of an actuator's joints, two tensors of shape (num_envs, joints); None without gains.

    default: those before any draw, of shape (1, joints) or (num_envs, joints).
    """
    if isinstance(actuator, IdealPdActuator):
        drawn = actuator.stiffness, actuator.damping
        return (actuator.default_stiffness, actuator.default_damping) if default else drawn
    gain, bias = (_of_model(env, f"actuator_{name}", default) for name in ("gainprm", "biasprm"))
    controls = actuator.global_ctrl_ids
    if isinstance(actuator, BuiltinPdActuator):
        positions, speeds = controls.split(actuator.num_targets)
        return gain[:, positions, 0], gain[:, speeds, 0]
    if isinstance(actuator, BuiltinDcMotorActuator):
        return gain[:, controls, 4], gain[:, controls, 6]
    if isinstance(actuator, BuiltinPositionActuator) or getattr(actuator, "command_field", "") == "position":
        return gain[:, controls, 0], -bias[:, controls, 2]
    return None


def torque_limits_of(env: Any, actuator: Any, default: bool = False) -> tuple[Any]:
    """Return the torque limits of an actuator's joints that mjlab may draw [N m]: a tensor shaped like `gains_of`'s."""
    if isinstance(actuator, IdealPdActuator):
        return (actuator.default_force_limit if default else actuator.force_limit,)
    if isinstance(actuator, BuiltinPdActuator):
        joints = actuator.entity.indexing.joint_ids[actuator.target_ids]
        return (_of_model(env, "jnt_actfrcrange", default)[:, joints, 1],)
    return (_of_model(env, "actuator_forcerange", default)[:, actuator.global_ctrl_ids, 1],)


def _of_model(env: Any, field: str, default: bool) -> Any:
    """Return a field of the compiled model, as it is in each world or as it was before any draw."""
    return env.sim.get_default_field(field).unsqueeze(0) if default else getattr(env.sim.model, field)
