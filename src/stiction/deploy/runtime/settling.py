"""Time of damping after a run, however it ended: at least a minimum, and while the robot moves, up to a limit."""

from __future__ import annotations

import math

import numpy as np

from stiction.deploy.observation import Sensors
from stiction.deploy.runtime.config import SupervisorCfg

REST_ANGLE, REST_TURN, REST_SECONDS = 0.02, 0.5, 0.2
"""Conditions of rest: no joint has moved by that angle [rad] and the base turns slower than that [rad/s] for so long
[s]: angles, since velocities are noisy at rest."""


class Settling:
    """Detection of rest of a damped robot; for the supervisor, and for the watchdog where it has taken over."""

    def __init__(self, cfg: SupervisorCfg, joints: int, now: float) -> None:
        """Start with a robot that may move; joints: number of them; now: on the caller's clock [s]."""
        self._cfg, self._since, self._at, self._heard = cfg, now, np.full(joints, math.nan), math.nan

    def look(self, sensors: Sensors, now: float) -> None:
        """Note whether the robot has moved since the last look; a comparison with NaN counts as moved."""
        position, turn = sensors.joint_position, sensors.angular_velocity
        if not (np.abs(position - self._at).max() <= REST_ANGLE and np.abs(turn).max() <= REST_TURN):
            self._at, self._since = np.array(position), now
        self._heard = now

    def over(self, elapsed: float, now: float, silent: bool = False) -> bool:
        """Return True if damping may end after `elapsed` [s]; silent: True if the robot never sent a state."""
        # A robot that has become silent may move; one that never sent a state is waited for no longer.
        rests = now - self._since >= REST_SECONDS and now - self._heard <= self._cfg.stale
        return elapsed >= (self._cfg.settle if rests or silent else self._cfg.settle_limit)
