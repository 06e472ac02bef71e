"""Links on a fixed base, as data: an arm on its table, a robot on a stand with its legs in the air. NumPy.

Frames are those of `model`: at joint angles of zero every link's is parallel to the base's, its origin on the axis of
its joint. A `Robot` with a held base is a mechanism; an arm has no feet and no standing height, so it is not a `Robot`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import RobotError
from stiction.robots.model import GRAVITY, Link, Robot, chain_to
from stiction.robots.shapes import Vector


@dataclass(frozen=True)
class Mechanism:
    """Tree of J links, each moved by one hinge, on a base that does not move."""

    name: str
    links: tuple[Link, ...]
    """Links, parents first."""
    joint_names: tuple[str, ...]
    """Name of each link's joint."""
    armature: tuple[float, ...]
    """Rotor inertia in the model [kg m²], 0 where it has none."""
    torque_limit: tuple[float | None, ...]
    """Torque limit of each motor, where the model has one [N m]."""
    rest: tuple[float, ...]
    """Angle at which a joint without a log counts as held [rad]."""
    gravity: Vector = (0.0, 0.0, -GRAVITY)
    """Acceleration of gravity in the base's frame [m/s²]."""
    rigid: tuple[str, ...] = ()
    """Joints of the file other than hinges (a gripper's slides), rigid at their reference."""
    notes: tuple[str, ...] = ()
    """Omissions and assumptions, a sentence each."""

    def __post_init__(self) -> None:
        """Reject joints without unique names, which could not be matched with a log."""
        if not self.joint_names or len(set(self.joint_names)) != len(self.joint_names) or "" in self.joint_names:
            raise RobotError(
                f"robot {self.name!r}: joints {list(self.joint_names)}; expected at least one, each with a name of "
                "its own"
            )

    @property
    def num_joints(self) -> int:
        """Number of joints, J."""
        return len(self.links)

    def chain(self, link: int) -> tuple[int, ...]:
        """Return the numbers of the joints from the base to a link, see `chain_to`."""
        return chain_to(self.links, link)

    def with_up(self, up: Vector) -> Mechanism:
        """Return the mechanism with its base turned: `up` is the direction up in the base's frame, of any length.

        Raises `RobotError` for a vector that is not a direction.
        """
        length = float(np.linalg.norm(up))
        if not (np.isfinite(length) and length > 0):
            raise RobotError(f"up {up}: expected the direction up in the base's frame, as in 0 0 1")
        x, y, z = (-GRAVITY * value / length for value in up)
        return replace(self, gravity=(x, y, z))


def on_a_stand(robot: Robot) -> Mechanism:
    """Return a robot whose base is held upright; joints without a log stand as in its standing pose."""
    return Mechanism(
        name=robot.name,
        links=robot.links,
        joint_names=robot.joint_names,
        armature=tuple(robot.joint_values("armature").tolist()),
        torque_limit=tuple(robot.joint_values("torque_limit").tolist()),
        rest=tuple(robot.joint_values("default_position").tolist()),
    )
