"""Lets the same bundles walk in the training's simulator and in every engine: flat ground, the robot of the data sheet.

Nothing differs between simulators but the simulator: no sensor noise, no delay, Coulomb friction of the same share of
the torque limit in every joint. What is left is how contacts and joints are solved, and where the controllers run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stiction.formats.bundle import Bundle
from stiction.formats.climb import wilson
from stiction.formats.engines import COARSE, FINE_TRAINING, MUJOCO, STIFF, TRAINING, EpisodeRow, WalkRow
from stiction.formats.errors import StictionError
from stiction.formats.friction import Law
from stiction.locomotion.config import NoiseCfg
from stiction.transfer.command import Command
from stiction.transfer.engines.catalog import make_engine
from stiction.transfer.engines.checks.rig import Make
from stiction.transfer.engines.engine import GRAVITY
from stiction.transfer.evaluate import EvaluationCfg, evaluate_bundle
from stiction.transfer.metrics import Metrics, measure
from stiction.transfer.robot.data_sheet import DataSheet
from stiction.transfer.robot.trial import World, walk
from stiction.transfer.rollout import robot_of
from stiction.transfer.statistics import ratio_interval, t_interval

TIMESTEP = 0.002
"""Physics step of the engines [s], that of the conformance suite's bounds."""

FINE = 0.001
"""Physics step of `FINE_TRAINING` [s]."""

CONTACT_TIME = 0.004
"""In which contacts give way in `STIFF` [s]: the shortest that MuJoCo takes at this step, twice the step."""

NO_NOISE = NoiseCfg(0.0, 0.0, 0.0, 0.0)
"""Perfect sensors."""


@dataclass(frozen=True)
class Simulator:
    """What a policy walks in."""

    name: str
    """As in `WalkRow`."""
    make: Make | None
    """Makes the engine; None for the training's simulator."""
    timestep: float | None
    """Physics step [s]; None: the policy's own, that of the training."""


@dataclass(frozen=True)
class Walk:
    """All episodes of one policy in one simulator at one level and command."""

    row: WalkRow
    """What they came to."""
    episodes: tuple[EpisodeRow, ...]
    """Each of them."""


def simulators(engines: Sequence[str]) -> list[Simulator]:
    """Return what policies walk in, the training's simulator first: the engines at 2 ms, MuJoCo in three ways."""
    found = [Simulator(TRAINING, None, None), Simulator(FINE_TRAINING, None, FINE)]
    for name in engines:
        make = partial(make_engine, name)
        if name == MUJOCO:
            from stiction.transfer.engines.mujoco_engine import MujocoEngine

            stiff = partial(MujocoEngine, contact_time=CONTACT_TIME)
            found += [Simulator(COARSE, make, None), Simulator(name, make, TIMESTEP), Simulator(STIFF, stiff, TIMESTEP)]
        else:
            found.append(Simulator(name, make, TIMESTEP))
    return found


def check_walks(cfg: EvaluationCfg) -> None:
    """Raise `StictionError` where a command asks for no motion, of which there is no speed to compare."""
    for command in cfg.parsed_commands:
        if command.direction is None:
            raise StictionError(f"command {command.label!r}: expected one that asks for motion, such as vx=0.5")


def walk_bundle(
    bundle: Bundle, found: Sequence[Simulator], cfg: EvaluationCfg, progress: Callable[[str, float], None]
) -> list[Walk]:
    """Let a bundle walk over levels and commands in every simulator, by level, command, simulator.

    cfg: as `stiction evaluate` has it; its noise, law and delay are not used. progress: called with the names of bundle
    and simulator, and the share of their walks that is done.

    Raises:
        StictionError: the bundle does not fit the robot, or a command asks for no motion.

    """
    check_walks(cfg)
    cells = [(level, command) for level in cfg.friction_levels for command in cfg.parsed_commands]
    measured: dict[str, list[tuple[Metrics, ...]]] = {}
    for simulator in found:
        done = partial(progress, f"{bundle.name}, {simulator.name}")
        if simulator.make is None:
            same = replace(cfg, noise=NO_NOISE, action_delay=0.0, friction_law="coulomb")
            finer = at_step(bundle, _timestep(bundle, simulator))
            measured[simulator.name] = list(evaluate_bundle(finer, same, progress=done).episodes)
            continue
        measured[simulator.name] = []
        for number, (level, command) in enumerate(cells):
            timestep = _timestep(bundle, simulator)
            measured[simulator.name].append(_walks(bundle, simulator.make, timestep, level, command, cfg))
            done((number + 1) / len(cells))
    return [
        _walk(bundle, simulator, level, command, measured[simulator.name][number], measured[TRAINING][number])
        for number, (level, command) in enumerate(cells)
        for simulator in found
    ]


def _walks(
    bundle: Bundle, make: Make, timestep: float, level: float, command: Command, cfg: EvaluationCfg
) -> tuple[Metrics, ...]:
    """Return what each episode of one robot in an engine was worth."""
    contract = bundle.contract
    spec, period = robot_of(contract), contract.control_period
    world = World(make, timestep=timestep, period=period)
    case, velocity = DataSheet(cfg.seed, Law(), level), np.array(command.velocity)
    steps, first = round(cfg.seconds / period), round(cfg.settle / period)
    metrics = []
    for episode in range(cfg.episodes):
        trial = walk(bundle, case, world, lambda number, motion: velocity, steps, episode)
        recording = trial.recording.lasting(steps).of(slice(0, 1), first)
        metrics.append(measure(recording, command, spec.groups(), spec.mass * GRAVITY))
    return tuple(metrics)


def at_step(bundle: Bundle, timestep: float) -> Bundle:
    """Return a bundle that evaluation steps at another timestep [s], with the same control period."""
    decimation = round(bundle.contract.control_period / timestep)
    return replace(bundle, contract=replace(bundle.contract, physics_timestep=timestep, decimation=decimation))


def _timestep(bundle: Bundle, simulator: Simulator) -> float:
    """Return the physics step of a policy's walk [s]."""
    return bundle.contract.physics_timestep if simulator.timestep is None else simulator.timestep


def _walk(
    bundle: Bundle,
    simulator: Simulator,
    level: float,
    command: Command,
    metrics: Sequence[Metrics],
    trained: Sequence[Metrics],
) -> Walk:
    """Return what episodes came to, beside those of the training's simulator."""
    speeds, base = ([float(one.speed_ratio or 0.0) for one in some] for some in (metrics, trained))
    falls = sum(one.fall_rate > 0 for one in metrics)
    low, high = t_interval(speeds) or (None, None)
    fall_low, fall_high = wilson(falls, len(speeds))
    other = simulator.name != TRAINING and bool(np.mean(base))
    ratio_low, ratio_high = (ratio_interval(speeds, base) if other else None) or (None, None)
    row = WalkRow(
        policy=bundle.name,
        simulator=simulator.name,
        timestep=_timestep(bundle, simulator),
        friction_level=level,
        command=command.label,
        episodes=len(speeds),
        speed_ratio=float(np.mean(speeds)),
        speed_low=low,
        speed_high=high,
        falls=falls,
        fall_low=fall_low,
        fall_high=fall_high,
        to_training=float(np.mean(speeds) / np.mean(base)) if other else None,
        to_training_low=ratio_low,
        to_training_high=ratio_high,
    )
    place = (bundle.name, simulator.name, level, command.label)
    each = zip(speeds, metrics, strict=True)
    return Walk(row, tuple(EpisodeRow(*place, n, speed, one.fall_rate > 0) for n, (speed, one) in enumerate(each)))
