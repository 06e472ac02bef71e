"""Grid of an evaluation: engines, with or without a virtual robot, levels, grounds, commands, episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from stiction.core.errors import ConfigurationError, EngineError, check_once, unknown_name
from stiction.core.rotation import yaw
from stiction.engines.catalog import ENGINES, EngineSpec, find_engine
from stiction.evaluation.course import START_DISTANCE, Course, parse_course, starts, straight_on
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.metrics import Metrics, measure
from stiction.evaluation.policies import fed_suffix
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import Command
from stiction.joints.compensation import BY_ERROR, LOAD_LAW, Compensation, parse_compensation
from stiction.joints.friction import Law, has_coefficient
from stiction.robots.model import GRAVITY, Robot
from stiction.virtual.cases import CELLS, FIRST_REPORTED, Case, Level, factorial, parse_levels, reported

if TYPE_CHECKING:  # A batch needs none of it.
    from stiction.engines.engine import Motion
    from stiction.virtual.trial import CommandSource, RobotCase, World

BATCH = "mujoco"
"""Simulator of the training, with all robots at once; the default of `stiction evaluate`."""

BATCH_COST = 0.05
"""Time per robot of its batch, in the unit of `EngineSpec.cost`."""

MOST_WALKS = 200_000
"""Maximum number of walks of a policy in a grid."""

ALONE = {spec.alone: name for name, spec in ENGINES.items()}
"""Name of a shipped engine with one robot, as in results.csv -> its name in the registry of engines."""


@dataclass(frozen=True)
class Simulator:
    """Engine and the robot in it."""

    engine: str
    """Engine: `mujoco`, the simulator of the training; one of `ALONE`; or a user's, `package.module:VARIABLE`."""
    cell: str | None = None
    """Real properties of the virtual robot (see `Case.cell`); None: the robot of the data sheet."""

    @property
    def label(self) -> str:
        """Name in results.csv: `physx`, `physx+all`."""
        return self.engine if self.cell is None else f"{self.engine}+{self.cell}"

    @property
    def is_batch(self) -> bool:
        """True if all its robots are simulated at once."""
        return self.engine == BATCH

    @property
    def spec(self) -> EngineSpec:
        """Entry of the engine in the registry. Raises `StictionError` where a user's engine cannot be imported."""
        return find_engine(ALONE.get(self.engine, self.engine))


def parse_simulator(text: str) -> Simulator:
    """Return the simulator in a text: an engine, and after a `+` a virtual robot's cell. Raises `StictionError`."""
    engine, plus, cell = text.strip().partition("+")
    if ":" in engine:
        find_engine(engine)
    elif engine not in (BATCH, *ALONE):
        virtual = f"physx+{', physx+'.join(CELLS)}"
        raise EngineError(
            f"{unknown_name('engine', engine, (BATCH, *ALONE))}; for your own, give package.module:VARIABLE; with a "
            f"virtual robot in it: {virtual}"
        )
    if plus and engine == BATCH:
        raise ConfigurationError(f"engine: got {text!r}, expected mujoco-alone+{cell} for a virtual robot")
    if plus:
        # Raises for an unknown cell.
        _ = Case(FIRST_REPORTED, cell, Level(0.0)).groups
    return Simulator(engine, cell if plus else None)


def check_fed_law(law: str, ways: Sequence[Compensation]) -> None:
    """Raise `ConfigurationError` where one of the ways cannot feed forward the friction of a law at its level."""
    unfed = [way.label for way in ways if law != LOAD_LAW or not way.feeds_load]
    if has_coefficient(law) and unfed:
        raise ConfigurationError(
            f"friction fed forward by {' '.join(unfed)} under the law {law}: it has a coefficient and no torque that "
            f"could be fed; expected coulomb or stribeck, or {LOAD_LAW} by reference or measured alone"
        )


