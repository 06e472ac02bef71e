"""Disturbances of a fleet in units of their limit: a force on each base, or a torque on each joint.

A force has three components, forward, left and up in the frame of the robot's heading, and at most the limit's length.
Up is among them because loads are put on and taken off a robot too; half of the weight lifts nobody off the ground. A
torque is bounded joint by joint, by a share of the dry friction that the joint has at the beginning of the control
period: it may brake or drive, and is on top of that friction.
"""

from __future__ import annotations

import numpy as np
import torch

from stiction.sim.fleet import Fleet

FORCE = 3
"""Components of a force."""


def bounded(raw: torch.Tensor, by_torque: bool) -> torch.Tensor:
    """Return what is within the limit of any numbers, (..., width): each in [-1, 1], or as a vector of length 1."""
    if by_torque:
        return raw.clamp(-1.0, 1.0)
    return raw / raw.norm(dim=-1, keepdim=True).clamp(min=1.0)


def intensity(values: torch.Tensor, by_torque: bool) -> torch.Tensor:
    """Return |d| in [0, 1] of disturbances in units of the limit, (..., width) -> (...).

    The length of a force; of torques the root mean square of their shares.
    """
    size = values.norm(dim=-1)
    return size / values.shape[-1] ** 0.5 if by_torque else size


class Disturbance:
    """Disturbs a fleet, for one control period at a time."""

    def __init__(self, fleet: Fleet, by_torque: bool, limit: float) -> None:
        """`limit`: share of the robot's weight, or of each joint's friction."""
        self.fleet, self.by_torque, self.limit = fleet, by_torque, limit
        self.width = fleet.spec.num_joints if by_torque else FORCE
        """Numbers that a robot's disturbance has."""

    def apply(self, values: torch.Tensor) -> None:
        """Disturb every robot in the next control period. `values`: within the limit, in its units, (N, width)."""
        fleet, shares = self.fleet, self.limit * values.detach().cpu().double().numpy()
        if self.by_torque:
            fleet.disturb(torque=shares * fleet.friction)
            return
        forward, left, up = fleet.spec.weight * shares.T
        cosine, sine = np.cos(fleet.yaw), np.sin(fleet.yaw)
        fleet.disturb(force=np.stack((cosine * forward - sine * left, sine * forward + cosine * left, up), -1))
