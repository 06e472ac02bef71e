"""Policies that walk side by side, each alone in its own engine, while command, friction and world change. No viser.

Each control step is the one that evaluations and robots take: `Pilot` on a `VirtualRobot` of the data sheet, in the
engines and under the laws of every other verb. All robots get the same command, friction, pushes and ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

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
from stiction.engines.engine import BlownUp, Body, ContactSensing, Engine, JointFriction, Motion, Pushable
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
"""Time that a robot lies where it fell before it is put back to the start [s]."""

MAX_WEAR = 5.0
"""Largest factor on the friction [1]; of a joint whose seals are gone it is 0.3, see `virtual.robot`."""

FASTEST_PUSH = 3.0
"""Largest push [m/s]."""

WALKING = 0.5
"""Forward speed at which robots start, unless they were trained for less [m/s]."""


class RewardMeter(Protocol):
    """Meter of reward terms, without torch; see `evaluation.reward_meter.RewardMeter`."""

    values: dict[str, float]
    """Weighted terms of the last control step, by name [1/s]."""

    def reset(self) -> None:
        """Forget the steps before."""

    def add(
        self,
        motion: Motion,
        torque: np.ndarray,
        action: np.ndarray,
        command: np.ndarray,
        fallen: bool = False,
        ground: float = 0.0,
    ) -> None:
        """Measure a control step."""


@dataclass(frozen=True)
class ViewedPolicy:
    """One policy to look at."""

    name: str
    """Name of the policy, and after a colon what it was trained for."""
    contract: Contract
    """Interface of the policy."""
    load: Callable[[], DrivingPolicy]
    """Constructor of the policy for one robot, its history empty."""
    wear: WearModel | None = None
    """Map from the policy's walk to its joints' friction, if it has one."""
    rewards: Callable[[], RewardMeter] | None = None
    """Constructor of the meter of its training's reward terms, of training runs only."""

    @property
    def short(self) -> str:
        """Name up to the colon."""
        return self.name.partition(":")[0]

    @classmethod
    def of_bundle(cls, bundle: Bundle, name: str | None = None) -> ViewedPolicy:
        """Return the policy of a checked bundle, called `name`, by default after its training."""
        contract = bundle.contract
        return cls(name or plain_name(contract), contract, lambda: load_policy(contract, bundle.policy), bundle.wear)


class Run(Protocol):
    """A training run whose checkpoint can be chosen, without torch; see `evaluation.newest.NewestPolicy`."""

    contract: Contract
    """Interface of its policies."""
    chosen: str
    """Name of the choice."""

    @property
    def name(self) -> str:
        """Name of run and checkpoint."""

    def load(self) -> DrivingPolicy:
        """Return the policy that was read last."""

    def meter(self) -> RewardMeter:
        """Return a meter of its reward terms."""

    @property
    def checkpoints(self) -> tuple[str, ...]:
        """Names of the choices."""

    def choose(self, name: str) -> None:
        """Read a checkpoint. Raises `StictionError`."""


def viewed(run: Run) -> ViewedPolicy:
    """Return the policy of the checkpoint that was read last."""
    return ViewedPolicy(run.name, run.contract, run.load, rewards=run.meter)


def plain_name(contract: Contract) -> str:
    """Return the training method and the friction in training: `direct: trained at 20 %`."""
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
    """Engine, ground and friction law of all robots."""

    engine: str = "mujoco"
    """Name of the physics engine."""
    course: Course = FLAT
    """Ground; each robot has its own."""
    law: Law = field(default_factory=Law)
    """Law of the joints' dry friction."""
    seed: int = 0
    """Seed of sensor noise, and of the slabs of rough ground."""


