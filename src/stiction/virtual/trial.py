"""Robot of the factorial, built in an engine and driven from a bundle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from stiction.core.provenance import seed_streams
from stiction.core.rotation import UPRIGHT, about
from stiction.deploy.control import ControlStep, Pilot
from stiction.deploy.policy import load_policy
from stiction.engines.engine import BlownUp, Make, Motion
from stiction.engines.ground import Ground, flat
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.walk import Recording
from stiction.joints.compensation import BY_ERROR, Compensation
from stiction.joints.net import TorqueSource
from stiction.robots.model import Robot, leans_too_far, too_low
from stiction.task.config import NoiseCfg
from stiction.virtual.cases import Case, DataSheet
from stiction.virtual.drive import INITIAL_ANGLE, Noisy, Recorder, Truth, drive
from stiction.virtual.hidden import draw
from stiction.virtual.robot import PERIOD, GroundTruth, VirtualRobot, Wear

TIMESTEP = 0.001
"""Physics step of virtual robots [s]: motor controllers run at 1 kHz and more."""

RobotCase = Case | DataSheet
"""Robot to build; its seed is also for start poses and sensor noise."""

CommandSource = Callable[[int, Motion], np.ndarray]
"""Number of the control step, motion -> commanded velocity: forward, sideways [m/s], turn [rad/s], shape (3,)."""


@dataclass(frozen=True)
class World:
    """Engine, ground and start of a robot."""

    make: Make
    ground: Ground = field(default_factory=flat)
    start: tuple[float, float] = (0.0, 0.0)
    """Initial position, x and y [m]."""
    heading: float = 0.0
    """Initial yaw [rad]."""
    timestep: float = TIMESTEP
    """Physics step [s]."""
    period: float = PERIOD
    """Time between two readings [s]; logs for an Actuator Net need that of the training's physics."""
    noise: NoiseCfg | None = None
    """Sensor noise of the training, for robots with perfect sensors."""
    torque_source: TorqueSource = "motor_side"
    """Place of the torque measurement, see `VirtualRobot`."""

    def height(self, place: np.ndarray) -> float:
        """Return the height of the ground at x, y [m], shape (2,)."""
        return float(self.ground.height(place[None])[0])

    def fallen(self, motion: Motion, spec: Robot) -> bool:
        """Return whether a robot has fallen, by the rule of the training (`Fleet.fallen`); spec: its data sheet."""
        height = motion.base_position[2] - self.height(motion.base_position[:2])
        return bool(leans_too_far(motion.base_quaternion) or too_low(height, spec.standing_height))

    def on_bench(self, case: RobotCase, spec: Robot, generator: np.random.Generator) -> VirtualRobot:
        """Build a robot bolted to a stand, its legs in the air; arguments as of `robot`."""
        robot = self.robot(case, spec, generator, fixed=True)
        robot.place(spec.joint_values("default_position"), np.array([0.0, 0.0, 3.0 * spec.standing_height]), UPRIGHT)
        return robot

    def robot(
        self,
        case: RobotCase,
        spec: Robot,
        generator: np.random.Generator,
        wear: Wear | None = None,
        fixed: bool = False,
    ) -> VirtualRobot:
        """Build a robot in its engine. generator: of its sensors' noise; fixed: bolted to a stand."""
        hidden = draw(spec, case.seed)
        real = case.robot(hidden)
        engine = self.make(real.body(spec, fixed), self.ground, self.timestep)
        friction = case.friction(hidden, spec, self.timestep)
        return VirtualRobot(engine, real, friction, generator, self.period, wear, fixed, self.torque_source)


