"""The grid of an evaluation: engines, with or without a virtual robot, levels, grounds, commands, episodes."""

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
"""The simulator of the training, all its robots at once; the default of `stiction evaluate`."""

BATCH_COST = 0.05
"""Time that a robot of its batch takes, in the unit of `EngineSpec.cost`."""

MOST_WALKS = 200_000

ALONE = {spec.alone: name for name, spec in ENGINES.items()}
"""Name of a shipped engine with one robot in it, as in results.csv -> its name in the registry of engines."""


@dataclass(frozen=True)
class Simulator:
    """An engine and the robot in it."""

    engine: str
    """`mujoco`, the simulator of the training; one of `ALONE`; or one's own, `package.module:VARIABLE`."""
    cell: str | None = None
    """Of a virtual robot, what of it is real (see `Case.cell`); None: the robot of the data sheet."""

    @property
    def label(self) -> str:
        """As it stands in results.csv: `physx`, `physx+all`."""
        return self.engine if self.cell is None else f"{self.engine}+{self.cell}"

    @property
    def is_batch(self) -> bool:
        """Whether all its robots are simulated at once."""
        return self.engine == BATCH

    @property
    def spec(self) -> EngineSpec:
        """What the registry says of the engine. Raises `StictionError` where one's own cannot be found."""
        return find_engine(ALONE.get(self.engine, self.engine))


def parse_simulator(text: str) -> Simulator:
    """Return the simulator in a text: an engine, and after a `+` a cell of the virtual robot.

    Raises `StictionError`.
    """
    engine, plus, cell = text.strip().partition("+")
    if ":" in engine:
        find_engine(engine)
    elif engine not in (BATCH, *ALONE):
        virtual = f"physx+{', physx+'.join(CELLS)}"
        raise EngineError(
            f"{unknown_name('engine', engine, (BATCH, *ALONE))}; one of your own: package.module:VARIABLE; with a "
            f"virtual robot in it: {virtual}"
        )
    if plus and engine == BATCH:
        raise ConfigurationError(
            f"engine {text!r}: a virtual robot is alone in its engine; expected mujoco-alone+{cell}"
        )
    if plus:
        # Raises where there is no such cell.
        _ = Case(FIRST_REPORTED, cell, Level(0.0)).groups
    return Simulator(engine, cell if plus else None)


def check_fed_law(law: str, ways: Sequence[Compensation]) -> None:
    """Raise `ConfigurationError` where one of the ways cannot feed the friction of a law at its level."""
    unfed = [way.label for way in ways if law != LOAD_LAW or not way.feeds_load]
    if has_coefficient(law) and unfed:
        raise ConfigurationError(
            f"friction fed forward by {' '.join(unfed)} under the law {law}: it has a coefficient and no torque that "
            f"could be fed; expected coulomb or stribeck, or {LOAD_LAW} by reference or measured alone"
        )


