"""Interface of every engine: one robot, its joints moved by torques and held by dry friction.

Torque and friction come from outside, at every physics step. Engines' built-in friction and control often mean
something else (PhysX 5.3 multiplies by load, Webots ignores friction under position control), so only one feature is
used: a constraint that holds a joint with any torque up to a bound, and brakes it with the bound where it slides. The
bound of each joint is set before each step from its state, the same in every engine. It is a sum of laws
(`stiction.joints.friction.LAWS`), each with a level and numbers that may differ between joints:

  bound_j = wear_j f_j (1 + (r_j − 1) exp(−(q'/v_j)²)) + c_j (|F_j| + |T_j|)

for Stribeck friction plus friction that grows with load. As in training, motor torque and transmitted force are those
of the step before, and the bound is low-pass filtered with the same time constant. Wear scales torques, as the paper's
seals do, and not coefficients.

Contacts are the same in every engine, and as in training: on the plane feet and trunk; on boxes and on a height field
shanks as well; feet touch each other and the trunk; thighs and hips touch nothing. The suite of `stiction study
engines` tests all of this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np

from stiction.core.errors import EngineError
from stiction.engines.ground import Ground
from stiction.joints.friction import LAWS, SMOOTHING_PERIOD, Law, Values, has_coefficient
from stiction.robots.model import Robot

FASTEST = 1e4
"""Speed of a base or a joint above which it has blown up [m/s, rad/s]."""

TOUCH = 1.0
"""Minimum force of the ground on a foot in contact [N], as in training (`Fleet.foot_contact`)."""


class BlownUp(EngineError):
    """Instability of the simulation, which counts as a fall. `reset` restarts it."""


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
    """Robot to build in an engine: shape, masses, rotors and viscous friction."""

    spec: Robot
    """Shape, masses, limits of the angles."""
    armature: np.ndarray
    """Rotor inertia at the joints, I [kg m²], shape (J,)."""
    damping: np.ndarray
    """Viscous friction, B [N m s/rad], shape (J,)."""
    ground_friction: float = 1.0
    """Coulomb coefficient between feet and ground [-], for any ground; trunk and shanks have 1."""
    base_shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the trunk's centre of mass from that of `spec` [m]."""
    fixed: bool = False
    """True if the base is bolted to a stand, at the place of `reset`."""

    @property
    def base_com(self) -> np.ndarray:
        """Centre of mass of the trunk in the base's frame [m], shape (3,)."""
        return np.add(self.spec.base.com, self.base_shift)

    @classmethod
    def nominal(cls, spec: Robot, fixed: bool = False) -> Body:
        """Return the robot of the data sheet."""
        return cls(spec, spec.joint_values("armature"), spec.joint_values("damping"), fixed=fixed)


@dataclass(frozen=True)
class Motion:
    """State of a robot. Joints in the order of `spec.joint_names`, feet in that of `spec.feet`.

    Contact, force and torque are those of the last step, as a sensor's are, and zero right after a reset.
    """

    base_position: np.ndarray
    """Position of the base's frame, not its centre of mass, in the world [m], shape (3,)."""
    base_quaternion: np.ndarray
    """Orientation of the base in the world, w x y z, shape (4,)."""
    base_linear_velocity: np.ndarray
    """Velocity of the base's frame, in it [m/s], shape (3,)."""
    base_angular_velocity: np.ndarray
    """Angular velocity in the base's frame [rad/s], shape (3,)."""
    joint_position: np.ndarray
    """[rad], shape (J,)."""
    joint_velocity: np.ndarray
    """[rad/s], shape (J,)."""
    foot_contact: np.ndarray
    """True for each foot that the ground pushes with at least `TOUCH`, bool, shape (legs,)."""
    joint_force: np.ndarray
    """|F|, the force that each joint transmitted, contacts included [N], shape (J,)."""
    joint_torque: np.ndarray
    """|T|, the torque that each joint transmitted, about the centre of mass of the link behind it, its axis included [N
    m], shape (J,)."""


