"""Robot in ODE 0.16, the engine that Webots' is based on: bodies held together by constraints.

MuJoCo and PhysX have joint angles for coordinates; ODE has bodies, and joints that pull them together. A step is one
linear complementarity problem, solved exactly (`dWorldStep`). ODE's iterative solver (`dWorldQuickStep`) does not hold
joints by friction: a standing robot sags, with a hundred iterations too, which cost as much as the exact solution.

After an error ODE calls exit(), after a failed assertion abort(); builds without assertions continue with garbage, and
a linear complementarity problem that holds a NaN may never end. So all numbers are checked here; the ground checks its
own.
"""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from stiction.core.errors import EngineError
from stiction.core.rotation import UPRIGHT
from stiction.engines.engine import TOUCH, BlownUp, Body, Motion, check_speed
from stiction.engines.ground import Ground
from stiction.engines.ode.contact import ContactSettings, OdeContacts
from stiction.engines.ode.library import ode_library, prepare_thread, take_messages
from stiction.engines.ode.robot import OdeRobot
from stiction.robots.model import GRAVITY

WIDEST = 2 * np.pi
"""Maximum range of a joint [rad]: ODE has angles from -π to π."""


def check_body(body: Body) -> None:
    """Raise `StictionError` for a robot that ODE cannot build."""
    spec, tree = body.spec, body.spec.links
    _expect(spec.name, "mass [kg]", [spec.base.mass, *(link.mass for link in tree)], above=0.0)
    _expect(spec.name, "moment of inertia [kg m²]", np.array([link.principal[0] for link in tree]), above=0.0)
    shapes = [shape for part in (spec.base, *tree) for shape in part.shapes]
    shapes += [shape for foot in spec.feet for shape in foot.shapes]
    solid = [shape for shape in shapes if shape.contact != "nothing"]
    _expect(spec.name, "size of a shape [m]", [shape.size[0] for shape in solid if shape.kind != "hull"], above=0.0)
    _expect(spec.name, "range of a joint [rad]", spec.joint_values("upper") - spec.joint_values("lower"), below=WIDEST)
    _expect(spec.name, "place of the trunk's centre of mass [m]", body.base_com)
    _expect(spec.name, "friction of the feet [1]", [body.ground_friction], least=0.0)
    _expect(spec.name, "armature [kg m²]", body.armature, least=0.0)
    _expect(spec.name, "damping [N m s/rad]", body.damping, least=0.0)
    _expect(spec.name, "sum of armature and damping", np.add(body.armature, body.damping), above=0.0)


