"""Everything is clipped on the way out: how fast a target moves, where it may be, and which torque it asks for.

In this order, each joint by itself:

1. slew: the target moves at most `slew` [rad/s] times the time since the last change of what was asked;
2. range: it stays within the joint's limits less a margin;
3. torque: kp (a − θ) − kd θ' stays within the motor's limit. A motor that limits by itself gives the same torque.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError
from stiction.deploy.runtime.config import LimitsCfg
from stiction.formats.contract import Contract

FREE, SLEW, RANGE, TORQUE = 0, 1, 2, 3
LIMITED_BY = ("", "slew", "range", "torque")
"""What limited a joint's target, the last rule that changed it, by its code in the log."""

LEAST_CHANGE = 1e-9
"""Change of a target that counts as one [rad]."""


@dataclass(frozen=True)
class Limited:
    """Targets as they go out. Arrays have shape (J,)."""

    target: np.ndarray
    """[rad]."""
    by: np.ndarray
    """Code of what limited each joint, int, see `LIMITED_BY`."""


class Limits:
    """The limits of one robot; holds what was let through last."""

    def __init__(self, contract: Contract, cfg: LimitsCfg, kp: np.ndarray, kd: np.ndarray) -> None:
        """Take the joints' limits from the contract; kp, kd: of the run [N m/rad, N m s/rad], shape (J,).

        Raises `ConfigurationError`: the margin leaves a joint no room.
        """
        self._cfg = cfg
        self._lower, self._upper = contract.array("lower") + cfg.margin, contract.array("upper") - cfg.margin
        self._limit, self._kp, self._kd = contract.array("torque_limit"), kp, kd
        self._last: np.ndarray | None = None
        if (self._lower >= self._upper).any():
            joint = contract.joint_names[int(np.argmax(self._lower >= self._upper))]
            raise ConfigurationError(f"a margin of {cfg.margin} rad leaves {joint} no room between its limits")

    def begin(self, position: np.ndarray) -> None:
        """Begin from where the joints are: what is asked first moves away from there [rad], shape (J,)."""
        self._last = np.array(position, dtype=np.float64)

    def step(self, requested: np.ndarray, elapsed: float) -> Limited:
        """Return what may be asked for, by slew and range; what of it the torque allows, `apply_torque` says.

        requested: finite [rad], shape (J,); elapsed: since what was asked for changed last [s].
        """
        assert self._last is not None, "begin first"
        most = self._cfg.slew * max(elapsed, 0.0)
        slow = np.clip(requested, self._last - most, self._last + most)
        inside = np.clip(slow, self._lower, self._upper)
        by = np.where(np.abs(slow - requested) > LEAST_CHANGE, SLEW, FREE)
        by = np.where(np.abs(inside - slow) > LEAST_CHANGE, RANGE, by)
        # Without the torque's limit: it follows the joint, as a motor that limits by itself, and has no memory.
        self._last = inside
        return Limited(inside, by)

    def apply_torque(self, limited: Limited, position: np.ndarray, velocity: np.ndarray) -> Limited:
        """Return targets whose torque is within the motors' limits at a measured angle [rad] and velocity [rad/s]."""
        torque = self._kp * (limited.target - position) - self._kd * velocity
        within = np.clip(torque, -self._limit, self._limit)
        # What is within stays as it is: the way to the torque and back would round it.
        target = np.where(within == torque, limited.target, position + (within + self._kd * velocity) / self._kp)
        # A joint that is thrown far behind its limit must not be asked to go on.
        inside = np.clip(target, self._lower, self._upper)
        return Limited(inside, np.where(np.abs(inside - limited.target) > LEAST_CHANGE, TORQUE, limited.by))
