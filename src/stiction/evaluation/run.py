"""Walks a grid on all cores, resumable: what its ledger has is not walked again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from stiction.core.cache import Ledger, key_of
from stiction.core.decode import from_plain
from stiction.core.errors import EngineError
from stiction.core.lock import output_folder
from stiction.core.parallel import spread
from stiction.core.rotation import yaw
from stiction.engines import catalog
from stiction.engines.catalog import binaries, what_is_missing
from stiction.engines.engine import Motion
from stiction.engines.ground import course
from stiction.evaluation.benches import forward_walks, with_known_friction
from stiction.evaluation.code import WALK_CODE
from stiction.evaluation.course import START_DISTANCE, Course, starts, straight_on
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.grid import GridCfg, Unit, Walk, plan, units
from stiction.evaluation.metrics import Metrics, measure
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import Command
from stiction.joints.compensation import BY_ERROR, Compensation, parse_compensation
from stiction.joints.friction import law_source
from stiction.robots.catalog import find_robot
from stiction.robots.model import GRAVITY, Robot
from stiction.virtual import trial as trials
from stiction.virtual.cases import Case, DataSheet, parse_level
from stiction.virtual.trial import TIMESTEP, CommandSource, RobotCase, World


class WalkLedger(Ledger):
    """The walks of one grid that are done."""

    def __init__(self, path: Path, cfg: GridCfg, digests: dict[str, str], robot: str | None = None) -> None:
        """Read the file at `path`, whose folder exists; raise `StictionError` where it cannot be read.

        digests: policy -> digest of its bundle; robot: a robot of one's own, see `robot_of`.
        """
        super().__init__(path)
        self._digests = digests
        spec = None if robot is None else find_robot(robot)
        self._common = key_of([cfg.settings(), law_source(cfg.base.friction_law), robot, spec], *WALK_CODE)

    def key(self, walk: Walk) -> str:
        """Return the key of a walk: bundle, cell, settings, code that measures, engine."""
        engine = binaries(walk.simulator.spec.name)
        return key_of([self._common, asdict(walk), self._digests[walk.policy], engine])[:24]

    def find(self, walk: Walk) -> Metrics | None:
        """Return the metrics of a walk; None where it was not done."""
        entry = self.get(self.key(walk))
        return None if entry is None else from_plain(Metrics, entry.get("metrics"), f"{LEDGER}, {entry['key']}")

    def add(self, walks: tuple[Walk, ...], metrics: list[Metrics]) -> None:
        """Add walks; they are on the disk when this returns. Raises `FileError` where the file cannot be written."""
        done = zip(walks, metrics, strict=True)
        self.extend([{"key": self.key(walk), "walk": asdict(walk), "metrics": asdict(one)} for walk, one in done])


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
    compensation = parse_compensation(one.forward_by)
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
    (command,), period = cfg.parsed_commands, bundle.contract.control_period
    steps = round(cfg.duration / period)
    commands = command_source(command, cfg.course)
    trial = trials.walk(
        bundle, case, world, commands, steps, episode, None, spec, friction, seed, known, compensation, load
    )
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


LEDGER = "walks.jsonl"
"""Name of the ledger in the folder of the results."""

BENCHES = "bench"
"""Name of the folder beside it for what was identified of virtual robots."""

Progress = Callable[[str, float], None]
"""Called with the name of an engine and the share of its walks that is done."""


def walk_grid(
    bundles: Sequence[Bundle],
    cfg: GridCfg,
    out: Path,
    jobs: int = 1,
    robot: str | None = None,
    progress: Progress = lambda name, share: None,
) -> dict[Walk, Metrics]:
    """Walk what is not in the ledger of `out` yet, and return every walk of the grid, those of one row together.

    Args:
        bundles: checked, each of another name.
        cfg: the grid.
        out: folder of the results; it exists.
        jobs: processes at once. They do not change the result.
        robot: a robot of one's own, see `robot_of`.
        progress: see `Progress`.

    Raises:
        StictionError: a bundle does not fit its robot, an engine is not installed, friction cannot be fed forward, or a
            process was killed. What was walked by then is in the ledger. Or another process writes the folder.

    """
    for bundle in bundles:
        spec = robot_of(bundle.contract, robot)
        for simulator in cfg.simulators:
            if not simulator.is_batch and (why := what_is_missing(simulator.spec.name, spec)):
                raise EngineError(why)
    with output_folder(out):
        ledger = WalkLedger(out / LEDGER, cfg, {bundle.name: bundle.digest for bundle in bundles}, robot)
        walks = plan([bundle.name for bundle in bundles], cfg)
        walks += forward_walks(bundles, cfg, out / BENCHES, jobs, robot, progress)
        walks = with_known_friction(walks, bundles, cfg, out / BENCHES, jobs, robot, progress)
        done = {walk: found for walk in walks if (found := ledger.find(walk)) is not None}
        total, finished = Counter(walk.simulator.label for walk in walks), Counter[str]()

        def report(new: Iterable[Walk]) -> None:
            count = Counter(walk.simulator.label for walk in new)
            finished.update(count)
            for name in count:
                progress(name, finished[name] / total[name])

        report(done)
        new = [unit for unit in units(walks, cfg) if any(walk not in done for walk in unit.walks)]
        by_name = {bundle.name: bundle for bundle in bundles}
        for number, metrics in spread(walk_unit, [(by_name[unit.policy], unit, cfg, robot) for unit in new], jobs):
            ledger.add(new[number].walks, metrics)
            report(walk for walk in new[number].walks if walk not in done)
            done |= dict(zip(new[number].walks, metrics, strict=True))
    return {walk: done[walk] for walk in walks}