@dataclass(frozen=True)
class GridCfg:
    """The conditions under which every policy is evaluated."""

    base: EvaluationCfg = field(default_factory=EvaluationCfg)
    """Friction levels and law, commands, episodes from 0 on, seconds, seed. Its terrain is not read."""
    engines: tuple[str, ...] = (BATCH,)
    """Engines, as `parse_simulator` reads them."""
    terrains: tuple[str, ...] = ("flat",)
    """Grounds, as `parse_course` reads them."""
    robots: tuple[int, ...] = reported(3)
    """Seeds of the virtual robots, see `stiction.virtual.cases`."""
    robot_levels: tuple[str, ...] = ()
    """Friction of the virtual robots: fractions of the torque limit, `bench`, `bench+0.02`; none: those of `base`."""
    forward: tuple[str, ...] = ()
    """Bundles, by name, that also walk with friction fed forward, see `stiction.evaluation.benches`."""
    forward_by: tuple[str, ...] = ("measured",)
    """How it is fed forward, as `parse_compensation` reads it; each is a policy of its own."""
    forward_only: bool = False
    """Whether the policies of `forward` walk with it alone: their walks without are in another grid."""

    def __post_init__(self) -> None:
        """Refuse what cannot be walked."""
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
                f"{alone[0]} with an action delay: only {BATCH} has it; a virtual robot has delays of its own"
            )
        self._check_forward()
        if any(each.cell for each in self.simulators) and has_coefficient(self.base.law.name) and not self.robot_levels:
            raise ConfigurationError(
                "virtual robots have a law of their own; give their --robot-levels, such as 0.1 bench"
            )

    def _check_forward(self) -> None:
        """Refuse friction fed forward in ways that there are not, where there is no one torque to feed, or late."""
        ways = [parse_compensation(text) for text in self.forward_by]
        check_once("friction fed forward by", [way.label for way in ways], least=0)
        if not self.forward:
            return
        if self.base.action_delay:
            raise ConfigurationError("friction fed forward with an action delay: give one of the two")
        if any(each.cell is None for each in self.simulators):
            check_fed_law(self.base.law.name, ways)

    @property
    def simulators(self) -> tuple[Simulator, ...]:
        """The engines, parsed."""
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
        """Return the configuration on one ground, with the commands that lead over it. Raises `StictionError`."""
        course = parse_course(terrain)
        commands = tuple(command.label for command in self.base.parsed_commands if course.takes(command))
        if not commands:
            given = ", ".join(self.base.commands)
            raise ConfigurationError(
                f"terrain {terrain}: none of the commands {given} leads over it; add one such as vx=0.4"
            )
        return replace(self.base, terrain=course.label, commands=commands)

    def cell(self, terrain: str, command: str) -> EvaluationCfg:
        """Return the configuration under one command alone, by its label, which over a course sets the duration."""
        return replace(self.on(terrain), commands=(command,))

    def settings(self) -> dict[str, Any]:
        """Return everything that a walk depends on beside its own fields, as plain data."""
        names = ("episodes", "seconds", "settle", "seed", "noise", "action_delay", "static_ratio", "stribeck_velocity")
        return {name: value for name, value in asdict(self.base).items() if name in names}


REAL = "real"
"""Law of a virtual robot's friction in results.csv: Stribeck's, different in every joint."""

BATCH_SECONDS = 320.0
"""Most robots times seconds of one batch [s], or one robot: some three seconds of work, lost by an interruption."""


@dataclass(frozen=True)
class Walk:
    """One episode of one policy in one cell of the grid."""

    policy: str
    simulator: Simulator
    law: str
    """Law of the friction; of a virtual robot with friction `REAL`."""
    level: str
    """Friction, as a number or as `parse_level` reads it."""
    terrain: str
    command: str
    episode: int
    """Number of start pose and noise."""
    robot: int | None = None
    forward: tuple[float, ...] | None = None
    """Friction that the joint controllers feed forward [N m], of each joint; None: they do not."""
    forward_by: str = "error"
    forward_load: tuple[float, ...] | None = None
    """Friction per torque of the motor that is fed beside it [1], of each joint; None: no coefficient is known, or the
    way has none."""
    known: tuple[float, ...] | None = None
    """Friction given to a policy that observes it, f/τ_max of each kind of joint [-]; None: what its contract says, or
    none."""

    @property
    def name(self) -> str:
        """What rows of results call the policy."""
        return self.policy + self.suffix

    @property
    def suffix(self) -> str:
        """Behind the names of policy and method."""
        return "" if self.forward is None else fed_suffix(parse_compensation(self.forward_by))

    @property
    def cell(self) -> tuple[str, ...]:
        """What the walks of one row of results.csv share."""
        return self.name, self.simulator.label, self.law, self.level, self.terrain, self.command


