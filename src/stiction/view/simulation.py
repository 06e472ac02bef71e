"""Policies that walk side by side, each alone in its own engine, while command, friction and world change. No viser.

Each control step is the one that evaluations and robots take: `Pilot` on a `VirtualRobot` of the data sheet, in the
engines and under the laws of every other verb. All robots get the same command, friction, pushes and ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.names import kind_of
from stiction.core.provenance import seed_streams
from stiction.core.rotation import yaw
from stiction.deploy.control import ControlStep, DrivingPolicy, Pilot
from stiction.deploy.plausibility import command_range
from stiction.deploy.policy import load_policy
from stiction.deploy.wear import WearEstimate, WearMonitor
from stiction.engines.catalog import find_engine, make_engine
from stiction.engines.engine import BlownUp, Body, Engine, JointFriction, Motion, Pushable
from stiction.engines.ground import Ground, course
from stiction.evaluation.course import FLAT, START_DISTANCE, Course, straight_on
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract
from stiction.files.wear import WearModel
from stiction.joints.friction import MAX_LEVEL, Law, has_coefficient, level_text
from stiction.robots.model import Robot
from stiction.task.config import NoiseCfg
from stiction.virtual.cases import DataSheet
from stiction.virtual.drive import Noisy
from stiction.virtual.hidden import Hidden
from stiction.virtual.trial import VirtualWalk, World

LYING = 1.5
"""How long a robot lies where it fell before it is put back to the start [s]."""

MAX_WEAR = 5.0
"""Largest factor on the friction [1]; of a joint whose seals are gone it is 0.3, see `virtual.robot`."""

FASTEST_PUSH = 3.0
"""Largest push [m/s]."""


@dataclass(frozen=True)
class ViewedPolicy:
    """One policy to look at."""

    name: str
    """What the robot is called."""
    contract: Contract
    """What the policy expects."""
    load: Callable[[], DrivingPolicy]
    """Makes it, for one robot, its history empty."""
    wear: WearModel | None = None
    """Map from its walk to its joints' friction, where it has one."""

    @property
    def short(self) -> str:
        """Its name up to the colon."""
        return self.name.partition(":")[0]

    @classmethod
    def of_bundle(cls, bundle: Bundle, name: str | None = None) -> ViewedPolicy:
        """Return the policy of a checked bundle, called `name`, by default after its training."""
        contract = bundle.contract
        return cls(name or plain_name(contract), contract, lambda: load_policy(contract, bundle.policy), bundle.wear)


def plain_name(contract: Contract) -> str:
    """Return what a policy's training met, in a few words: `direct: trained at 20 %`."""
    law, (low, high) = contract.friction_law, contract.friction_range
    words = {
        "none": "trained without friction",
        "deception": f"trained from {level_text(law, low)} to {level_text(law, high)}",
        "direct": f"trained at {level_text(law, contract.friction_level)}",
        "imported": "trained elsewhere",
    }.get(contract.method, f"trained {contract.trained}")
    return f"{contract.method}: {words}"


@dataclass(frozen=True)
class WorldCfg:
    """Where the robots walk."""

    engine: str = "mujoco"
    """Name of the physics engine."""
    course: Course = FLAT
    """The ground; each robot has its own."""
    law: Law = field(default_factory=Law)
    """Of the joints' dry friction."""
    seed: int = 0
    """Of sensor noise, and of the slabs of rough ground."""


