"""One unit of a grid: builds robot and ground in the engine, lets the policy walk, and measures it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.robots.spec import RobotSpec
from stiction.transfer.command import Command
from stiction.transfer.course import FOOT, Course, starts, straight_on
from stiction.transfer.engines import catalog
from stiction.transfer.engines.engine import GRAVITY, Motion
from stiction.transfer.engines.ground import course
from stiction.transfer.engines.rotation import yaw
from stiction.transfer.evaluate import EvaluationCfg, evaluate_bundle
from stiction.transfer.grid.config import ALONE, GridCfg
from stiction.transfer.grid.plan import Unit, Walk
from stiction.transfer.metrics import Metrics, measure
from stiction.transfer.robot.data_sheet import DataSheet
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.trial import TIMESTEP, Kind, Steer, World, walk
from stiction.transfer.rollout import robot_of


def walk_unit(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None = None) -> list[Metrics]:
    """Do a unit and return what each of its walks was worth.

    Raises:
        StictionError: the bundle does not fit the robot, or what the engine needs is not installed.

    """
    return _batch(bundle, unit, cfg, robot) if unit.place.is_batch else [_alone(bundle, unit.walks[0], cfg, robot)]


def _batch(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None) -> list[Metrics]:
    """Walk all episodes of a unit at once."""
    first, episodes = unit.walks[0], len(unit.walks)
    asked = cfg.asked(first.terrain, first.command)
    asked = replace(asked, friction_levels=(float(first.level),), episodes=episodes, first_episode=first.episode)
    return list(evaluate_bundle(bundle, asked, robot).episodes[0])


def _alone(bundle: Bundle, one: Walk, cfg: GridCfg, robot: str | None) -> Metrics:
    """Walk one robot in one engine."""
    asked = cfg.asked(one.terrain, one.command)
    ground = asked.course
    aside, askew = (0.0, 0.0) if ground.is_flat else starts(asked.seed, one.episode + 1)[-1].tolist()
    world = World(
        make=partial(catalog.make_engine, ALONE[one.place.engine]),
        ground=course(ground.kind, ground.size, asked.seed),
        start=(0.0 if ground.is_flat else -FOOT, aside),
        heading=askew,
        timestep=catalog.TIMESTEP if one.robot is None else TIMESTEP,
        noise=asked.noise if one.robot is None else None,
    )
    case: Kind
    if one.robot is None or one.place.cell is None:
        case = DataSheet(asked.seed, asked.law, float(one.level))
    else:
        case = Case(one.robot, one.place.cell, parse_level(one.level))
    friction, known = (None if told is None else np.array(told) for told in (one.forward, one.known))
    seed = 0 if one.robot is None else asked.seed
    return walk_once(bundle, case, world, asked, one.episode, robot_of(bundle.contract, robot), friction, seed, known)


def walk_once(
    bundle: Bundle,
    case: Kind,
    world: World,
    asked: EvaluationCfg,
    episode: int,
    spec: RobotSpec,
    friction: np.ndarray | None = None,
    seed: int = 0,
    known: np.ndarray | None = None,
) -> Metrics:
    """Walk one episode with one robot, and return what it was worth.

    asked: the ground, which `world` has too, one command, times; spec: the robot; other arguments and errors as of
    `walk`.
    """
    (command,), period = asked.parsed_commands, bundle.contract.control_period
    steps = round(asked.duration / period)
    trial = walk(bundle, case, world, steer(command, asked.course), steps, episode, None, spec, friction, seed, known)
    part = trial.recording.lasting(steps).of(slice(0, 1), round(asked.settle / period))
    return measure(part, command, spec.groups(), spec.mass * GRAVITY, asked.course)


def steer(command: Command, ground: Course) -> Steer:
    """Return who commands a robot: the command itself on flat ground; over a course its speed, straight on."""
    velocity = np.array(command.velocity)
    if ground.is_flat:
        return lambda step, motion: velocity

    def straight(step: int, motion: Motion) -> np.ndarray:
        return np.array([velocity[0], 0.0, straight_on(yaw(motion.base_quaternion))])

    return straight
