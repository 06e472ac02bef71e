"""Who follows, as tables: for a joint of some friction, place by place, and by engine and friction."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

from stiction.files.results import FOLLOWS, ResultRow
from stiction.files.straight import DEFINITION, NOT_KNOWN, SLOW, STALLS, Following, counts_text, stalled
from stiction.joints.friction import level_text
from stiction.report.page import COLORS, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def shade_following(axis: Axes, along: Literal["x", "y"] = "y") -> None:
    """Shade the speeds over the commanded one that count as following. along: the axis that they are on."""
    span = axis.axhspan if along == "y" else axis.axvspan
    span(*FOLLOWS, color=COLORS[2], alpha=0.12, linewidth=0)


def friction_text(law: str, level: float) -> str:
    """Return friction as people read it: `20 %`, `c = 0.05`, `bench (1.07 %) and 0.1 of the load`."""
    base, _, load = law.partition("+load")
    text = level_text(base, round(level, 4)) if level else "none"
    text = f"bench ({text})" if base.endswith("-bench") else text
    return f"{text} and {load} of the load" if load else text


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
    header = ("friction", everyone, *(_named(method, found) for method, found in own.items()))
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


def counts_sheet(cells: Sequence[Following]) -> Sheet:
    """Return how many seeds of each method follow, a row for each engine and friction."""
    rows = [
        (cell.method, cell.engine, friction_text(cell.friction_law, cell.friction_level), cell.text, cell.each)
        for cell in cells
    ]
    header = (
        "method",
        "engine",
        "friction [of the torque limit]",
        "seeds that follow",
        "speed ratios of each seed [1]",
    )
    note = f"{DEFINITION} Of virtual robots: the slowest..the fastest."
    return Sheet("Seeds that follow", header, tuple(rows), note)


MOST_STALLED = 12
"""Walks that one line names."""


def stalled_text(rows: Iterable[ResultRow], name_of: Callable[[ResultRow], str]) -> str:
    """Say in one line where a seed follows while one of its walks stalls, see `stalled`; empty where none is known.

    name_of: row -> its training method.
    """
    found = stalled(rows)
    said = [
        f"{name_of(row)}, slowest walk of seed {row.seed} at {level_text(row.friction_law, row.friction_level)}: "
        f"{row.slowest_walk:.2f}"
        for row in found[:MOST_STALLED]
    ]
    more = [f"{len(found) - MOST_STALLED} more in results.csv"] if len(found) > MOST_STALLED else []
    return f"Seeds that follow in the mean, a walk of theirs under {STALLS}: {'; '.join(said + more)}." if said else ""


def paces_text(found: Sequence[tuple[str, set[str]]]) -> str:
    """Say where something follows and where it does what else: `follows at 20 %; is too fast at 0 and 10 %`.

    found: a place in words, and all that was seen there, as of `paces`; it follows where nothing else was seen.
    """
    where = {"follows": {at: seen == {"follows"} for at, seen in found}}
    where |= {one: {at: one in seen for at, seen in found} for one in ("too fast", "too slow", "fell", NOT_KNOWN)}
    words = {"follows": "follows", "too fast": "is too fast", "too slow": "is too slow", "fell": "falls"}
    words[NOT_KNOWN] = "is not known to follow, not having walked both ways,"
    said = [f"{words[one]} {places_text(places)}" for one, places in where.items() if any(places.values())]
    known = any(where["follows"].values()) or any(where[NOT_KNOWN].values())
    return "; ".join(said if known else ["follows nowhere", *said])


def places_text(tried: Mapping[str, bool]) -> str:
    """Say at which places something was seen: `from 0 to 20 % and at 30 %`; at none: `nowhere`.

    tried: place in words -> whether it was seen there; three or more that were tried one after the other are a span.
    """
    runs = [[at for at, _ in run] for seen, run in groupby(tried.items(), key=itemgetter(1)) if seen]
    spans = [f"from {_without_unit(run[0], run[-1])} to {run[-1]}" for run in runs if len(run) > 2]
    single = [place for run in runs if len(run) < 3 for place in run]
    if single:
        *first, last = single
        listed = ", ".join(_without_unit(place, last) for place in first)
        spans.append(f"at {listed} and {last}" if first else f"at {last}")
    return " and ".join(spans) or "nowhere"


def _without_unit(place: str, other: str) -> str:
    """Return `10 %` as `10` beside another place in per cent."""
    return place.removesuffix(" %") if other.endswith(" %") else place


def recommended_sentence(cells: Sequence[Following], level: float) -> str:
    """Say who follows at a level: with every seed everywhere, and who does with most seeds. Empty if not tested."""
    methods = by_level(cells).get(level)
    if methods is None:
        return ""
    found = everywhere(methods)
    alone = [method for method in found if has_one_seed(methods[method])]
    said = [_everywhere_text([method for method in found if method not in alone], "every seed")]
    said.append(_everywhere_text(alone, "their one seed" if len(alone) > 1 else "its one seed"))
    if not found:
        own = [cell for some in methods.values() for cell in some]
        said = [_everywhere_text(["no training"], "its one seed" if has_one_seed(own) else "every seed")]
    best = ", ".join(f"{_named(method, methods[method])}, {counts_text(methods[method])}" for method in most(methods))
    seeds = f"; the largest share of seeds over all places: {best}" if best else ""
    sure = ", and ".join(filter(None, said))
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


def judged_text(summary: Mapping[str, Any]) -> str:
    """Say by which command rows of before were judged; empty where the command that made them did."""
    judged = summary.get("judged")
    if judged is None:
        return ""
    return f"Judged and drawn anew, from the same rows, by {judged['command']}, revision {judged['revision']}."