@dataclass(frozen=True)
class DialledSheet(DataSheet):
    """The robot of the data sheet; its friction can be had, to be changed while it walks."""

    given: list[JointFriction] = field(default_factory=list)
    """What `friction` returned."""

    def friction(self, hidden: Hidden, spec: Robot, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        self.given.append(super().friction(hidden, spec, timestep))
        return self.given[-1]


@dataclass(frozen=True)
class Seen:
    """One robot at the end of a control step."""

    motion: Motion
    """The truth about its body."""
    torque: np.ndarray
    """That its motors gave in the last physics step [N m], shape (J,)."""
    friction: np.ndarray
    """Bounds of its joints' dry friction [N m], shape (J,)."""
    step: ControlStep | None
    """What policy and sensors did; None of a robot that lies."""

    @property
    def velocity(self) -> np.ndarray:
        """Forward, sideways [m/s], turn [rad/s], of the base in its frame, shape (3,)."""
        return np.array([*self.motion.base_linear_velocity[:2], self.motion.base_angular_velocity[2]])


class Walker:
    """One policy on one robot, in a world of its own."""

    def __init__(self, policy: ViewedPolicy, spec: Robot, cfg: WorldCfg, ground: Ground, level: np.ndarray) -> None:
        """Make the robot, and put it to the start.

        spec: its data sheet; level: of each joint's friction, torque [N m] or coefficient [-], shape (J,). Raises
        `StictionError` where the engine is not installed or cannot have such a robot, or the map from the policy's walk
        to friction is another's.
        """
        self.policy, self.spec = policy, spec
        self.range = command_range(policy.contract)
        self._monitor = None if policy.wear is None else WearMonitor(policy.contract, policy.wear)
        self.start = 0.0 if cfg.course.is_flat else -START_DISTANCE
        """Where it starts, along x [m]."""
        self.falls = 0
        """How often it fell."""
        self.belief: WearEstimate | None = None
        """What the policy's walk told last of its joints' friction; None: nothing yet, or it has no map for that."""
        engine = find_engine(cfg.engine)
        engines: list[Engine] = []

        def make(body: Body, around: Ground, timestep: float) -> Engine:
            # The world makes the engine within; it is caught here, to be pushed.
            engines.append(make_engine(cfg.engine, body, around, timestep))
            return engines[-1]

        world = World(make, ground, (self.start, 0.0), timestep=engine.timestep, noise=NoiseCfg())
        # Not at 0: a robot whose law has no level need not know what its joints transmit, and would never be told.
        sheet = DialledSheet(cfg.seed, cfg.law, 1.0)
        noise, sensors = seed_streams(cfg.seed, ["view", "view, sensors"]).values()
        robot = world.robot(sheet, self.spec, sensors)
        (self._engine,), (self._friction,) = engines, sheet.given
        self._port = Noisy(robot.handle, NoiseCfg(), noise)
        self._walk = VirtualWalk(robot, Pilot(self._port, self.policy.load()), world, self.spec)
        self.set_friction(level)
        self.reset()

    @property
    def believes(self) -> bool:
        """Whether the policy's walk tells anything of its joints' friction."""
        return self._monitor is not None

    @property
    def lies(self) -> bool:
        """Whether it has fallen and waits."""
        return self._left > 0

    def teach(self, policy: ViewedPolicy) -> None:
        """Give the robot another policy, as it walks."""
        self.policy = policy
        self._walk.pilot = Pilot(self._port, policy.load())

    def reset(self) -> None:
        """Put the robot to the start, standing."""
        self._walk.place(self.policy.contract.array("standing"))
        self._left, self.belief = 0.0, None
        if self._monitor is not None:
            self._monitor.reset()
        self.seen = self._look(None)

    def set_friction(self, level: np.ndarray) -> None:
        """Set the level of each joint's friction, torque [N m] or coefficient [-], shape (J,)."""
        self._friction.set_levels(level)

    def push(self, velocity: np.ndarray) -> None:
        """Add a velocity, x and y in the world [m/s], to the robot's. Raises `StictionError`: an engine without."""
        if not isinstance(self._engine, Pushable):
            raise ConfigurationError(f"the engine {self._engine.name!r} cannot push robots; choose another one")
        self._engine.push(velocity)

    def step(self, velocity: np.ndarray) -> None:
        """Advance by one control period under a command, shape (3,), as near to it as the policy was trained for."""
        period = self.policy.contract.control_period
        if self._left > 0:
            self._left -= period
            if self._left <= 0:
                self.reset()
            else:
                self.seen = replace(self.seen, step=None)
            return
        try:
            step = self._walk.step(np.clip(velocity, *self.range))
        except BlownUp:
            self._fall()
            return
        self.seen = self._look(step)
        if self._walk.fallen:
            self._fall()
        elif self._monitor is not None:
            self.belief = self._monitor.step(step.policy.observation) or self.belief

    def _fall(self) -> None:
        """Let the robot lie for a while."""
        self.falls += 1
        self._left = LYING
        self.seen = replace(self.seen, step=None)

    def _look(self, step: ControlStep | None) -> Seen:
        """Return what there is to see of the robot."""
        truth = self._walk.seen
        return Seen(truth.motion, truth.torque, truth.friction, step)


class Simulation:
    """Robots side by side. Numbers that are out of range are taken as the nearest that is not."""

    def __init__(self, policies: Sequence[ViewedPolicy], spec: Robot, cfg: WorldCfg | None = None) -> None:
        """Put one robot a policy to the start, told to stand, without dry friction.

        Raises `StictionError`: no policy, policies of other robots or control periods, or no such engine.
        """
        if not policies:
            raise ConfigurationError("no policy to look at; name a bundle or a run")
        first = policies[0].contract
        for policy in policies:
            contract = policy.contract
            if contract.joint_names != first.joint_names or contract.control_period != first.control_period:
                raise ConfigurationError(
                    f"{policy.name!r} is for {contract.robot}, a command every {contract.control_period:g} s, and "
                    f"{policies[0].name!r} for {first.robot}, every {first.control_period:g} s; expected policies of "
                    "one robot and one period: look at them one by one"
                )
        self.spec, self.period = spec, first.control_period
        self.kinds = spec.joint_kinds
        self.levels: Mapping[str, float] = dict.fromkeys(self.kinds, 0.0)
        """Friction of each kind of joint: a fraction of the torque limit, or a coefficient [-]."""
        self.wear = 1.0
        """Factor on torques of friction [1]; coefficients do not wear."""
        self.velocity = np.zeros(3)
        """Command: forward, sideways [m/s], turn [rad/s]."""
        self.straight = True
        """Whether robots that are not told to turn are held straight on, so that they stay side by side; over a course
        they always are."""
        self._enter(cfg or WorldCfg(), policies)

    @property
    def range(self) -> np.ndarray:
        """Commands that every policy was trained for: lower and upper ends, shape (2, 3)."""
        ranges = np.array([walker.range for walker in self.walkers])
        return np.stack((ranges[:, 0].max(axis=0), ranges[:, 1].min(axis=0)))

    def set_world(self, cfg: WorldCfg) -> None:
        """Put all robots to the start of another world. Raises `StictionError`, and stays in the old one."""
        self._enter(cfg, [walker.policy for walker in self.walkers])

    def _enter(self, cfg: WorldCfg, policies: Sequence[ViewedPolicy]) -> None:
        """Put one robot a policy to the start of a world."""
        ground, level = course(cfg.course.kind, cfg.course.size, cfg.seed), self._level(cfg.law)
        # All new robots before anything else is changed: where one cannot be made, the old world stays.
        self.walkers = [Walker(policy, self.spec, cfg, ground, level) for policy in policies]
        self.cfg, self.ground = cfg, ground
        self.time = 0.0
        """Simulated since the last start [s]."""

    def reset(self) -> None:
        """Put all robots to the start, under the command that they have."""
        for walker in self.walkers:
            walker.reset()
        self.time = 0.0

    def set_velocity(self, velocity: Sequence[float]) -> None:
        """Command all robots: forward, sideways [m/s], turn [rad/s]."""
        self.velocity = np.clip([finite(value) for value in velocity], *self.range)

    def set_level(self, kind: str, level: float) -> None:
        """Set the friction of a kind of joint, a fraction of its torque limit or a coefficient [-]."""
        if kind not in self.levels:
            raise ConfigurationError(unknown_name("kind of joint", kind, self.kinds))
        self.levels = {**self.levels, kind: min(max(finite(level), 0.0), MAX_LEVEL)}
        self._set_friction()

    def set_wear(self, factor: float) -> None:
        """Set the factor on torques of friction [1]."""
        self.wear = min(max(finite(factor), 0.0), MAX_WEAR)
        self._set_friction()

    def push(self, velocity: Sequence[float]) -> None:
        """Add a velocity, forward and to the left of each robot [m/s], to that of all that stand."""
        forward, left = np.clip([finite(value) for value in velocity], -FASTEST_PUSH, FASTEST_PUSH)
        for walker in self.walkers:
            if not walker.lies:
                heading = yaw(walker.seen.motion.base_quaternion)
                cosine, sine = math.cos(heading), math.sin(heading)
                walker.push(np.array([cosine * forward - sine * left, sine * forward + cosine * left]))

    def step(self) -> None:
        """Advance all robots by one control period."""
        held = (self.straight or not self.cfg.course.is_flat) and self.velocity[2] == 0.0 and any(self.velocity)
        for walker in self.walkers:
            velocity = self.velocity.copy()
            if held:
                velocity[2] = straight_on(yaw(walker.seen.motion.base_quaternion))
            walker.step(velocity)
        self.time += self.period

    def _set_friction(self) -> None:
        level = self._level(self.cfg.law)
        for walker in self.walkers:
            walker.set_friction(level)

    def _level(self, law: Law) -> np.ndarray:
        """Return the level of each joint, torque [N m] or coefficient [-], shape (J,)."""
        share = np.array([self.levels[kind_of(name)] for name in self.spec.joint_names])
        return share if has_coefficient(law.name) else self.wear * share * self.spec.joint_values("torque_limit")


def finite(value: float) -> float:
    """Return a number; raise `StictionError` for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ConfigurationError(f"{value!r} is no finite number")
    return float(value)
