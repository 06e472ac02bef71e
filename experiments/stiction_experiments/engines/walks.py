"""Lets the same bundles walk in the training's simulator and in every engine: flat ground, the robot of the data sheet.

Nothing else differs: no sensor noise, no delay, Coulomb friction of the same share of the torque limit in every joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import key_of
from stiction.core.decode import from_plain
from stiction.core.errors import ConfigurationError
from stiction.core.parallel import spread
from stiction.core.statistics import t_interval, wilson
from stiction.engines.catalog import TIMESTEP, binaries, make_engine
from stiction.evaluation.evaluate import WALK_CODE, EvaluationCfg, evaluate_bundle
from stiction.evaluation.grid import walk_once
from stiction.evaluation.metrics import Metrics
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.joints.friction import Law
from stiction.task.config import NoiseCfg
from stiction.virtual.cases import DataSheet
from stiction.virtual.trial import World
from stiction_experiments.engines.conformance.rig import Make
from stiction_experiments.lab.files import cached
from stiction_experiments.lab.statistics import ratio_interval

TRAINING, FINE_TRAINING = "training", "training (1 ms)"
"""The simulator that policies were trained in, many robots at once, their controllers part of the engine: at its own
step, and at a finer one."""

MUJOCO, COARSE, STIFF = "mujoco", "mujoco (training's step)", "mujoco (contacts of 4 ms)"
"""MuJoCo with one robot and torque from outside: at the step of the other engines, at the step of the training, and at
the step of the others with contacts about as stiff as theirs."""


@dataclass(frozen=True)
class WalkRow:
    """How one policy walked in one simulator at one friction level and command."""

    policy: str
    simulator: str
    """`TRAINING`, `FINE_TRAINING`, `COARSE`, `STIFF`, or the name of an engine."""
    timestep: float
    friction_level: float
    """Dry friction in every joint as a fraction of its torque limit [-]."""
    command: str
    episodes: int
    """Number of walks, each from other joint angles."""
    speed_ratio: float
    """Mean speed along the command over the commanded speed [-]."""
    speed_low: float | None
    """Lower end of the 95 % t-interval of that mean over episodes; None for one episode."""
    speed_high: float | None
    falls: int
    """Episodes with a fall."""
    fall_low: float
    """Lower end of Wilson's 95 % interval of the share of falls."""
    fall_high: float
    to_training: float | None
    """Speed over that in `TRAINING` [-]; None there, and where that is zero."""
    to_training_low: float | None
    """Lower end of its 95 % interval (the delta method); None where there is none."""
    to_training_high: float | None


@dataclass(frozen=True)
class EpisodeRow:
    """One walk behind a `WalkRow`."""

    policy: str
    simulator: str
    friction_level: float
    command: str
    episode: int
    speed_ratio: float
    """Mean speed along the command over the commanded speed, zero after a fall [-]."""
    fell: bool


FINE = 0.001
"""Physics step of `FINE_TRAINING` [s]."""

CONTACT_TIME = 0.004
"""Time constant of contacts in `STIFF` [s]: the shortest that MuJoCo takes, twice the step."""

NO_NOISE = NoiseCfg(0.0, 0.0, 0.0, 0.0)
"""Perfect sensors."""


@dataclass(frozen=True)
class Simulator:
    """Simulator that a policy walks in."""

    name: str
    make: Make | None
    """Makes the engine; None for the training's simulator."""
    timestep: float | None
    """Physics step [s]; None: the policy's own, that of the training."""


def find_simulators(engines: Sequence[str]) -> list[Simulator]:
    """Return the simulators, that of the training first: the engines at 2 ms, MuJoCo also as `COARSE` and `STIFF`."""
    kinds = [Simulator(TRAINING, None, None), Simulator(FINE_TRAINING, None, FINE)]
    for name in engines:
        make = partial(make_engine, name)
        if name == MUJOCO:
            from stiction.engines.mujoco_engine import MujocoEngine

            stiff = partial(MujocoEngine, contact_time=CONTACT_TIME)
            kinds += [Simulator(COARSE, make, None), Simulator(name, make, TIMESTEP), Simulator(STIFF, stiff, TIMESTEP)]
        else:
            kinds.append(Simulator(name, make, TIMESTEP))
    return kinds


def check_walks(cfg: EvaluationCfg) -> None:
    """Raise `StictionError` where a command asks for no motion, of which there is no speed to compare."""
    for command in cfg.parsed_commands:
        if command.direction is None:
            raise ConfigurationError(f"command {command.label!r}: expected one that asks for motion, such as vx=0.5")


