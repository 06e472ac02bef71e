"""Which training to choose for a joint's friction: the one whose seeds follow every command where it was tested.

It rests on `advice.json` beside this module, which the studies write from their rows; see `stiction.files.advice`.
A training covers a friction at which every seed of it, of three or more, follows every command, and nothing else:
neither what lies between two such levels, nor what is beyond the last that anybody walked with, nor another robot,
ground or law.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction.files.advice import SHARES, TRAINING, Source, TrainedWith, read_advice, robot_title
from stiction.files.following import FEWEST_SEEDS, CommandCount
from stiction.joints.friction import level_text

SHIPPED = Path(__file__).parent / "advice.json"
"""The file that comes with the package."""

TRAINED_IN = "mujoco"
"""Engine of the training: the others are elsewhere."""

TOLD = "told"
"""Method that observes its joints' friction: it is shown, and not chosen, for the robot has to tell it."""

PLACES = {TRAINED_IN: "in the simulator of the training", "physx": "in PhysX", "ode": "in ODE", "ode-webots": "in ODE"}
"""Engine -> how people call it; a plus in its name means a virtual robot."""

GROUND_AND_LAW = "on flat ground, under Coulomb friction"
"""What every count is of, see `TRAINED_UNDER`."""

TRAINED_UNDER = "coulomb"
"""Friction law of the trainings that are compared."""


def place_text(engine: str) -> str:
    """Return the place of a walk in words."""
    return "on virtual robots" if "+" in engine else PLACES.get(engine, f"in {engine}")


