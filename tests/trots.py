"""Walks of simulated robots of known friction as strangers log them: sampled, in their columns, nothing of the truth.

Physics and motor controllers run at 1 kHz; targets come at 50 Hz, from an open-loop trot (Go2) or a trained policy
(hexapod). A sample holds what an on-board computer reads at its stamp: encoders, torques, and an IMU that is not at the
base's origin.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to have a robot walk")

import mujoco

from stiction.core.rotation import into_frame
from stiction.deploy.policy import load_policy
from stiction.evaluate.rollout import Rollout
from stiction.evaluate.walk_logs import record_motion
from stiction.formats.log import BodySignals, JointSignals, Log
from stiction.robots.catalog import find_robot
from stiction.robots.mjcf import build_model
from stiction.robots.model import Robot
from walks import walking_bundle

GO2, HEXAPOD = find_robot("go2"), find_robot("saturn_lite")

TIMESTEP = 0.001
"""Of the physics and the motor controllers [s]."""

KP, KD, DAMPING, ARMATURE = 60.0, 1.5, 0.05, 0.01
"""The trot's gains [N m/rad], [N m s/rad], and the Go2's viscous friction [N m s/rad] and rotors [kg m²]."""

IMU = (-0.02557, 0.0, 0.04232)
"""Where the IMU is in the base's frame [m]."""

LINK = 0.213
"""Length of the Go2's thigh and calf [m]."""


@dataclass(frozen=True)
class Walked:
    """What a robot did at 1 kHz, T samples, without errors: what its sensors would read, and no more."""

    position: np.ndarray
    velocity: np.ndarray
    target: np.ndarray
    torque: np.ndarray
    quaternion: np.ndarray
    gyroscope: np.ndarray
    accelerometer: np.ndarray
    foot_force: np.ndarray


def limits(spec: Robot) -> np.ndarray:
    """Return the motors' torque limits [N m], shape (J,)."""
    return spec.joint_values("torque_limit")


def asked(time: float, phases: np.ndarray, pace: float) -> np.ndarray:
    """Return the angles that the trot asks for at a time [s], shape (12,): diagonal legs together."""
    found = np.empty((4, 3))
    for leg, (side, offset) in enumerate(((-1, 0.0), (1, 0.5), (-1, 0.5), (1, 0.0))):
        phase = (time * pace + offset) % 1.0
        lift = max(0.0, np.sin(2 * np.pi * phase))
        stride = 0.05 + 0.02 * np.sin(0.9 * time + phases[leg])
        x = -stride * np.cos(2 * np.pi * phase) - 0.01
        z = -0.30 + 0.08 * lift
        calf = -2 * np.arccos(np.hypot(x, z) / (2 * LINK))
        sway = 0.06 * np.sin(1.3 * time + phases[4]) + side * 0.12 * lift
        found[leg] = (side * 0.02 + sway, np.arctan2(-x, -z) - calf / 2, calf)
    return found.ravel()


def trot(friction: np.ndarray, seconds: float = 5.0, seed: int = 0) -> Walked:
    """Return a trot of a Go2 whose joints have dry friction [N m], shape (12,)."""
    generator = np.random.default_rng(seed)
    phases, pace = generator.uniform(0, 2 * np.pi, 5), generator.uniform(1.5, 1.9)
    model = build_model(GO2, TIMESTEP)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.dof_frictionloss[6:], model.dof_damping[6:] = friction, DAMPING
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7:] = asked(0.0, phases, pace)
    rows: list[tuple[np.ndarray, ...]] = []
    for step in range(round(seconds / TIMESTEP)):
        if step % 20 == 0:
            target = asked(step * TIMESTEP, phases, pace)
        before, turned = data.qvel.copy(), data.qpos[3:7].copy()
        torque = np.clip(KP * (target - data.qpos[7:]) - KD * data.qvel[6:], -limits(GO2), limits(GO2))
        data.qfrc_applied[6:] = torque
        state = (data.qpos[7:].copy(), before[6:], target, torque, turned, before[3:6])
        mujoco.mj_step(model, data)
        change = (data.qvel[:6] - before[:6]) / TIMESTEP
        push = at_imu(into_frame(turned, change[:3] + np.array([0, 0, 9.81])), before[3:6], change[3:])
        rows.append((*state, push, data.sensordata[:4].copy()))
    assert data.qpos[2] > 0.2, "the robot fell"
    return Walked(*(np.array(column) for column in zip(*rows, strict=True)))


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


def at_imu(force: np.ndarray, rate: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Return the specific force at the IMU [m/s²], shape (3,), from that at the base's origin."""
    return force + np.cross(turning, IMU) + np.cross(rate, np.cross(rate, IMU))


def sampled(spec: Robot, truth: Walked, every: int = 2, seed: int = 0) -> dict[str, np.ndarray]:
    """Return what a computer logs that reads one sample in `every`, with the errors of common sensors."""
    generator = np.random.default_rng([seed, 7])
    raw = {item.name: getattr(truth, item.name)[::every].copy() for item in fields(Walked)}
    sizes = {"velocity": 0.02, "torque": 0.005 * limits(spec), "gyroscope": 0.003, "accelerometer": 0.05}
    for name, size in sizes.items():
        raw[name] += size * generator.standard_normal(raw[name].shape)
    raw["torque"] += 0.005 * limits(spec) * generator.uniform(-1, 1, spec.num_joints)
    raw["accelerometer"] += 0.05 * generator.uniform(-1, 1, 3)
    step = 2 * np.pi / 2**15
    raw["position"] = np.round(raw["position"] / step) * step
    if spec is GO2:  # its sensors count in a unit of their own, and not from zero
        raw["foot_force"] = np.round(20 + raw["foot_force"] + 3 * generator.standard_normal(raw["foot_force"].shape))
    return raw | {"time": np.arange(len(raw["position"])) * TIMESTEP * every}


def opened(spec: Robot, raw: dict[str, np.ndarray], **body: np.ndarray | None) -> Log:
    """Return the log as the door gives it, without a file; body: what is different of the body."""
    roles = ("position", "velocity", "target", "torque")
    joints = {
        name.removesuffix("_joint"): JointSignals(**{role: raw[role][:, index] for role in roles})
        for index, name in enumerate(spec.joint_names)
    }
    known = {name: raw[name] for name in ("quaternion", "gyroscope", "accelerometer", "foot_force")}
    return Log("walk.csv", raw["time"], joints, body=BodySignals(**known | body))  # type: ignore[arg-type]


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
