"""How long does a policy live while friction grows? Virtual robots walk at one command and wear out on the way.

Robots are independent of each other, and each is one file: an interrupted study loses the robots that were walking.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from stiction.deploy.check import check_bundle
from stiction.deploy.wear import WearEstimate, WearMonitor
from stiction.formats.bundle import Bundle
from stiction.formats.errors import StictionError
from stiction.formats.life import Life, Reading, Window
from stiction.formats.wear import LEVEL
from stiction.robots.spec import RobotSpec
from stiction.transfer.command import Command, parse_command
from stiction.transfer.engines.catalog import make_engine
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.trial import Trial, World, walk
from stiction.transfer.robot.wear import Wear
from stiction.transfer.rollout import robot_of
from stiction.transfer.wear_life import life, ratios

Progress = Callable[[str, float], None]
"""Called with the name of a piece of work and the share of it that is done."""

DEVELOPMENT = (*range(8), 101)
"""Seeds of virtual robots that were looked at while those were made: their results are no evidence."""

SEEDS = tuple(range(1000, 1005))
"""Seeds of the robots by default, which nothing was tuned on."""


@dataclass(frozen=True)
class WearCfg:
    """What every policy is put through."""

    engine: str = "physx"
    """Physics engine; one that the policies were not trained in."""
    levels: tuple[str, ...] = ("0.1",)
    """Levels of dry friction that wear multiplies: of the torque limit, or `bench`; see `parse_level`."""
    cell: str = "all"
    """What is real about the robots; see `Case`."""
    seeds: tuple[int, ...] = SEEDS
    """Seeds of the virtual robots."""
    wear: Wear = field(default_factory=lambda: Wear(seconds=120.0))
    """Which joints wear, how far, and in which time. Twelve windows from x0.3 to x3: x1.2 in each. At the end of it the
    robot walks on for a window, so that one is all at the greatest wear."""
    command: str = "vx=0.5"
    """What is commanded all the time."""
    settle: float = 2.0
    """Time after the start that nothing looks at [s]."""
    window: float = 10.0
    """Time over which the speed is averaged [s]: that of the monitor's window."""
    every: float = 1.0
    """Time from one such window to the next [s]."""

    def __post_init__(self) -> None:
        """Refuse what has no speed, no robot or no window."""
        if parse_command(self.command).direction is None:
            raise StictionError(f"wear under the command {self.command!r}: expected one that asks for motion, vx=0.5")
        for name in ("levels", "seeds"):
            given = getattr(self, name)
            if not given or len(set(given)) < len(given):
                raise StictionError(f"{name} {given}: expected at least one, each once")
        for level, seed in product(self.levels, self.seeds):
            Case(seed, self.cell, parse_level(level))
            if parse_level(level).is_none:
                raise StictionError("friction level 0 cannot wear: expected levels above it")
        if not (self.settle >= 0 and self.every >= 0.1 and 0.1 <= self.window <= self.wear.seconds - self.settle):
            raise StictionError(
                f"windows of {self.window} s, every {self.every} s, after {self.settle} s to settle, in "
                f"{self.wear.seconds} s: expected windows that fit, of 0.1 s or more and as far from each other"
            )


@dataclass(frozen=True)
class Worn:
    """One robot to wear out under one policy."""

    bundle: Path
    """Directory of the policy's bundle."""
    level: str
    """Of its friction."""
    seed: int
    """Of the robot."""
    cfg: WearCfg
    """All else."""
    out: Path
    """Folder for the files of robots."""

    @property
    def name(self) -> str:
        """Name of the walk: policy, level and robot."""
        return f"{self.bundle.resolve().name}--{self.level}--{self.seed}"

    def key(self, digest: str) -> dict[str, Any]:
        """Return everything that the walk depends on beside the code; digest: of the bundle."""
        cfg = asdict(self.cfg) | {"levels": self.level, "seeds": self.seed}
        return json.loads(json.dumps({"bundle": digest, "config": cfg}))


def study_wear(
    bundles: Sequence[Bundle], paths: Sequence[Path], cfg: WearCfg, out: Path, jobs: int, progress: Progress
) -> tuple[list[Life], list[Window], list[Reading]]:
    """Wear out every robot under every policy, `jobs` at once; return the rows of all.

    Args:
        bundles: the policies, checked.
        paths: their directories.
        cfg: what they are put through.
        out: folder in which each robot's part is kept.
        jobs: processes.
        progress: called with the name of a walk, or of the study, and the share that is done.

    Raises:
        StictionError: a bundle does not fit the robot, the engine is not here, or a process was killed.

    """
    for bundle in bundles:
        cfg.wear.worn(robot_of(bundle.contract).joint_names)
    todo = [Worn(path, level, seed, cfg, out) for path in paths for level, seed in product(cfg.levels, cfg.seeds)]
    if jobs == 1:
        parts = [wear_out(worn, partial(progress, worn.name)) for worn in todo]
    else:
        # Forked children would share the simulator's threads with this process.
        pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))
        try:
            waiting = [pool.submit(wear_out, worn) for worn in todo]
            for done, _ in enumerate(as_completed(waiting), 1):
                progress("robots", done / len(waiting))
            parts = [future.result() for future in waiting]
        except BrokenProcessPool as error:
            raise StictionError(
                "a process was killed, perhaps for want of memory; give fewer --jobs, what is done is kept"
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)
    windows = [Window(**row) for part in parts for row in part["windows"]]
    readings = [Reading(**row) for part in parts for row in part["readings"]]
    return [Life(**part["life"]) for part in parts], windows, readings


