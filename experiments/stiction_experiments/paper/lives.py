"""Lives of virtual robots whose joints' friction grows, by the walks of the study of wear; a share followed of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stiction.deploy.check import check_for_simulation
from stiction.evaluation.run import Progress
from stiction.virtual.robot import Wear
from stiction_experiments.lab.straight import pace
from stiction_experiments.wear.lifetimes import Window
from stiction_experiments.wear.run import WearCfg, study_wear

LEAST, MOST, TRAINED = 0.05, 0.3, 0.24
"""Friction at birth and at the end, and the most that `deception` was trained with, over the torque limit [1]."""

NOMINAL = 0.1
"""Level that wear multiplies [1]."""

COMMANDS = ("vx=0.5", "vx=-0.5", "vy=0.3", "vy=-0.3", "wz=0.5", "wz=-0.5")
"""Commands of the lives, a walk each: every axis both ways."""

SECONDS = 90.0
"""Time in which friction grows [s]."""


@dataclass(frozen=True)
class Life:
    """One policy under one command on one robot that wears; a row of lives.csv."""

    training: str
    seed: int
    robot: int
    command: str
    followed: float
    """Share of the windows that are followed [1]; those after a fall are not."""
    beyond: float
    """The same of the windows with `TRAINED` or more friction [1]."""


def life_cfg(robots: Sequence[int], commands: Sequence[str] = COMMANDS, seconds: float = SECONDS) -> WearCfg:
    """Return the settings of the walks; seconds: in which friction grows."""
    wear = Wear(start=LEAST / NOMINAL, end=MOST / NOMINAL, seconds=seconds)
    return WearCfg(levels=(f"{NOMINAL:g}",), robots=tuple(robots), wear=wear, control=False, commands=tuple(commands))


def live(
    training: str,
    policies: Sequence[Path],
    cfg: WearCfg,
    folder: Path,
    jobs: int = 1,
    progress: Progress = lambda name, share: None,
) -> list[Life]:
    """Let robots wear under the policies of a training; folder: of one file for every walk, where it goes on.

    policies: directories of bundles.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bundles = [check_for_simulation(policy) for policy in policies]
    _, windows, _ = study_wear(bundles, policies, cfg, folder, jobs, progress)
    seeds = {bundle.name: bundle.contract.seed for bundle in bundles}
    return lives_of(training, seeds, windows, cfg)


def lives_of(training: str, seeds: dict[str, int], windows: Sequence[Window], cfg: WearCfg) -> list[Life]:
    """Return the lives of robots; seeds: policy -> its training seed; windows: of all walks."""
    every, wear = cfg.every, cfg.wear
    # A robot that fell has fewer windows than its life.
    starts = range(round((wear.seconds - cfg.settle) / every) + 1)
    factors = [wear.factor(cfg.settle + start * every + cfg.window / 2) for start in starts]
    late = sum(factor * NOMINAL >= TRAINED for factor in factors)
    lives = []
    for policy, seed in seeds.items():
        for robot in cfg.robots:
            for command in cfg.labels:
                own = [w for w in windows if (w.policy, w.robot, w.command) == (policy, robot, command)]
                good = [window for window in own if pace(window.ratio) == "follows"]
                beyond = sum(window.factor * NOMINAL >= TRAINED for window in good)
                lives.append(Life(training, seed, robot, command, len(good) / len(factors), beyond / late))
    return lives
