"""Walks of simulated robots of known friction as strangers log them: sampled, in their columns, nothing of the truth.

Physics and motor controllers run at 1 kHz; targets come at 50 Hz, from an open-loop trot (Go2, `studies.flags.trot`) or
a trained policy (hexapod).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to have a robot walk")

from stiction.deploy.policy import load_policy
from stiction.evaluation.rollout import Rollout
from stiction.evaluation.walk_logs import record_motion
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction_experiments.flags.trot import (
    ARMATURE,
    DAMPING,
    IMU,
    KD,
    KP,
    TIMESTEP,
    Walked,
    at_imu,
    limits,
    opened,
    sampled,
    trot,
)
from walks import walking_bundle

__all__ = ["ARMATURE", "DAMPING", "IMU", "KD", "KP", "Walked", "limits", "opened", "sampled", "trot"]

GO2, HEXAPOD = find_robot("go2"), find_robot("saturn_lite")


def hexapods(friction: np.ndarray, command: tuple[float, float, float], seconds: float, seed: int = 0) -> list[Walked]:
    """Return walks of hexapods whose joints have dry friction [N m], shape (N, 18); those that fell are left out."""
    bundle = walking_bundle()
    contract = replace(bundle.contract, physics_timestep=TIMESTEP, decimation=20)
    generators = [np.random.default_rng([seed, index]) for index in range(len(friction))]
    rollout = Rollout(contract, load_policy(contract, bundle.policy, (len(friction),)), HEXAPOD, friction, generators)
    steps = round(seconds / contract.control_period)
    found = []
    for truth in record_motion(rollout, contract.array("kd"), np.tile(command, (len(friction), 1)), steps):
        if truth is None or len(truth["time"]) < steps * 20:
            continue
        rate = truth["angular_velocity"]
        turning = np.gradient(rate, TIMESTEP, axis=0)
        force = np.stack([at_imu(*row) for row in zip(truth["specific_force"], rate, turning, strict=True)])
        names = ("joint_position", "joint_velocity", "joint_target", "joint_torque", "quaternion")
        found.append(Walked(*(truth[name] for name in names), rate, force, truth["foot_contact"].astype(float)))
    return found


def unitree_columns(raw: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of the maker's messages as PlotJuggler names them."""
    table = {"__time": raw["time"]}
    motor = {"q": "position", "dq": "velocity", "tau_est": "torque"}
    for index in range(raw["position"].shape[1]):
        table |= {f"/lowstate/motor_state[{index}]/{key}": raw[role][:, index] for key, role in motor.items()}
        table[f"/lowcmd/motor_cmd[{index}]/q"] = raw["target"][:, index]
    for name in ("quaternion", "gyroscope", "accelerometer"):
        for index, column in enumerate(raw[name].T):
            table[f"/lowstate/imu_state/{name}[{index}]"] = column
    return table | {f"/lowstate/foot_force[{index}]": column for index, column in enumerate(raw["foot_force"].T)}


def ros_columns(spec: Robot, raw: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns of joint states, their command and an IMU as PlotJuggler names them."""
    table = {"__time": raw["time"]}
    for index, name in enumerate(spec.joint_names):
        for key, role in (("position", "position"), ("velocity", "velocity"), ("effort", "torque")):
            table[f"/joint_states/{name}/{key}"] = raw[role][:, index]
        table[f"/joint_command/{name}/position"] = raw["target"][:, index]
    for axis, column in zip("wxyz", raw["quaternion"].T, strict=True):
        table[f"/imu/data/orientation/{axis}"] = column
    for stem, name in (("angular_velocity", "gyroscope"), ("linear_acceleration", "accelerometer")):
        table |= {f"/imu/data/{stem}/{axis}": column for axis, column in zip("xyz", raw[name].T, strict=True)}
    return table
