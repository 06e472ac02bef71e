"""One robot of the factorial, built in an engine and driven from a bundle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stiction.deploy.policy import load_policy
from stiction.formats.bundle import Bundle
from stiction.formats.reproducibility import seed_streams
from stiction.locomotion.config import NoiseCfg
from stiction.robots.spec import RobotSpec
from stiction.transfer.engines.engine import BlownUp, Body, Engine, Motion
from stiction.transfer.engines.ground import Ground, flat
from stiction.transfer.engines.joint_physics import JointFriction
from stiction.transfer.engines.rotation import UPRIGHT, about
from stiction.transfer.metrics import Recording
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.hidden import Hidden
from stiction.transfer.robot.noisy import Noisy
from stiction.transfer.robot.pilot import Pilot, Turn
from stiction.transfer.robot.referee import Referee
from stiction.transfer.robot.virtual import PERIOD, VirtualRobot
from stiction.transfer.robot.wear import Wear
from stiction.transfer.rollout import INITIAL_ANGLE, robot_of

TIMESTEP = 0.001
"""Physics step of virtual robots [s]: motor controllers run at 1 kHz and more."""

Make = Callable[[Body, Ground, float], Engine]
"""Makes an engine: body, ground, timestep [s]."""


Steer = Callable[[int, Motion], np.ndarray]
"""Commands a robot as a person would who sees it: number of the control step, motion -> forward, sideways [m/s], turn
[rad/s], shape (3,)."""


class Kind(Protocol):
    """Which robot is built: a `Case` of the factorial, or one like it."""

    @property
    def seed(self) -> int:
        """Of the robot, of its start poses and of its sensors' noise."""
        ...

    def robot(self, hidden: Hidden) -> Hidden:
        """Return what of a robot is real."""
        ...

    def friction(self, hidden: Hidden, spec: RobotSpec, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        ...


@dataclass(frozen=True)
class World:
    """Where a robot is built."""

    make: Make
    """The engine."""
    ground: Ground = field(default_factory=flat)
    """What the robot walks on."""
    start: tuple[float, float] = (0.0, 0.0)
    """Where it is put, x and y [m]."""
    heading: float = 0.0
    """Where it looks, from x to the left [rad]."""
    timestep: float = TIMESTEP
    """Physics step [s]."""
    period: float = PERIOD
    """Time between two readings [s]; logs for an Actuator Net need that of the training's physics."""
    noise: NoiseCfg | None = None
    """Sensor noise of the training, for robots whose own sensors are perfect."""

    def height(self, place: np.ndarray) -> float:
        """Return the height of the ground at x, y [m], shape (2,)."""
        return float(self.ground.height(place[None])[0])

    def robot(
        self, case: Kind, spec: RobotSpec, generator: np.random.Generator, wear: Wear | None = None
    ) -> VirtualRobot:
        """Build a robot of the factorial.

        spec: the data sheet; generator: of its sensors' noise; wear: of its joints.
        """
        return self._built(case, spec, generator, wear, fixed=False)

    def on_bench(self, case: Kind, spec: RobotSpec, generator: np.random.Generator) -> VirtualRobot:
        """Build the same robot bolted to a stand, its legs in the air; arguments as of `robot`."""
        robot = self._built(case, spec, generator, None, fixed=True)
        robot.place(spec.joint_values("standing"), np.array([0.0, 0.0, 3.0 * spec.standing_height]), UPRIGHT)
        return robot

    def _built(
        self, case: Kind, spec: RobotSpec, generator: np.random.Generator, wear: Wear | None, fixed: bool
    ) -> VirtualRobot:
        """Build a robot around its own engine."""
        hidden = draw(spec, case.seed)
        real = case.robot(hidden)
        engine = self.make(real.body(spec, fixed), self.ground, self.timestep)
        friction = case.friction(hidden, spec, self.timestep)
        return VirtualRobot(engine, real, friction, generator, self.period, wear, loads=fixed)


@dataclass(frozen=True)
class Trial:
    """One walk."""

    recording: Recording
    """The truth, of one robot; shapes (T, 1, ...)."""
    turns: tuple[Turn, ...]
    """What the policy's side saw and did."""


def walk(
    bundle: Bundle,
    case: Kind,
    world: World,
    steer: Steer,
    steps: int,
    episode: int = 0,
    wear: Wear | None = None,
    spec: RobotSpec | None = None,
    friction: np.ndarray | None = None,
    seed: int = 0,
    known: np.ndarray | None = None,
) -> Trial:
    """Let a bundle walk on a virtual robot for `steps` control periods, or until it falls or blows up, which is a fall.

    steer: gives the commands; episode: number of the start pose and of the sensors' noise, the same in all cells, at
    all levels, and in the training's simulator (`Rollout`) under the case's seed; wear: of the robot's joints; spec:
    the robot, by default the shipped one that the bundle names; friction: what the joint controllers feed forward, see
    `Pilot`; seed: 0, or of other episodes of the same robot; known: what a policy that observes its joints' friction is
    told, see `ObservationBuilder`, by default what its contract says.

    Raises:
        StictionError: the bundle does not fit the robot, or friction is to be fed forward to one that compensates it.

    """
    contract = bundle.contract
    spec = spec or robot_of(contract)
    name = f"episode {episode}" + (f" of seed {seed}" if seed else "")
    walking, sensing = seed_streams(case.seed, [name, f"{name}, sensors"]).values()
    standing = contract.array("standing") + INITIAL_ANGLE * walking.uniform(-1.0, 1.0, contract.num_joints)
    robot = world.robot(case, spec, sensing, wear)
    standing = np.clip(standing, contract.array("lower"), contract.array("upper"))
    height = spec.standing_height + world.height(np.array(world.start))
    robot.place(standing, np.array([*world.start, height]), about(2, world.heading))
    port = robot.plug if world.noise is None else Noisy(robot.plug, world.noise, walking)
    pilot = Pilot(port, load_policy(contract, bundle.policy, known_friction=known), friction)
    referee = Referee(robot.witness, spec, contract.control_period)
    turns: list[Turn] = []
    while len(turns) < steps and referee.upright:
        try:
            turns.append(pilot.step(steer(len(turns), robot.witness().motion)))
        except BlownUp:
            referee.lose()
        else:
            referee.look(world.height(robot.witness().motion.base_position[:2]))
    return Trial(referee.recording(), tuple(turns))
