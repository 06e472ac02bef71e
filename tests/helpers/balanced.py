"""Logs of any robot in made-up motion: its feet's efforts balance the base, its motors do the rest. No simulation.

The base, which turns and shakes, and all joints move along sines. On what is down acts the smallest effort that gives
the base its acceleration, in the full model's inverse dynamics, and the torque of the motors follows from it.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from stiction.core.rotation import matrix, up_in_frames
from stiction.files.walk import WalkHeader, WalkLog
from stiction.robots.mjcf import build_model
from stiction.robots.model import Robot

PERIOD = 0.005

Friction = Mapping[str, tuple[float, float, float]]
"""Kind -> viscous friction B [N m s/rad], dry friction b [N m] and its growth with load c [1]."""


def sines(generator: np.random.Generator, samples: int, columns: int, size: float) -> np.ndarray:
    """Return smooth signals about zero, shape (samples, columns): three sines each, slower than 2 Hz."""
    time = PERIOD * np.arange(samples)[:, None, None]
    frequency, phase = generator.uniform(0.5, 2.0, (3, columns)), generator.uniform(0, 2 * np.pi, (3, columns))
    return size / 3 * np.sin(2 * np.pi * frequency * time + phase).sum(axis=1)


def walk(spec: Robot, order: list[list[int]], friction: Friction, seconds: float = 10.0, seed: int = 0) -> WalkLog:
    """Return the log of a robot whose feet of `order[n]` are down in the n-th quarter of a second, and so on again.

    Two feet that are balls cannot balance a base. Rotors are those of the robot's data.
    """
    generator, samples = np.random.default_rng(seed), round(seconds / PERIOD)
    model = build_model(spec, PERIOD)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    position = spec.joint_values("default_position") + sines(generator, samples + 2, spec.num_joints, 0.35)
    spin, push = sines(generator, samples + 1, 3, 0.5), sines(generator, samples, 3, 2.0)
    velocity = np.diff(position, axis=0) / PERIOD
    position, acceleration = position[1:-1], np.diff(velocity, axis=0) / PERIOD
    turn = np.diff(spin, axis=0) / PERIOD
    quaternion = np.concatenate([np.ones((samples, 1)), sines(generator, samples, 3, 0.1)], axis=1)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    down = np.zeros((samples, len(spec.feet)), bool)
    for sample in range(samples):
        down[sample, order[int(sample * PERIOD / 0.25) % len(order)]] = True
    torque, specific = np.empty((samples, spec.num_joints)), np.empty((samples, 3))
    levels = np.array([friction[joint.kind] for joint in spec.joints]).T
    for sample in range(samples):
        data.qpos[:7], data.qpos[7:] = [0, 0, 1, *quaternion[sample]], position[sample]
        data.qvel[:] = np.concatenate([np.zeros(3), spin[sample], velocity[sample]])
        data.qacc[:] = np.concatenate([push[sample], turn[sample], acceleration[sample]])
        mujoco.mj_inverse(model, data)
        needed = data.qfrc_inverse - _of_feet(spec, model, data, down[sample])
        rate = velocity[sample + 1]
        direction, (viscous, dry, growth) = np.sign(rate), levels
        free = needed[6:] + viscous * rate + dry * direction
        # τ = free + c |τ| sign(θ') has the sign of `free`, since c < 1.
        torque[sample] = free / (1 - growth * direction * np.sign(free))
        specific[sample] = matrix(quaternion[sample]).T @ (push[sample] + [0, 0, 9.81])
    assert np.abs(up_in_frames(quaternion)[:, 2]).min() > 0.9
    header = WalkHeader(
        robot=spec.name,
        joint_names=spec.joint_names,
        foot_names=spec.foot_names,
        period=PERIOD,
        kp=tuple(spec.joint_values("kp").tolist()),
        kd=tuple(spec.joint_values("kd").tolist()),
        torque_limit=tuple(spec.joint_values("torque_limit").tolist()),
        torque_source="motor_side",
    )
    return WalkLog(
        header,
        time=PERIOD * np.arange(samples),
        joint_position=position,
        joint_velocity=velocity[:-1],
        joint_target=position,
        angular_velocity=spin[:-1],
        quaternion=quaternion,
        joint_torque=torque,
        specific_force=specific,
        foot_contact=down,
    )


def _of_feet(spec: Robot, model: mujoco.MjModel, data: mujoco.MjData, down: np.ndarray) -> np.ndarray:
    """Return what the ground does along every degree of freedom, so that nothing is left for the base to do itself."""
    columns = []
    for foot in [foot for foot, is_down in zip(spec.feet, down, strict=True) if is_down]:
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        point = data.site(foot.name).xpos - [0, 0, foot.radius]
        mujoco.mj_jac(model, data, linear, angular, point, model.site(foot.name).bodyid[0])
        columns += [linear] if foot.shapes[0].kind == "sphere" else [linear, angular]
    jacobian = np.concatenate(columns)
    effort, *_ = np.linalg.lstsq(jacobian[:, :6].T, data.qfrc_inverse[:6], rcond=None)
    pushed = jacobian.T @ effort
    np.testing.assert_allclose(pushed[:6], data.qfrc_inverse[:6], atol=1e-6)
    return pushed
