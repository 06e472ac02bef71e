"""Walks the units of a grid: a batch in the simulator of the training, or one robot alone in one engine.

From a unit to the metrics of its walks, and no more: processes that do nothing else import nothing else. Ledger and
processes are in `run`, rows in `table`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from stiction.core.rotation import yaw
from stiction.evaluation.course import START_DISTANCE, Course, starts, straight_on
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.grid import GridCfg, Unit, Walk
from stiction.evaluation.metrics import Metrics, measure
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import Command
from stiction.joints.compensation import BY_ERROR, Compensation, parse_compensation
from stiction.robots.model import GRAVITY, Robot

if TYPE_CHECKING:  # A batch needs none of it.
    from stiction.engines.engine import Motion
    from stiction.virtual.trial import CommandSource, RobotCase, World


def walk_unit(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None = None) -> list[Metrics]:
    """Do a unit and return the metrics of each of its walks.

    Raises `StictionError`: the bundle does not fit the robot, or what the engine needs is not installed.
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
    """Walk one episode with one robot, and return its metrics.

    cfg: the ground, as in `world`, one command, times; other arguments and errors as of `walk`.
    """
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