class Engine(Protocol):
    """One robot in one physics engine."""

    name: str
    """As in results.csv: `mujoco`, `physx`, `ode`."""
    body: Body
    """The robot."""
    timestep: float
    """Physics step [s]."""

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot at rest: joint angles [rad], shape (J,); place [m] and orientation of its base."""

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep under joint torques [N m] and bounds of dry friction [N m], both of shape (J,).

        Raises `BlownUp`: the simulation has become unstable.
        """

    def motion(self, loads: bool = True) -> Motion:
        """Return the present motion; without `loads`, |F| and |T| of its joints stay zero, which is faster."""


@runtime_checkable
class Pushable(Protocol):
    """Engine whose robot can be pushed, as in all shipped ones."""

    def push(self, velocity: np.ndarray) -> None:
        """Add a velocity, x and y in the world [m/s], shape (2,), to the whole robot's, without a change of its
        joints'.
        """


@runtime_checkable
class FrictionSensing(Protocol):
    """Engine that reports the torque of its dry friction, such as `mujoco` and `physx`."""

    def friction_torque(self) -> np.ndarray:
        """Return the torque of dry friction on each joint in the last step, signed [N m], shape (J,).

        Zero right after a reset.
        """


@runtime_checkable
class ContactSensing(Protocol):
    """An engine that reports contact forces; `mujoco` and `physx` do."""

    def contact_forces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return point [m] and force on the robot [N], in the world, of its contacts in the last step, shapes (3,).

        Contacts of the robot with itself are left out.
        """


Make = Callable[[Body, Ground, float], Engine]
"""Function of body, ground, timestep [s] that makes an engine."""


@dataclass(frozen=True)
class Term:
    """Friction law at a level. Numbers are of the joints, shape (J,), or one for all."""

    law: str
    """One of `simulated_laws`."""
    level: Values
    """Torque [N m], or coefficient [-]."""
    numbers: Mapping[str, Values] = field(default_factory=dict)
    """Numbers of the law in addition to its level, by name; see `Law`."""

    def bound(self, signals: Mapping[str, Values]) -> Values:
        """Return its part of the bound [N m], unfiltered; `signals`: inputs of laws, by name."""
        spec = LAWS[self.law]
        assert spec.factor is not None
        return self.level * spec.factor(**{name: signals[name] for name in spec.reads}, **self.numbers)


class JointFriction:
    """Dry friction of one robot."""

    def __init__(self, timestep: float, *terms: Term) -> None:
        """Combine laws; timestep: of the physics [s]; terms: laws whose bounds add up."""
        self._terms = [Term(term.law, np.array(term.level, float), term.numbers) for term in terms]
        self._decay = [LAWS[term.law].smoothing ** (timestep / SMOOTHING_PERIOD) for term in terms]
        self._wears = [not has_coefficient(term.law) for term in terms]
        self.reset()

    @classmethod
    def under(cls, law: Law, level: np.ndarray, timestep: float) -> JointFriction:
        """Return friction under one law of the training at some level: torque [N m] or coefficient [-], shape (J,)."""
        return cls(timestep, Term(law.name, level, law.numbers))

    @property
    def loaded(self) -> bool:
        """True if the friction depends on the load that a joint transmits."""
        return any(LAWS[term.law].loaded and np.any(term.level) for term in self._terms)

    def reset(self) -> None:
        """Clear the bounds of the last step."""
        self._last: list[Values | None] = [None] * len(self._terms)

    def set_levels(self, *levels: Values) -> None:
        """Set the level of each law from the next step on; the filters continue from the last bounds."""
        self._terms = [
            replace(term, level=np.array(level, float)) for term, level in zip(self._terms, levels, strict=True)
        ]

    def bound(self, motion: Motion, torque: np.ndarray, wear: Values = 1.0) -> np.ndarray:
        """Return the bounds of the coming step [N m], shape (J,).

        motion: the present one; torque: of the motors in the last step [N m], shape (J,); wear: factor on torques [1].
        """
        load = motion.joint_force + motion.joint_torque
        signals = {"velocity": motion.joint_velocity, "load": load, "torque": torque}
        total = np.zeros_like(motion.joint_velocity)
        for index, (term, decay, wears) in enumerate(zip(self._terms, self._decay, self._wears, strict=True)):
            bound, last = term.bound(signals), self._last[index]
            if decay and last is not None:
                bound = decay * last + (1.0 - decay) * bound
            self._last[index] = bound
            total = total + (wear * bound if wears else bound)
        return total
