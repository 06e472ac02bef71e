"""One robot of the factorial, built in an engine and driven from a bundle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.core.rotation import UPRIGHT, about
from stiction.deploy.check import robot_of
from stiction.deploy.pilot import ControlStep, Pilot
from stiction.deploy.policy import load_policy
from stiction.engines.engine import BlownUp, Body, Engine, Motion
from stiction.engines.friction import JointFriction
from stiction.engines.ground import Ground, flat
from stiction.formats.bundle import Bundle
from stiction.formats.walk import Recording
from stiction.locomotion.config import NoiseCfg
from stiction.robots.model import RobotSpec, leans_too_far, too_low
from stiction.virtual.hidden import Hidden, draw
from stiction.virtual.robot import PERIOD, GroundTruth, VirtualRobot, Wear
from stiction.virtual.sensors import INITIAL_ANGLE, Noisy


def fallen(motion: Motion, spec: RobotSpec, ground: float) -> bool:
    """Say whether a robot lies or is about to, by the rule of the training (`Fleet.fallen`); ground: under it [m]."""
    return bool(
        leans_too_far(motion.base_quaternion) or too_low(motion.base_position[2] - ground, spec.standing_height)
    )


class TruthRecorder:
    """Records what one robot does, control step by control step, from its ground truth."""

    def __init__(self, ground_truth: Callable[[], GroundTruth], spec: RobotSpec, period: float) -> None:
        """Begin with the robot in place.

        ground_truth: as `VirtualRobot.ground_truth`; spec: the data sheet; period: of control [s].
        """
        self._ground_truth, self._spec, self._period = ground_truth, spec, period
        self._rows: list[dict[str, np.ndarray | float | bool]] = []
        self._upright, self._velocity = True, ground_truth().motion.joint_velocity

    @property
    def upright(self) -> bool:
        """Whether the robot has not fallen yet."""
        return self._upright

    def record(self, ground: float = 0.0) -> None:
        """Record the end of a control period; ground: its height under the robot [m]."""
        seen = self._ground_truth()
        self._upright = self._upright and not fallen(seen.motion, self._spec, ground)
        self._rows.append(self._row(seen))
        self._velocity = seen.motion.joint_velocity

    def _row(self, seen: GroundTruth) -> dict[str, np.ndarray | float | bool]:
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

    def record_fall(self) -> None:
        """Record a robot that has blown up in its engine: it has fallen, where it was last."""
        self._upright = False
        last = self._rows[-1] if self._rows else self._row(self._ground_truth())
        self._rows.append(last | {"upright": False})

    def recording(self) -> Recording:
        """Return what was seen, of one robot: shapes (T, 1, ...)."""
        stacked = {name: np.stack([row[name] for row in self._rows])[:, None] for name in self._rows[0]}
        return Recording(self._period, **stacked)


TIMESTEP = 0.001
"""Physics step of virtual robots [s]: motor controllers run at 1 kHz and more."""

Make = Callable[[Body, Ground, float], Engine]
"""Makes an engine: body, ground, timestep [s]."""


CommandSource = Callable[[int, Motion], np.ndarray]
"""Commands a robot that it sees: number of the control step, motion -> forward, sideways [m/s], turn [rad/s], (3,)."""


class RobotCase(Protocol):
    """Which robot is built: a `Case` of the factorial, or a `DataSheet`."""

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
        self, case: RobotCase, spec: RobotSpec, generator: np.random.Generator, wear: Wear | None = None
    ) -> VirtualRobot:
        """Build a robot of the factorial.

        spec: the data sheet; generator: of its sensors' noise; wear: of its joints.
        """
        return self._built(case, spec, generator, wear, fixed=False)

    def on_bench(self, case: RobotCase, spec: RobotSpec, generator: np.random.Generator) -> VirtualRobot:
        """Build the same robot bolted to a stand, its legs in the air; arguments as of `robot`."""
        robot = self._built(case, spec, generator, None, fixed=True)
        robot.place(spec.joint_values("standing"), np.array([0.0, 0.0, 3.0 * spec.standing_height]), UPRIGHT)
        return robot

    def _built(
        self, case: RobotCase, spec: RobotSpec, generator: np.random.Generator, wear: Wear | None, fixed: bool
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
    steps: tuple[ControlStep, ...]
    """What the policy saw and did, one for each control period."""


def walk(
    bundle: Bundle,
    case: RobotCase,
    world: World,
    commands: CommandSource,
    steps: int,
    episode: int = 0,
    wear: Wear | None = None,
    spec: RobotSpec | None = None,
    friction: np.ndarray | None = None,
    seed: int = 0,
    known: np.ndarray | None = None,
) -> Trial:
    """Let a bundle walk on a virtual robot for `steps` control periods, or until it falls or blows up, which is a fall.

    commands: gives the commands; episode: number of the start pose and of the sensors' noise, the same in all cells, at
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
    port = robot.handle if world.noise is None else Noisy(robot.handle, world.noise, walking)
    pilot = Pilot(port, load_policy(contract, bundle.policy, known_friction=known), friction)
    recorder = TruthRecorder(robot.ground_truth, spec, contract.control_period)
    done: list[ControlStep] = []
    while len(done) < steps and recorder.upright:
        try:
            done.append(pilot.step(commands(len(done), robot.ground_truth().motion)))
        except BlownUp:
            recorder.record_fall()
        else:
            recorder.record(world.height(robot.ground_truth().motion.base_position[:2]))
    return Trial(recorder.recording(), tuple(done))
