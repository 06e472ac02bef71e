"""Observations of robots, batched in torch: terms, frames by `files.observation.ObservationLayout`, and histories.

`deploy` builds the same frames in NumPy. A new term of a frame is a function here and a line in `FRAME_TERMS`, and its
name in `files.observation`, from which a contract tells the robot's runtime what to measure. A new quantity for the
policy to estimate is a function and a line in `ESTIMATED`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch

from stiction.files.observation import PLACEHOLDERS, SLOW_TERMS, ObservationLayout
from stiction.task.config import TaskCfg
from stiction.task.randomization import FRICTION_UNIT

LocomotionEnv = Any
"""`task.env.LocomotionEnv`, whose module imports this one."""

ObservationTerm = Callable[[LocomotionEnv], torch.Tensor]
"""Function that returns one quantity of every robot, (N, size), without noise."""


def roll_pitch(quaternion: torch.Tensor) -> torch.Tensor:
    """Return roll and pitch [rad], shape (N, 2), of base orientations w, x, y, z, shape (N, 4)."""
    w, x, y, z = quaternion.unbind(-1)
    roll = torch.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    # Rounding may lead out of asin's domain, and a robot on end would measure NaN.
    pitch = torch.asin((2 * (w * y - z * x)).clamp(-1.0, 1.0))
    return torch.stack((roll, pitch), -1)


def angular_velocity(env: LocomotionEnv) -> torch.Tensor:
    """Return the rates of the base in its frame [rad/s]."""
    return env.robots.base_angular_velocity


def tilt(env: LocomotionEnv) -> torch.Tensor:
    """Return roll and pitch of the base [rad]."""
    return roll_pitch(env.robots.base_quaternion)


def joint_position(env: LocomotionEnv) -> torch.Tensor:
    """Return the angles of the encoders [rad]."""
    return env.robots.joint_position + env.randomizer.draws.encoder_offset


def joint_velocity(env: LocomotionEnv) -> torch.Tensor:
    """Return the velocities of the joints [rad/s]."""
    return env.robots.joint_velocity


def command(env: LocomotionEnv) -> torch.Tensor:
    """Return the commanded vx, vy [m/s] and yaw rate [rad/s]."""
    return env.commands.value


def last_action(env: LocomotionEnv) -> torch.Tensor:
    """Return the action of the last step."""
    return env.last_action


def known_friction(env: LocomotionEnv) -> torch.Tensor:
    """Return f/τ_max of each kind of joint, with the error of a bench [1]."""
    return env.randomizer.unloaded_share() @ env.kind_average * env.bench_error


def first_side(env: LocomotionEnv) -> torch.Tensor:
    """Return 1 or -1: the mirror image of the gait that begins."""
    return env.first_side


def gait_phase(env: LocomotionEnv) -> torch.Tensor:
    """Return the phase of each foot on the gait clock [rad], (N, feet): a turn per stride; the other side starts half a
    turn later.
    """
    clock = env.layout.clock
    turned = env.episode_length_buf[:, None] * (2 * torch.pi * env.cfg.control_period / clock.period)
    other = torch.pi / 2 * (1.0 - env.first_side)
    return env.foot_phases + turned + other


def phase(env: LocomotionEnv) -> torch.Tensor:
    """Return the sines of all phases of the gait clock, and then their cosines."""
    angle = gait_phase(env)
    return torch.cat((angle.sin(), angle.cos()), -1)


FRAME_TERMS: dict[str, ObservationTerm] = {
    "angular_velocity": angular_velocity,
    "roll_pitch": tilt,
    "joint_position": joint_position,
    "joint_velocity": joint_velocity,
    "command": command,
    "last_action": last_action,
    "known_friction": known_friction,
    "first_side": first_side,
    "phase": phase,
}
"""Name in the layout -> term. Measured terms have noise: the field of that name of `NoiseCfg`."""


def base_velocity(env: LocomotionEnv) -> torch.Tensor:
    """Return the velocity of the base in its frame [m/s]."""
    return env.robots.base_linear_velocity


def foot_contact(env: LocomotionEnv) -> torch.Tensor:
    """Return 1 for each foot that carries load."""
    return env.robots.foot_contact.float()


def kind_friction(env: LocomotionEnv) -> torch.Tensor:
    """Return the friction of each kind of joint over the torque limit, in units of `FRICTION_UNIT`."""
    return env.randomizer.friction_share() @ env.kind_average / FRICTION_UNIT


ESTIMATED: tuple[tuple[ObservationTerm, Callable[[TaskCfg], bool]], ...] = (
    (base_velocity, lambda cfg: True),
    (foot_contact, lambda cfg: True),
    (kind_friction, lambda cfg: cfg.estimated_friction),
)
"""Terms of o_exp, which the policy estimates, each with its condition on the task."""


class FrameBuilder:
    """Builder of one frame from named raw quantities: clip((raw - offset) * scale)."""

    def __init__(self, layout: ObservationLayout, standing: torch.Tensor) -> None:
        """Precompute scale, offset and clip of every entry. `standing`: (joints,) [rad]."""
        self.layout, self.task_device = layout, standing.device
        self.scale = torch.cat([torch.tensor(term.scales) for term in layout.terms]).float().to(self.task_device)
        self.clip = torch.cat([torch.tensor(term.clips) for term in layout.terms]).float().to(self.task_device)
        zero = torch.zeros_like(standing[:1])
        self.offset = torch.cat(
            [standing if term.offset == "standing" else zero.expand(term.size) for term in layout.terms]
        ).float()

    def __call__(self, raw: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the frame, shape (N, frame_size). `raw`: every term except the placeholders, each (N, size),
        float32.
        """
        num = next(iter(raw.values())).shape[0]
        parts = [
            torch.zeros(num, t.size, device=self.task_device) if t.name in PLACEHOLDERS else raw[t.name]
            for t in self.layout.terms
        ]
        frame = (torch.cat(parts, -1) - self.offset) * self.scale
        return torch.minimum(torch.maximum(frame, -self.clip), self.clip)


