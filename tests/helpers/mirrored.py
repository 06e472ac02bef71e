"""A task's state in the mirror, written apart from `locomotion.symmetry`: positions, quaternions, boxes, draws.

Given the map of the joints and feet, the reflection of everything that MuJoCo and the task hold: what a step makes of
it must be the reflection of what it makes of the state.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from stiction.robots.mirror import RobotMirror
from stiction.task.env import LocomotionEnv

VELOCITY = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Linear and angular velocity of a body."""

QUATERNION = np.array([1.0, -1.0, 1.0, -1.0])
"""w, x, y, z."""


def mirrored_state(env: LocomotionEnv, mirror: RobotMirror) -> dict[str, Any]:
    """Return the mirror image of an environment's state, for `load_state` of another one like it."""
    state = env.state()
    joints, feet = mirror.joints, mirror.feet
    sign = torch.from_numpy(mirror.sign).float()

    def exchanged(value: torch.Tensor) -> torch.Tensor:
        return value[:, joints]

    def signed(value: torch.Tensor) -> torch.Tensor:
        return value[:, joints] * sign

    draws = state["draws"]
    for name in ("armature", "damping", "friction", "stiffness", "motor_strength"):
        draws[name] = exchanged(draws[name])
    draws["encoder_offset"] = signed(draws["encoder_offset"])
    draws["center_of_mass"] = draws["center_of_mass"] * torch.tensor([1.0, -1.0, 1.0])

    buffers = state["buffers"]
    for name in ("last_action", "last_velocity", "measured_position", "measured_velocity"):
        buffers[name] = signed(buffers[name])
    buffers["air_time"] = buffers["air_time"][:, feet]

    buffers["first_side"] = -buffers["first_side"]

    kinds = mirror_of_kinds(env)
    buffers["bench_error"] = buffers["bench_error"][:, kinds]

    phases = 0 if env.layout.clock is None else 2 * len(feet)
    frames, clock = state["history"].tensor_split([state["history"].shape[-1] - phases], -1)
    frames = mirrored_frames(frames, mirror, kinds)
    if env.cfg.first_side:
        frames[..., -1] *= -1
    state["history"] = torch.cat([frames, *(part[..., feet] for part in clock.tensor_split(2, -1) if phases)], -1)
    if env.slow is not None:
        state["slow"]["sums"] = state["slow"]["sums"][..., joints]
    groups = env.spec.groups()
    if (groups != groups[feet]).any():
        state["unsync"] = {**state["unsync"], "window": -state["unsync"]["window"]}
    state["command"] = state["command"] * torch.tensor([1.0, -1.0, -1.0])
    state["simulation"] = {name: torch.from_numpy(value) for name, value in _simulation(env, mirror).items()}
    if "friction" in state:
        of_joints = {name: value if name == "fresh" else value[:, joints] for name, value in state["friction"].items()}
        state["friction"] = {name: torch.from_numpy(value) for name, value in of_joints.items()}
    state["ground"] = torch.from_numpy(state["ground"].copy())
    state["blown_up"] = torch.from_numpy(state["blown_up"].copy())
    if env.motors is not None:
        motors = state["motors"]
        order = np.argsort(env.motors.memory._order)  # the net keeps its joints group by group
        past = motors["past"][:, :, order][:, :, joints] * mirror.sign[:, None]
        state["motors"] = {
            "past": torch.from_numpy(past[:, :, env.motors.memory._order].astype(np.float32)),
            "fresh": torch.from_numpy(motors["fresh"]),
            "targets": torch.from_numpy(motors["targets"][:, joints] * mirror.sign),
        }
    if env.course:
        course = state["course"]
        course["heading"] = -course["heading"]
        course["position"] = course["position"] * VELOCITY[:3]
        course["quaternion"] = course["quaternion"] * QUATERNION
    return state


def mirror_of_kinds(env: LocomotionEnv) -> list[int]:
    """Return which kind each kind mirrors, told from names: `L_hip` and `R_hip`; any other is its own image."""
    kinds = env.spec.joint_kinds
    sides = {"L_": "R_", "R_": "L_"}
    return [kinds.index(sides.get(kind[:2], kind[:2]) + kind[2:]) for kind in kinds]


def mirrored_frames(frames: torch.Tensor, mirror: RobotMirror, kinds: list[int]) -> torch.Tensor:
    """Return frames of the paper's layout in the mirror, shape (..., 11 + 3 joints), entry by entry.

    What is known of kinds of joints, or slow means, stand behind it, if anything: the first are those of the kinds'
    images, the second have no sign.
    """
    ahead = torch.tensor([-1.0, 1, -1, -1, 1, 1, 1, -1, -1, 1])  # rates; roll, pitch; nothing; command; nothing
    parts = [frames[..., :10] * ahead]
    end = 10 + 3 * len(mirror.joints)
    for values in frames[..., 10:end].tensor_split(3, dim=-1):
        parts.append(values[..., mirror.joints] * torch.from_numpy(mirror.sign).float())
    parts.append(frames[..., end : end + 1])
    rest = frames[..., end + 1 :]
    if rest.shape[-1] >= len(mirror.joints):
        parts += [values[..., mirror.joints] for values in rest.tensor_split(3, dim=-1)]
    else:
        parts.append(rest[..., kinds[: rest.shape[-1]]])
    return torch.cat(parts, -1)


def mirrored_qpos(qpos: np.ndarray, mirror: RobotMirror) -> np.ndarray:
    """Return positions in the mirror, shape (N, 7 + joints)."""
    joints = qpos[:, 7:][:, mirror.joints] * mirror.sign
    return np.hstack([qpos[:, :3] * VELOCITY[:3], qpos[:, 3:7] * QUATERNION, joints])


def mirrored_qvel(qvel: np.ndarray, mirror: RobotMirror) -> np.ndarray:
    """Return velocities, or what else has their shape, in the mirror, shape (N, 6 + joints)."""
    return np.hstack([qvel[:, :6] * VELOCITY, qvel[:, 6:][:, mirror.joints] * mirror.sign])


def _simulation(env: LocomotionEnv, mirror: RobotMirror) -> dict[str, np.ndarray]:
    """Return MuJoCo's state in the mirror; a joint's delay line ends with its values, whose times stay."""
    state = env.fleet.simulation.state()
    lines = state["history"].reshape(env.num_envs, env.num_actions, -1)[:, mirror.joints]
    samples = (lines.shape[-1] - 2) // 2
    lines[..., -samples:] *= mirror.sign[:, None]
    state |= {
        "qpos": mirrored_qpos(state["qpos"], mirror),
        "ctrl": state["ctrl"][:, mirror.joints] * mirror.sign,
        "history": lines.reshape(env.num_envs, -1),
    }
    if "plastic" in state:  # angles at which the sliders of the joints are slack
        state["plastic"] = state["plastic"][:, mirror.joints] * mirror.sign
    for name in ("qvel", "qacc_warmstart", "qfrc_applied"):
        state[name] = mirrored_qvel(state[name], mirror)
    assert not state["xfrc_applied"].any()
    return state
