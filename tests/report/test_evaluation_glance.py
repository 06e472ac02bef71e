"""An evaluation at a glance: which commands, up to which friction, and no column that a robot cannot have."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import pytest

from stiction.files.results import ResultRow
from stiction.report.evaluated import MOST_ROWS, evaluation_glance, rows_table
from stiction.report.evaluation import definitions_table, results_table
from stiction.report.glance import print_glance
from stiction.report.terminal import Terminal

SUMMARY: dict[str, Any] = {
    "command": "stiction evaluate 'my bundle' --friction-levels 0 0.1",
    "policies": {"mine": {}},
    "warnings": ["the revision is not committed"],
}


def row(level: float, command: str, reached: float, falls: float = 0.0) -> ResultRow:
    """Return a row that reached a share of its command; commands are along one axis."""
    axis, _, speed = command.partition("=")
    means = {f"mean_{name}": reached * float(speed) if name == axis else 0.0 for name in ("vx", "vy", "wz")}
    names = "mine", "none", 0, "mujoco", "coulomb", level, "flat", command
    return ResultRow(*names, reached, 0.1, falls, 4.0, None, None, 20.0, 0.5, None, 8, slowest_walk=0.9, **means)


def shown(rows: list[ResultRow], summary: dict[str, Any] = SUMMARY, terminal: bool = True) -> list[str]:
    """Return the lines of a terminal of 80 columns, or of a file."""
    out = io.StringIO()
    console = Terminal(file=out, width=80, force_terminal=terminal, color_system=None)
    print_glance(console, evaluation_glance(rows, summary), rows_table(rows))
    return out.getvalue().splitlines()


GOOD = [row(level, f"vx=0.{speed}", 1.0) for level in (0.0, 0.1) for speed in range(2, 8)]


@pytest.mark.parametrize(
    ("rows", "answer", "tone", "step"),
    [
        (GOOD, "ALL 6 COMMANDS up to 10 % friction", "good", "deploy 'my bundle'"),
        (
            [*GOOD, row(0.1, "wz=1", 0.5)],
            "ALL 6 COMMANDS up to 0 % friction, 6 of 7 at 10 %: wz=1: too slow",
            "note",
            "view 'my bundle' --friction-level 0.1 --command wz=1",
        ),
        (
            [row(0.0, "vx=0.5", 0.9, falls=0.5), row(0.0, "wz=1", 1.0)],
            "1 OF 2 COMMANDS at 0 %: vx=0.5: falls",
            "bad",
            "view 'my bundle' --friction-level 0 --command vx=0.5",
        ),
        ([replace(GOOD[0], mean_vx=None)], "NOT JUDGED (rows of older files)", "unknown", ""),
        ([replace(GOOD[0], slowest_walk=0.1)], "0 OF 1 COMMANDS at 0 %: vx=0.2: stalls", "warn", "view 'my bundle'"),
    ],
)
def test_the_answer_is_what_is_followed_up_to_which_friction(
    rows: list[ResultRow], answer: str, tone: str, step: str
) -> None:
    """The colour is that of the gravest fault, and the next command shows it; whoever follows all can be run."""
    glance, lines = evaluation_glance(rows, SUMMARY), shown(rows)
    assert lines[:2] == ["mine", f"Follows: {answer}"] and glance.tone == tone
    assert ("Next:" in lines) == bool(step)
    assert not step or lines[lines.index("Next:") + 1].startswith(f"  stiction {step}")
    assert max(map(len, lines)) <= 80


def test_rows_that_fail_come_first_and_all_good_ones_are_one_line() -> None:
    """Lists failing rows first, the worst on top, and counts the passing ones in one line."""
    lines = shown([*GOOD, row(0.1, "vx=0.8", 0.3), row(0.1, "wz=1", 0.9, falls=0.2)])
    table = lines[lines.index(next(line for line in lines if line.startswith("friction"))) :]
    assert [line.split()[2] for line in table[1:3]] == ["wz=1", "vx=0.8"] and table[3].strip() == "12 rows follow"
    many = shown([*GOOD, *(row(0.2, f"vx=0.{speed}", 0.3) for speed in range(1, 10)), row(0.2, "wz=1", 0.1)])
    assert "2 more on the page; 12 rows follow" in {line.strip() for line in many}
    assert sum("too slow" in line for line in many) == MOST_ROWS + 1


@pytest.mark.parametrize(("gait", "heading"), [("tripod", "tripod"), ("trot", "trot"), ("", None)])
def test_no_robot_has_a_gait_that_is_not_its_own(gait: str, heading: str | None) -> None:
    """Four feet trot; two have no contact groups at all."""
    text = results_table(GOOD, [{}] * len(GOOD), gait) + definitions_table(GOOD, gait)
    gaits = {word for word in ("tripod", "trot") if f">{word}<" in text or f">{word} [" in text}
    assert gaits == ({heading} if heading else set())
