"""A trained policy as training computes it: observation and network in torch, float32. The runtime's twin.

Golden vectors are recorded with this one and replayed with the runtime's (NumPy and onnxruntime), so that a drift
between the two shows in every bundle.
"""

from __future__ import annotations

import numpy as np
import torch

from stiction.deploy.observation import Sensors, told
from stiction.deploy.policy import PolicyStep
from stiction.formats.contract import Contract
from stiction.formats.known_friction import TERM
from stiction.joints.pd import compensated
from stiction.locomotion.env import to_tensor
from stiction.locomotion.observations import FrameBuilder, History, SlowMeans, roll_pitch


class TrainedPolicy:
    """Sensors and command in, joint targets out, by the modules of training."""

    def __init__(
        self, module: torch.nn.Module, contract: Contract, num: int = 1, known_friction: np.ndarray | None = None
    ) -> None:
        """Start with an empty history.

        Args:
            module: observations (num, size), float32 -> actions (num, J).
            contract: layout, standing pose, scale and clip of the action.
            num: robots side by side.
            known_friction: f/τ_max of each kind of joint [-], shape (kinds,) or (num, kinds), for a policy that is told
                it; by default what the contract says.

        Raises:
            StictionError: the friction does not fit the policy.

        """
        self._module = module.eval()
        self._standing = to_tensor(contract.array("standing"))
        self._scale, self._clip = contract.action_scale, contract.action_clip
        extra = contract.compensation
        self._compensation = None if extra is None else to_tensor(np.array(extra))
        self._width = contract.compensation_width
        self._frames = FrameBuilder(contract.observation, self._standing)
        self._history = History(num, contract.observation)
        kept = contract.observation.slow_kept
        self._slow = None if kept is None else SlowMeans(num, contract.num_joints, kept)
        self._last_action = torch.zeros(num, contract.num_joints)
        self._fresh = torch.ones(num, dtype=torch.bool)
        known = contract.told_friction if known_friction is None else known_friction
        self._known = {} if known is None else {TERM: to_tensor(told(contract.observation, known, (num,)))}

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the history and the last action of the robots in `mask` (bool, shape (num,)), of all without."""
        chosen = torch.ones_like(self._fresh) if mask is None else torch.from_numpy(np.asarray(mask, dtype=bool))
        self._fresh = self._fresh | chosen
        self._last_action[chosen] = 0.0

    @torch.no_grad()
    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period; `command`: forward, sideways [m/s], turn [rad/s], shape (num, 3)."""
        raw = {
            "angular_velocity": to_tensor(sensors.angular_velocity),
            "roll_pitch": roll_pitch(to_tensor(sensors.quaternion)),
            "joint_position": to_tensor(sensors.joint_position),
            "joint_velocity": to_tensor(sensors.joint_velocity),
            "command": to_tensor(command),
            "last_action": self._last_action,
            **self._known,
        }
        if self._slow is not None:
            error = self._standing + self._scale * self._last_action - raw["joint_position"]
            raw |= self._slow.push(error, raw["joint_velocity"], self._fresh)
        observation = self._history.push(self._frames(raw), self._fresh)
        self._fresh = torch.zeros_like(self._fresh)
        action = self._module(observation).clamp(-self._clip, self._clip)
        target = self._standing + self._scale * action
        if self._compensation is not None:
            target = compensated(target, raw["joint_position"], self._compensation, self._width)
        self._last_action = action.clone()
        return PolicyStep(observation.numpy(), action.numpy(), target.double().numpy())
