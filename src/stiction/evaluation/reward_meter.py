"""Reward terms of one robot as its training pays them. Needs torch."""

from __future__ import annotations

import numpy as np
import torch

from stiction.engines.engine import Motion
from stiction.robots.model import Robot
from stiction.task.config import TaskCfg
from stiction.task.env import UnsyncWindow, exactly_one_group, group_imbalance
from stiction.task.rewards import Snapshot

CLOCK = "clock"
"""Term that needs the gait clock of an episode, which a viewed robot does not have."""


class RewardMeter:
    """The terms of one training's reward, measured on one robot."""

    def __init__(self, task: TaskCfg, spec: Robot) -> None:
        """Take the weights of a task. Raises `StictionError`: a term is not defined for the robot."""
        self._period, self._moving_above, self._spec = task.control_period, task.commands.moving_above, spec
        self._terms = {name: term for name, term in task.rewards.terms_for(spec).items() if name != CLOCK}
        groups = spec.groups()
        self._groups = None if groups is None else torch.from_numpy(groups)
        self.reset()

    def reset(self) -> None:
        """Forget the steps before, at the start of an episode."""
        feet, joints = len(self._spec.feet), self._spec.num_joints
        self._unsync = UnsyncWindow(1, feet)
        self._velocity, self._action = np.zeros(joints), np.zeros(joints)
        self._air_time = np.zeros(feet)
        self.values: dict[str, float] = {}
        """Weighted terms of the last control step, by name [1/s]."""

    def add(
        self,
        motion: Motion,
        torque: np.ndarray,
        action: np.ndarray,
        command: np.ndarray,
        fallen: bool = False,
        ground: float = 0.0,
    ) -> None:
        """Measure a control step.

        motion: after it; torque: of the motors [N m], shape (J,); action: of the policy, shape (J,); command: forward,
        sideways [m/s], turn [rad/s]; fallen: in this step; ground: its height under the robot [m].
        """
        contact = motion.foot_contact
        landed = np.where(contact, self._air_time, 0.0)
        self._air_time = np.where(contact, 0.0, self._air_time + self._period)
        deviation = motion.joint_position - self._spec.joint_values("default_position")
        feet = torch.from_numpy(contact)[None]
        one_group, unsync = torch.zeros(1, dtype=torch.bool), torch.zeros(1)
        if self._groups is not None:
            one_group = exactly_one_group(feet, self._groups)
            unsync = self._unsync.push(group_imbalance(feet, self._groups))
        w, x, y, z = motion.base_quaternion
        snapshot = Snapshot(
            command=row(command),
            moving=row(command).norm(dim=-1) > self._moving_above,
            linear_velocity=row(motion.base_linear_velocity),
            angular_velocity=row(motion.base_angular_velocity),
            up=row(np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])),
            height_error=row(motion.base_position[2] - ground - self._spec.standing_height),
            torque_share=row(torque / self._spec.joint_values("torque_limit")),
            joint_deviation=row(deviation),
            sideways_deviation=row(deviation[list(self._spec.sideways_joints)]),
            joint_acceleration=row((motion.joint_velocity - self._velocity) / self._period),
            action_change=row(action - self._action),
            contact=feet,
            one_group=one_group,
            unsync=unsync,
            in_stance=torch.zeros_like(feet),
            landed_air_time=row(landed),
            fallen=torch.tensor([fallen]),
            blown_up=torch.tensor([False]),
        )
        self._velocity, self._action = motion.joint_velocity.copy(), np.array(action, float)
        self.values = {name: weight * float(term(snapshot)[0]) for name, (term, weight) in self._terms.items()}


def row(values: np.ndarray) -> torch.Tensor:
    """Return values of one robot as a batch of one, float32."""
    return torch.as_tensor(np.asarray(values)[None], dtype=torch.float32)