def wear_out(worn: Worn, progress: Callable[[float], None] = lambda share: None) -> dict[str, Any]:
    """Wear out one robot, unless its file is there; return `life`, `windows` and `readings` as plain data."""
    bundle = check_bundle(worn.bundle).bundle
    key = worn.key(bundle.digest)
    file = worn.out / f"{worn.name}-{hashlib.sha256(json.dumps(key, sort_keys=True).encode()).hexdigest()[:12]}.json"
    if file.is_file():
        progress(1.0)
        return json.loads(file.read_text(encoding="utf-8"))
    part = _wear_out(worn, bundle, progress)
    temporary = file.with_suffix(".tmp")
    temporary.write_text(json.dumps(part, allow_nan=False), encoding="utf-8")
    temporary.replace(file)
    return part


def _wear_out(worn: Worn, bundle: Bundle, progress: Callable[[float], None]) -> dict[str, Any]:
    """Let one robot walk, and judge it."""
    cfg, command = worn.cfg, parse_command(worn.cfg.command)
    period, spec = bundle.contract.control_period, robot_of(bundle.contract)
    steps = round((cfg.wear.seconds + cfg.window) / period)
    case = Case(worn.seed, cfg.cell, parse_level(worn.level))
    velocity = np.array(command.velocity)

    def steer(step: int, _: object) -> np.ndarray:
        if step % 50 == 0:
            progress(step / steps)
        return velocity

    trial = walk(bundle, case, World(partial(make_engine, cfg.engine)), steer, steps, wear=cfg.wear)
    progress(1.0)
    named: dict[str, Any] = {"policy": bundle.name, "friction_level": worn.level, "robot": worn.seed}
    windows = [Window(**named, **seen) for seen in speeds(trial, command, cfg)]
    readings = [Reading(**named, **seen) for seen in listen(trial, bundle, spec, case, cfg)]
    lasted = len(trial.recording.upright) * period
    fell = None if trial.recording.upright[-1, 0] else (lasted, cfg.wear.factor(lasted))
    what = named | {"method": bundle.contract.method, "engine": cfg.engine, "command": command.label}
    row = life(what, windows, readings, fell, bundle.wear is not None)
    return {
        "life": asdict(row),
        "windows": [asdict(one) for one in windows],
        "readings": [asdict(one) for one in readings],
    }


def speeds(trial: Trial, command: Command, cfg: WearCfg) -> list[dict[str, Any]]:
    """Return `time`, `factor` and `ratio` of every window of a walk."""
    recording, direction = trial.recording, np.asarray(command.direction)
    along = (recording.velocity[:, 0] @ direction) * recording.upright[:, 0] / command.speed
    return [
        {"time": time, "factor": cfg.wear.factor(time - cfg.window / 2), "ratio": ratio}
        for time, ratio in ratios(along, recording.period, cfg.settle, cfg.window, cfg.every)
    ]


def listen(trial: Trial, bundle: Bundle, spec: RobotSpec, case: Case, cfg: WearCfg) -> list[dict[str, Any]]:
    """Return what the bundle's monitor says of what the policy saw; nothing without one.

    The target is the joint that wears, or the level where several do. The truth is the referee's to know.
    """
    if bundle.wear is None:
        return []
    period, worn = bundle.contract.control_period, cfg.wear.worn(spec.joint_names)
    share = case.robot(draw(spec, case.seed)).friction.share
    own = case.level.coulomb(spec) * share / spec.joint_values("torque_limit")
    one = int(np.argmax(worn)) if worn.sum() == 1 else None
    target = LEVEL if one is None else spec.joint_names[one]
    monitor, first, said = WearMonitor(bundle.contract, bundle.wear), round(cfg.settle / period), []
    for steps, turn in enumerate(trial.turns[first:], first + 1):
        estimate = monitor.step(turn.policy.observation)
        if estimate is None:
            continue
        time = steps * period
        factor = cfg.wear.factor(time - bundle.wear.window * period / 2)
        true = own * np.where(worn, factor, 1.0)
        true = float(true.mean() if one is None else true[one])
        told = {name: value if np.isfinite(value) else None for name, value in numbers(estimate, one).items()}
        said.append(
            {"target": target, "time": time, "factor": factor, "true": true} | told | {"unusual": estimate.unusual}
        )
    return said


def numbers(estimate: WearEstimate, joint: int | None) -> dict[str, float]:
    """Return the estimate of one joint, by its number, or of the level, with the ends of its interval."""
    if joint is None:
        low, high = estimate.level_interval95
        return {"estimate": estimate.level, "low": low, "high": high}
    low, high = estimate.interval95[:, joint].tolist()
    return {"estimate": float(estimate.friction[joint]), "low": low, "high": high}