def walk_bundles(
    bundles: Sequence[Bundle],
    simulators: Sequence[Simulator],
    cfg: EvaluationCfg,
    folder: Path,
    jobs: int,
    progress: Callable[[str, float], None],
) -> tuple[list[WalkRow], list[EpisodeRow]]:
    """Let bundles walk over levels and commands in every simulator, by bundle, level, command, simulator.

    bundles: each of another name. cfg: levels, commands and episodes, checked by `check_walks`; its noise, law and
    delay are not used. folder: of the cache, a file for every such cell; it exists. jobs: processes at once, which do
    not change the result.

    Raises:
        StictionError: a bundle does not fit the robot, or a process was killed.

    """
    same = replace(cfg, noise=NO_NOISE, action_delay=0.0, friction_law="coulomb")
    asked = [
        replace(same, friction_levels=(level,), commands=(command,))
        for level, command in product(cfg.friction_levels, cfg.commands)
    ]
    tasks = [(bundle, simulator, one, folder) for bundle, one, simulator in product(bundles, asked, simulators)]
    walked: dict[int, tuple[EpisodeRow, ...]] = {}
    for number, episodes in spread(walk_cell, tasks, jobs):
        walked[number] = episodes
        progress("walks", len(walked) / len(tasks))
    rows = [
        # The training's simulator is the first one of each cell.
        _row(timestep_of(bundle, simulator), walked[n], walked[n - n % len(simulators)])
        for n, (bundle, simulator, _, _) in enumerate(tasks)
    ]
    return rows, [episode for n in range(len(tasks)) for episode in walked[n]]


def walk_cell(bundle: Bundle, simulator: Simulator, asked: EvaluationCfg, folder: Path) -> tuple[EpisodeRow, ...]:
    """Return the episodes of a policy in one simulator, from their file if they have walked before.

    asked: one level and one command.
    """
    # All of these run in MuJoCo, so that its binaries count.
    engine = MUJOCO if simulator.name in (TRAINING, FINE_TRAINING, COARSE, STIFF) else simulator.name
    inputs: dict[str, Any] = {"bundle": bundle.digest, "simulator": simulator.name, "asked": asdict(asked)}
    inputs["binaries"] = binaries(engine)
    name = f"{bundle.name}--{simulator.name}--{asked.friction_levels[0]:g}--{asked.commands[0]}".replace(" ", "-")

    def make() -> dict[str, list[dict[str, Any]]]:
        return {"episodes": [asdict(row) for row in _episodes(bundle, simulator, asked)]}

    entry = cached(folder, name, key_of(inputs, *WALK_CODE, "stiction_experiments:engines/walks.py"), make)
    return tuple(from_plain(EpisodeRow, row, name) for row in entry["episodes"])


def _episodes(bundle: Bundle, simulator: Simulator, asked: EvaluationCfg) -> list[EpisodeRow]:
    (level,), (command,) = asked.friction_levels, asked.parsed_commands
    timestep, cell = timestep_of(bundle, simulator), (bundle.name, simulator.name, level, command.label)
    measured: Sequence[Metrics]
    if simulator.make is None:
        decimation = round(bundle.contract.control_period / timestep)
        stepped = replace(bundle, contract=replace(bundle.contract, physics_timestep=timestep, decimation=decimation))
        (measured,) = evaluate_bundle(stepped, asked).episodes
    else:
        world = World(simulator.make, timestep=timestep, period=bundle.contract.control_period)
        case, spec = DataSheet(asked.seed, Law(), level), robot_of(bundle.contract)
        measured = [walk_once(bundle, case, world, asked, episode, spec) for episode in asked.numbers]
    return [EpisodeRow(*cell, n, float(one.speed_ratio or 0.0), one.fall_rate > 0) for n, one in enumerate(measured)]


def timestep_of(bundle: Bundle, simulator: Simulator) -> float:
    """Return the physics step of a policy's walk [s]."""
    return bundle.contract.physics_timestep if simulator.timestep is None else simulator.timestep


def _row(timestep: float, episodes: Sequence[EpisodeRow], trained: Sequence[EpisodeRow]) -> WalkRow:
    """Return what episodes came to, beside those of the training's simulator."""
    speeds, base = ([one.speed_ratio for one in some] for some in (episodes, trained))
    first, falls = episodes[0], sum(one.fell for one in episodes)
    low, high = t_interval(speeds) or (None, None)
    fall_low, fall_high = wilson(falls, len(speeds))
    other = first.simulator != TRAINING and bool(np.mean(base))
    ratio_low, ratio_high = (ratio_interval(speeds, base) if other else None) or (None, None)
    return WalkRow(
        policy=first.policy,
        simulator=first.simulator,
        timestep=timestep,
        friction_level=first.friction_level,
        command=first.command,
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
