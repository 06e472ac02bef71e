"""How long does a policy live while friction grows? Virtual robots walk at one command and wear out on the way.

Beside them the same robots walk as long under the same policies with friction that stays where it is: what ends there,
and what a monitor notices there, has another cause than growth.

Robots are independent of each other, and each walk is one file: an interrupted study loses those that were going on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
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
from stiction.transfer.kept import WALKING, keep
from stiction.transfer.robot.draw import draw
from stiction.transfer.robot.factorial import Case, parse_level
from stiction.transfer.robot.seeds import reported
from stiction.transfer.robot.trial import Trial, World, walk
from stiction.transfer.robot.wear import Wear
from stiction.transfer.rollout import robot_of
from stiction.transfer.wear_life import life, ratios
from stiction.transfer.workers import spread

JUDGING = ("transfer/wear_study.py", "transfer/wear_life.py", "transfer/statistics.py")
"""Code that decides, beside `WALKING`, what becomes of a robot."""


@dataclass(frozen=True)
class WearCfg:
    """What every policy is put through."""

    engine: str = "physx"
    """Physics engine; one that the policies were not trained in."""
    levels: tuple[str, ...] = ("0.1",)
    """Levels of dry friction that wear multiplies: of the torque limit, or `bench`; see `parse_level`."""
    cell: str = "all"
    """What is real about the robots; see `Case`."""
    robots: tuple[int, ...] = reported(5)
    """Seeds of the virtual robots."""
    wear: Wear = field(default_factory=lambda: Wear(seconds=120.0))
    """Which joints wear, how far, and in which time. Twelve windows from x0.3 to x3: x1.2 in each. At the end of it the
    robot walks on for a window, so that one is all at the greatest wear."""
    control: bool = True
    """Whether every robot also walks with friction that stays, see `steady`."""
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
        for name in ("levels", "robots"):
            given = getattr(self, name)
            if not given or len(set(given)) < len(given):
                raise StictionError(f"{name} {given}: expected at least one, each once")
        for level, seed in product(self.levels, self.robots):
            Case(seed, self.cell, parse_level(level))
            if parse_level(level).is_none:
                raise StictionError("friction level 0 cannot wear: expected levels above it")
        if not (self.settle >= 0 and self.every >= 0.1 and 0.1 <= self.window <= self.wear.seconds - self.settle):
            raise StictionError(
                f"windows of {self.window} s, every {self.every} s, after {self.settle} s to settle, in "
                f"{self.wear.seconds} s: expected windows that fit, of 0.1 s or more and as far from each other"
            )

    @property
    def steady(self) -> tuple[float, ...]:
        """Wear of the control walks [1].

        At its beginning the walk is that in which friction grows, in everything but growth: what comes there would have
        come without it. x1 is the level itself, what a robot with its seals in has, and the growing one only passes.
        """
        return tuple(dict.fromkeys((self.wear.start, 1.0))) if self.control else ()


@dataclass(frozen=True)
class Worn:
    """One walk: one robot under one policy."""

    bundle: Path
    """Directory of the policy's bundle."""
    level: str
    """Of its friction."""
    seed: int
    """Of the robot."""
    steady: float | None
    """Wear at which its friction stays [1]; None: it grows."""
    cfg: WearCfg
    """All else."""
    out: Path
    """Folder for the files of walks."""

    @property
    def name(self) -> str:
        """Name of the walk: policy, level and robot, and where its friction stays."""
        stays = "" if self.steady is None else f"--x{self.steady:g}"
        return f"{self.bundle.resolve().name}--{self.level}--{self.seed}{stays}"

    @property
    def wear(self) -> Wear:
        """How its friction goes."""
        wear = self.cfg.wear
        return wear if self.steady is None else replace(wear, start=self.steady, end=self.steady)

    def made_from(self, digest: str) -> dict[str, Any]:
        """Return everything that the walk depends on beside the code; digest: of the bundle."""
        cfg = asdict(replace(self.cfg, levels=(self.level,), robots=(self.seed,), wear=self.wear, control=False))
        return {"bundle": digest, "steady": self.steady, "config": cfg}