@dataclass(frozen=True)
class GridCfg:
    """Conditions of the evaluation of every policy."""

    base: EvaluationCfg = field(default_factory=EvaluationCfg)
    """Friction levels and law, commands, episodes from 0 on, seconds, seed. Its terrain is not used."""
    engines: tuple[str, ...] = (BATCH,)
    """Engines, as `parse_simulator` reads them."""
    terrains: tuple[str, ...] = ("flat",)
    """Grounds, as `parse_course` reads them."""
    robots: tuple[int, ...] = reported(3)
    """Seeds of the virtual robots, see `stiction.virtual.cases`."""
    robot_levels: tuple[str, ...] = ()
    """Friction of the virtual robots: fractions of the torque limit, `bench`, `bench+0.02`; none: those of `base`."""
    forward: tuple[str, ...] = ()
    """Names of bundles that also walk with friction fed forward, see `stiction.evaluation.benches`."""
    forward_by: tuple[str, ...] = ("measured",)
    """Ways to feed friction forward, as `parse_compensation` reads them; each counts as a separate policy."""
    forward_only: bool = False
    """True if the policies of `forward` walk only with it; their other walks are in another grid."""

    def __post_init__(self) -> None:
        """Validate the conditions."""
        for name in ("engines", "terrains", "robots", "robot_levels", "forward", "forward_by"):
            least = 0 if name in ("robot_levels", "forward") else 1
            check_once(name.replace("_", " "), getattr(self, name), least)
        parse_levels(self.levels_of_robots)
        robots = max(1, len(self.robots)) * len(self.engines)
        levels = max(len(self.base.friction_levels), len(self.robot_levels))
        walks = robots * levels * len(self.terrains) * len(self.base.commands) * self.base.episodes
        if walks > MOST_WALKS:
            raise ConfigurationError(
                f"a grid of some {walks} walks a policy; expected at most {MOST_WALKS}, days of computing: ask for "
                "fewer episodes, robots, levels, grounds, commands or engines"
            )
        for terrain in self.terrains:
            self.on(terrain)
        alone = [simulator.label for simulator in self.simulators if not simulator.is_batch]
        if alone and self.base.action_delay:
            raise ConfigurationError(
                f"action delay: got one with {alone[0]}, expected {BATCH} alone; a virtual robot has its own delays"
            )
        self._check_forward()
        if any(each.cell for each in self.simulators) and has_coefficient(self.base.law.name) and not self.robot_levels:
            raise ConfigurationError(
                "virtual robots have their own friction law; give their --robot-levels, e.g. 0.1 bench"
            )

    def _check_forward(self) -> None:
        """Reject unknown or repeated ways to feed friction forward, laws without such a torque, and an action delay."""
        ways = [parse_compensation(text) for text in self.forward_by]
        check_once("friction fed forward by", [way.label for way in ways], least=0)
        if not self.forward:
            return
        if self.base.action_delay:
            raise ConfigurationError("friction fed forward cannot be combined with an action delay; remove one")
        if any(each.cell is None for each in self.simulators):
            check_fed_law(self.base.law.name, ways)

    @property
    def simulators(self) -> tuple[Simulator, ...]:
        """Engines, parsed."""
        return tuple(parse_simulator(text) for text in self.engines)

    @property
    def levels_of_robots(self) -> tuple[str, ...]:
        """Friction of the virtual robots."""
        return self.robot_levels or tuple(f"{level:g}" for level in self.base.friction_levels)

    @property
    def used_robots(self) -> list[int]:
        """Seeds of the virtual robots that walk."""
        return list(self.robots) if any(simulator.cell for simulator in self.simulators) else []

    def on(self, terrain: str) -> EvaluationCfg:
        """Return the configuration on one ground, with the commands that cross it. Raises `StictionError`."""
        course = parse_course(terrain)
        commands = tuple(command.label for command in self.base.parsed_commands if course.takes(command))
        if not commands:
            labels = ", ".join(self.base.commands)
            raise ConfigurationError(
                f"terrain {terrain}: none of the commands {labels} leads over it; add one such as vx=0.4"
            )
        return replace(self.base, terrain=course.label, commands=commands)

    def cell(self, terrain: str, command: str) -> EvaluationCfg:
        """Return the configuration under one command, by its label; over a course the command sets the duration."""
        return replace(self.on(terrain), commands=(command,))

    def settings(self) -> dict[str, Any]:
        """Return the settings that affect a walk besides its own fields, as plain data."""
        names = ("episodes", "seconds", "settle", "seed", "noise", "action_delay", "static_ratio", "stribeck_velocity")
        more = {"friction_shape": self.base.friction_shape} if self.base.friction_shape else {}
        return more | {name: value for name, value in asdict(self.base).items() if name in names}


