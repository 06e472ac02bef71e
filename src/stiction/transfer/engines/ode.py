"""One robot in ODE 0.16, the family of engines that Webots belongs to: bodies held together by constraints.

MuJoCo and PhysX have joint angles for coordinates; ODE has bodies, and joints that pull them together. A step is one
linear complementarity problem, solved exactly (`dWorldStep`). ODE's iterative solver (`dWorldQuickStep`) does not hold
joints: with friction at 20 % of the torque limits, Saturn Lite under its controllers had sagged 0.0003 rad after 3 s
with the exact one, 0.22 rad with 20 iterations and 0.10 rad with 100, at 2.3, 5.2 and 2.8 thousand steps a second.
"""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass, field

import numpy as np

from stiction.formats.errors import StictionError
from stiction.transfer.engines.engine import GRAVITY, TOUCH, BlownUp, Body, Motion, check_speed
from stiction.transfer.engines.ground import Ground
from stiction.transfer.engines.ode_check import check_body, check_drive, check_pose
from stiction.transfer.engines.ode_contact import ContactSettings, OdeContacts
from stiction.transfer.engines.ode_library import ode_library, prepare_thread, taken_messages
from stiction.transfer.engines.ode_robot import OdeRobot
from stiction.transfer.engines.rotation import UPRIGHT

ITERATIONS = 100
"""Of the iterative solver, in a step that the exact one gives up. Robots that thrashed about under random torques had 9
such steps in 67 000 on height fields, with Webots' settings 12, and none in 77 000 on planes and boxes."""


@dataclass(frozen=True)
class OdeSettings:
    """What a user of ODE can set."""

    name: str = "ode"
    """As in results.csv."""
    erp: float = 0.2
    """Share of a joint's gap that is closed in a step [1]."""
    cfm: float = 1e-10
    """Speed at which a constraint gives way, per force [m/s/N, rad/s/N m]: as good as none."""
    contact: ContactSettings = field(default_factory=ContactSettings)
    """Of the contacts."""


ACCURATE = OdeSettings()
"""The best that ODE can do."""

WEBOTS = OdeSettings("ode-webots", cfm=1e-5, contact=ContactSettings(cfm=1e-3, last_step=False))
"""What Webots sets unless a world says otherwise, for contacts that do not bounce (its default is to bounce by 0.5)."""


class OdeEngine:
    """`Engine` on ODE. `reset` and `step` are called by one thread."""

    def __init__(self, body: Body, ground: Ground, timestep: float, settings: OdeSettings = ACCURATE) -> None:
        """Build the robot on its ground, standing, the base at the origin; `timestep` of the physics [s].

        Raises:
            StictionError: there is no ODE 0.16, or it cannot have such a robot or timestep.

        """
        if not 0 < timestep < np.inf:
            raise StictionError(f"physics step {timestep} s; expected a positive number")
        check_body(body)
        self._library = library = ode_library()
        prepare_thread(library)
        self.name, self.body, self.timestep, self.settings = settings.name, body, timestep, settings
        self._world = world = library.dWorldCreate()
        library.dWorldSetGravity(world, 0.0, 0.0, -GRAVITY)
        library.dWorldSetERP(world, settings.erp)
        library.dWorldSetCFM(world, settings.cfm)
        library.dWorldSetQuickStepNumIterations(world, ITERATIONS)
        self._robot = OdeRobot(library, world, body, timestep)
        self._contacts = OdeContacts(library, world, self._robot, body, ground, settings.contact)
        weakref.finalize(self, _destroy, library, world, self._contacts)
        self.reset(body.spec.joint_values("standing"), np.zeros(3), UPRIGHT)

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Put the robot there, at rest; see `Engine.reset`.

        Raises:
            StictionError: something is not a number, or the quaternion not of length 1.

        """
        check_pose(joint_position, position, quaternion)
        prepare_thread(self._library)
        self._contacts.forget()
        self._robot.place(joint_position, position, quaternion)
        self._lost = False

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep; see `Engine.step`.

        Raises:
            BlownUp: the robot's numbers, or torques or bounds, are none any more.
            StictionError: a bound is negative.

        """
        check_drive(torque, friction)
        if self._lost:
            raise BlownUp(f"the robot in the engine {self.name!r} was lost in a step before; reset it first")
        self._lost = True
        self._contacts.find()
        self._robot.drive(torque, friction)
        self._advance()
        self._robot.read()
        check_speed(self.name, *self._robot.speeds())
        self._lost = False

    def _advance(self) -> None:
        """Take a step; where the exact solver gives it up, and leaves forces out, take it again with the iterative one.

        That one puts its rows in a random order, each time from the same seed.
        """
        library, world, before = self._library, self._world, self._robot.state()
        taken_messages()
        done = library.dWorldStep(world, self.timestep)
        if taken_messages():
            self._robot.restore(before)
            library.dRandSetSeed(0)
            done = library.dWorldQuickStep(world, self.timestep)
        if not done:
            raise StictionError("ODE found no memory for a step; free some")

    def motion(self, loads: bool = True) -> Motion:
        """Return what the robot does now; see `Motion`."""
        position, quaternion, velocity, rate = self._robot.base_motion()
        force, torque = self._robot.transmitted() if loads else np.zeros((2, self.body.spec.num_joints))
        return Motion(
            base_position=position,
            base_quaternion=quaternion,
            base_linear_velocity=velocity,
            base_angular_velocity=rate,
            joint_position=self._robot.angle.copy(),
            joint_velocity=self._robot.speed.copy(),
            foot_contact=self._contacts.pushes() >= TOUCH,
            joint_force=force,
            joint_torque=torque,
        )


def webots_engine(body: Body, ground: Ground, timestep: float) -> OdeEngine:
    """Return an engine with Webots' settings; arguments and errors as those of `OdeEngine`."""
    return OdeEngine(body, ground, timestep, WEBOTS)


def _destroy(library: ctypes.CDLL, world: int, contacts: OdeContacts) -> None:
    """Give a world and all that is in it back, shapes before the bodies that they know."""
    contacts.release()
    library.dWorldDestroy(world)
