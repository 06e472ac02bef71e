"""Runs a batch of robots and keeps what the metrics need."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stiction.sim.fleet import Fleet
from stiction.transfer.metrics import Recording
from stiction.transfer.rollout import Rollout


def record(
    rollout: Rollout, pilot: Callable[[Fleet], np.ndarray], steps: int, progress: Callable[[float], None]
) -> tuple[Recording, int]:
    """Run the batch and keep what the metrics need; return it and the number of simulations that blew up.

    pilot: commands every robot before each control step: forward, sideways [m/s], turn [rad/s], (N, 3).
    """
    fleet, legs = rollout.fleet, len(rollout.fleet.spec.legs)
    num, period = fleet.num_envs, fleet.control_period
    recording = Recording(
        period,
        velocity=np.zeros((steps, num, 3), dtype=np.float32),
        position=np.zeros((steps, num, 2), dtype=np.float32),
        contact=np.zeros((steps, num, legs), dtype=bool),
        power=np.zeros((steps, num), dtype=np.float32),
        square_acceleration=np.zeros((steps, num), dtype=np.float32),
        upright=np.zeros((steps, num), dtype=bool),
        friction=(friction := np.zeros((steps, num), dtype=np.float32)),
    )
    upright, blown_up = np.ones(num, dtype=bool), 0
    last_velocity = fleet.joint_velocity.copy()
    for t in range(steps):
        moment = rollout.step(pilot(fleet))
        blown_up += len(moment.blown_up)
        upright = upright & ~fleet.fallen()
        upright[moment.blown_up] = False
        recording.velocity[t, :, :2] = fleet.base_linear_velocity[:, :2]
        recording.velocity[t, :, 2] = fleet.base_angular_velocity[:, 2]
        recording.position[t] = fleet.base_position[:, :2]
        recording.contact[t] = fleet.foot_contact
        recording.power[t] = np.abs(fleet.torque * fleet.joint_velocity).sum(axis=1)
        recording.square_acceleration[t] = (((fleet.joint_velocity - last_velocity) / period) ** 2).mean(axis=1)
        recording.upright[t] = upright
        friction[t] = fleet.friction.mean(axis=1)
        last_velocity = fleet.joint_velocity.copy()
        progress((t + 1) / steps)
    return recording, blown_up
