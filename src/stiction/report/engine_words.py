"""What the numbers of the study of engines say, in sentences: computed from the rows, and no more than they hold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean

from stiction.formats.engines import COARSE, FINE_TRAINING, MUJOCO, STIFF, TRAINING, FigureRow, WalkRow

CLOSE = 0.1
"""A speed is reached, and two simulators agree, within this share [-]."""

MOST = 0.5
"""Contacts explain a difference where stiffer ones leave at most this share of it."""

Cell = tuple[str, float, str]
"""Policy, friction level, command."""


def judge(low: float | None, high: float | None) -> str:
    """Return whether an interval of a ratio is within 1 ± `CLOSE`: `within`, `outside`, or `not decided`."""
    if low is None or high is None:
        return "not decided"
    if low >= 1 - CLOSE and high <= 1 + CLOSE:
        return "within"
    return "outside" if high < 1 - CLOSE or low > 1 + CLOSE else "not decided"


def conformance_words(rows: Sequence[FigureRow]) -> list[str]:
    """Return a sentence for each timestep: which engines pass all figures, and what the others fail."""
    sentences = []
    for timestep in dict.fromkeys(row.timestep for row in rows):
        mine = [row for row in rows if row.timestep == timestep]
        engines = list(dict.fromkeys(row.engine for row in mine))
        failed = {name: [row for row in mine if row.engine == name and not row.passed] for name in engines}
        passing = [name for name in engines if not failed[name]]
        figures = len({(row.check, row.figure) for row in mine})
        words = [f"{', '.join(passing)} pass{'es' if len(passing) == 1 else ''} all figures"] if passing else []
        words += [
            f"{name} fails {len(lost)} of {sum(row.engine == name for row in mine)} ("
            + "; ".join(f"{row.check}: {row.figure}" for row in lost)
            + ")"
            for name, lost in failed.items()
            if lost
        ]
        sentences.append(f"At steps of {1000 * timestep:g} ms, of {figures} figures: {'; '.join(words)}.")
    return sentences


def walk_words(rows: Sequence[WalkRow]) -> list[str]:
    """Return what the walks say: speeds without friction, what contacts make of it, agreement with the training."""
    if not rows:
        return []
    return [*_reached(rows), *_contacts(rows), *_step(rows), *_agreement(rows), *_falls(rows)]


def _cell(row: WalkRow) -> Cell:
    """Return what a row has in common with those of other simulators."""
    return row.policy, row.friction_level, row.command


def _names(rows: Iterable[WalkRow]) -> list[str]:
    """Return the simulators, in the order of the rows."""
    return list(dict.fromkeys(row.simulator for row in rows))


def _reached(rows: Sequence[WalkRow]) -> list[str]:
    """Return in how many walks without friction each simulator reaches the commanded speed."""
    free = [row for row in rows if row.friction_level == 0]
    if not free:
        return []
    counts = []
    for name in _names(free):
        mine = [row for row in free if row.simulator == name]
        judged = [judge(row.speed_low, row.speed_high) for row in mine]
        open_ones = f" ({judged.count('not decided')} not decided)" if "not decided" in judged else ""
        counts.append(f"{name} {judged.count('within')} of {len(mine)}{open_ones}")
    here = [row for row in free if row.simulator not in (TRAINING, FINE_TRAINING)]
    missed = [row for row in here if judge(row.speed_low, row.speed_high) == "outside"]
    near = [row for row in missed if judge(row.to_training_low, row.to_training_high) == "within"]
    own = [row.speed_ratio for row in free if row.simulator == TRAINING]
    sentences = [
        f"Without friction the commanded speed is reached within ±{CLOSE:.0%} in: {', '.join(counts)} pairs of policy "
        f"and command. In training's own simulator the policies reach {min(own):.2f} to {max(own):.2f} of it."
    ]
    if missed:
        sentences.append(
            f"Of the {len(missed)} walks in the engines that miss it, {len(near)} {'is' if len(near) == 1 else 'are'} "
            f"within ±{CLOSE:.0%} of what the same policy reaches in training's simulator."
        )
    return sentences


def _agreement(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far each engine is from the training's simulator, level by level."""
    sentences = []
    for level in dict.fromkeys(row.friction_level for row in rows):
        parts = []
        for name in _names(rows):
            ratios = [
                row.to_training
                for row in rows
                if (row.simulator, row.friction_level) == (name, level) and row.to_training is not None
            ]
            if ratios:
                parts.append(f"{name} {min(ratios):.2f} to {max(ratios):.2f}")
        if parts:
            sentences.append(f"Speed over that in training's simulator at {level:.0%} friction: {', '.join(parts)}.")
    return sentences


def distance(rows: Sequence[WalkRow], one: str, other: str) -> float | None:
    """Return the mean difference of two simulators' speed ratios over all walks that both have [-]; None: no walk."""
    first, second = ({_cell(row): row.speed_ratio for row in rows if row.simulator == name} for name in (one, other))
    both = [abs(first[cell] - second[cell]) for cell in first if cell in second]
    return fmean(both) if both else None


def _contacts(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far the other engines are from MuJoCo with training's contacts, and with stiffer ones."""
    sentences = []
    for name in _names(rows):
        soft, stiff = distance(rows, name, MUJOCO), distance(rows, name, STIFF)
        if name in (TRAINING, FINE_TRAINING, MUJOCO, COARSE, STIFF) or soft is None or stiff is None:
            continue
        if soft == 0:
            sentences.append(f"{name} does not differ from {MUJOCO}.")
            continue
        verdict = (
            f"stiffer contacts take away {1 - stiff / soft:.0%} of the difference"
            if stiff <= MOST * soft
            else f"stiffer contacts do not explain most of the difference: {stiff / soft:.0%} of it is left"
        )
        sentences.append(
            f"{name} differs from {MUJOCO} by {soft:.3f} of the commanded speed in the mean over all walks, from "
            f"{STIFF} by {stiff:.3f}: {verdict}."
        )
    return sentences


def _step(rows: Sequence[WalkRow]) -> list[str]:
    """Return how far the training's simulator is from the same engine with one robot, at its own and a finer step."""
    own, fine, finer = (
        distance(rows, *pair) for pair in ((TRAINING, COARSE), (TRAINING, MUJOCO), (FINE_TRAINING, MUJOCO))
    )
    if own is None or fine is None or finer is None:
        return []
    return [
        "Training's simulator differs from the same engine with one robot, whose controllers are outside of it, by "
        f"{own:.3f} at the same step, and from that at 2 ms by {fine:.3f}; at steps of 1 ms of its own, by {finer:.3f}."
    ]


def _falls(rows: Sequence[WalkRow]) -> list[str]:
    """Return how many robots fell."""
    fell, all_of_them = sum(row.falls for row in rows), sum(row.episodes for row in rows)
    return [f"{fell} of {all_of_them} robots fell."]