@dataclass(frozen=True)
class Advice:
    """What to train with, and what that rests on."""

    method: str
    """Training that is advised."""
    asked: float
    """Highest friction that was asked for [-]."""
    levels: tuple[float, ...]
    """Tested friction at which the trainings were compared, the nearest below and above what was asked included [-]."""
    cells: Mapping[str, tuple[CommandCount, ...]]
    """Training -> commands followed at these levels, in the simulator of the training."""
    elsewhere: tuple[CommandCount, ...]
    """Commands that the advised policies follow in other engines and on virtual robots, in each at the tested level
    nearest to the highest asked for; empty where they have not walked there."""
    source: Source
    """Part of the study."""
    robot: str | None = None
    """Name of the robot with the joint; None where unknown."""

    @property
    def borne_at(self) -> float | None:
        """Level up to which every seed that was trained without friction follows every command, the next tested one
        from `asked` on.

        None where one does not, where there are too few seeds to say so, or nothing was tested that high.
        """
        own = {cell.friction_level: cell.covered for cell in _trained_in(self.source) if cell.method == "none"}
        above = [level for level in own if level >= self.asked]
        return min(above) if above and all(own[level] for level in own if level <= min(above)) else None

    @property
    def covered(self) -> bool:
        """True if every seed, of three or more, follows at the friction that was asked for and all others compared."""
        return self.asked in self.levels and _all_covered(self.cells[self.method], self.levels)

    @property
    def training(self) -> TrainedWith:
        """How the policies of the method were trained."""
        return self.source.methods[self.method]

    @property
    def budget(self) -> str:
        """Preset of the advised policies as words of `stiction train`; empty without one."""
        named = re.search(r"--preset[ =]\S+", self.source.command)
        return named.group() if named else ""

    @property
    def flags(self) -> str:
        """Method and level as words of `stiction train`."""
        level = f" --friction-level {self.training.level:g}" if self.training.level > 0 else ""
        return f"--method {self.training.method}{level}"

    @property
    def settings(self) -> dict[str, Any]:
        """Fields of `FrictionCfg` that train so."""
        return {"method": self.training.method, "level": self.training.level, "law": TRAINED_UNDER, "per": "robot"}

    @property
    def range(self) -> list[float]:
        """Friction that training then draws, least and most, over the torque limit [-]."""
        return [self.training.low * self.training.level, self.training.high * self.training.level]

    @property
    def coverage(self) -> str:
        """Answer to whether the training covers what was asked, and the robot, ground and law that it rests on."""
        covers = self._covers
        return f"{covers[0].upper()}{covers[1:]}. {self._limits}"

    @property
    def text(self) -> str:
        """What to train with and what that covers; the other methods; the same policies elsewhere; the limits."""
        words = " ".join(filter(None, (self.budget, self.flags)))
        others = [
            f"{name}{', which the robot has to tell its friction,' if name == TOLD else ''} {_by_level(cells)}"
            for name, cells in self.cells.items()
            if name != self.method
        ]
        parts = [f"For up to {_percent(self.asked)}, train with {words}; {self._covers}."]
        parts += [f"Other methods: {'; '.join(others)}."] if others else []
        if self.training.level > 0 and self.training.level != self.asked:
            untried = f"training at {self.asked:.2g} itself has not been tried."
            return " ".join((*parts, self._transfer, f"{self._limits[:-1]}; {untried}"))
        return " ".join((*parts, self._transfer, self._limits))

    @property
    def _covers(self) -> str:
        """Answer to whether every seed, of three or more, follows every command with what was asked, with counts."""
        own, asked = self.cells[self.method], _percent(self.asked)
        beyond = max(cell.friction_level for cell in _trained_in(self.source))
        nearest = [cell for cell in own if cell.friction_level == self.asked] or own[
            -2 if self.asked <= beyond else -1 :
        ]
        if self.covered:
            begin = f"it covers {asked}"
        elif self.asked in self.levels and any(cell.covered for cell in nearest):
            begin = f"it covers {asked}, and not all below it"
        else:
            failing = not any(cell.every_seed for cell in nearest)
            begin = f"it does not cover {asked}" if failing else f"whether it covers {asked} is not known"
        parts = [f"{begin}: {PLACES[TRAINED_IN]} every command is followed by {_by_level(own)}"]
        parts += [f"the worst at {_percent(cell.friction_level)} is {cell.worst}" for cell in own if cell.worst][-1:]
        if any(cell.every_seed and not cell.covered for cell in own):
            parts.append(f"fewer than {FEWEST_SEEDS} seeds do not tell")
        if self.asked > beyond:
            parts.append(f"beyond {_percent(beyond)} nothing was walked")
        elif self.asked not in self.levels:
            parts.append("nothing was walked between")
        return "; ".join(parts)

    @property
    def _transfer(self) -> str:
        """Sentence on the same policies elsewhere, place by place."""
        if not self.elsewhere:
            return "In other engines and on virtual robots these policies have not walked."
        counts = (
            f"{place_text(cell.engine)} {_by_level([cell])}{cell.worst and f' (worst {cell.worst})'}"
            for cell in self.elsewhere
        )
        missing = (
            "" if any("+" in cell.engine for cell in self.elsewhere) else "; on virtual robots they have not walked"
        )
        return f"The same policies elsewhere: {'; '.join(counts)}{missing}."

    @property
    def _limits(self) -> str:
        """Sentence on the robot, the ground and the law that all of it rests on."""
        text = f"All of this is of {self.source.robot_text}, {GROUND_AND_LAW}, in simulation"
        if self.robot == self.source.robot:
            return f"{text}."
        other = "any other robot" if self.robot is None else robot_title(self.robot)
        return f"{text}; of {other} nothing is known directly."

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `training.json`: the counts, and the command and revision that they came from."""
        return {
            "levels": list(self.levels),
            "covered": self.covered,
            "cells": [asdict(cell) for cells in self.cells.values() for cell in cells],
            "elsewhere": [asdict(cell) for cell in self.elsewhere],
            "robot": self.source.robot,
            "command": self.source.command,
            "revision": self.source.revision,
            "policies": list(self.source.policies),
            "tables": list(self.source.tables),
        }


@cache
def shipped() -> dict[str, Source]:
    """Return what comes with the package."""
    return read_advice(SHIPPED)


def advise(low: float, high: float, sources: Mapping[str, Source] | None = None, robot: str | None = None) -> Advice:
    """Return which training to choose for friction from `low` to `high`, shares of the torque limit [-].

    The trainings are compared at the tested levels from the last that is not above `low` to the first that is not below
    `high`, or to the highest, in the simulator of the training: first by whether every seed, of three or more, follows
    every command at all of them, then by the share of pairs of seed and command that are followed, then by the least
    mean miss. `TOLD` is compared and never chosen.

    sources: as of `read_advice`; by default what comes with the package; robot: whose joint it is, by its name.
    """
    source = (shipped() if sources is None else sources)[TRAINING]
    low, high = round(low, 9), round(high, 9)
    own = _trained_in(source)
    tested = sorted({cell.friction_level for cell in own})
    first = max((level for level in tested if level <= low), default=tested[0])
    last = min((level for level in tested if level >= high), default=tested[-1])
    levels = tuple(level for level in tested if first <= level <= last)
    cells = {
        name: chosen
        for name in source.methods
        if (chosen := tuple(cell for cell in own if cell.method == name and cell.friction_level in levels))
    }
    best = max((name for name in cells if name != TOLD), key=lambda name: _rank(cells[name], levels))
    others: dict[str, list[CommandCount]] = {}
    for cell in source.cells:
        if cell.method == best and cell.engine != TRAINED_IN and cell.friction_law in SHARES:
            others.setdefault(cell.engine, []).append(cell)
    # Rounded, or the last bits of a difference would decide between two that are as near: the lower does.
    nearest = (
        min(o, key=lambda c: (round(abs(c.friction_level - high), 9), c.friction_level)) for o in others.values()
    )
    return Advice(best, high, levels, cells, tuple(nearest), source, robot)


def _trained_in(source: Source) -> list[CommandCount]:
    """Return the counts of the simulator of the training, under the law of the training."""
    return [one for one in source.cells if one.engine == TRAINED_IN and one.friction_law == TRAINED_UNDER]


def _rank(cells: Sequence[CommandCount], levels: Sequence[float]) -> tuple[bool, float, float]:
    """Return how well a training does: covered, share of cells that are followed, least miss; the more the better."""
    total = sum(cell.cells for cell in cells)
    share = sum(cell.followed for cell in cells) / total
    return _all_covered(cells, levels), share, -sum(cell.miss * cell.cells for cell in cells) / total


def _all_covered(cells: Sequence[CommandCount], levels: Sequence[float]) -> bool:
    """Return whether a training follows with every seed, of three or more, at every one of the levels."""
    return len(cells) == len(levels) and all(cell.covered for cell in cells)


def _percent(level: float) -> str:
    """Return a level of Coulomb friction as people read it."""
    return level_text(TRAINED_UNDER, round(level, 4))


def _together(words: Sequence[str]) -> str:
    """Return `a, b and c`; nothing of nothing."""
    return "".join(words) if len(words) < 2 else f"{', '.join(words[:-1])} and {words[-1]}"


def _by_level(cells: Sequence[CommandCount]) -> str:
    """Return the seeds that follow every command: `5 of 5 seeds at 10 % and 4 of 5 at 20 %`."""
    texts = [f"{cell.follow_all} of {cell.seeds} at {_percent(cell.friction_level)}" for cell in cells]
    return _together([texts[0].replace(" at ", " seeds at " if cells[0].seeds > 1 else " seed at "), *texts[1:]])