REAL = "real"
"""Law of a virtual robot's friction in results.csv: Stribeck's, different in every joint."""

BATCH_SECONDS = 320.0
"""Maximum number of robots times seconds in one batch [s], or one robot: some three seconds of work lost at a stop."""


@dataclass(frozen=True)
class Walk:
    """One episode of one policy in one cell of the grid."""

    policy: str
    simulator: Simulator
    law: str
    """Law of the friction; `REAL` for the friction of a virtual robot."""
    level: str
    """Friction, as a number or as `parse_level` reads it."""
    terrain: str
    command: str
    episode: int
    """Number of the episode; it sets start pose and noise."""
    robot: int | None = None
    forward: tuple[float, ...] | None = None
    """Friction fed forward by the joint controllers [N m], of each joint; None: none."""
    forward_by: str = "error"
    forward_load: tuple[float, ...] | None = None
    """Friction per motor torque that is also fed forward [1], of each joint; None: unknown, or not fed in this way."""
    known: tuple[float, ...] | None = None
    """Friction observed by the policy, f/τ_max of each kind of joint [-]; None: that of its contract, or none."""

    @property
    def name(self) -> str:
        """Name of the policy in rows of results."""
        return self.policy + self.suffix

    @property
    def suffix(self) -> str:
        """Suffix of the names of policy and method."""
        return "" if self.forward is None else fed_suffix(parse_compensation(self.forward_by))

    @property
    def cell(self) -> tuple[str, ...]:
        """Properties shared by the walks of one row of results.csv."""
        return self.name, self.simulator.label, self.law, self.level, self.terrain, self.command


