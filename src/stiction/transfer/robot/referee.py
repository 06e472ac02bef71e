"""Records what a virtual robot really did, control step by control step, in the form that `transfer.metrics` judges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stiction.robots.spec import RobotSpec
from stiction.sim.fall import tilted, too_low
from stiction.transfer.engines.engine import Motion
from stiction.transfer.metrics import Recording
from stiction.transfer.robot.virtual import Witness


def fallen(motion: Motion, spec: RobotSpec, ground: float) -> bool:
    """Say whether a robot lies or is about to, by the rule of the training (`Fleet.fallen`); ground: under it [m]."""
    return bool(tilted(motion.base_quaternion) or too_low(motion.base_position[2] - ground, spec.standing_height))


class Referee:
    """Watches one robot."""

    def __init__(self, witness: Callable[[], Witness], spec: RobotSpec, period: float) -> None:
        """Begin with the robot in place.

        witness: tells the truth, as `VirtualRobot.witness`; spec: the data sheet; period: of control [s].
        """
        self._witness, self._spec, self._period = witness, spec, period
        self._rows: list[dict[str, np.ndarray | float | bool]] = []
        self._upright, self._velocity = True, witness().motion.joint_velocity

    @property
    def upright(self) -> bool:
        """Whether the robot has not fallen yet."""
        return self._upright

    def look(self, ground: float = 0.0) -> None:
        """Record the end of a control period; ground: its height under the robot [m]."""
        seen = self._witness()
        self._upright = self._upright and not fallen(seen.motion, self._spec, ground)
        self._rows.append(self._row(seen))
        self._velocity = seen.motion.joint_velocity

    def _row(self, seen: Witness) -> dict[str, np.ndarray | float | bool]:
        """Return what is recorded of an instant, by the fields of `Recording`."""
        motion = seen.motion
        change = (motion.joint_velocity - self._velocity) / self._period
        return {
            "velocity": np.array([*motion.base_linear_velocity[:2], motion.base_angular_velocity[2]]),
            "position": motion.base_position[:2],
            "contact": motion.foot_contact,
            "power": float(np.abs(seen.torque * motion.joint_velocity).sum()),
            "square_acceleration": float(np.square(change).mean()),
            "upright": self._upright,
            "friction": float(seen.friction.mean()),
        }

    def lose(self) -> None:
        """Record a robot that has blown up in its engine: it has fallen, where it was last."""
        self._upright = False
        last = self._rows[-1] if self._rows else self._row(self._witness())
        self._rows.append(last | {"upright": False})

    def recording(self) -> Recording:
        """Return what was seen, of one robot: shapes (T, 1, ...)."""
        stacked = {name: np.stack([row[name] for row in self._rows])[:, None] for name in self._rows[0]}
        return Recording(self._period, **stacked)
