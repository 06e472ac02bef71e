"""How long a robot is damped after a run, however it ended: for a time at least, and while it moves, up to a limit."""

from __future__ import annotations

import math

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.deploy.runtime.config import SupervisorCfg

REST_ANGLE, REST_TURN, REST_SECONDS = 0.02, 0.5, 0.2
"""A robot rests when no joint has moved by that angle [rad] and the base turns slower than that [rad/s] for so long
[s]: angles, since velocities are noisy at rest."""


class Settling:
    """Watches a damped robot come to rest; for the supervisor, and for the watchdog where it has taken over."""

    def __init__(self, cfg: SupervisorCfg, joints: int, now: float) -> None:
        """Begin with a robot that may move; joints: number of them; now: on the caller's clock [s]."""
        self._cfg, self._since, self._at, self._heard = cfg, now, np.full(joints, math.nan), math.nan

    def look(self, sensors: Sensors, now: float) -> None:
        """Note whether the robot has moved since it was last looked at; a comparison with NaN counts as moved."""
        position, turn = sensors.joint_position, sensors.angular_velocity
        if not (np.abs(position - self._at).max() <= REST_ANGLE and np.abs(turn).max() <= REST_TURN):
            self._at, self._since = np.array(position), now
        self._heard = now

    def over(self, elapsed: float, now: float, silent: bool = False) -> bool:
        """Return whether damping may end after `elapsed` [s]; silent: the robot has never said anything."""
        # A robot that says nothing any more may move; one that never said anything is waited for no longer.
        rests = now - self._since >= REST_SECONDS and now - self._heard <= self._cfg.stale
        return elapsed >= (self._cfg.settle if rests or silent else self._cfg.settle_limit)