def study_wear(
    bundles: Sequence[Bundle],
    paths: Sequence[Path],
    cfg: WearCfg,
    out: Path,
    jobs: int,
    progress: Callable[[str, float], None],
) -> tuple[list[Life], list[Window], list[Reading]]:
    """Wear out every robot under every policy, and walk the controls; return the rows of all.

    Args:
        bundles: the policies, checked.
        paths: their directories.
        cfg: what they are put through.
        out: folder in which each walk's part is kept.
        jobs: processes at once. They do not change the result.
        progress: called with `walks` and the share that is done.

    Raises:
        StictionError: a bundle does not fit the robot, the engine is not here, or a process was killed.

    """
    for bundle in bundles:
        cfg.wear.worn(robot_of(bundle.contract).joint_names)
    walks = product(paths, cfg.levels, (None, *cfg.steady), cfg.robots)
    todo = [Worn(path, level, seed, steady, cfg, out) for path, level, steady, seed in walks]
    done: dict[int, dict[str, Any]] = {}
    progress("walks", 0.0)
    for number, part in spread(wear_out, [(worn,) for worn in todo], jobs):
        done[number] = part
        progress("walks", len(done) / len(todo))
    parts = [done[number] for number in range(len(todo))]
    windows = [Window(**row) for part in parts for row in part["windows"]]
    readings = [Reading(**row) for part in parts for row in part["readings"]]
    return [Life(**part["life"]) for part in parts], windows, readings


def wear_out(worn: Worn) -> dict[str, Any]:
    """Do a walk, unless its file is there; return `life`, `windows` and `readings` as plain data."""
    bundle = check_bundle(worn.bundle).bundle
    code = (*WALKING, *JUDGING)
    return keep(worn.out, worn.name, worn.made_from(bundle.digest), code, lambda: _wear_out(worn, bundle))


def _wear_out(worn: Worn, bundle: Bundle) -> dict[str, Any]:
    """Let one robot walk, and judge it."""
    cfg, command, wear = worn.cfg, parse_command(worn.cfg.command), worn.wear
    period, spec = bundle.contract.control_period, robot_of(bundle.contract)
    steps = round((wear.seconds + cfg.window) / period)
    case = Case(worn.seed, cfg.cell, parse_level(worn.level))
    velocity = np.array(command.velocity)
    world = World(partial(make_engine, cfg.engine))
    trial = walk(bundle, case, world, lambda step, motion: velocity, steps, wear=wear)
    named: dict[str, Any] = {"policy": bundle.name, "friction_level": worn.level, "robot": worn.seed}
    named |= {"steady": worn.steady}
    windows = [Window(**named, **seen) for seen in speeds(trial, command, wear, cfg)]
    readings = [Reading(**named, **seen) for seen in listen(trial, bundle, spec, case, wear, cfg.settle)]
    lasted = len(trial.recording.upright) * period
    fell = None if trial.recording.upright[-1, 0] else (lasted, wear.factor(lasted))
    what = named | {"method": bundle.contract.method, "engine": cfg.engine, "command": command.label}
    row = life(what, windows, readings, fell, bundle.wear is not None)
    return {
        "life": asdict(row),
        "windows": [asdict(one) for one in windows],
        "readings": [asdict(one) for one in readings],
    }


def speeds(trial: Trial, command: Command, wear: Wear, cfg: WearCfg) -> list[dict[str, Any]]:
    """Return `time`, `factor` and `ratio` of every window of a walk; cfg: when there are windows."""
    recording, direction = trial.recording, np.asarray(command.direction)
    along = (recording.velocity[:, 0] @ direction) * recording.upright[:, 0] / command.speed
    return [
        {"time": time, "factor": wear.factor(time - cfg.window / 2), "ratio": ratio}
        for time, ratio in ratios(along, recording.period, cfg.settle, cfg.window, cfg.every)
    ]


def listen(
    trial: Trial, bundle: Bundle, spec: RobotSpec, case: Case, wear: Wear, settle: float
) -> list[dict[str, Any]]:
    """Return what the bundle's monitor says of what the policy saw after `settle` [s]; nothing without one.

    The target is the joint that wears, or the level where several do. The truth is the referee's to know.
    """
    if bundle.wear is None:
        return []
    period, worn = bundle.contract.control_period, wear.worn(spec.joint_names)
    share = case.robot(draw(spec, case.seed)).friction.share
    own = case.level.coulomb(spec) * share / spec.joint_values("torque_limit")
    one = int(np.argmax(worn)) if worn.sum() == 1 else None
    target = LEVEL if one is None else spec.joint_names[one]
    monitor, first, said = WearMonitor(bundle.contract, bundle.wear), round(settle / period), []
    for steps, turn in enumerate(trial.turns[first:], first + 1):
        estimate = monitor.step(turn.policy.observation)
        if estimate is None:
            continue
        time = steps * period
        factor = wear.factor(time - bundle.wear.window * period / 2)
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