class History:
    """Last frames, oldest first. `push` returns a new tensor: the caller's stored ones never change."""

    def __init__(self, num_envs: int, layout: ObservationLayout, task_device: torch.device | None = None) -> None:
        """Start with zeros, on `task_device`; every robot is reset before its first observation."""
        self.frames = torch.zeros(num_envs, layout.history_length, layout.frame_size, device=task_device)

    def push(self, frame: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        """Append `frame`, (N, frame_size); where `fresh`, (N,) bool, fill the history with it. Returns (N, size)."""
        self.frames = torch.cat((self.frames[:, 1:], frame[:, None]), 1)
        # On a GPU nobody waits to learn which ones there are.
        if fresh.is_cuda:
            self.frames = torch.where(fresh[:, None, None], frame[:, None], self.frames)
        elif len(ids := fresh.nonzero().flatten()):
            self.frames[ids] = frame[ids, None]
        return self.frames.flatten(1)


class SlowMeans:
    """Means of products of error and velocity that reveal a joint's dry friction, see `SLOW_TERMS`."""

    def __init__(self, num_envs: int, num_joints: int, decay: float, task_device: torch.device | None = None) -> None:
        """Start without frames, on `task_device`; `decay`: see `ObservationLayout.slow_kept`."""
        self.decay = decay
        # In float64, as on the robot: a mean goes on from its own rounding, and x_i may be large once.
        self.sums = torch.zeros(num_envs, len(SLOW_TERMS), num_joints, dtype=torch.float64, device=task_device)
        """Σ k^(t-i) x_i."""
        self.weight = torch.zeros(num_envs, 1, dtype=torch.float64, device=task_device)
        """Σ k^(t-i)."""

    def push(self, error: torch.Tensor, velocity: torch.Tensor, fresh: torch.Tensor) -> dict[str, torch.Tensor]:
        """Add a frame and return the means by term, each (N, joints), float32.

        `error`: to the last target [rad], `velocity` [rad/s], (N, joints); where `fresh`, (N,) bool, earlier frames are
        cleared.
        """
        products = torch.stack((error.abs(), velocity.abs(), error * velocity), 1)
        self.sums = products + torch.where(fresh[:, None, None], 0.0, self.decay * self.sums)
        self.weight = 1.0 + torch.where(fresh[:, None], 0.0, self.decay * self.weight)
        return dict(zip(SLOW_TERMS, (self.sums / self.weight[..., None]).float().unbind(1), strict=True))
