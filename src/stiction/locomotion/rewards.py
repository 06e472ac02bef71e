"""The reward terms: pure functions of a snapshot of the robots. Each returns shape (N,); weights are in `RewardCfg`."""

from __future__ import annotations

from dataclasses import dataclass

import torch

LINEAR_SCALE = 0.1
"""Width of the linear tracking reward [m²/s²]: an error of 0.1 m/s still pays 90 %, standing at 0.5 m/s 8 %."""

ANGULAR_SCALE = 0.25
"""Width of the angular tracking reward [rad²/s²]."""

AIR_TIME = (0.15, 0.35)
"""Swing times between which the air-time reward grows [s]."""


@dataclass
class Snapshot:
    """What the rewards see of N robots after one control period."""

    command: torch.Tensor
    """Commanded vx, vy [m/s] and yaw rate [rad/s], (N, 3)."""
    moving: torch.Tensor
    """Whether the command asks to move, (N,) bool."""
    linear_velocity: torch.Tensor
    """Base velocity in the base frame [m/s], (N, 3)."""
    angular_velocity: torch.Tensor
    """Base rates in the base frame [rad/s], (N, 3)."""
    up: torch.Tensor
    """World's up axis in the base frame, (N, 3)."""
    height_error: torch.Tensor
    """Height of the base minus its standing height [m], (N,)."""
    torque_share: torch.Tensor
    """Motor torque over its limit, (N, J)."""
    joint_deviation: torch.Tensor
    """Joint angles minus the standing pose [rad], (N, J)."""
    joint_acceleration: torch.Tensor
    """Change of joint velocity over the control period [rad/s²], (N, J)."""
    action_change: torch.Tensor
    """Action minus the one before, (N, J)."""
    one_group: torch.Tensor
    """r_trot, (N,) bool."""
    unsync: torch.Tensor
    """r_unsync as a share of its largest value, (N,)."""
    landed_air_time: torch.Tensor
    """Time each foot that touches down in this step has been in the air [s], 0 for the others, (N, legs)."""
    fallen: torch.Tensor
    """Whether the robot fell in this step, (N,) bool."""


def track_linear(s: Snapshot) -> torch.Tensor:
    """exp(-|v_xy - v*_xy|² / scale)."""
    return torch.exp(-(s.command[:, :2] - s.linear_velocity[:, :2]).square().sum(-1) / LINEAR_SCALE)


def track_angular(s: Snapshot) -> torch.Tensor:
    """exp(-(ω_z - ω*_z)² / scale)."""
    return torch.exp(-(s.command[:, 2] - s.angular_velocity[:, 2]).square() / ANGULAR_SCALE)


def trot(s: Snapshot) -> torch.Tensor:
    """r_trot while moving."""
    return (s.one_group & s.moving).float()


def unsync(s: Snapshot) -> torch.Tensor:
    """r_unsync while moving."""
    return s.unsync * s.moving


def air_time(s: Snapshot) -> torch.Tensor:
    """Useful swing time of the feet that touch down, while moving [s]."""
    low, high = AIR_TIME
    useful = (s.landed_air_time - low).clamp(max=high - low) * (s.landed_air_time > 0)
    return useful.sum(-1) * s.moving


def vertical_velocity(s: Snapshot) -> torch.Tensor:
    """v_z²."""
    return s.linear_velocity[:, 2].square()


def roll_pitch_rate(s: Snapshot) -> torch.Tensor:
    """ω_x² + ω_y²."""
    return s.angular_velocity[:, :2].square().sum(-1)


def orientation(s: Snapshot) -> torch.Tensor:
    """Horizontal part of the up axis, squared."""
    return s.up[:, :2].square().sum(-1)


def base_height(s: Snapshot) -> torch.Tensor:
    """(h - h_stand)²."""
    return s.height_error.square()


def torque(s: Snapshot) -> torch.Tensor:
    """Sum of (τ / τ_max)²."""
    return s.torque_share.square().sum(-1)


def joint_acceleration(s: Snapshot) -> torch.Tensor:
    """Sum of squares."""
    return s.joint_acceleration.square().sum(-1)


def action_rate(s: Snapshot) -> torch.Tensor:
    """Sum of squares."""
    return s.action_change.square().sum(-1)


def hip_deviation(s: Snapshot) -> torch.Tensor:
    """Sum of squares over the hips, every third joint."""
    return s.joint_deviation[:, ::3].square().sum(-1)


def stand_still(s: Snapshot) -> torch.Tensor:
    """Sum of |q - q_stand| while standing is commanded."""
    return s.joint_deviation.abs().sum(-1) * ~s.moving


def fall(s: Snapshot) -> torch.Tensor:
    """1 in the step of the fall."""
    return s.fallen.float()


TERMS = (
    track_linear,
    track_angular,
    trot,
    unsync,
    air_time,
    vertical_velocity,
    roll_pitch_rate,
    orientation,
    base_height,
    torque,
    joint_acceleration,
    action_rate,
    hip_deviation,
    stand_still,
    fall,
)
"""All terms; a field of `RewardCfg` with the same name holds the weight."""