def plan(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return every walk without friction fed forward, grouped by row; each virtual robot walks `episodes`."""
    return _walks([name for name in policies if not (cfg.forward_only and name in cfg.forward)], cfg)


def plan_forward(cfg: GridCfg) -> list[Walk]:
    """Return every walk planned with friction fed forward, with its friction not yet set."""
    return [replace(walk, forward_by=by) for by in cfg.forward_by for walk in _walks(cfg.forward, cfg)]


def _walks(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return each combination of conditions once."""
    walks = []
    for policy in policies:
        for simulator in cfg.simulators:
            for terrain in cfg.terrains:
                ground = cfg.on(terrain)
                for law, level, robots in _frictions(simulator, cfg):
                    for command in ground.parsed_commands:
                        walks += [
                            Walk(policy, simulator, law, level, ground.terrain, command.label, episode, robot)
                            for robot in robots
                            for episode in range(ground.episodes)
                        ]
    return walks


def _frictions(simulator: Simulator, cfg: GridCfg) -> list[tuple[str, str, tuple[int | None, ...]]]:
    """Return law, level and robots of every friction in a simulator."""
    if simulator.cell is None:
        return [(cfg.base.friction_law, f"{level:g}", (None,)) for level in cfg.base.friction_levels]
    # Cells and levels are the same for every robot: the first is enough.
    cases = factorial(cfg.robots[:1], cfg.levels_of_robots, (simulator.cell,))
    law = REAL if "friction" in cases[0].groups else Law().name
    return [(law, case.level.label, cfg.robots) for case in cases]


@dataclass(frozen=True)
class Unit:
    """Walks that run together: one, or consecutive episodes of one cell in a batch."""

    walks: tuple[Walk, ...]

    @property
    def policy(self) -> str:
        """Name of the bundle."""
        return self.walks[0].policy

    @property
    def simulator(self) -> Simulator:
        """Engine and robot."""
        return self.walks[0].simulator

    @property
    def cost(self) -> float:
        """Time of the unit, in the unit of `EngineSpec.cost`."""
        single = BATCH_COST if self.simulator.is_batch else self.simulator.spec.cost
        return single * len(self.walks)


def units(walks: Sequence[Walk], cfg: GridCfg) -> list[Unit]:
    """Return the walks of a plan as units, the longest first."""
    planned = [Unit((walk,)) for walk in walks if not walk.simulator.is_batch]
    for _, cell in groupby((walk for walk in walks if walk.simulator.is_batch), key=lambda walk: walk.cell):
        episodes = tuple(cell)
        size = max(1, int(BATCH_SECONDS / cfg.cell(episodes[0].terrain, episodes[0].command).duration))
        planned += [Unit(episodes[begin : begin + size]) for begin in range(0, len(episodes), size)]
    # A long unit begun last would keep a single process busy at the end.
    return sorted(planned, key=lambda unit: -unit.cost)


def walk_unit(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None = None) -> list[Metrics]:
    """Run a unit; return the metrics of its walks. Raises `StictionError` where bundle or engine do not fit."""
    first, episodes = unit.walks[0], len(unit.walks)
    cell = cfg.cell(first.terrain, first.command)
    if not unit.simulator.is_batch:
        return [_walk_alone(bundle, first, cell, robot_of(bundle.contract, robot))]
    cell = replace(cell, friction_levels=(float(first.level),), episodes=episodes, first_episode=first.episode)
    controller = None
    if first.forward is not None:
        contract, compensation = bundle.contract, parse_compensation(first.forward_by)
        friction, width = np.array(first.forward), contract.compensation_width
        controller = compensation.controller(friction, contract.physics_timestep, width, _load(first))
    return list(evaluate_bundle(bundle, cell, robot, compensation=controller).episodes[0])


def _load(walk: Walk) -> np.ndarray | float:
    """Return the friction per motor torque that is fed forward [1], shape (J,) or a single zero."""
    return 0.0 if walk.forward_load is None else np.array(walk.forward_load)


def _walk_alone(bundle: Bundle, walk: Walk, cfg: EvaluationCfg, spec: Robot) -> Metrics:
    """Walk one robot in one engine."""
    from stiction.engines import catalog
    from stiction.engines.ground import course
    from stiction.virtual.cases import Case, DataSheet, parse_level
    from stiction.virtual.trial import TIMESTEP, World

    engine, ground = walk.simulator.spec, cfg.course
    sideways, heading = (0.0, 0.0) if ground.is_flat else starts(cfg.seed, walk.episode + 1)[-1].tolist()
    world = World(
        make=partial(catalog.make_engine, engine.name),
        ground=course(ground.kind, ground.size, cfg.seed),
        start=(0.0 if ground.is_flat else -START_DISTANCE, sideways),
        heading=heading,
        timestep=engine.timestep if walk.robot is None else TIMESTEP,
        noise=cfg.noise if walk.robot is None else None,
    )
    case: RobotCase
    if walk.robot is None or walk.simulator.cell is None:
        case = DataSheet(cfg.seed, cfg.law, float(walk.level), cfg.friction_shape)
    else:
        case = Case(walk.robot, walk.simulator.cell, parse_level(walk.level))
    friction, known = (None if values is None else np.array(values) for values in (walk.forward, walk.known))
    # The robot of the data sheet has the evaluation's seed for its own, and so the noise that `Rollout` draws.
    seed = 0 if walk.robot is None else cfg.seed
    compensation = BY_ERROR if friction is None else parse_compensation(walk.forward_by)
    return walk_once(bundle, case, world, cfg, walk.episode, spec, friction, seed, known, compensation, _load(walk))


def walk_once(
    bundle: Bundle,
    case: RobotCase,
    world: World,
    cfg: EvaluationCfg,
    episode: int,
    spec: Robot,
    friction: np.ndarray | None = None,
    seed: int = 0,
    known: np.ndarray | None = None,
    compensation: Compensation = BY_ERROR,
    load: np.ndarray | float = 0.0,
) -> Metrics:
    """Walk one episode and return its metrics; cfg: ground as in `world`, one command, times; rest as for `walk`."""
    from stiction.virtual.trial import walk

    (command,), period = cfg.parsed_commands, bundle.contract.control_period
    steps = round(cfg.duration / period)
    commands = command_source(command, cfg.course)
    trial = walk(bundle, case, world, commands, steps, episode, None, spec, friction, seed, known, compensation, load)
    part = trial.recording.extended(steps).of(slice(0, 1), round(cfg.settle / period))
    return measure(part, command, spec.groups(), spec.mass * GRAVITY, cfg.course)


def command_source(command: Command, ground: Course) -> CommandSource:
    """Return the commands of a robot: the command itself on flat ground; over a course its speed, straight on."""
    velocity = np.array(command.velocity)
    if ground.is_flat:
        return lambda step, motion: velocity

    def straight(step: int, motion: Motion) -> np.ndarray:
        return np.array([velocity[0], 0.0, straight_on(yaw(motion.base_quaternion))])

    return straight
