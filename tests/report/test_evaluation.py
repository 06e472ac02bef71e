"""The files of an evaluation, and the sentence on top of the page."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.formats.errors import StictionError
from stiction.formats.folder import make_folder
from stiction.formats.results import ResultRow, read_results
from stiction.report.evaluation import lead, results_table, write_evaluation
from stiction.report.evaluation_figures import draw_budget


def make_row(policy: str, level: float, command: str, ratio: float | None, falls: float = 0.0) -> ResultRow:
    """Return one row with the columns that matter here."""
    names = policy, "none", 0, "mujoco", "coulomb", level, "flat", command
    return ResultRow(*names, ratio, 0.1, falls, 4.0, None, None, 20.0, None, None, 8)


ROWS = [
    make_row("plain", 0.0, "vx=0.5", 0.95),
    make_row("plain", 0.0, "vx=-0.5", 1.05),
    make_row("plain", 0.2, "vx=0.5", 0.3),
    make_row("plain", 0.2, "vx=-0.5", 0.9),
    make_row("wild", 0.0, "vx=0.5", 0.9, falls=0.5),
    make_row("wild", 0.0, "stand", None),
]

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


def test_the_lead_says_where_each_policy_follows() -> None:
    """One direction that fails, or one fall, is enough not to follow."""
    text = lead(ROWS)
    assert "plain follows every command without a fall at 0 % of the tested levels 0 %, 20 %." in text
    assert "wild does at none of the tested levels 0 %." in text


def test_one_panel_for_each_command_with_a_speed() -> None:
    """Standing has no speed ratio to draw."""
    figure = draw_budget(ROWS)
    assert [axis.get_title() for axis in figure.axes] == ["commanded vx=0.5", "commanded vx=-0.5"]
    line = figure.axes[0].get_lines()[1]
    assert line.get_xydata().tolist() == [[0.0, 0.95], [20.0, 0.3]]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    """The work of an hour must not be lost for a wrong --out."""
    (tmp_path / "file").write_text("")
    with pytest.raises(StictionError, match="--out"):
        make_folder(tmp_path / "file")


def test_without_the_details_there_is_no_moving_column() -> None:
    """A column of dashes would read as robots that never moved."""
    assert ">moving</th>" not in results_table(ROWS)
    assert ">moving</th>" in results_table(ROWS, SUMMARY["rows"])


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
    assert "plain follows every command without a fall at load c = 0.05 of the tested" in lead(load)
    details = [asdict(load[0]) | {"moving_share": 0.4, "mean_friction": 3.21}]
    assert "load c = 0.05, 3.21 N m" in results_table(load, details)