class VirtualWalk:
    """Policy on one virtual robot in its world: a walker of `drive`."""

    def __init__(self, robot: VirtualRobot, pilot: Pilot, world: World, spec: Robot) -> None:
        """Connect policy and robot; spec: the robot's data sheet."""
        self.robot, self.pilot, self._world, self._spec = robot, pilot, world, spec

    def place(self, joint_position: np.ndarray) -> None:
        """Place the robot at the start of its world at joint angles [rad], shape (J,), without any history."""
        start, height = self._world.start, self._spec.standing_height + self._world.height(np.array(self._world.start))
        self.robot.place(joint_position, np.array([*start, height]), about(2, self._world.heading))
        self.pilot.reset()

    def step(self, velocity: np.ndarray) -> ControlStep:
        """Advance by one control period; see `Pilot.step`. Raises `BlownUp`."""
        return self.pilot.step(velocity)

    @property
    def seen(self) -> GroundTruth:
        """Ground truth of the last physics step."""
        return self.robot.ground_truth()

    @property
    def fallen(self) -> bool:
        """True if the robot has fallen, or is about to."""
        return self._world.fallen(self.seen.motion, self._spec)

    def truth(self) -> Truth:
        """Return the ground truth at the end of the last control period, of a batch of one."""
        seen, motion = self.seen, self.seen.motion
        return Truth(
            velocity=np.array([[*motion.base_linear_velocity[:2], motion.base_angular_velocity[2]]]),
            position=motion.base_position[None, :2],
            contact=motion.foot_contact[None],
            torque=seen.torque[None],
            joint_velocity=motion.joint_velocity[None],
            friction=seen.friction[None],
            fallen=np.array([self.fallen]),
            chatter=np.array([seen.chatter]),
        )


@dataclass(frozen=True)
class Trial:
    """Results of one walk."""

    recording: Recording
    """Ground truth of one robot; shapes (T, 1, ...)."""
    steps: tuple[ControlStep, ...]
    """Observations and actions of the policy, one for each control period."""


def walk(
    bundle: Bundle,
    case: RobotCase,
    world: World,
    commands: CommandSource,
    steps: int,
    episode: int = 0,
    wear: Wear | None = None,
    spec: Robot | None = None,
    friction: np.ndarray | None = None,
    seed: int = 0,
    known: np.ndarray | None = None,
    compensation: Compensation = BY_ERROR,
    load: np.ndarray | float = 0.0,
) -> Trial:
    """Let a bundle walk on a virtual robot for `steps` control periods, or until it falls or blows up, which is a fall.

    episode: number of start pose and noise, the same in all cells and in `Rollout` under the case's seed; seed: 0, or
    another one for other episodes; friction, load: fed forward by the computer or the motors as in `compensation`, see
    `Pilot`; known: friction for a policy that observes it, by default the contract's. Raises `StictionError` where the
    bundle does not match, or compensates friction itself.
    """
    contract = bundle.contract
    spec = spec or robot_of(contract)
    name = f"episode {episode}" + (f" of seed {seed}" if seed else "")
    # `walking` is drawn as in the simulator of the training (`Rollout`): start pose, and its noise where that is asked
    # for.
    walking, sensing = seed_streams(case.seed, [name, f"{name}, sensors"]).values()
    standing = contract.array("standing") + INITIAL_ANGLE * walking.uniform(-1.0, 1.0, contract.num_joints)
    robot = world.robot(case, spec, sensing, wear)
    # After the draw, which is the same for every robot of an episode.
    standing = np.clip(standing, contract.array("lower"), contract.array("upper"))
    port = robot.handle if world.noise is None else Noisy(robot.handle, world.noise, walking)
    policy, motors = load_policy(contract, bundle.policy, known_friction=known), None
    if friction is not None and compensation.in_motor:
        motors = compensation.controller(friction, world.timestep, load=load)
        friction, compensation = None, BY_ERROR
    walker = VirtualWalk(robot, Pilot(port, policy, friction, compensation, load), world, spec)
    walker.place(standing)
    robot.program(motors)
    recorder = Recorder(walker, contract.control_period, steps, float)
    done: list[ControlStep] = []
    try:
        for step in drive(walker, lambda number: commands(number, walker.seen.motion), steps):
            done.append(step)
            recorder.record()
            if not recorder.upright.all():
                break
    except BlownUp:
        recorder.record_fall()
    return Trial(recorder.recording(), tuple(done))
