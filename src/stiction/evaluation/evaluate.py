"""Evaluation of a policy bundle over friction levels and commands in MuJoCo, in one batch, one robot per episode.

Episode e has the same initial state and sensor noise at every level and command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from stiction.core.errors import ConfigurationError, check_once, if_per_cent
from stiction.core.provenance import seed_streams
from stiction.deploy.control import Driver
from stiction.deploy.policy import load_policy
from stiction.evaluation.course import SETTLE, Course, course_commands, line_up, parse_course, starts
from stiction.evaluation.metrics import Metrics, measure
from stiction.evaluation.policies import FunctionDriver, OwnPolicy, known_to, method_of, parse_source
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.following import COMMAND_SET, EVERY
from stiction.files.results import DIRECTIONS, ResultRow, slowest_of
from stiction.files.velocity import Command, parse_command
from stiction.files.walk import Recording
from stiction.joints.compensation import FrictionController
from stiction.joints.friction import MAX_LEVEL, Law, has_coefficient
from stiction.robots.model import Robot
from stiction.task.config import NoiseCfg
from stiction.virtual.drive import Commands, record

if TYPE_CHECKING:
    from stiction.evaluation.rollout import Rollout

ENGINE = "mujoco"

MAX_ROBOT_SECONDS = 400_000.0
"""Maximum number of robots at once times seconds [s]: at 50 Hz the recording of these fills some 700 MB."""


FLEET = (
    *(f"core/{name}.py" for name in ("names", "rotation", "provenance")),
    *(f"joints/{name}.py" for name in ("compensation", "pd", "friction")),
    *("sim/*.py", "robots/*.py", "robots/shipped/*.json", "task/friction.py", "task/terrain.py", "virtual/drive.py"),
    *(f"files/{name}.py" for name in ("method", "contract", "known_friction", "observation", "velocity", "walk")),
    *(f"evaluation/{name}.py" for name in ("course", "evaluate", "metrics", "policies", "rollout")),
)
"""Code that determines the motion of robots under a contract in the simulator of the training."""

WALK_CODE = (*FLEET, "deploy/*.py", "engines/*.py", "engines/ode/*.py", "virtual/*.py", "evaluation/grid.py")
"""Code that determines the metrics of a bundle's walk; keys also contain the `binaries` of the engine."""

RUN_WALK_CODE = (
    *FLEET,
    *(f"deploy/{name}.py" for name in ("check", "control", "observation")),
    *(f"learning/{name}.py" for name in ("models", "runner", "symmetry")),
    *(f"task/{name}.py" for name in ("config", "observations", "randomization", "symmetry", "task_fleet")),
    *("evaluation/export.py", "evaluation/newest.py"),
)
"""Code that determines the walks of a run's teacher and student; keys also contain `RunDirectory.walks_by`."""


