"""Who follows, in tables and in words: by engine and friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

from stiction.files.results import FOLLOWS
from stiction.files.straight import DEFINITION, NOT_KNOWN, Following
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


def judged_text(summary: Mapping[str, Any]) -> str:
    """Say by which command rows of before were judged; empty where the command that made them did."""
    judged = summary.get("judged")
    if judged is None:
        return ""
    return f"Judged and drawn anew, from the same rows, by {judged['command']}, revision {judged['revision']}."
