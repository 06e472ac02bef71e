"""The factorial of virtual robots: cells (which groups of imperfections are real) times levels of friction.

    nominal     the data sheet in every group, no dry friction
    friction    dry friction of the level, in the robot's own shape; all else perfect
    rest        all but friction
    all         both

Any selection of groups is a cell too (`friction+delays`). A level scales dry friction alone: the joints' mean f/τ_max,
or the bench's value of each kind, and the load coefficient. A seed gives the same robot in all cells and at all levels;
seeds below `FIRST_REPORTED` are for tuning, the others for results.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError, check_once, if_per_cent, unknown_name
from stiction.engines.engine import JointFriction
from stiction.joints.friction import MAX_LEVEL, Law, has_coefficient
from stiction.robots.model import Robot
from stiction.virtual.hidden import GROUPS, Hidden

REST = tuple(name for name in GROUPS if name != "friction")

CELLS: dict[str, tuple[str, ...]] = {"nominal": (), "friction": ("friction",), "rest": REST, "all": GROUPS}

BENCH = "bench"
"""Name of a level: the friction of each kind of joint in the data sheet, as measured without load."""

LOAD = 0.02
"""Load coefficient in addition to the bench's value [-]: about a planetary gear of 90 % efficiency."""

LEVELS = ("0", "0.01", "0.05", "0.1", "0.2", "0.3", BENCH, f"{BENCH}+{LOAD:g}")
"""Levels of the comparison: shares of the torque limit, the paper's 1 % among them, and the bench's."""


@dataclass(frozen=True)
class Level:
    """Level of dry friction."""

    share: float | None
    """Mean over the joints of f/τ_max [-]; None: that of the data sheet for each kind of joint."""
    load: float = 0.0
    """Load coefficient c [-]."""

    @property
    def label(self) -> str:
        """Level as typed: `0.1`, `bench`, `bench+0.02`."""
        base = BENCH if self.share is None else f"{self.share:g}"
        return f"{base}+{self.load:g}" if self.load else base

    @property
    def is_none(self) -> bool:
        """True if there is no friction at all."""
        return self.share == 0 and self.load == 0

    def coulomb(self, spec: Robot) -> np.ndarray:
        """Return the friction of every joint before its share [N m], shape (J,)."""
        if self.share is None:
            return spec.joint_values("frictionloss")
        return self.share * spec.joint_values("torque_limit")


def parse_level(text: str) -> Level:
    """Return the level in a text: a share of the torque limit or `bench`; after a `+` a load coefficient."""
    base, plus, coefficient = text.strip().partition("+")
    try:
        share = None if base == BENCH else float(base)
        load = float(coefficient) if plus else 0.0
    except ValueError:
        # No comparison with NaN is true: the check below refuses it.
        share, load = math.nan, math.nan
    meant = if_per_cent(share or 0.0)
    if not all(0 <= number <= MAX_LEVEL for number in (share or 0.0, load)):
        raise ConfigurationError(
            f"friction level {text!r} of a virtual robot: expected a fraction of the torque limit up to {MAX_LEVEL} or "
            f"{BENCH!r}, with a load coefficient where wanted: 0.1, {BENCH}, {BENCH}+{LOAD:g}{meant}"
        )
    return Level(share, load)


def parse_levels(texts: Sequence[str]) -> tuple[Level, ...]:
    """Return the levels of several texts; raise `StictionError` for none, or for a repeated one (0.1 and 0.10)."""
    texts = [part for text in texts for part in text.split(",")]
    check_once("friction levels", texts, same=lambda text: parse_level(text).label)
    return tuple(map(parse_level, texts))