@dataclass(frozen=True)
class EvaluationCfg:
    """Conditions of the evaluation of a policy."""

    friction_levels: tuple[float, ...] = (0.0, 0.1, 0.2)
    """Dry friction as a fraction of each joint's torque limit [-]; coefficient for `load` and `effort`."""
    commands: tuple[str, ...] = DIRECTIONS
    """Commanded velocities: vx, vy [m/s], wz [rad/s], or `stand`; `all`: the command set."""
    episodes: int = 32
    """Episodes per level and command."""
    seconds: float = 20.0
    """Length of an episode [s]."""
    settle: float = SETTLE
    """Time at the start of an episode that is not measured [s]: the robot accelerates."""
    seed: int = 0
    """Seed of initial states and sensor noise."""
    noise: NoiseCfg = field(default_factory=NoiseCfg)
    """Sensor noise, as in training."""
    action_delay: float = 0.0
    """Delay between target and motor [s], in whole physics steps; at most the buffer of the robot's model."""
    friction_law: str = "coulomb"
    """Law of the dry friction, independent of the policy's training."""
    static_ratio: float = 1.5
    """Friction at rest over friction in motion, of the law `stribeck`."""
    stribeck_velocity: float = 0.1
    """Velocity at which 63 % of that excess is gone [rad/s], of the law `stribeck`."""
    terrain: str = "flat"
    """Ground: `flat`, or a course crossed straight forward: `stairs=0.1`, `slope=0.2`, `rough=0.05`."""
    known_friction: str = "contract"
    """Source of the friction that a policy observes, see `parse_source`: `contract`, `true`, `true*0.7`."""
    first_episode: int = 0
    """Number of the first episode; start and noise of an episode follow from its number."""
    friction_shape: tuple[float, ...] = ()
    """Friction of each joint over that of the level [-], see `as_identified`; empty: 1 in every joint."""

    def __post_init__(self) -> None:
        """Validate the conditions."""
        unit = "coefficients" if has_coefficient(self.law.name) else "fractions of the torque limit"
        for level in self.friction_levels:
            if not 0.0 <= level <= MAX_LEVEL:
                meant = "" if has_coefficient(self.law.name) else if_per_cent(level)
                raise ConfigurationError(f"friction level {level} is outside [0, {MAX_LEVEL}], {unit}{meant}")
        check_once("friction levels", self.friction_levels)
        check_once("commands", [command.label for command in self.parsed_commands])
        if self.episodes * self.seconds > MAX_ROBOT_SECONDS:
            raise ConfigurationError(
                f"{self.episodes} episodes of {self.seconds:g} s are more than {MAX_ROBOT_SECONDS:g} robot-seconds, "
                "whose recording fills the memory; ask for fewer or shorter ones"
            )
        if not (self.episodes >= 1 and self.settle >= 0.0 and self.settle + 1.0 <= self.seconds <= 3600.0):
            raise ConfigurationError(
                f"{self.episodes} episodes of {self.seconds} s, {self.settle} s of it to settle; "
                "expected at least one episode, at least 1 s measured, and at most an hour"
            )
        if refused := [command.label for command in self.parsed_commands if not self.course.takes(command)]:
            raise ConfigurationError(
                f"command {refused[0]!r} on {self.terrain}: a course is crossed straight on; expected such as vx=0.4"
            )
        if not 0.0 <= self.action_delay < math.inf:
            raise ConfigurationError(f"action delay {self.action_delay} s; expected a time of 0 s or more")
        parse_source(self.known_friction)
        # Raises for an invalid seed.
        seed_streams(self.seed, ["episode"])

    @property
    def law(self) -> Law:
        """Friction law with its parameters. Raises `StictionError` where they are invalid."""
        return Law(self.friction_law, self.static_ratio, self.stribeck_velocity)

    @property
    def parsed_commands(self) -> tuple[Command, ...]:
        """Commanded velocities, parsed."""
        return tuple(parse_command(text) for text in (COMMAND_SET if self.commands == (EVERY,) else self.commands))

    @property
    def course(self) -> Course:
        """Ground of the walks. Raises `StictionError` for an unknown terrain."""
        return parse_course(self.terrain)

    @property
    def duration(self) -> float:
        """Length of every episode [s]: `seconds` on flat ground, else the longest time of the slowest crossing."""
        return max(self.course.seconds(command, self.seconds) for command in self.parsed_commands)

    @property
    def conditions(self) -> dict[str, float]:
        """Values fixed by the evaluation and randomised in training."""
        fixed = {"encoder_offset": 0.0, "ground_friction": 1.0, "push_velocity": 0.0, "payload": 0.0}
        return {"action_delay": self.action_delay, **fixed}

    @property
    def numbers(self) -> range:
        """Numbers of the episodes."""
        return range(self.first_episode, self.first_episode + self.episodes)

    @property
    def num_robots(self) -> int:
        """Number of robots in the batch."""
        return len(self.friction_levels) * len(self.commands) * self.episodes

    @property
    def robot_levels(self) -> np.ndarray:
        """Friction level of every robot of the batch, shape (N,): by level, then by command, then by episode."""
        return np.repeat(self.friction_levels, len(self.commands) * self.episodes)

    def friction(self, contract: Contract) -> np.ndarray:
        """Return the dry friction of every robot's joints, as from `friction_at`, shape (N, J)."""
        from stiction.evaluation.rollout import friction_at

        return friction_at(contract, self.robot_levels, self.law) * np.array(self.friction_shape or 1.0)

    @property
    def robot_commands(self) -> np.ndarray:
        """Commanded velocity of every robot of the batch, shape (N, 3), in the same order."""
        block = np.repeat([command.velocity for command in self.parsed_commands], self.episodes, axis=0)
        return np.tile(block, (len(self.friction_levels), 1))


@dataclass(frozen=True)
class Evaluation:
    """Results of one policy."""

    rows: tuple[ResultRow, ...]
    metrics: tuple[Metrics, ...]
    episodes: tuple[tuple[Metrics, ...], ...]


def evaluate_bundle(
    bundle: Bundle,
    cfg: EvaluationCfg,
    robot: str | None = None,
    threads: int = 1,
    compensation: FrictionController | None = None,
) -> Evaluation:
    """Evaluate one checked bundle; arguments and errors as of `drive`."""
    spec = robot_of(bundle.contract, robot)
    policy = batch_policy(bundle, spec, cfg, cfg.friction(bundle.contract))
    driven = drive(policy, bundle.contract, spec, cfg, threads, compensation)
    return judge(driven, bundle.contract, bundle.name, cfg)


