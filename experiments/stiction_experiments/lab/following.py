"""Tables and sentences on the training methods that follow: for a joint of some friction, and place by place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from stiction.files.following import STALLS
from stiction.files.results import ResultRow
from stiction.joints.friction import level_text
from stiction.report.following import friction_text
from stiction.report.page import Sheet
from stiction_experiments.lab.straight import DEFINITION, SLOW, Following, counts_text, stalled


def by_level(cells: Sequence[Following]) -> dict[float, dict[str, list[Following]]]:
    """Return level -> method -> its cells, levels from low to high, methods in the order of the rows."""
    methods = dict.fromkeys(cell.method for cell in cells)
    at: dict[float, dict[str, list[Following]]] = {
        level: {method: [] for method in methods} for level in sorted({cell.friction_level for cell in cells})
    }
    for cell in cells:
        at[cell.friction_level][cell.method].append(cell)
    return at


def everywhere(methods: Mapping[str, Sequence[Following]]) -> list[str]:
    """Return the methods that follow with every seed in every place where others were tried at that level too."""
    places = {cell.engine for own in methods.values() for cell in own}
    return [
        method
        for method, own in methods.items()
        if own and {cell.engine for cell in own} == places and all(cell.every_seed for cell in own)
    ]


def most(methods: Mapping[str, Sequence[Following]]) -> list[str]:
    """Return the methods of which the largest share of seeds follows, over all places; none where nobody does."""
    shares = {
        method: sum(cell.follow for cell in own) / sum(cell.seeds for cell in own)
        for method, own in methods.items()
        if own
    }
    best = max(shares.values(), default=0.0)
    return [method for method, share in shares.items() if share == best > 0.0]


def has_one_seed(cells: Iterable[Following]) -> bool:
    """Return whether there is one training seed: it is not every seed, and pages say `its one seed`."""
    return max((cell.seeds for cell in cells), default=0) == 1


def _named(method: str, cells: Sequence[Following]) -> str:
    """Return a method, and that it has one seed where it does."""
    return f"{method} (one seed)" if has_one_seed(cells) else method


def recommended_sheet(cells: Sequence[Following]) -> Sheet:
    """Return, for every level that was tested, who follows everywhere, and how many seeds of each.

    cells: shares of the torque limit, in places where a user's robot may be.
    """
    levels = by_level(cells)
    own: dict[str, list[Following]] = {}
    for cell in cells:
        own.setdefault(cell.method, []).append(cell)
    rows = []
    for level, methods in levels.items():
        sure = ", ".join(_named(method, own[method]) for method in everywhere(methods))
        counts = (counts_text(methods[method]) if methods[method] else "not tested" for method in own)
        rows.append((friction_text("coulomb", level), sure or "nobody", *counts))
    everyone = "its one seed, everywhere" if has_one_seed(cells) else "every seed, everywhere"
    header = ("friction", everyone, *(_named(method, by_friction) for method, by_friction in own.items()))
    note = (
        f"{DEFINITION} Levels are those that were tested. Columns of methods count pairs of a seed and a place: the "
        "engines, and the virtual robots, on each of which a seed has to follow. One seed is no evidence."
    )
    return Sheet("My joint has this much friction: which training follows?", header, tuple(rows), note)


def places_sheet(cells: Sequence[Following]) -> Sheet:
    """Return how many seeds of each method follow, place by place."""
    methods = list(dict.fromkeys(cell.method for cell in cells))
    at: dict[tuple[float, str], dict[str, Following]] = {}
    for cell in sorted(cells, key=lambda one: one.friction_level):
        at.setdefault((cell.friction_level, cell.engine), {})[cell.method] = cell
    rows = []
    for (level, engine), own in at.items():
        texts = (own[method].text if method in own else "–" for method in methods)
        rows.append((friction_text("coulomb", level), engine, *texts))
    return Sheet("Who follows, place by place", ("friction", "place", *methods), tuple(rows), DEFINITION)


MOST_STALLED = 12
"""Walks that one line names."""


def stalled_text(rows: Iterable[ResultRow], name_of: Callable[[ResultRow], str]) -> str:
    """Say in one line where a seed follows while one of its walks stalls, see `stalled`; empty where none is known.

    name_of: row -> its training method.
    """
    walks = stalled(rows)
    texts = [
        f"{name_of(row)}, slowest walk of seed {row.seed} at {level_text(row.friction_law, row.friction_level)}: "
        f"{row.slowest_walk:.2f}"
        for row in walks[:MOST_STALLED]
    ]
    more = [f"{len(walks) - MOST_STALLED} more in results.csv"] if len(walks) > MOST_STALLED else []
    return (
        f"Seeds that follow in the mean, a walk of theirs under {STALLS}: {'; '.join(texts + more)}." if texts else ""
    )


def recommended_sentence(cells: Sequence[Following], level: float) -> str:
    """Say who follows at a level: with every seed everywhere, and who does with most seeds. Empty if not tested."""
    methods = by_level(cells).get(level)
    if methods is None:
        return ""
    names = everywhere(methods)
    alone = [method for method in names if has_one_seed(methods[method])]
    phrases = [_everywhere_text([method for method in names if method not in alone], "every seed")]
    phrases.append(_everywhere_text(alone, "their one seed" if len(alone) > 1 else "its one seed"))
    if not names:
        own = [cell for some in methods.values() for cell in some]
        phrases = [_everywhere_text(["no training"], "its one seed" if has_one_seed(own) else "every seed")]
    best = ", ".join(f"{_named(method, methods[method])}, {counts_text(methods[method])}" for method in most(methods))
    seeds = f"; the largest share of seeds over all places: {best}" if best else ""
    sure = ", and ".join(filter(None, phrases))
    return f"With {friction_text('coulomb', level)} friction, {sure}{seeds}."


def _everywhere_text(methods: Sequence[str], seeds: str) -> str:
    """Say that methods follow everywhere with these of their seeds; empty of none."""
    if len(methods) < 2:
        return f"{methods[0]} follows everywhere with {seeds}" if methods else ""
    return f"{', '.join(methods)} follow everywhere with {seeds}"


def changes_sheet(summary: Mapping[str, Any], sentences: Mapping[str, str]) -> Sheet | None:
    """Return the sentences of which the same rows are judged otherwise than before; None where there are none.

    sentences: number -> sentence.
    """
    changes: Sequence[Mapping[str, str]] = summary.get("changed", ())
    names = ("before", "asked_before", "now", "asked")
    rows = tuple((f"“{sentences[one['id']]}”", *(one[name] for name in names)) for one in changes)
    header = ("sentence", "before", "what was asked", "now", "what is asked")
    note = (
        f"The rows are the same. Before, following asked for {SLOW} or more, or for the mean over seeds to be within "
        f"the band. {DEFINITION}"
    )
    return Sheet("Verdicts that changed with the definition of following", header, rows, note) if rows else None
