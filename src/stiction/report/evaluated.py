"""Evaluation at a glance: which commands are followed, up to which friction, and the walks that fail first."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from stiction.files.following import CommandVerdict, judge_row, worst_command
from stiction.files.onset import Prediction
from stiction.files.results import ResultRow
from stiction.report.following import friction_text, result_cells, walked_text
from stiction.report.glance import COMMAND, STYLES, Glance, Tone

MOST_ROWS = 8
"""Rows that the terminal shows; the page has them all."""

Level = tuple[str, float]
"""Friction law and level."""


def tone_of(rows: Sequence[ResultRow]) -> Tone:
    """Return the colour of rows: good where all are followed, bad where any falls, warn where any stalls, else note."""
    verdicts = [judge_row(row) for row in rows]
    faults = {fault for verdict in verdicts if verdict is not None for fault in verdict.faults}
    if None in verdicts:
        return "unknown"
    return "bad" if "falls" in faults else "warn" if "stalls" in faults else "note" if faults else "good"


def evaluation_glance(rows: Sequence[ResultRow], summary: Mapping[str, Any], out: Path | None = None) -> Glance:
    """Return results at a glance: of several policies or places the one that follows least. out: of the results."""
    walks: dict[tuple[str, str, str], list[ResultRow]] = {}
    for row in rows:
        walks.setdefault((row.policy, row.engine, row.terrain), []).append(row)
    worst = min(walks, key=lambda place: _share(walks[place]))
    notes = [*_onsets(summary), *summary["warnings"]]
    policy, engine, terrain = worst
    where = "" if engine == "mujoco" else f" in {engine}"
    where += "" if terrain == "flat" else f" on {terrain}"
    least = f", the least of {len(walks)}" if len(walks) > 1 else ""
    count = f" ({len(notes)} note{'s' if len(notes) > 1 else ''})" if notes else ""
    return Glance(
        f"{policy}{where}{least}",
        "Follows",
        _answer(walks[worst]),
        tone_of(walks[worst]),
        _step(walks[worst], summary),
        notes=tuple(notes),
        why="" if out is None else f"every command, and what is not known{count}: {out / 'report.html'}",
    )


def rows_table(rows: Sequence[ResultRow]) -> Table:
    """Tabulate the rows that are not followed, the gravest first; all that are followed are one line."""
    named = {"policy": "policy", "engine": "engine", "terrain": "ground"}
    where = {field: label for field, label in named.items() if len({getattr(row, field) for row in rows}) > 1}
    columns = [*where.values(), "friction", "command", "speed ratio", "pace"]
    table = Table(*columns, box=None, pad_edge=False)
    bad = sorted((row for row in rows if tone_of([row]) != "good"), key=_gravity, reverse=True)
    shown = list(rows) if len(rows) <= MOST_ROWS else bad[:MOST_ROWS]
    for row in shown:
        cells = result_cells(row) | {label: getattr(row, field) for field, label in where.items()}
        table.add_row(*(cells[name] for name in columns[:-1]), Text(cells["pace"], STYLES[tone_of([row])]))
    if len(shown) < len(rows):
        more = [f"{len(bad) - len(shown)} more on the page"] if len(bad) > len(shown) else []
        table.caption, table.caption_justify = "; ".join([*more, f"{len(rows) - len(bad)} rows follow"]), "left"
    return table


def _gravity(row: ResultRow) -> tuple[bool, float]:
    """Return how badly a row misses its command."""
    verdict = judge_row(row)
    return (False, 0.0) if verdict is None else ("falls" in verdict.faults, verdict.miss)


def _by_level(rows: Sequence[ResultRow]) -> dict[Level, list[CommandVerdict]]:
    """Return the verdicts of each friction, the least first."""
    levels: dict[Level, list[CommandVerdict]] = {}
    for row in sorted(rows, key=lambda row: (row.friction_law, row.friction_level)):
        if (verdict := judge_row(row)) is not None:
            levels.setdefault((row.friction_law, row.friction_level), []).append(verdict)
    return levels


def _share(rows: Sequence[ResultRow]) -> float:
    """Return the share of rows that are followed."""
    return sum(tone_of([row]) == "good" for row in rows) / len(rows)


def _answer(rows: Sequence[ResultRow]) -> str:
    """Return which commands are followed: `all 15 commands up to 10 % friction; 12 of 15 at 20 %`."""
    levels = _by_level(rows)
    if not levels:
        return "not judged (rows of older files)"
    whole = list(takewhile(lambda level: all(one.follows for one in levels[level]), levels))
    texts = {level: friction_text(*level).replace("none", "0 %") for level in levels}
    count = len(levels[whole[-1]]) if whole else 0
    every = f"all {count} commands" if count > 1 else "its command"
    if len(whole) == len(levels):
        return f"{every} {'at' if len(levels) == 1 else 'up to'} {texts[whole[-1]]} friction"
    first = next(level for level in levels if level not in whole)
    followed, of = sum(one.follows for one in levels[first]), len(levels[first])
    worst = worst_command(one.row for one in levels[first])
    fails = f"at {texts[first]}: {'' if worst is None else worst.text}"
    if not whole:
        return f"{followed} of {of} commands {fails}"
    return f"{every} up to {texts[whole[-1]]} friction, {followed} of {of} {fails}"


def _step(rows: Sequence[ResultRow], summary: Mapping[str, Any]) -> str:
    """Return the next command: to watch the worst walk at the least friction that fails, or to run the policy."""
    words = shlex.split(summary["command"])
    bundles = list(takewhile(lambda word: not word.startswith("-"), words[2:])) if words[:1] == ["stiction"] else []
    policies = list(summary["policies"])
    if len(bundles) != len(policies) or rows[0].policy not in policies:
        return ""
    bundle = shlex.quote(bundles[policies.index(rows[0].policy)])
    if not (levels := _by_level(rows)):
        return ""
    worst = next((each for own in levels.values() if (each := worst_command(one.row for one in own))), None)
    if worst is None:
        return f"{COMMAND}deploy {bundle}"
    row = worst.row
    flags = {"friction-level": f"{row.friction_level:g}", "command": row.command}
    for name, value, usual in (
        ("friction-law", row.friction_law, "coulomb"),
        ("terrain", row.terrain, "flat"),
        ("robot", summary.get("robot"), None),
    ):
        flags |= {} if value == usual else {name: shlex.quote(str(value))}
    return " ".join((f"{COMMAND}view {bundle}", *(f"--{name} {value}" for name, value in flags.items())))


def _onsets(summary: Mapping[str, Any]) -> list[str]:
    """Return where policies that never met friction lose half of their speed, as predicted and as walked."""
    lines = []
    for policy, each in summary.get("onset", {}).items():
        predicted = Prediction(**each["predicted"])
        text = f"half of its speed lost: predicted at {predicted.span}{', an extrapolation' * bool(predicted.outside)}"
        text += f"; walked: {walked_text(each['walked'], 'standstill')}" if each["walked"]["to"] else ""
        lines.append(text if len(summary["onset"]) == 1 else f"{policy}, {text}")
    return lines