@dataclass(frozen=True)
class DialledSheet(DataSheet):
    """Robot of the data sheet whose friction can be changed while it walks."""

    made: list[JointFriction] = field(default_factory=list)
    """Frictions that `friction` returned."""

    def friction(self, hidden: Hidden, spec: Robot, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        self.made.append(super().friction(hidden, spec, timestep))
        return self.made[-1]


@dataclass(frozen=True)
class Seen:
    """State of one robot at the end of a control step."""

    motion: Motion
    """True motion of the robot."""
    torque: np.ndarray
    """Motor torque in the last physics step [N m], shape (J,)."""
    friction: np.ndarray
    """Bounds of its joints' dry friction [N m], shape (J,)."""
    step: ControlStep | None
    """Readings and policy output of the control step; None for a robot that lies."""

    @property
    def velocity(self) -> np.ndarray:
        """Velocity of the base in its frame: forward, sideways [m/s], turn [rad/s], shape (3,)."""
        return np.array([*self.motion.base_linear_velocity[:2], self.motion.base_angular_velocity[2]])


@dataclass(frozen=True)
class Belief:
    """Estimate of a robot's joint friction from the last window of its walk."""

    estimate: WearEstimate
    """Estimate of the window."""
    changed: bool
    """True if the friction was changed within the window."""


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
        """Position of the start along x [m]."""
        self.falls = 0
        """Number of falls."""
        self.belief: Belief | None = None
        """Last estimate of the joints' friction; None before the end of the first window, or without a map."""
        self.rewards: RewardMeter | None = None
        """Meter of the reward terms of the policy's training; None if it is no training run."""
        engine = find_engine(cfg.engine)
        engines: list[Engine] = []

        def make(body: Body, around: Ground, timestep: float) -> Engine:
            # The world makes the engine within; it is caught here, to be pushed.
            engines.append(make_engine(cfg.engine, body, around, timestep))
            return engines[-1]

        self._world = world = World(make, ground, (self.start, 0.0), timestep=engine.timestep, noise=NoiseCfg())
        # Not at 0: a robot whose law has no level need not know what its joints transmit, and would never be told.
        sheet = DialledSheet(cfg.seed, cfg.law, 1.0)
        noise, sensors = seed_streams(cfg.seed, ["view", "view, sensors"]).values()
        robot = world.robot(sheet, self.spec, sensors)
        (self._engine,), (self._friction,) = engines, sheet.made
        self._port = Noisy(robot.handle, NoiseCfg(), noise)
        self._walk = VirtualWalk(robot, Pilot(self._port, self.policy.load()), world, self.spec)
        self._level: np.ndarray | None = None
        self.set_friction(level)
        self._measure_rewards()
        self.reset()

    @property
    def believes(self) -> bool:
        """True if the policy has a map from its walk to its joints' friction."""
        return self._monitor is not None

    @property
    def doubt(self) -> str | None:
        """Reason not to trust the last estimate of the joints' friction; None if there is none."""
        if self.belief is None:
            return None
        if self.belief.changed:
            return "the friction changed within the window"
        if self._outdated:
            return "the friction changed after the window"
        return self.belief.estimate.untold[-1]

    @property
    def lies(self) -> bool:
        """True if the robot has fallen and waits."""
        return self._left > 0

    def teach(self, policy: ViewedPolicy) -> None:
        """Replace the robot's policy while it walks."""
        self.policy = policy
        self._walk.pilot = Pilot(self._port, policy.load())
        self._measure_rewards()

    def contact_forces(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return point [m] and force [N] of its contacts with the ground; empty where the engine reports none."""
        return self._engine.contact_forces() if isinstance(self._engine, ContactSensing) else []

    @property
    def senses_contacts(self) -> bool:
        """True if the engine reports contact forces."""
        return isinstance(self._engine, ContactSensing)

    def reset(self) -> None:
        """Put the robot to the start, standing."""
        self._walk.place(self.policy.contract.array("standing"))
        self._left, self.belief = 0.0, None
        self._begin_window()
        if self._monitor is not None:
            self._monitor.reset()
        if self.rewards is not None:
            self.rewards.reset()
        self.seen = self._look(None)

    def set_friction(self, level: np.ndarray) -> None:
        """Set the level of each joint's friction, torque [N m] or coefficient [-], shape (J,)."""
        if self._level is not None and not np.array_equal(level, self._level):
            self._outdated, self._changed = True, self._window_begun
        self._level = level
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
        command = np.clip(velocity, *self.range)
        try:
            step = self._walk.step(command)
        except BlownUp:
            self._fall()
            return
        self.seen = self._look(step)
        fallen = self._walk.fallen
        if self.rewards is not None:
            motion = self.seen.motion
            height = self._world.height(motion.base_position[:2])
            self.rewards.add(motion, self.seen.torque, step.policy.action, command, fallen, height)
        if fallen:
            self._fall()
            return
        self._window_begun = True
        if self._monitor is not None and (estimate := self._monitor.step(step.policy.observation)) is not None:
            self.belief = Belief(estimate, self._changed)
            self._begin_window()

    def _begin_window(self) -> None:
        """Begin a window of the monitor, in which no step was taken and no friction changed."""
        self._window_begun = self._changed = self._outdated = False

    def _measure_rewards(self) -> None:
        """Measure the reward terms of the present policy's training."""
        self.rewards = None if self.policy.rewards is None else self.policy.rewards()

    def _fall(self) -> None:
        """Let the robot lie for a while."""
        self.falls += 1
        self._left = LYING
        self.seen = replace(self.seen, step=None)

    def _look(self, step: ControlStep | None) -> Seen:
        """Return the state of the robot after a control step; step: of a robot that walks."""
        truth = self._walk.seen
        return Seen(truth.motion, truth.torque, truth.friction, step)


class Simulation:
    """Robots side by side; numbers out of range are clipped."""

    def __init__(self, policies: Sequence[ViewedPolicy], spec: Robot, cfg: WorldCfg | None = None) -> None:
        """Put one robot per policy to the start, commanded to walk, without dry friction.

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
        """True if robots that are not commanded to turn are held straight on; over a course they always are."""
        self._enter(cfg or WorldCfg(), policies)
        self.set_velocity((WALKING, 0.0, 0.0))

    @property
    def range(self) -> np.ndarray:
        """Range of commands that every policy was trained for: lower and upper ends, shape (2, 3)."""
        ranges = np.array([walker.range for walker in self.walkers])
        return np.stack((ranges[:, 0].max(axis=0), ranges[:, 1].min(axis=0)))

    def set_world(self, cfg: WorldCfg) -> None:
        """Put all robots to the start of another world. Raises `StictionError`, and stays in the old one."""
        self._enter(cfg, [walker.policy for walker in self.walkers])

    def _enter(self, cfg: WorldCfg, policies: Sequence[ViewedPolicy]) -> None:
        """Put one robot per policy to the start of a world."""
        ground, level = course(cfg.course.kind, cfg.course.size, cfg.seed), self._level(cfg.law)
        # All new robots before anything else is changed: where one cannot be made, the old world stays.
        self.walkers = [Walker(policy, self.spec, cfg, ground, level) for policy in policies]
        self.cfg, self.ground = cfg, ground
        self.time = 0.0
        """Simulated time since the last start [s]."""

    def reset(self) -> None:
        """Put all robots to the start; the command stays."""
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
        """Add a velocity, forward and to the left of each robot [m/s], to that of all robots that have not fallen."""
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
    """Return a number; raise `StictionError` for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ConfigurationError(f"got {str(value)[:40]!r}, expected a finite number; enter one")
    return float(value)