@dataclass(frozen=True)
class Driven:
    """Motion of a policy's robots."""

    spec: Robot
    weight: float
    parts: tuple[tuple[float, Command, Recording], ...]
    """Friction level, command and measured part of the episodes, for each level and command in row order."""


def judge(driven: Driven, contract: Contract, name: str, cfg: EvaluationCfg) -> Evaluation:
    """Return the metrics of the robots' walks; name: of the policy in the rows."""
    rows, measured, each = [], [], []
    robots = (slice(0, cfg.episodes), *(slice(e, e + 1) for e in range(cfg.episodes)))
    for level, command, part in driven.parts:
        groups, weight = driven.spec.groups(), driven.weight
        metrics, *episodes = (measure(part.of(some), command, groups, weight, cfg.course) for some in robots)
        row = ResultRow(
            policy=name,
            method=method_of(contract),
            seed=contract.seed,
            engine=ENGINE,
            friction_law=cfg.friction_law,
            friction_level=level,
            terrain=cfg.course.label,
            command=command.label,
            episodes=cfg.episodes,
            slowest_walk=slowest_of(command, (episode.mean_velocity for episode in episodes)),
            **metrics.columns,
        )
        rows.append(row)
        measured.append(metrics)
        each.append(tuple(episodes))
    return Evaluation(tuple(rows), tuple(measured), tuple(each))


def batch_policy(bundle: Bundle, spec: Robot, cfg: EvaluationCfg, friction: np.ndarray) -> Driver:
    """Return a bundle's policy for N robots; friction: of their joints, as from `friction_at`, shape (N, J)."""
    if isinstance(bundle, OwnPolicy):
        return FunctionDriver(bundle, len(friction))
    known = known_to(bundle.contract, spec, parse_source(cfg.known_friction), cfg.law, friction)
    return load_policy(bundle.contract, bundle.policy, (len(friction),), known_friction=known)


def make_rollout(
    policy: Driver,
    contract: Contract,
    spec: Robot,
    cfg: EvaluationCfg,
    threads: int = 1,
    compensation: FrictionController | None = None,
) -> Rollout:
    """Return the robots of an evaluation in their first state; arguments and errors as of `drive`."""
    from stiction.evaluation.rollout import Rollout

    streams = seed_streams(cfg.seed, [f"episode {number}" for number in cfg.numbers])
    return Rollout(
        contract,
        policy,
        spec,
        cfg.friction(contract),
        list(streams.values()),
        threads,
        cfg.noise,
        cfg.action_delay,
        cfg.course.terrain(cfg.num_robots, cfg.seed),
        cfg.law,
        compensation=compensation,
    )


def drive(
    policy: Driver,
    contract: Contract,
    spec: Robot,
    cfg: EvaluationCfg,
    threads: int = 1,
    compensation: FrictionController | None = None,
) -> Driven:
    """Drive robots over levels and commands and return their motion.

    policy: with batch (cfg.num_robots,), robot i at level i of `cfg.robot_levels`; compensation: see `Rollout`; threads
    do not change the result. Raises `StictionError` where robot or delay do not fit, or for too many robots at once.
    """
    if cfg.num_robots * cfg.duration > MAX_ROBOT_SECONDS:
        raise ConfigurationError(
            f"{cfg.num_robots} robots at once for {cfg.duration:g} s each are more than {MAX_ROBOT_SECONDS:g} "
            "robot-seconds; give fewer levels, commands or episodes, or shorter ones"
        )
    rollout = make_rollout(policy, contract, spec, cfg, threads, compensation)
    velocity, period = cfg.robot_commands, rollout.fleet.control_period
    commands: Commands = velocity
    if not cfg.course.is_flat:
        line_up(rollout.fleet, starts(cfg.seed, cfg.numbers.stop)[cfg.first_episode :])
        commands = course_commands(rollout.fleet, velocity[:, 0])
    recording = record(rollout, commands, period, round(cfg.duration / contract.control_period))
    first = round(cfg.settle / contract.control_period)
    weight = spec.mass * float(np.linalg.norm(rollout.fleet.model.opt.gravity))
    parts = tuple(
        (level, command, recording.of(slice(index * cfg.episodes, (index + 1) * cfg.episodes), first))
        for index, (level, command) in enumerate(product(cfg.friction_levels, cfg.parsed_commands))
    )
    return Driven(spec, weight, parts)