def plan(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return every walk without friction fed forward, those of a row together; each virtual robot walks `episodes`."""
    return _walks([name for name in policies if not (cfg.forward_only and name in cfg.forward)], cfg)


def plan_forward(cfg: GridCfg) -> list[Walk]:
    """Return every walk that is to be walked with friction fed forward, still without it."""
    return [replace(walk, forward_by=by) for by in cfg.forward_by for walk in _walks(cfg.forward, cfg)]


def _walks(policies: Sequence[str], cfg: GridCfg) -> list[Walk]:
    """Return every combination once."""
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
    """Return law, level and robots of every friction that is met in a simulator."""
    if simulator.cell is None:
        return [(cfg.base.friction_law, f"{level:g}", (None,)) for level in cfg.base.friction_levels]
    # Cells and levels are the same for every robot: one tells them.
    cases = factorial(cfg.robots[:1], cfg.levels_of_robots, (simulator.cell,))
    law = REAL if "friction" in cases[0].groups else Law().name
    return [(law, case.level.label, cfg.robots) for case in cases]


@dataclass(frozen=True)
class Unit:
    """Walks that are done at once: one, or consecutive episodes of one cell in a batch."""

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
        """How long it takes, in the unit of `EngineSpec.cost`."""
        one = BATCH_COST if self.simulator.is_batch else self.simulator.spec.cost
        return one * len(self.walks)


def units(walks: Sequence[Walk], cfg: GridCfg) -> list[Unit]:
    """Return the walks of a plan as units, the longest first."""
    found = [Unit((walk,)) for walk in walks if not walk.simulator.is_batch]
    for _, cell in groupby((walk for walk in walks if walk.simulator.is_batch), key=lambda walk: walk.cell):
        some = tuple(cell)
        size = max(1, int(BATCH_SECONDS / cfg.cell(some[0].terrain, some[0].command).duration))
        found += [Unit(some[begin : begin + size]) for begin in range(0, len(some), size)]
    # Else a long one that is begun last keeps a single process busy at the end.
    return sorted(found, key=lambda unit: -unit.cost)


def walk_unit(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None = None) -> list[Metrics]:
    """Do a unit and return the metrics of each of its walks.

    Raises `StictionError` where bundle or engine do not fit.
    """
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
    """Return the friction per torque of the motor that is fed forward [1], shape (J,) or a single zero."""
    return 0.0 if walk.forward_load is None else np.array(walk.forward_load)


def _walk_alone(bundle: Bundle, one: Walk, cfg: EvaluationCfg, spec: Robot) -> Metrics:
    """Walk one robot in one engine."""
    from stiction.engines import catalog
    from stiction.engines.ground import course
    from stiction.virtual.cases import Case, DataSheet, parse_level
    from stiction.virtual.trial import TIMESTEP, World

    engine, ground = one.simulator.spec, cfg.course
    aside, askew = (0.0, 0.0) if ground.is_flat else starts(cfg.seed, one.episode + 1)[-1].tolist()
    world = World(
        make=partial(catalog.make_engine, engine.name),
        ground=course(ground.kind, ground.size, cfg.seed),
        start=(0.0 if ground.is_flat else -START_DISTANCE, aside),
        heading=askew,
        timestep=engine.timestep if one.robot is None else TIMESTEP,
        noise=cfg.noise if one.robot is None else None,
    )
    case: RobotCase
    if one.robot is None or one.simulator.cell is None:
        case = DataSheet(cfg.seed, cfg.law, float(one.level))
    else:
        case = Case(one.robot, one.simulator.cell, parse_level(one.level))
    friction, known = (None if given is None else np.array(given) for given in (one.forward, one.known))
    # The robot of the data sheet has the evaluation's seed for its own, and so the noise that `Rollout` draws.
    seed = 0 if one.robot is None else cfg.seed
    compensation = BY_ERROR if friction is None else parse_compensation(one.forward_by)
    return walk_once(bundle, case, world, cfg, one.episode, spec, friction, seed, known, compensation, _load(one))


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
    """Walk one episode and return its metrics. cfg: ground, as in `world`, one command, times; others as of `walk`."""
    from stiction.virtual.trial import walk

    (command,), period = cfg.parsed_commands, bundle.contract.control_period
    steps = round(cfg.duration / period)
    commands = command_source(command, cfg.course)
    trial = walk(bundle, case, world, commands, steps, episode, None, spec, friction, seed, known, compensation, load)
    part = trial.recording.extended(steps).of(slice(0, 1), round(cfg.settle / period))
    return measure(part, command, spec.groups(), spec.mass * GRAVITY, cfg.course)


def command_source(command: Command, ground: Course) -> CommandSource:
    """Return what commands a robot: the command itself on flat ground; over a course its speed, straight on."""
    velocity = np.array(command.velocity)
    if ground.is_flat:
        return lambda step, motion: velocity

    def straight(step: int, motion: Motion) -> np.ndarray:
        return np.array([velocity[0], 0.0, straight_on(yaw(motion.base_quaternion))])

    return straight
