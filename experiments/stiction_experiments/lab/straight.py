"""Straight at 0.5 m/s: 80 to 120 % of the commanded speed, forward and backward, by every training seed, and no fall.

The definition of results from before `files.following`, which know no other command. A speed ratio alone is too slow,
follows, or is too fast; a policy, which is one training seed, follows where it does so in both directions and never
falls, on virtual robots on each of them. Of a training method the seeds that follow are counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from stiction.files.results import DIRECTIONS, FOLLOWS, ResultRow

Pace = Literal["too slow", "follows", "too fast"]

SLOW, FAST = (f"{100 * end:g} %" for end in FOLLOWS)
"""Too slow is under the one, too fast over the other: the ends of the band, as people read them."""

BAND = f"{100 * FOLLOWS[0]:g} to {FAST}"
"""The band as people read it."""

DEFINITION = (
    f"Following is {BAND} of the commanded speed, forward and backward, by every training seed, on each virtual robot, "
    f"and nobody falls. Too slow: under {SLOW} in the slower direction; too fast: over {FAST} in the faster one; a "
    "seed can be both."
)


def pace(ratio: float) -> Pace:
    """Return what a speed ratio is [-]; the ends of the band belong to it."""
    return "too slow" if ratio < FOLLOWS[0] else "too fast" if ratio > FOLLOWS[1] else "follows"


def worst(ratios: Iterable[float]) -> float:
    """Return the speed ratio that is the farthest from the middle of the band [-]; at least one is given."""
    return max(ratios, key=lambda ratio: abs(ratio - sum(FOLLOWS) / 2.0))


@dataclass(frozen=True)
class Following:
    """Training seeds of a method that follow at one friction in one engine on flat ground; a row of following.csv.

    A seed counts that walked in both directions; of virtual robots the slowest and the fastest count.
    """

    method: str
    engine: str
    """Engine, and what of a virtual robot is real in it."""
    friction_law: str
    friction_level: float
    """Friction over the torque limit, or a coefficient [-]."""
    seeds: int
    follow: int
    """Number of seeds that follow in both directions, and never fall."""
    too_slow: int
    """Number of seeds that are too slow in at least one direction, on at least one robot."""
    too_fast: int
    """Number of seeds that are too fast in at least one direction, on at least one robot."""
    fell: int
    deviation: float
    """Mean of |speed ratio - 1| over both directions and the seeds [-]; of virtual robots, of the worst."""
    each: str
    """Forward and backward speed ratio of every seed, `1.15/1.05 1.09/1.02`; of virtual robots that of the slowest and
    of the fastest, `0.60..1.40/0.90..1.10`."""

    @property
    def every_seed(self) -> bool:
        """Return whether every training seed follows."""
        return self.follow == self.seeds

    @property
    def text(self) -> str:
        """Seeds that follow, and what is wrong with the others: `4 of 5, 1 too fast`."""
        return counts_text([self])


def counts_text(cells: Sequence[Following]) -> str:
    """Return the text of `Following` over several cells of one training method; a seed counts once in each cell."""
    wrong = {
        "too slow": sum(cell.too_slow for cell in cells),
        "too fast": sum(cell.too_fast for cell in cells),
        "fell": sum(cell.fell for cell in cells),
    }
    follow, seeds = sum(cell.follow for cell in cells), sum(cell.seeds for cell in cells)
    return ", ".join((f"{follow} of {seeds}", *(f"{number} {what}" for what, number in wrong.items() if number)))


def count(cell: tuple[str, str, str, float], seeds: Iterable[Mapping[str, ResultRow]]) -> Following | None:
    """Return which seeds of one cell follow; None where none of them walked in both directions.

    cell: method, engine, law, level; seeds: command -> row, of each.
    """
    walked = [[rows[command] for command in DIRECTIONS] for rows in seeds if all(vx in rows for vx in DIRECTIONS)]
    ratios = [[row.ends or (0.0, 0.0) for row in rows] for rows in walked]
    seen = [{pace(ratio) for ends in both for ratio in ends} for both in ratios]
    fell = [any(row.fall_rate > 0.0 for row in rows) for rows in walked]
    if not walked:
        return None
    return Following(
        *cell,
        seeds=len(walked),
        follow=sum(own == {"follows"} and not down for own, down in zip(seen, fell, strict=True)),
        too_slow=sum("too slow" in own for own in seen),
        too_fast=sum("too fast" in own for own in seen),
        fell=sum(fell),
        deviation=sum(max(abs(ratio - 1.0) for ratio in ends) for both in ratios for ends in both) / (2 * len(ratios)),
        each=" ".join("/".join(map(ends_text, rows)) for rows in walked),
    )


def ends_text(row: ResultRow) -> str:
    """Return the speed ratio of a row; of virtual robots that of the slowest and of the fastest: `0.60..1.40`."""
    low, high = row.ends or (0.0, 0.0)
    return f"{low:.2f}" if row.slowest is None else f"{low:.2f}..{high:.2f}"


def following(rows: Iterable[ResultRow], method_of: Callable[[ResultRow], str]) -> list[Following]:
    """Return which seeds of every training method follow, in every engine and under every friction, in row order.

    method_of: row -> its training method; each of its policies is one training seed.
    """
    cells: dict[tuple[str, str, str, float], dict[str, dict[str, ResultRow]]] = {}
    for row in rows:
        if row.terrain == "flat" and row.command in DIRECTIONS and row.speed_ratio is not None:
            cell = method_of(row), row.engine, row.friction_law, round(row.friction_level, 6)
            cells.setdefault(cell, {}).setdefault(row.policy, {})[row.command] = row
    counts = (count(cell, policies.values()) for cell, policies in cells.items())
    return [one for one in counts if one is not None]
