"""Rows of results and followed commands, in tables and in words: by engine and friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Literal

from stiction.core.records import header, texts, two_digits
from stiction.files.following import DEFINITION, CommandCount, CommandVerdict, judge_row, worst_command
from stiction.files.onset import LEAST, Prediction
from stiction.files.results import FOLLOWS, ResultRow
from stiction.files.velocity import parse_command
from stiction.joints.friction import level_text
from stiction.report.page import COLORS, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SLOWEST_WALK = "slowest walk"
"""Column of results, where a row has it."""


def onset_lines(onsets: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a line for each policy that never met friction: where it is too slow, predicted and walked.

    onsets: policy -> `predicted` and `walked`, as `evaluation.onset.onset_of` returns them.
    """
    lines = []
    for policy, each in onsets.items():
        line = f"{policy}, predicted by its walks without friction: {Prediction(**each['predicted']).text}."
        if each["walked"]["to"]:
            first, half = (walked_text(each["walked"], name) for name in ("onset", "standstill"))
            line += f" Walked: {half}; some command under {100 * LEAST:g} % of its speed without friction: {first}."
        lines.append(line)
    return lines


def walked_text(walked: Mapping[str, float | None], name: str) -> str:
    """Return a walked level in words: `at 6.4 %`, `not up to 20 %`, or why it is not known.

    name: `onset` or `standstill`.
    """
    level, last = walked[name], walked["to"] or 0.0
    if level is not None:
        return f"at {two_digits(100 * level)} %"
    if walked["free"] is None:
        return "not known, 0 % was not walked"
    return f"not up to {100 * last:.4g} %" if walked["free"] else "it stands without friction"


def pace_text(row: ResultRow) -> str:
    """Return `follows`, or the faults; a dash for rows without a mean velocity, of older files."""
    verdict = judge_row(row)
    return "–" if verdict is None else ", ".join(verdict.faults) or "follows"


def result_cells(row: ResultRow) -> dict[str, str]:
    """Return column -> cell of a row of results, a dash where there is no number."""
    measured = dict(zip(header(row), texts(row), strict=True))
    friction = level_text(row.friction_law, row.friction_level)
    if row.slowest is not None:
        measured["speed ratio"] += f" ({row.slowest:.2f} to {row.fastest:.2f})"
    walk = "–" if row.slowest_walk is None else f"{row.slowest_walk:.2f}"
    return measured | {
        "friction": friction,
        "command": row.command,
        "pace": pace_text(row),
        SLOWEST_WALK: walk,
    }


BAND = f"{100 * FOLLOWS[0]:g} to {100 * FOLLOWS[1]:g} %"
"""Share of the command that counts as reached."""


def shade_following(axis: Axes, along: Literal["x", "y"] = "y") -> None:
    """Shade the speeds over the commanded one that count as following. along: the axis that they are on."""
    span = axis.axhspan if along == "y" else axis.axvspan
    span(*FOLLOWS, color=COLORS[2], alpha=0.18, linewidth=0, label=f"follows: {BAND} of the command")


def friction_text(law: str, level: float) -> str:
    """Return friction as people read it: `20 %`, `c = 0.05`, `bench (1.07 %) and 0.1 of the load`."""
    base, _, load = law.partition("+load")
    text = level_text(base, round(level, 4)) if level else "none"
    text = f"bench ({text})" if base.endswith("-bench") else text
    return f"{text} and {load} of the load" if load else text


def followed_text(rows: Sequence[ResultRow]) -> str:
    """Return which commands one policy follows in one place, and the worst: `follows all 15 commands at 0 and 10 %`."""
    levels: dict[tuple[str, float], list[CommandVerdict]] = {}
    for row in sorted(rows, key=lambda row: (row.friction_law, row.friction_level)):
        if (verdict := judge_row(row)) is not None:
            levels.setdefault((row.friction_law, row.friction_level), []).append(verdict)
    named = {level: friction_text(*level).replace("none", "0 %") for level in levels}
    everywhere = {named[level]: all(one.follows for one in own) for level, own in levels.items()}
    if not levels:
        return "is not judged: rows of older files lack the mean velocity"
    count = max(map(len, levels.values()))
    all_of_them = f"all {count} commands" if count > 1 else "its command"
    clauses = [f"follows {all_of_them} {places_text(everywhere)} of friction"] if any(everywhere.values()) else []
    for level, own in levels.items():
        if (worst := worst_command([one.row for one in own])) is not None:
            followed = sum(one.follows for one in own)
            clauses.append(
                f"{'' if clauses else 'follows '}{followed} of {len(own)} at {named[level]}, the worst is {worst.text}"
            )
    return "; ".join(clauses)


def command_map(rows: Sequence[ResultRow], title: str) -> Sheet:
    """Return a table of commands by friction, of one policy in one place: the reached share of each commanded axis."""
    levels = list(dict.fromkeys((row.friction_law, row.friction_level) for row in rows))
    cells = {(row.command, (row.friction_law, row.friction_level)): _reached(row) for row in rows}
    lines = [
        (command, *(cells.get((command, level), "–") for level in levels))
        for command in dict.fromkeys(row.command for row in rows)
    ]
    return Sheet(title, ("command", *(friction_text(*level) for level in levels)), tuple(lines))


def _reached(row: ResultRow) -> str:
    """Return what a walk reached of its command, and what is wrong with it: `0.75 too slow`."""
    verdict = judge_row(row)
    if verdict is None or row.mean_velocity is None:
        return "–"
    ratios = [f"{ratio:.2f}" for ratio in parse_command(row.command).axis_ratios(row.mean_velocity)]
    return " ".join((" / ".join(ratios) or "stands", *((", ".join(verdict.faults),) if verdict.faults else ())))


def counts_sheet(cells: Sequence[CommandCount]) -> Sheet:
    """Return the seeds of each method that follow every command, a row for each engine and friction."""
    rows = []
    for cell in cells:
        where = cell.method, cell.engine, friction_text(cell.friction_law, cell.friction_level)
        counts = f"{cell.follow_all} of {cell.seeds}", f"{cell.followed} of {cell.cells}"
        rows.append((*where, *counts, f"{cell.largest_miss:.3f}" if cell.worst else "–", cell.worst or "–"))
    header = ("method", "engine", "friction [of the torque limit]", "seeds that follow all", "cells followed")
    return Sheet("Seeds that follow", (*header, "largest miss [m/s, rad/s]", "worst"), tuple(rows), DEFINITION)


def places_text(tried: Mapping[str, bool]) -> str:
    """Return the places of an observation: `from 0 to 20 % and at 30 %`; at none: `nowhere`.

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
