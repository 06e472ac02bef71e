"""What every engine gives: one robot, its joints moved by torques and held by dry friction.

Torque and friction come from outside, at every physics step. An engine's own words for friction and control often mean
something else (PhysX 5.3 multiplies by load, Webots ignores friction under position control), so nothing of theirs is
used but one thing: a constraint that holds a joint with any torque up to a bound, and brakes it with the bound where it
slides. That is dry friction. What the bound is, the law says (`friction.py`), and the same law in every engine.

What touches what is the same in every engine, too, and as in training: on the plane feet and trunk; on boxes and on a
height field shanks as well; feet touch each other and the trunk; thighs and hips touch nothing. The suite in
`conformance/` holds engines to all of this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stiction.core.errors import EngineError
from stiction.engines.ground import Ground
from stiction.robots.model import GRAVITY as GRAVITY
from stiction.robots.model import RobotSpec

FASTEST = 1e4
"""A base or a joint that is faster has blown up [m/s, rad/s]."""

TOUCH = 1.0
"""Force with which the ground must push a foot for a contact [N], as in training (`Fleet.foot_contact`)."""


class BlownUp(EngineError):
    """A robot whose numbers are no motion any more. To whoever drives it that is a fall; `reset` puts it right."""


def check_speed(engine: str, *speeds: np.ndarray) -> None:
    """Raise `BlownUp` unless every speed, arrays in m/s or rad/s, is a number under `FASTEST`."""
    for speed in speeds:
        largest = np.abs(speed).max()
        if not largest < FASTEST:
            raise BlownUp(
                f"the robot has blown up in the engine {engine!r}: a speed is {largest:g}; "
                "take shorter steps, or lower gains and torques"
            )


@dataclass(frozen=True)
class Body:
    """The robot as an engine builds it: its shape and masses, and what is in its joints beside friction."""

    spec: RobotSpec
    """Shape, masses, limits of the angles."""
    armature: np.ndarray
    """Rotor inertia at the joints, I [kg m²], shape (J,)."""
    damping: np.ndarray
    """Viscous friction, B [N m s/rad], shape (J,)."""
    ground_friction: float = 1.0
    """Coulomb coefficient between feet and ground [-], whatever the ground is made of; trunk and shanks have 1."""
    base_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the trunk's centre of mass is in the base's frame [m]: a payload, or a drawing that was wrong."""
    fixed: bool = False
    """Whether the base is bolted to a stand, where `reset` put it: a robot whose joints are being measured."""

    @classmethod
    def nominal(cls, spec: RobotSpec, fixed: bool = False) -> Body:
        """Return the robot as its description has it."""
        return cls(spec, spec.joint_values("armature"), spec.joint_values("damping"), fixed=fixed)


@dataclass(frozen=True)
class Motion:
    """What a robot does at one instant. Joints in the order of `spec.joint_names`, legs in that of `spec.legs`.

    Position and velocity are those of now; contact, force and torque those of the step that led here, as a sensor's
    are, and zero right after a reset.
    """

    base_position: np.ndarray
    """Of the base's frame, not its centre of mass, in the world [m], shape (3,)."""
    base_quaternion: np.ndarray
    """Of the base in the world, w x y z, shape (4,)."""
    base_linear_velocity: np.ndarray
    """Of the base's frame, seen in it [m/s], shape (3,)."""
    base_angular_velocity: np.ndarray
    """In the base's frame [rad/s], shape (3,)."""
    joint_position: np.ndarray
    """[rad], shape (J,)."""
    joint_velocity: np.ndarray
    """[rad/s], shape (J,)."""
    foot_contact: np.ndarray
    """Whether the ground pushes a foot with at least `TOUCH`, bool, shape (legs,)."""
    joint_force: np.ndarray
    """|F|, the force that each joint transmitted, contacts included [N], shape (J,)."""
    joint_torque: np.ndarray
    """|T|, the torque that it transmitted, about the centre of mass of the link behind it, its axis included [N m],
    shape (J,)."""


class Engine(Protocol):
    """One robot in one physics engine."""

    name: str
    """As in results.csv: `mujoco`, `physx`, `ode`."""
    body: Body
    """The robot."""
    timestep: float
    """Of the physics [s]."""

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Put the robot there, at rest: joint angles [rad], shape (J,); place [m] and orientation of its base."""

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep under joint torques [N m] and bounds of dry friction [N m], both of shape (J,).

        Raises:
            BlownUp: the robot's numbers are no motion any more.

        """

    def motion(self, loads: bool = True) -> Motion:
        """Return what the robot does now; without `loads`, |F| and |T| of its joints are zero: nobody asks for them."""


Make = Callable[[Body, Ground, float], Engine]
"""Makes an engine: body, ground, timestep [s]."""
