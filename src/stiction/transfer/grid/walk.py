"""One unit of a grid: builds robot and ground in the engine, lets the policy walk, and measures it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.transfer.command import Command, parse_command
from stiction.transfer.course import FOOT, Course, parse_course, starts, straight_on
from stiction.transfer.engines.catalog import make_engine
from stiction.transfer.engines.engine import GRAVITY, Motion
from stiction.transfer.engines.ground import course
from stiction.transfer.engines.rotation import yaw
from stiction.transfer.evaluate import evaluate_bundle
from stiction.transfer.grid.config import ALONE, GridCfg
from stiction.transfer.grid.plan import Unit, Walk
from stiction.transfer.metrics import Metrics, measure
from stiction.transfer.robot.data_sheet import DataSheet
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.trial import TIMESTEP, Kind, Steer, World, walk
from stiction.transfer.rollout import robot_of

STEP = 0.002
"""Physics step of an engine with the data sheet's robot in it [s]: what the engines' conformance is held at."""


def walk_unit(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None = None) -> list[Metrics]:
    """Do a unit and return what each of its walks was worth.

    Raises:
        StictionError: the bundle does not fit the robot, or what the engine needs is not installed.

    """
    return _batch(bundle, unit, cfg, robot) if unit.place.is_batch else [_alone(bundle, unit.walks[0], cfg, robot)]


def _batch(bundle: Bundle, unit: Unit, cfg: GridCfg, robot: str | None) -> list[Metrics]:
    """Walk all of a unit at once, in the order of its walks: by command, by episode."""
    first = unit.walks[0]
    evaluation = evaluate_bundle(bundle, replace(cfg.on(first.terrain), friction_levels=(float(first.level),)), robot)
    return [metrics for row in evaluation.episodes for metrics in row]


def _alone(bundle: Bundle, one: Walk, cfg: GridCfg, robot: str | None) -> Metrics:
    """Walk one robot in one engine."""
    asked, ground = cfg.on(one.terrain), parse_course(one.terrain)
    spec, period = robot_of(bundle.contract, robot), bundle.contract.control_period
    command = parse_command(one.command)
    aside, askew = (0.0, 0.0) if ground.is_flat else starts(asked.seed, asked.episodes)[one.episode].tolist()
    world = World(
        make=partial(make_engine, ALONE[one.place.engine]),
        ground=course(ground.kind, ground.size, asked.seed),
        start=(0.0 if ground.is_flat else -FOOT, aside),
        heading=askew,
        timestep=STEP if one.robot is None else TIMESTEP,
        noise=asked.noise if one.robot is None else None,
    )
    case: Kind
    if one.robot is None or one.place.cell is None:
        case = DataSheet(asked.seed, asked.law, float(one.level))
    else:
        case = Case(one.robot, one.place.cell, parse_level(one.level))
    steps = round(asked.duration / period)
    friction = None if one.forward is None else np.array(one.forward)
    seed = 0 if one.robot is None else asked.seed
    trial = walk(bundle, case, world, steer(command, ground), steps, one.episode, None, spec, friction, seed)
    part = trial.recording.lasting(steps).of(slice(0, 1), round(asked.settle / period))
    return measure(part, command, spec.groups(), spec.mass * GRAVITY, ground)


def steer(command: Command, ground: Course) -> Steer:
    """Return who commands a robot: the command itself on flat ground; over a course its speed, straight on."""
    velocity = np.array(command.velocity)
    if ground.is_flat:
        return lambda step, motion: velocity

    def straight(step: int, motion: Motion) -> np.ndarray:
        return np.array([velocity[0], 0.0, straight_on(yaw(motion.base_quaternion))])

    return straight
