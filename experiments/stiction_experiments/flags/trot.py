"""A trot of a simulated Go2 of known friction as a stranger logs it: sampled, in its columns, nothing of the truth.

Physics and motor controllers run at 1 kHz; targets come at 50 Hz from an open loop. A sample holds what an on-board
computer reads at its stamp: encoders, torques, and an IMU that is not at the base's origin.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import mujoco
import numpy as np

from stiction.core.errors import EngineError
from stiction.core.rotation import into_frame
from stiction.files.log import BodySignals, JointSignals, Log
from stiction.robots.catalog import find_robot
from stiction.robots.mjcf import build_model
from stiction.robots.model import GRAVITY, Robot

ROBOT = "go2"
"""The robot that trots."""

TIMESTEP = 0.001
"""Time step of the physics and the motor controllers [s]."""

KP, KD, DAMPING, ARMATURE = 60.0, 1.5, 0.05, 0.01
"""The trot's gains [N m/rad], [N m s/rad], viscous friction [N m s/rad] and rotors [kg m²]."""

IMU = (-0.02557, 0.0, 0.04232)
"""Where the IMU is in the base's frame [m]."""

LINK = 0.213
"""Length of thigh and calf [m]."""

LEAST_HEIGHT = 0.2
"""Height of the base under which the robot has fallen [m]."""


@dataclass(frozen=True)
class Walked:
    """Ideal sensor readings of a walking robot at 1 kHz, T samples."""

    position: np.ndarray
    """[rad], shape (T, J)."""
    velocity: np.ndarray
    """[rad/s], shape (T, J)."""
    target: np.ndarray
    """[rad], shape (T, J)."""
    torque: np.ndarray
    """[N m], shape (T, J)."""
    quaternion: np.ndarray
    """w x y z, shape (T, 4)."""
    gyroscope: np.ndarray
    """[rad/s], shape (T, 3)."""
    accelerometer: np.ndarray
    """[m/s²], shape (T, 3)."""
    foot_force: np.ndarray
    """[N], or contact as 0 and 1, shape (T, L)."""


def limits(spec: Robot) -> np.ndarray:
    """Return the motors' torque limits [N m], shape (J,)."""
    return spec.joint_values("torque_limit")


def asked(time: float, phases: np.ndarray, pace: float) -> np.ndarray:
    """Return the angles that the trot asks for at a time [s], shape (12,): diagonal legs together.

    phases: of the sway, shape (5,); pace: steps a second [Hz].
    """
    angles = np.empty((4, 3))
    for leg, (side, offset) in enumerate(((-1, 0.0), (1, 0.5), (-1, 0.5), (1, 0.0))):
        phase = (time * pace + offset) % 1.0
        lift = max(0.0, np.sin(2 * np.pi * phase))
        stride = 0.05 + 0.02 * np.sin(0.9 * time + phases[leg])
        x = -stride * np.cos(2 * np.pi * phase) - 0.01
        z = -0.30 + 0.08 * lift
        calf = -2 * np.arccos(np.hypot(x, z) / (2 * LINK))
        sway = 0.06 * np.sin(1.3 * time + phases[4]) + side * 0.12 * lift
        angles[leg] = (side * 0.02 + sway, np.arctan2(-x, -z) - calf / 2, calf)
    return angles.ravel()


def trot(friction: np.ndarray, seconds: float = 5.0, seed: int = 0) -> Walked:
    """Return a trot whose joints have dry friction [N m], shape (12,). Raises `EngineError` where the robot falls."""
    generator, spec = np.random.default_rng(seed), find_robot(ROBOT)
    phases, pace = generator.uniform(0, 2 * np.pi, 5), generator.uniform(1.5, 1.9)
    model = build_model(spec, TIMESTEP)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.dof_frictionloss[6:], model.dof_damping[6:] = friction, DAMPING
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7:] = asked(0.0, phases, pace)
    most = limits(spec)
    rows: list[tuple[np.ndarray, ...]] = []
    for step in range(round(seconds / TIMESTEP)):
        if step % 20 == 0:
            target = asked(step * TIMESTEP, phases, pace)
        # What is read at a stamp is the state before the step, and the torque that acts over it.
        before, turned = data.qvel.copy(), data.qpos[3:7].copy()
        torque = np.clip(KP * (target - data.qpos[7:]) - KD * data.qvel[6:], -most, most)
        data.qfrc_applied[6:] = torque
        state = (data.qpos[7:].copy(), before[6:], target, torque, turned, before[3:6])
        mujoco.mj_step(model, data)
        change = (data.qvel[:6] - before[:6]) / TIMESTEP
        push = at_imu(into_frame(turned, change[:3] + np.array([0, 0, GRAVITY])), before[3:6], change[3:])
        rows.append((*state, push, data.sensordata[:4].copy()))
    if data.qpos[2] < LEAST_HEIGHT:
        raise EngineError(f"the robot fell in its trot with seed {seed}; expected a friction at which it walks")
    return Walked(*(np.array(column) for column in zip(*rows, strict=True)))


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
    if spec.name == ROBOT:  # its sensors count in a unit of their own, and not from zero
        raw["foot_force"] = np.round(20 + raw["foot_force"] + 3 * generator.standard_normal(raw["foot_force"].shape))
    return raw | {"time": np.arange(len(raw["position"])) * TIMESTEP * every}


def opened(spec: Robot, raw: dict[str, np.ndarray], **body: np.ndarray | None) -> Log:
    """Return the log as the door gives it, without a file, of what there is; body: what is different of the body."""
    roles = ("position", "velocity", "target", "torque")
    joints = {
        name.removesuffix("_joint"): JointSignals(**{role: raw[role][:, index] for role in roles if role in raw})
        for index, name in enumerate(spec.joint_names)
    }
    known = {name: raw.get(name) for name in ("quaternion", "gyroscope", "accelerometer", "foot_force")}
    return Log("walk.csv", raw["time"], joints, body=BodySignals(**known | body))  # type: ignore[arg-type]
