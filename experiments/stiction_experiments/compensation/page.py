"""The page on friction fed forward: in which way, and with which share, a policy follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stiction.core.decode import from_plain
from stiction.core.records import header, texts
from stiction.files.results import ResultRow
from stiction.joints.compensation import Compensation, parse_compensation
from stiction.joints.friction import level_text
from stiction.report.following import places_text
from stiction.report.page import Section, fold, paragraph, row_table, table
from stiction_experiments.compensation.standing import Standing
from stiction_experiments.compensation.walking import Followed, followed
from stiction_experiments.lab.straight import DEFINITION
from stiction_experiments.lab.study import Report

WAYS = {
    "error": "by the position error",
    "reference": "by the target's speed",
    "measured": "by the measured speed",
    "measured-motor": "by the speed that the motor measures",
}
"""A way to feed friction forward, in words."""

AS_IS = "nothing fed forward"


def report(
    walks: Sequence[Mapping[str, Any]], stood: Sequence[Standing], summary: Mapping[str, Any], warnings: Sequence[str]
) -> Report:
    """Return the tables and the page. walks: rows of results.csv; summary: what summary.json has beside the rows."""
    rows = [from_plain(ResultRow, dict(row), "a walk of before") for row in walks]
    who = followed(rows)
    law = ", ".join(dict.fromkeys(row.friction_law for row in rows))
    note = f"Speed reached over commanded, forward / backward; * it follows. Law of the friction: {law}. {DEFINITION}"
    sections = [
        Section("Who follows", (level_table(who), paragraph(note))),
        Section("Every pair of a policy and a friction", (fold("Every row", [row_table(who, grouped=True)]),)),
    ]
    if stood:
        sections.append(Section("Standing still on a virtual robot", (standing_table(stood),)))
    return Report(
        title="Is it enough to feed friction forward in the motors?",
        lead="\n".join(answer(who)),
        tables={"walks": rows, "following": who, "standing": stood},
        sections=sections,
        summary=summary,
        warnings=warnings,
    )


def way_of(policy: str) -> tuple[str, str]:
    """Return the bundle's name, and in words how friction was fed forward. policy: `NAME+measured=0.7`."""
    name, plus, label = policy.partition("+")
    if not plus:
        return name, AS_IS
    return name, way_text(parse_compensation(label.replace("forward", "error")))


def way_text(how: Compensation) -> str:
    """Return a way to feed friction forward in words."""
    return f"{WAYS[how.by]}, share {how.share:g}"


def follows(row: Followed) -> bool:
    """Return whether a policy follows both ways, and nobody falls."""
    return row.follows == "follows" and not row.fall_rate


def level_table(rows: Sequence[Followed]) -> Any:
    """Return the speeds of each policy and way, a column for each friction."""
    levels = {row.friction_level: _level(row) for row in sorted(rows, key=lambda row: row.friction_level)}
    cells: dict[tuple[str, str], dict[float, str]] = {}
    for row in rows:
        text = f"{row.forward:.2f} / {row.backward:.2f}{' *' if follows(row) else ''}"
        cells.setdefault(way_of(row.policy), {})[row.friction_level] = text
    lines = [[*way, *(texts.get(level, "–") for level in levels)] for way, texts in cells.items()]
    header = ["policy", "friction fed forward", *(f"{level} friction [1]" for level in levels.values())]
    return table(header, lines, grouped=True)


def answer(rows: Sequence[Followed]) -> list[str]:
    """Return whether it is enough, as a sentence to be read aloud for each policy; others only where they follow.

    It is where a way follows at every friction that was tried.
    """
    lines = []
    for name in dict.fromkeys(way_of(row.policy)[0] for row in rows):
        ways: dict[str, list[Followed]] = {}
        for row in rows:
            if way_of(row.policy)[0] == name:
                ways.setdefault(way_of(row.policy)[1], []).append(row)
        alone = f"follows {_where(ways.pop(AS_IS, []))} as it is"
        if not ways:
            lines.append(f"{name} {alone}.")
            continue
        count = sum(all(map(follows, own)) for own in ways.values())
        enough = f"is enough in {count} of {len(ways)} ways" if count else f"is not enough in any of {len(ways)} ways"
        reached = {way: sum(map(follows, own)) for way, own in ways.items()}
        best = [way for way, number in reached.items() if number == max(reached.values())]
        shown = f"{'; '.join(best[:3])}{f'; {len(best) - 3} more' if best[3:] else ''}"
        best_said = f"with friction fed forward at best {_where(ways[best[0]])} ({shown})"
        best_way = best_said if max(reached.values()) else "no way helps"
        lines.append(f"In the simulator of the training it {enough}: {name} {alone}, and {best_way}.")
    return lines


def standing_table(rows: Sequence[Standing]) -> Any:
    """Return how robots stood, under each friction; rows: by friction, then by robot."""
    lines = [
        [
            f"{row.engine}, robot {row.robot}, friction {row.friction_level} of the torque limit",
            AS_IS if row.fed == "none" else way_text(parse_compensation(row.fed)),
            *texts(row),
        ]
        for row in rows
    ]
    return table(["friction", "friction fed forward", *header(Standing)], lines, grouped=True)


def _where(rows: Sequence[Followed]) -> str:
    """Return at which of the frictions that were tried something follows, in words."""
    return places_text({_level(row): follows(row) for row in rows})


def _level(row: Followed) -> str:
    return level_text(row.friction_law, row.friction_level)
