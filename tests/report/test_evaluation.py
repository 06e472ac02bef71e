"""The files of an evaluation, and the sentence on top of the page."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.evaluation.table import Sample
from stiction.files.results import ResultRow, read_results
from stiction.report.evaluation import draw_budget, lead, results_table, write_evaluation
from stiction.report.following import command_map, places_text


def make_row(policy: str, level: float, command: str, ratio: float | None, falls: float = 0.0) -> ResultRow:
    """Return one row with the columns that matter here."""
    names = policy, "none", 0, "mujoco", "coulomb", level, "flat", command
    return ResultRow(*names, ratio, 0.1, falls, 4.0, None, None, 20.0, None, None, 8)


@pytest.mark.parametrize(
    ("seen", "text"),
    [
        ("", "nowhere"),
        ("0", "at 0 %"),
        ("0 10 30", "at 0, 10 and 30 %"),
        ("10 20", "at 10 and 20 %"),
        ("0 5 10 20 30", "from 0 to 30 %"),
        ("0 5 10 30", "from 0 to 10 % and at 30 %"),
    ],
)
def test_places_are_said_as_a_person_would(seen: str, text: str) -> None:
    """A span over a place where it was otherwise would claim what was not seen: 5 % lies between 0 and 10 %."""
    tried = {f"{level} %": level in seen.split() for level in ["0", "5", "10", "20", "30"]}
    assert places_text(tried) == text


ROWS = [
    make_row("plain", 0.0, "vx=0.5", 0.95),
    make_row("plain", 0.0, "vx=-0.5", 1.05),
    make_row("plain", 0.2, "vx=0.5", 0.3),
    make_row("plain", 0.2, "vx=-0.5", 0.9),
    make_row("wild", 0.0, "vx=0.5", 0.9, falls=0.5),
    make_row("wild", 0.0, "stand", None),
]


def walked(level: float, command: str, vx: float, vy: float = 0.0, wz: float = 0.0) -> ResultRow:
    """Return one row with its mean velocity."""
    return replace(make_row("deception", level, command, 1.0), mean_vx=vx, mean_vy=vy, mean_wz=wz, slowest_walk=0.9)


COMMANDED = [
    *(walked(level, "vx=0.5", 0.5) for level in (0.0, 0.1, 0.2)),
    *(walked(level, "wz=0.5", 0.0, 0.0, wz) for level, wz in ((0.0, 0.5), (0.1, 0.48), (0.2, 0.3))),
    *(walked(level, "stand", 0.01) for level in (0.0, 0.1, 0.2)),
]
"""Follows all at 0 and 10 %; at 20 % the turn reaches 0.6 of the command."""


def test_the_answer_names_the_worst_command(tmp_path: Path) -> None:
    """All commands that were walked are judged, with the map; rows of older files are not."""
    assert lead(COMMANDED).splitlines()[0] == (
        "deception follows all 3 commands at 0 and 10 % of friction; 2 of 3 at 20 %, the worst is wz=0.5: too slow."
    )
    sheet = command_map(COMMANDED, "deception")
    assert sheet.header == ("command", "none", "10 %", "20 %")
    assert sheet.rows[1] == ("wz=0.5", "1.00", "0.96", "0.60 too slow") and sheet.rows[2][1] == "stands"
    older = [replace(row, mean_vx=None) for row in COMMANDED]
    assert lead(older).splitlines()[0] == "deception is not judged: rows of older files lack the mean velocity."
    page = write_evaluation(tmp_path, COMMANDED, SUMMARY | {"rows": [asdict(row) for row in COMMANDED]})
    assert "Commands by friction" in page.read_text()


SUMMARY = {
    "command": "stiction evaluate <b>plain</b>",
    "evaluation": {"episodes": 8, "noise": {}},
    "engines": ["mujoco"],
    "terrains": ["flat"],
    "robots": [],
    "warnings": ["Exploratory: 3."],
    "conditions": {
        "action_delay": 0.01,
        "encoder_offset": 0.0,
        "ground_friction": 1.0,
        "push_velocity": 0.0,
        "payload": 0.0,
    },
    "policies": {"plain": {"method": "none", "seed": 0, "revision": "abc", "digest": "0" * 64, "command": "train"}},
    "ways": {"plain": "none", "wild": "none (wild)"},
    "revision": "abc",
    "seconds": 1.0,
    "machine": {"cpu": "a processor"},
    "rows": [asdict(row) | {"group_share": None, "moving_share": 0.37} for row in ROWS],
}


def test_every_file_is_written_and_read_back(tmp_path: Path) -> None:
    """A page without its numbers beside it could not be checked."""
    page = write_evaluation(tmp_path / "new" / "folder", ROWS, SUMMARY)
    assert read_results(page.parent / "results.csv") == ROWS
    assert json.loads((page.parent / "summary.json").read_text())["command"] == SUMMARY["command"]
    assert (page.parent / "friction_budget.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (page.parent / "friction_budget.svg").read_text()
    html = page.read_text()
    assert "stiction evaluate &lt;b&gt;plain&lt;/b&gt;" in html
    assert "<script" not in html
    assert "Exploratory: 3." in html
    assert 'src="http' not in html
    assert "0.95" in html
    assert "0" * 16 in html
    assert html.count("37%") == len(ROWS)
    assert "action delay 0.01 s, encoder offset 0 rad, ground friction 1, pushes of 0 m/s" in html
    assert "while training randomises them" in html


def seeded(column: str, level: float, *each: float, command: str = "vx=0.5", **trials) -> Sample:
    """Return a sample of `deception` with a seed for every number, the interval 0.1 to each side."""
    mean, seeds = sum(each) / len(each), " ".join(map(str, range(len(each))))
    cell = "deception", "mujoco", "coulomb", level, "flat", command
    ends = (mean - 0.1, mean + 0.1) if len(each) > 1 else (None, None)
    none = {"trials": None, "trials_low": None, "trials_high": None}
    return Sample(*cell, column, seeds, " ".join(map(str, each)), mean, *ends, **(none | trials))


SEEDS = [
    replace(make_row(f"p{seed}", level, "vx=0.5", ratio), method="deception", seed=seed)
    for seed, ratios in enumerate(((1.0, 0.8), (1.1, 1.0)))
    for level, ratio in zip((0.0, 0.2), ratios, strict=True)
]
SPEEDS = [seeded("speed_ratio", 0.2, 0.8, 1.0), seeded("speed_ratio", 0.0, 1.0, 1.1)]


def test_a_way_with_several_seeds_is_one_line_with_its_interval_and_every_seed() -> None:
    """Two lines would read as two policies to choose from; a method with one seed stays the line of its policy."""
    methods = {"plain": "none", "wild": "none (wild)", "p0": "deception", "p1": "deception"}
    alone = replace(seeded("speed_ratio", 0.0, 0.95), method="none")
    axis = draw_budget([*ROWS, *SEEDS], [alone, *SPEEDS], methods).axes[0]
    lines = axis.get_lines()[1:]
    assert [line.get_label() for line in lines if line.get_label()[0] != "_"] == ["plain", "wild", "deception"]
    assert lines[2].get_xydata().tolist() == [[0.0, 1.05], [20.0, 0.9]]
    assert [line.get_xydata().tolist() for line in lines[3:]] == [[[0.0, 1.0], [0.0, 1.1]], [[20.0, 0.8], [20.0, 1.0]]]
    (band,) = axis.collections
    assert {tuple(corner) for corner in band.get_paths()[0].vertices.round(3)} >= {(20.0, 0.8), (20.0, 1.0)}


def test_the_worst_virtual_robot_is_judged_and_shown() -> None:
    """At 0.6 on one robot and at 1.4 on another: 1.0 in the mean, and no policy follows."""
    ends = {"slowest": 0.6, "fastest": 1.4}
    rows = [
        replace(walked(0.1, command, vx), engine="physx+all", **ends)
        for command, vx in (("vx=0.5", 0.5), ("vx=-0.5", -0.5))
    ]
    assert "deception follows 0 of 2 at 10 %, the worst is vx=0.5: too slow, too fast." in lead(rows)
    table = results_table(rows)
    assert "1.00 (0.60 to 1.40)" in table and ">follows<" not in table and ">too " in table


def test_a_coefficient_is_no_percentage() -> None:
    """A law with a coefficient has panels and an axis of its own, and the torque that it came to in the table."""
    load = [replace(row, friction_law="load", friction_level=0.05) for row in ROWS[:1]]
    figure = draw_budget([*ROWS, *load])
    assert [axis.get_xlabel() for axis in figure.axes if axis.get_visible()] == [
        "dry friction, % of each joint's torque limit",
        "dry friction, % of each joint's torque limit",
        "load friction c, N m per N and N m transmitted",
    ]
    assert [line.get_xydata().tolist() for line in figure.axes[2].get_lines()[1:]] == [[[0.05, 0.95]], []]
    known = replace(load[0], mean_vx=0.5, mean_vy=0.0, mean_wz=0.0)
    assert "plain follows its command at c = 0.05 of friction." in lead([known])
    details = [asdict(load[0]) | {"moving_share": 0.4, "mean_friction": 3.21}]
    assert "load c = 0.05, 3.21 N m" in results_table(load, details)
