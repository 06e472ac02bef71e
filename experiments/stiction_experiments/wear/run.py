"""Virtual robots walk forward and backward while their friction grows; beside them, as controls, while it stays.

Walks are independent of each other, and each is one file: an interrupted study loses those that were going on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.cache import key_of
from stiction.core.errors import ConfigurationError, check_once
from stiction.core.parallel import spread
from stiction.deploy.check import check_for_simulation
from stiction.engines.catalog import binaries, make_engine
from stiction.evaluation.course import SETTLE, untrained
from stiction.evaluation.evaluate import WALK_CODE
from stiction.evaluation.policies import method_of
from stiction.files.bundle import Bundle
from stiction.files.contract import robot_of
from stiction.files.velocity import parse_command
from stiction.virtual.cases import Case, parse_level, parse_levels, reported
from stiction.virtual.robot import Wear
from stiction.virtual.trial import World, walk
from stiction_experiments.lab.files import cached
from stiction_experiments.wear.lifetimes import Lifetime, Reading, Seen, Window, judge_robot, monitor_readings, speeds

WEARING = (*WALK_CODE, "files/wear.py", "stiction_experiments:wear/run.py", "stiction_experiments:wear/lifetimes.py")
"""Code that decides what is recorded of a walk; what it means is judged anew every time."""


@dataclass(frozen=True)
class WearCfg:
    """Settings of every policy's walks; fields as of `WearOptions`."""

    engine: str = "physx"
    levels: tuple[str, ...] = ("0.1",)
    cell: str = "all"
    robots: tuple[int, ...] = reported(5)
    wear: Wear = field(default_factory=lambda: Wear(seconds=120.0))
    """Worn joints, largest wear, and time to reach it. The robot then walks on for a window, so that one is all at the
    greatest wear."""
    control: bool = True
    commands: tuple[str, ...] = ("vx=0.5", "vx=-0.5")
    settle: float = SETTLE
    """Time after the start that is not measured [s]."""
    window: float = 10.0
    every: float = 1.0
    """Time from one such window to the next [s]."""

    def __post_init__(self) -> None:
        """Refuse what has no speed, no robot or no window."""
        check_once("commands", self.labels)
        for command in self.commands:
            if parse_command(command).direction is None:
                raise ConfigurationError(
                    f"wear under the command {command!r}: expected one that asks for motion, vx=0.5"
                )
        check_once("robots", self.robots)
        for level in parse_levels(self.levels):
            Case(self.robots[0], self.cell, level)
            if level.is_none:
                raise ConfigurationError("friction level 0 cannot wear: expected levels above it")
        if not (self.settle >= 0 and self.every >= 0.1 and 0.1 <= self.window <= self.wear.seconds - self.settle):
            raise ConfigurationError(
                f"windows of {self.window} s, every {self.every} s, after {self.settle} s to settle, in "
                f"{self.wear.seconds} s: expected windows that fit, of 0.1 s or more and as far from each other"
            )

    @property
    def labels(self) -> tuple[str, ...]:
        """The commands as they stand in results: `vx=0.5`, also where `vx=0.50` was typed."""
        return tuple(parse_command(command).label for command in self.commands)

    @property
    def steady(self) -> tuple[float, ...]:
        """Wear of the control walks [1]: that at which growth begins, and the level itself."""
        return tuple(dict.fromkeys((self.wear.start, 1.0))) if self.control else ()


@dataclass(frozen=True)
class WearWalk:
    """One walk: one robot under one policy and command."""

    bundle: Path
    """Directory of the policy's bundle."""
    level: str
    seed: int
    steady: float | None
    """Wear at which its friction stays [1]; None: it grows."""
    command: str
    """Command, one of the labels."""
    cfg: WearCfg
    out: Path
    """Folder for the files of walks."""

    @property
    def name(self) -> str:
        """Name of the walk: policy, level and robot, where its friction stays, and its command."""
        stays = "" if self.steady is None else f"--x{self.steady:g}"
        return f"{self.bundle.resolve().name}--{self.level}--{self.seed}{stays}--{self.command}"

    @property
    def wear(self) -> Wear:
        """How its friction goes."""
        wear = self.cfg.wear
        return wear if self.steady is None else replace(wear, start=self.steady, end=self.steady)

    def key(self, digest: str) -> str:
        """Return the key of the walk; digest: of the bundle."""
        # What else was asked for does not count: a walk stays where levels, robots or controls are added.
        own = replace(self.cfg, levels=(self.level,), robots=(self.seed,), commands=(self.command,))
        cfg = asdict(replace(own, wear=self.wear, control=False))
        return key_of([digest, self.steady, cfg, binaries(self.cfg.engine)], *WEARING)


