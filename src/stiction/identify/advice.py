"""Which training to choose for a joint's friction: the one that follows with the most seeds where it was tested.

It rests on `advice.json` beside this module, which the studies write from their rows; see `stiction.formats.advice`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stiction.formats.advice import TRAINING, TRANSFER, Source, TrainedWith, read_advice
from stiction.formats.following import BAND, Following, counts_text
from stiction.joints.friction import level_text

SHIPPED = Path(__file__).parent / "advice.json"
"""The file that comes with the package."""

TRAINED_IN = "mujoco"
"""Engine of the training: the others are elsewhere."""


@dataclass(frozen=True)
class Advice:
    """What to train with, and what that rests on."""

    method: str
    """The training whose policies follow with the most seeds."""
    asked: float
    """Highest friction that was asked for [-]."""
    levels: tuple[float, ...]
    """Tested friction at which the trainings were compared [-]."""
    cells: Mapping[str, tuple[Following, ...]]
    """Training -> how many seeds follow at these levels, in the simulator of the training."""
    elsewhere: tuple[Following, ...]
    """How many seeds of the chosen training follow in other engines and on virtual robots, at the tested level nearest
    to the highest asked for."""
    source: Source
    """The study."""

    @property
    def borne(self) -> bool:
        """Whether every seed that was trained without friction follows up to the next tested level above `asked`."""
        own = {cell.friction_level: cell.every_seed for cell in self.source.cells if cell.method == "none"}
        above = [level for level in own if level >= self.asked]
        return bool(above) and all(follow for level, follow in own.items() if level <= min(above))

    @property
    def training(self) -> TrainedWith:
        """How the policies of the method were trained."""
        return self.source.methods[self.method]

    @property
    def settings(self) -> dict[str, Any]:
        """Fields of `FrictionCfg` that train so."""
        return {"method": self.training.method, "level": self.training.level, "law": "coulomb", "per": "robot"}

    @property
    def range(self) -> list[float]:
        """Friction that training then draws, least and most, over the torque limit [-]."""
        return [self.training.low * self.training.level, self.training.high * self.training.level]

    @property
    def text(self) -> str:
        """What to train with, how many seeds stand behind it, which side fails, and what was not tried."""
        training, beyond = self.training, max(cell.friction_level for cell in self.source.cells)
        flags = f"--method {training.method}"
        flags += f" --friction-level {training.level:g}" if training.level > 0 else ""
        if any(cell.follow for cell in self.cells[self.method]):
            reason = f"{self.method} follows with the most seeds"
        else:
            reason = (
                f"no training method follows with any seed there, and {self.method} deviates least from the command"
            )
        compared = "; ".join(f"{name} {_by_level(cells)}" for name, cells in self.cells.items())
        parts = [
            f"For up to {_percent(round(self.asked, 4))}, {reason}: train with {flags}.",
            f"Seeds that follow, {BAND} of the command both ways, {_levels_text(self.levels)}, in the simulator of the "
            f"training: {compared}.",
        ]
        if training.level > 0 and training.level != self.asked:
            parts.append(
                f"Those policies were trained at level {training.level:g}; training at {self.asked:.2g} itself has not "
                "been tried."
            )
        if self.asked > beyond:
            parts.append(f"Nothing was tested beyond {_percent(beyond)}.")
        if self.elsewhere:
            seeds = max(cell.seeds for cell in self.elsewhere)
            parts.append(
                f"In other engines and on virtual robots at {_percent(self.elsewhere[0].friction_level)}, pairs of a "
                f"seed and a place: {_bracketed(counts_text(self.elsewhere))}, of "
                f"{'one seed' if seeds == 1 else f'{seeds} seeds'}."
            )
        return " ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `training.json`: the counts, and the command and revision that they came from."""
        return {
            "levels": list(self.levels),
            "seeds_that_follow": {
                name: {_percent(cell.friction_level): cell.text for cell in own} for name, own in self.cells.items()
            },
            "elsewhere": {cell.engine: cell.text for cell in self.elsewhere},
            "command": self.source.command,
            "revision": self.source.revision,
            "policies": list(self.source.policies),
        }


@cache
def shipped() -> dict[str, Source]:
    """Return what comes with the package."""
    return read_advice(SHIPPED)


def advise(low: float, high: float, sources: Mapping[str, Source] | None = None) -> Advice:
    """Return which training to choose for friction from `low` to `high`, shares of the torque limit [-].

    The trainings are compared at the tested levels from the one nearest to `low` to the one nearest to `high`: by the
    number of seeds that follow, added up over the levels; between equals by the least deviation from the command.

    sources: as of `read_advice`; by default what comes with the package.
    """
    sources = shipped() if sources is None else sources
    source = sources[TRAINING]
    tested = {cell.friction_level for cell in source.cells}
    first, last = (_nearest(tested, end) for end in (low, high))
    levels = tuple(level for level in sorted(tested) if first <= level <= last)
    cells = {
        name: tuple(cell for cell in source.cells if cell.method == name and cell.friction_level in levels)
        for name in source.methods
    }
    best = max(cells, key=lambda name: (sum(c.follow for c in cells[name]), -sum(c.deviation for c in cells[name])))
    others = [cell for cell in sources[TRANSFER].cells if cell.method == best and cell.engine != TRAINED_IN]
    top = _nearest({cell.friction_level for cell in others}, high) if others else high
    return Advice(best, high, levels, cells, tuple(cell for cell in others if cell.friction_level == top), source)


def _nearest(tested: Set[float], level: float) -> float:
    """Return the tested level nearest to one; of two as near the lower."""
    # Rounded, or the last bits of a difference would decide between two that are as near.
    return min(tested, key=lambda one: (round(abs(one - level), 9), one))


def _percent(level: float) -> str:
    """Return a level of Coulomb friction as people read it."""
    return level_text("coulomb", level)


def _levels_text(levels: Sequence[float]) -> str:
    """Return the tested levels in words."""
    if len(levels) == 1:
        return f"at the nearest level that was tested, {_percent(levels[0])}"
    return f"at the levels that were tested from {_percent(levels[0])} to {_percent(levels[-1])}"


def _by_level(cells: Sequence[Following]) -> str:
    """Return the counts of a training, with their level where there are several."""
    if len(cells) == 1:
        return _bracketed(cells[0].text)
    return ", ".join(f"{_bracketed(cell.text)} at {_percent(cell.friction_level)}" for cell in cells)


def _bracketed(text: str) -> str:
    """Return `4 of 5, 1 too slow` as `4 of 5 (1 too slow)`."""
    count, _, wrong = text.partition(", ")
    return f"{count} ({wrong})" if wrong else count