def check_pose(joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Raise `StictionError` for an invalid pose; arguments as those of `Engine.reset`."""
    is_unit = abs(np.linalg.norm(quaternion) - 1.0) < 1e-6
    if not (np.isfinite(joint_position).all() and np.isfinite(position).all() and is_unit):
        raise EngineError(
            f"reset of a robot to {position} m, quaternion {quaternion}, joint angles of {np.min(joint_position)} to "
            f"{np.max(joint_position)} rad; expected finite numbers, and a quaternion of length 1"
        )


def check_drive(torque: np.ndarray, friction: np.ndarray) -> None:
    """Raise `BlownUp` for a torque or a bound that is not finite, `StictionError` for a negative bound."""
    for name, values in (("torque", torque), ("bound of friction", friction)):
        if not np.isfinite(values).all():
            joint = int(np.argmin(np.isfinite(values)))
            raise BlownUp(f"the {name} of joint {joint} is {values[joint]} N m; expected a finite number")
    if np.min(friction) < 0:
        raise EngineError(f"the bound of friction of a joint is {np.min(friction):g} N m; expected none under zero")


def _expect(
    robot: str,
    name: str,
    values: object,
    least: float = -np.inf,
    above: float = -np.inf,
    below: float = np.inf,
) -> None:
    """Raise `StictionError` unless values of a robot are finite and in a range, the first bound included."""
    numbers = np.ravel(np.asarray(values, float))
    wrong = ~(np.isfinite(numbers) & (numbers >= least) & (numbers > above) & (numbers < below))
    if wrong.any():
        bounds = ((least, "at least"), (above, "above"), (below, "below"))
        wanted = [f"{word} {bound:.4g}" for bound, word in bounds if np.isfinite(bound)]
        raise EngineError(
            f"robot {robot!r}: {name} of {numbers[wrong][0]:g}; the engine 'ode' expects "
            f"{' and '.join(['a finite number', *wanted])}"
        )


ITERATIONS = 100
"""Iterations of QuickStep, used only when the exact solver fails."""


@dataclass(frozen=True)
class OdeSettings:
    """Settings of ODE."""

    name: str = "ode"
    """Name as in results.csv."""
    erp: float = 0.2
    """Share of a joint's gap that is closed in a step [1]."""
    cfm: float = 1e-10
    """Yielding speed of a constraint per force [m/s/N, rad/s/N m]: negligible."""
    contact: ContactSettings = field(default_factory=ContactSettings)
    """Settings of the contacts."""


ACCURATE = OdeSettings()
"""Most accurate settings of ODE."""

WEBOTS = OdeSettings("ode-webots", cfm=1e-5, contact=ContactSettings(cfm=1e-3, last_step=False))
"""Webots' defaults, except that contacts do not bounce (its default is to bounce by 0.5)."""


class OdeEngine:
    """`Engine` on ODE. `reset` and `step` must be called by one thread."""

    def __init__(self, body: Body, ground: Ground, timestep: float, settings: OdeSettings = ACCURATE) -> None:
        """Build the robot on its ground, standing, the base at the origin; `timestep` of the physics [s].

        Raises `StictionError`: ODE 0.16 is missing, or does not support such a robot or timestep.
        """
        if not 0 < timestep < np.inf:
            raise EngineError(f"physics step {timestep} s; expected a positive number")
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
        # Not `__del__`, which may run when the modules that it needs are gone. It must not refer to this object, or
        # would keep it.
        weakref.finalize(self, _destroy, library, world, self._contacts)
        self.reset(body.spec.joint_values("default_position"), np.zeros(3), UPRIGHT)

    def reset(self, joint_position: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Place the robot at rest; see `Engine.reset` and `check_pose`."""
        check_pose(joint_position, position, quaternion)
        prepare_thread(self._library)
        self._contacts.forget()
        self._robot.place(joint_position, position, quaternion)
        self._lost = False

    def step(self, torque: np.ndarray, friction: np.ndarray) -> None:
        """Advance by one timestep; see `Engine.step` and `check_drive`."""
        check_drive(torque, friction)
        if self._lost:
            raise BlownUp(f"the robot in the engine {self.name!r} was lost in a step before; reset it first")
        # Until the step has ended well: after an error in between nobody may go on from this state.
        self._lost = True
        self._contacts.find()
        self._robot.drive(torque, friction)
        self._advance()
        self._robot.read()
        check_speed(self.name, *self._robot.speeds())
        self._lost = False

    def _advance(self) -> None:
        """Take a step; where the exact solver fails, which omits forces, repeat it with the iterative one."""
        library, world, before = self._library, self._world, self._robot.state()
        # Those of finding contacts are not the solver's.
        take_messages()
        done = library.dWorldStep(world, self.timestep)
        if take_messages():
            self._robot.restore(before)
            # The iterative solver shuffles its rows.
            library.dRandSetSeed(0)
            done = library.dWorldQuickStep(world, self.timestep)
        if not done:
            raise EngineError("ODE found no memory for a step; free some")

    def push(self, velocity: np.ndarray) -> None:
        """Push the robot; see `Pushable.push`."""
        if not self.body.fixed:
            self._robot.push(velocity)

    def motion(self, loads: bool = True) -> Motion:
        """Return the present motion; see `Motion`."""
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


def _destroy(library: ctypes.CDLL, world: int, contacts: OdeContacts) -> None:
    """Free a world and its contents, shapes before the bodies that they refer to."""
    contacts.release()
    library.dWorldDestroy(world)


webots_engine = partial(OdeEngine, settings=WEBOTS)
"""Factory of the engine `ode-webots`."""