def study_wear(
    bundles: Sequence[Bundle],
    paths: Sequence[Path],
    cfg: WearCfg,
    out: Path,
    jobs: int,
    progress: Callable[[str, float], None],
) -> tuple[list[Lifetime], list[Window], list[Reading]]:
    """Wear out every robot under every policy, and walk the controls; return the rows of all.

    paths: directories of the bundles. out: folder of the cache, a file for every walk. jobs: processes at once, which
    do not change the result.

    Raises:
        StictionError: a bundle does not fit the robot, the engine is not here, or a process was killed.

    """
    for bundle in bundles:
        cfg.wear.worn(robot_of(bundle.contract).joint_names)
    walks = [
        WearWalk(path, level, seed, steady, command, cfg, out)
        for path, level, steady, seed, command in product(
            paths, cfg.levels, (None, *cfg.steady), cfg.robots, cfg.labels
        )
    ]
    done: dict[int, Seen] = {}
    progress("walks", 0.0)
    for number, part in spread(wear_out, [(one,) for one in walks], jobs):
        done[number] = part
        progress("walks", len(done) / len(walks))
    seen = [done[number] for number in range(len(walks))]
    lifetimes, ways, of_path = [], len(cfg.commands), dict(zip(paths, bundles, strict=True))
    for first in range(0, len(walks), ways):
        bundle = of_path[walks[first].bundle]
        what = {"method": method_of(bundle.contract), "engine": cfg.engine}
        what |= named(walks[first], bundle) | {"command": " ".join(cfg.labels)}
        lifetimes.append(judge_robot(what, seen[first : first + ways], bundle.wear is not None))
    return (
        lifetimes,
        list(chain.from_iterable(one.windows for one in seen)),
        list(chain.from_iterable(one.readings for one in seen)),
    )


def untrained_notes(bundles: Sequence[Bundle], cfg: WearCfg) -> list[str]:
    """Return a sentence for each policy that is given commands beyond those that it was trained for."""
    commands = [parse_command(label) for label in cfg.labels]
    return [
        f"{bundle.name}: {note}; its lifetime under that is of what nobody trained"
        for bundle in bundles
        if (note := untrained(commands, bundle.contract))
    ]


def named(one: WearWalk, bundle: Bundle) -> dict[str, Any]:
    """Return the fields that say which walk a row is about."""
    return {
        "policy": bundle.name,
        "friction_level": one.level,
        "robot": one.seed,
        "steady": one.steady,
        "command": one.command,
    }


def wear_out(one: WearWalk) -> Seen:
    """Walk, unless the walk's file is there. The file has what was recorded, and not what that means."""
    bundle = check_for_simulation(one.bundle)
    seen = cached(one.out, one.name, one.key(bundle.digest), lambda: record_walk(one, bundle))
    walk = named(one, bundle)
    return Seen(
        [Window(**walk, **row) for row in seen["windows"]],
        [Reading(**walk, **row) for row in seen["readings"]],
        None if seen["fell"] is None else (seen["fell"], one.wear.factor(seen["fell"])),
    )


def record_walk(one: WearWalk, bundle: Bundle) -> dict[str, Any]:
    """Let a robot walk; return `windows`, `readings`, and the time [s] when it `fell`, or None."""
    cfg, command, wear = one.cfg, parse_command(one.command), one.wear
    period, spec = bundle.contract.control_period, robot_of(bundle.contract)
    steps = round((wear.seconds + cfg.window) / period)
    case = Case(one.seed, cfg.cell, parse_level(one.level))
    velocity = np.array(command.velocity)
    world = World(partial(make_engine, cfg.engine))
    trial = walk(bundle, case, world, lambda step, motion: velocity, steps, wear=wear)
    upright = trial.recording.upright
    return {
        "windows": speeds(trial, command, wear, cfg.settle, cfg.window, cfg.every),
        "readings": monitor_readings(trial, bundle, spec, case, wear, cfg.settle),
        "fell": None if upright[-1, 0] else len(upright) * period,
    }
