"""Which training to choose for a joint's friction: the one that follows with the most seeds where it was tested.

It rests on `advice.json` beside this module, which the studies write from their rows; see `stiction.files.advice`.
A training covers a friction at which every seed of it follows, of three or more, and nothing else: neither what lies
between two such levels, nor what is beyond the last that anybody walked with, nor another robot, ground or law.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction.files.advice import TRAINING, Source, TrainedWith, read_advice, robot_title
from stiction.files.straight import BAND, FEWEST_SEEDS, Following
from stiction.joints.friction import level_text

SHIPPED = Path(__file__).parent / "advice.json"
"""The file that comes with the package."""

TRAINED_IN = "mujoco"
"""Engine of the training: the others are elsewhere."""

PLACES = {TRAINED_IN: "in the simulator of the training", "physx": "in PhysX", "ode-webots": "in ODE"}
"""Engine -> how people call it; a plus in its name means a virtual robot."""

SEVERAL_PLACES = "in other engines and on virtual robots"
"""All of them but the first, in words."""

GROUND_AND_LAW = "on flat ground, under Coulomb friction"
"""What every count is of: see `Following`, and `TRAINED_UNDER`."""

STRAIGHT = "straight at 0.5 m/s, forward and backward"
"""The two commands of every count."""

TRAINED_UNDER = "coulomb"
"""Friction law of the trainings that are compared."""


def place_text(engine: str) -> str:
    """Return where something was seen, in words."""
    kind, _, robot = engine.partition(" ")
    if "+" in kind:
        return f"on virtual robot {robot}" if robot else "on virtual robots"
    return PLACES.get(engine, f"in {engine}")


@dataclass(frozen=True)
class Advice:
    """What to train with, and what that rests on."""

    method: str
    """The training whose policies follow with the most seeds."""
    asked: float
    """Highest friction that was asked for [-]."""
    levels: tuple[float, ...]
    """Tested friction at which the trainings were compared, the nearest below and above what was asked included [-]."""
    cells: Mapping[str, tuple[Following, ...]]
    """Training -> how many seeds follow at these levels, in the simulator of the training."""
    elsewhere: tuple[Following, ...]
    """How many of the same policies follow in other engines and on virtual robots, in each at the tested level nearest
    to the highest asked for; nothing where they have not walked there."""
    source: Source
    """The study."""
    robot: str | None = None
    """Whose joint it is; None where nobody said."""

    @property
    def borne_at(self) -> float | None:
        """Level up to which every seed that was trained without friction follows, the next tested one from `asked` on.

        None where one does not, where there are too few seeds to say so, or nothing was tested that high.
        """
        own = {cell.friction_level: cell.covered for cell in _trained_in(self.source) if cell.method == "none"}
        above = [level for level in own if level >= self.asked]
        return min(above) if above and all(own[level] for level in own if level <= min(above)) else None

    @property
    def covered(self) -> bool:
        """Whether every seed, of three or more, follows at the friction that was asked for and all others compared."""
        return self.asked in self.levels and _all_covered(self.cells[self.method], self.levels)

    @property
    def training(self) -> TrainedWith:
        """How the policies of the method were trained."""
        return self.source.methods[self.method]

    @property
    def budget(self) -> str:
        """The preset with which those were trained that it rests on, as words of `stiction train`; empty without."""
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
        """Whether the training covers what was asked, on what robot, ground and law that rests, or what is unknown."""
        where = f"That is of {self.source.robot_text} walking {STRAIGHT}, in simulation, {GROUND_AND_LAW}"
        return f"{self._covers}. {where}{self._other_robot}."

    @property
    def _covers(self) -> str:
        """Whether every seed, of three or more, follows with what was asked, or what is not known of it."""
        own, asked = self.cells[self.method], _percent(self.asked)
        at = _together([_percent(cell.friction_level) for cell in own if cell.covered])
        if self.covered:
            return f"It covers {asked}: each of {min(cell.seeds for cell in own)} seeds follows at {at}"
        beyond = max(cell.friction_level for cell in _trained_in(self.source))
        beside = [cell.covered for cell in own if cell.friction_level == self.asked] or [
            cell.covered for cell in (own[-2:] if self.asked <= beyond else own[-1:])
        ]
        parts = [f"at {_percent(one.friction_level)} {_bracketed(one.text)} follow" for one in own if not one.covered]
        if any(cell.every_seed and not cell.covered for cell in own):
            parts.append(f"fewer than {FEWEST_SEEDS} seeds do not tell")
        parts += [f"every seed follows at {at}"] if at else []
        if self.asked > beyond:
            parts.append(f"beyond {_percent(beyond)} nothing was walked")
        elif self.asked not in self.levels:
            parts.append(
                f"between {_together([_percent(cell.friction_level) for cell in own[-2:]])} nothing was walked"
            )
        if self.asked in self.levels and any(beside):
            begin = f"It covers {asked}, and not all below it"
        else:
            known = not any(beside) and not any(cell.every_seed for cell in own[-len(beside) :])
            begin = f"It does not cover {asked}" if known else f"Whether it covers {asked} is not known"
        return f"{begin}: {'; '.join(parts)}"

    @property
    def _other_robot(self) -> str:
        """What is known of the robot whose joint it is, where it may be another one."""
        if self.robot == self.source.robot:
            return ""
        return f"; of {'any other robot' if self.robot is None else robot_title(self.robot)} nothing is known directly"

    @property
    def _as_good(self) -> list[str]:
        """Other trainings that follow with as many seeds, of any; what the method is chosen by is its deviation."""
        most = _rank(self.cells[self.method], self.levels)[:2]
        equal = [name for name, cells in self.cells.items() if _rank(cells, self.levels)[:2] == most]
        return [name for name in equal if name != self.method] if most[1] > 0 else []

    @property
    def text(self) -> str:
        """What to train with, whether that covers the friction, how many seeds stand behind it, which side fails, and
        what was not tried.
        """
        training, equal = self.training, self._as_good
        if equal:
            reason = (
                f"{_together([self.method, *equal])} follow with the most seeds, and {self.method} deviates least from "
                "the command"
            )
        elif any(cell.follow for cell in self.cells[self.method]):
            reason = f"{self.method} follows with the most seeds"
        else:
            reason = (
                f"no training method follows with any seed there, and {self.method} deviates least from the command"
            )
        compared = "; ".join(f"{name} {_by_level(cells)}" for name, cells in self.cells.items())
        words = " ".join(filter(None, (self.budget, self.flags)))
        parts = [
            f"For up to {_percent(self.asked)}, {reason}: train with {words}. {self.coverage}",
            f"Seeds that follow, {BAND} of the command both ways, {_levels_text(self.levels)}, {PLACES[TRAINED_IN]}: "
            f"{compared}.",
        ]
        if training.level > 0 and training.level != self.asked:
            parts.append(
                f"Those policies were trained at level {training.level:g}; training at {self.asked:.2g} itself has not "
                "been tried."
            )
        return " ".join((*parts, self._transfer, *self._all_commands))

    @property
    def _all_commands(self) -> list[str]:
        """Counts over turns, sideways, slow and fast commands too, in each place at the tested level nearest to the
        highest asked for; nothing where only straight walks were walked.
        """
        counts = [count for count in self.source.commands if count.method == self.method]
        levels = {count.friction_level for count in counts}
        nearest = min(levels, key=lambda level: (round(abs(level - self.asked), 9), level), default=None)
        parts = [
            f"{place_text(count.engine)}, {count.follow_all} of {count.seeds} seeds follow all, {count.followed} of "
            f"{count.cells} pairs of seed and command follow" + (f" (worst: {count.worst})" if count.worst else "")
            for count in counts
            if count.friction_level == nearest
        ]
        if nearest is None:
            return []
        where = f"At {_percent(nearest)}, of all commands (turns, sideways, slow and fast walks, standing)"
        return [f"{where}: {'; '.join(parts)}."]

    @property
    def _transfer(self) -> str:
        """Who of the same policies follows elsewhere, place by place."""
        if not self.elsewhere:
            return f"{SEVERAL_PLACES.capitalize()} these policies have not walked: how they do there is not known."
        found = (
            f"{place_text(cell.engine)} {_bracketed(cell.text)} at {_percent(cell.friction_level)}"
            for cell in self.elsewhere
        )
        nearest = any(cell.friction_level != self.asked for cell in self.elsewhere)
        note = ", the nearest level that they walked with there" if nearest else ""
        missing = (
            "" if any("+" in cell.engine for cell in self.elsewhere) else "; on virtual robots they have not walked"
        )
        return f"The same policies elsewhere{note}: {'; '.join(found)}{missing}."

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `training.json`: the counts, and the command and revision that they came from."""
        return {
            "levels": list(self.levels),
            "seeds_that_follow": {
                name: {_percent(cell.friction_level): cell.text for cell in own} for name, own in self.cells.items()
            },
            "covered": self.covered,
            "elsewhere": {cell.engine: {_percent(cell.friction_level): cell.text} for cell in self.elsewhere},
            "robot": self.source.robot,
            "commands": STRAIGHT,
            "all_commands": [asdict(count) for count in self.source.commands if count.method == self.method],
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
    `high`, or to the highest: first whether every seed, of three or more, follows at all of them, then by the number of
    seeds that follow, added up over the levels; between equals by the least deviation from the command.

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
        name: found
        for name in source.methods
        if (found := tuple(cell for cell in own if cell.method == name and cell.friction_level in levels))
    }
    best = max(cells, key=lambda name: _rank(cells[name], levels))
    others: dict[str, list[Following]] = {}
    for cell in source.cells:
        if cell.method == best and cell.engine != TRAINED_IN:
            others.setdefault(cell.engine, []).append(cell)
    # Rounded, or the last bits of a difference would decide between two that are as near: the lower does.
    nearest = (
        min(o, key=lambda c: (round(abs(c.friction_level - high), 9), c.friction_level)) for o in others.values()
    )
    return Advice(best, high, levels, cells, tuple(nearest), source, robot)