@dataclass(frozen=True)
class Case:
    """Robot of the experiment."""

    seed: int
    cell: str
    """One of `CELLS`, or groups joined by `+`."""
    level: Level
    """Level of its dry friction; zero if friction is not among the groups."""

    def __post_init__(self) -> None:
        """Reject unknown groups, and friction in a cell without it."""
        if wrong := sorted(set(self.groups) - set(GROUPS)):
            raise ConfigurationError(
                f"cell {self.cell!r}: {unknown_name('group', wrong[0], dict.fromkeys((*CELLS, *GROUPS)))}"
            )
        if "friction" not in self.groups and not self.level.is_none:
            raise ConfigurationError(f"cell {self.cell!r} has no friction; expected level 0, not {self.level.label}")

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the real groups."""
        return CELLS[self.cell] if self.cell in CELLS else tuple(self.cell.split("+"))

    @property
    def label(self) -> str:
        """Name for tables and files: `all--0.1--3`."""
        return f"{self.cell}--{self.level.label}--{self.seed}"

    def robot(self, hidden: Hidden) -> Hidden:
        """Return the robot of `hidden` in this cell."""
        return hidden.only(self.groups)

    def coulomb(self, hidden: Hidden, spec: Robot) -> np.ndarray:
        """Return the dry friction of its joints without load, f [N m], shape (J,)."""
        return self.level.coulomb(spec) * self.robot(hidden).friction.share

    def shown(self, hidden: Hidden, spec: Robot) -> np.ndarray:
        """Return the same as seen in its motors' torque, f/k [N m], shape (J,): k is their strength."""
        return self.coulomb(hidden, spec) / self.robot(hidden).motors.strength

    def friction(self, hidden: Hidden, spec: Robot, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        return self.robot(hidden).friction.at(self.level.coulomb(spec), self.level.load, timestep)


def factorial(seeds: Sequence[int], levels: Sequence[str] = LEVELS, cells: Sequence[str] = tuple(CELLS)) -> list[Case]:
    """Return every robot of an experiment once: by seed, then by cell, then by level.

    Cells without friction have only level 0; cells with friction leave out level 0 where another cell has it.
    """
    parsed = parse_levels(levels)
    cases = []
    for seed in seeds:
        for cell in cells:
            groups = Case(seed, cell, Level(0.0)).groups
            if "friction" not in groups:
                cases.append(Case(seed, cell, Level(0.0)))
                continue
            bare = set(groups) - {"friction"}
            twin = any(set(Case(seed, other, Level(0.0)).groups) == bare for other in cells)
            cases += [Case(seed, cell, level) for level in parsed if not (level.is_none and twin)]
    return cases


@dataclass(frozen=True)
class DataSheet:
    """Robot of the data sheet, with the same share of friction in every joint, or with shares of its joints."""

    seed: int
    """Seed for start poses and sensor noise."""
    law: Law
    level: float
    """Friction as a fraction of the torque limit, or its coefficient [-]."""
    shape: tuple[float, ...] = ()
    """Friction of each joint over that of the level [-]; empty: 1 in every joint."""

    def robot(self, hidden: Hidden) -> Hidden:
        """Return a robot without hidden imperfections."""
        return hidden.only(())

    def friction(self, hidden: Hidden, spec: Robot, timestep: float) -> JointFriction:
        """Return the dry friction of its joints; `timestep`: of the physics [s]."""
        unit = np.ones(spec.num_joints) if has_coefficient(self.law.name) else spec.joint_values("torque_limit")
        return JointFriction.under(self.law, self.level * unit * np.array(self.shape or 1.0), timestep)


FIRST_REPORTED = 1000
"""Lowest seed of a virtual robot reserved for results."""


def reported(count: int) -> tuple[int, ...]:
    """Return the seeds of the first `count` virtual robots that are reserved for results."""
    return tuple(range(FIRST_REPORTED, FIRST_REPORTED + count))


def warnings_on(seeds: Iterable[int]) -> list[str]:
    """Return a warning if results are on robots reserved for tuning."""
    tuned = [str(seed) for seed in seeds if seed < FIRST_REPORTED]
    if not tuned:
        return []
    return [
        f"Exploratory: virtual robots with seeds below {FIRST_REPORTED} ({', '.join(tuned)}) are there for making and "
        "tuning methods; results on them are no evidence."
    ]