def _trained_in(source: Source) -> list[Following]:
    """Return the counts of the simulator of the training, under the law of the training."""
    return [one for one in source.cells if one.engine == TRAINED_IN and one.friction_law == TRAINED_UNDER]


def _rank(cells: Sequence[Following], levels: Sequence[float]) -> tuple[bool, int, float]:
    """Return how well a training does: covered, seeds that follow, and least deviation; the more the better."""
    return _all_covered(cells, levels), sum(c.follow for c in cells), -sum(c.deviation for c in cells)


def _all_covered(cells: Sequence[Following], levels: Sequence[float]) -> bool:
    """Return whether a training follows with every seed, of three or more, at every one of the levels."""
    return len(cells) == len(levels) and all(cell.covered for cell in cells)


def _percent(level: float) -> str:
    """Return a level of Coulomb friction as people read it."""
    return level_text(TRAINED_UNDER, round(level, 4))


def _levels_text(levels: Sequence[float]) -> str:
    """Return the tested levels in words."""
    if len(levels) == 1:
        return f"at the nearest level that was tested, {_percent(levels[0])}"
    return f"at the levels that were tested from {_percent(levels[0])} to {_percent(levels[-1])}"


def _together(words: Sequence[str]) -> str:
    """Return `a, b and c`; nothing of nothing."""
    return "".join(words) if len(words) < 2 else f"{', '.join(words[:-1])} and {words[-1]}"


def _by_level(cells: Sequence[Following]) -> str:
    """Return the counts of a training, with their level where there are several."""
    if len(cells) == 1:
        return _bracketed(cells[0].text)
    return ", ".join(f"{_bracketed(cell.text)} at {_percent(cell.friction_level)}" for cell in cells)


def _bracketed(text: str) -> str:
    """Return `4 of 5, 1 too slow` as `4 of 5 (1 too slow)`."""
    count, _, wrong = text.partition(", ")
    return f"{count} ({wrong})" if wrong else count
