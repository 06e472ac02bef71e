"""The page on wear: the sentence on top, the rows, and what is said of a monitor that is not there."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.studies.study import write_report
from stiction.studies.wear.lives import Life, Reading, Window
from stiction.studies.wear.page import answers, report

WALK = {"policy": "<b>p</b>", "friction_level": "0.1", "robot": 1000, "steady": None}
LIFE = Life(
    **WALK,
    method="none",
    engine="physx",
    command="vx=0.5",
    first_ratio=1.1,
    last_ratio=0.2,
    begin=None,
    end="too slow",
    factor=1.25,
    time=42.0,
    monitored=True,
    unusual_factor=None,
    unusual="never",
    grown_factor=0.9,
    grown="before",
    held=0.5,
)
WINDOWS = [Window(**WALK, time=10.0 * at, factor=0.3 * at, ratio=1.1 - 0.1 * at) for at in range(1, 10)]
READING = Reading(
    **WALK, target="level", time=12.0, factor=0.4, true=0.04, estimate=0.07, low=0.05, high=0.09, unusual=True
)
GROUP = {
    "policy": "p",
    "friction_level": "0.1",
    "robots": 3,
    "ends": {"too slow": 2, "fell": 1},
    "first": {"follows": 3},
    "begin": None,
    "mean": 1.5,
    "interval95": [1.2, 1.9],
    "median": 1.4,
    "monitored": True,
    "unusual": {"before": 2, "never": 1},
    "grown": {"before": 3},
    "held": 0.25,
    "controls": [],
}
CONTROL = {
    "steady": 0.3,
    "robots": 3,
    "ends": {"alive": 2, "too slow": 1},
    "alarms": {"unusual": 2, "grown": 0},
    "at_once": {"unusual": 1, "grown": 0},
    "interval95": {"unusual": [0.208, 0.939], "grown": [0.0, 0.562]},
}


def written(
    out: Path,
    lives: list[Life],
    windows: list[Window],
    readings: list[Reading],
    told: list[str] | None = None,
    **changes,
) -> str:
    """Write the study; return its page."""
    wear = {"joints": [], "start": 0.3, "end": 3.0, "seconds": 120.0}
    settings = {"engine": "physx", "cell": "all", "command": "vx=0.5", "settle": 2.0, "window": 10.0, "wear": wear}
    made = {"command": "stiction study wear p", "revision": "abc", "machine": {"cpu": "a processor"}}
    found = {"settings": settings, "groups": [GROUP], "ways": []} | changes
    write_report(out, report(lives, windows, readings, found), made | {"warnings": told or []})
    return (out / "report.html").read_text()


def test_the_answer_says_where_lives_end_and_of_what_the_interval_is() -> None:
    """A mean with its interval where every life ended, counts where some did not."""
    (said,) = answers([GROUP], 3.0)
    assert said.startswith("p at level 0.1: its life ends at x1.50 (95 % over robots: x1.20 to x1.90), 1 by a fall.")
    assert said.endswith(
        "an unusual reading came before for 2, never for 1; growth was told before for 3. "
        "Its 95 % intervals held the truth in 25% of the windows."
    )
    some = GROUP | {"mean": None, "interval95": None, "median": 2.5, "monitored": False}
    some |= {"ends": {"alive": 1, "too slow": 1, "too fast from the start": 1}}
    (said,) = answers([some], 3.0)
    assert "1 of 3 robots still follow at x3, 1 of 3 slow under 80 % of the command before that" in said
    assert "1 of 3 never follow, at first over 120 % of the command; the median life ends at x2.50." in said
    assert said.endswith("The bundle has no wear monitor.")
    (said,) = answers([GROUP | {"robots": 1, "interval95": None, "ends": {"too slow": 1}}], 3.0)
    assert "its life ends at x1.50, one robot." in said


def test_robots_that_are_too_fast_at_first_are_said_to_be(tmp_path: Path) -> None:
    """A policy that outruns its command until friction slows it down does not follow from the start."""
    group = GROUP | {"first": {"too fast": 2, "follows": 1}, "begin": 1.5}
    (said,) = answers([group], 3.0)
    assert said.startswith(
        "p at level 0.1: at first 2 of 3 too fast, and those that come to follow do so from x1.50 on; its life ends"
    )
    row = replace(LIFE, first_ratio=1.44, begin=1.57, last_ratio=0.5)
    page = written(tmp_path, [row], WINDOWS, [], groups=[group])
    assert "1.44, too fast" in page and "x1.57" in page and "0.50, too slow" in page


def test_a_way_of_training_speaks_for_its_seeds(tmp_path: Path) -> None:
    """Its interval is over policies; where lives go on there is a bound, and no interval that looks exact."""
    policies = {
        "p0": {"mean": 1.0, "alive": 0, "never": 0},
        "p1": {"mean": 4.0, "alive": 0, "never": 0},
    }
    method = {"way": "deception", "friction_level": "0.1", "policies": policies, "mean": 2.0, "interval95": [1.5, 2.7]}
    method |= {"at_least": None, "at_most": None}
    (_, said) = answers([GROUP], 3.0, [method])
    assert said == (
        "deception at level 0.1, 2 seeds: its policies' lives end at x2.00 "
        "(95 % over training seeds: x1.50 to x2.70); x1.00, x4.00."
    )
    alive = {"p0": policies["p0"], "p1": policies["p1"] | {"alive": 2}}
    open_end = method | {"mean": None, "interval95": None, "at_least": 2.0, "policies": alive}
    assert answers([], 3.0, [open_end])[0].endswith("lives end at least at x2.00; x1.00, ≥ x4.00.")
    neither = open_end | {"at_least": None}
    assert "no mean" in answers([], 3.0, [neither])[0]
    page = written(tmp_path, [LIFE], WINDOWS, [], ways=[method])
    assert "Training methods, over their seeds" in page and "x1.50 to x2.70" in page


def test_the_page_has_tables_and_figures_and_the_numbers_lie_beside_it(tmp_path: Path) -> None:
    """Self-contained and escaped; every number can be had as CSV."""
    second = replace(READING, time=22.0, estimate=None, low=None, high=None)
    page = written(tmp_path, [LIFE], WINDOWS, [READING, second])
    assert "<b>p</b>" not in page and page.count("data:image/png") == 2 and "http" not in page.replace("http-equiv", "")
    assert "x1.25" in page and "x0.90" in page and "Exploratory" not in page
    for name, count in (("lives", 1), ("windows", 9), ("readings", 2)):
        with (tmp_path / f"{name}.csv").open(newline="") as file:
            assert len(list(csv.DictReader(file))) == count
    assert json.loads((tmp_path / "summary.json").read_text())["groups"][0]["mean"] == 1.5
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("wear.png", "monitor.png"))


def test_false_alarms_stand_beside_the_notices(tmp_path: Path) -> None:
    """Without them nobody could say what a notice is worth; rows of the files say in which walks nothing grew."""
    group = GROUP | {"controls": [CONTROL, CONTROL | {"steady": 1.0, "ends": {"too fast from the start": 3}}]}
    (said,) = answers([group], 3.0)
    assert (
        "Where friction stayed at x0.3, 2 of 3 follow to the end, 1 too slow; false alarms: an unusual reading for 2 "
        "of 3 (21% to 94%), growth for 0 of 3 (0% to 56%). Where friction stayed at x1, 0 of 3 follow to the end, 3 "
        "too fast from the start; " in said
    )
    (deaf,) = answers([group | {"monitored": False}], 3.0)
    assert "at x0.3, 2 of 3 follow to the end, 1 too slow. Where" in deaf and "alarm" not in deaf
    stayed = [replace(row, steady=0.3) for row in (LIFE, READING, *WINDOWS)]
    rows = [LIFE, stayed[0]], [*WINDOWS, *stayed[2:]], [READING, stayed[1]]
    page = written(tmp_path, *rows, groups=[group])
    assert "2 of 3 (21% to 94%)" in page and page.count("x1.25") == 1 and "not known" not in page
    with (tmp_path / "lives.csv").open(newline="") as file:
        assert [row["steady"] for row in csv.DictReader(file)] == ["", "0.3"]
    assert "false alarms are not known" in written(tmp_path, *rows)


def test_a_bundle_without_a_monitor_is_said_to_have_none(tmp_path: Path) -> None:
    """And what an earlier study left there of one is gone; robots that were looked at before are named."""
    (tmp_path / "readings.csv").write_text("old")
    (tmp_path / "monitor.png").write_text("old")
    rows = [replace(LIFE, monitored=False, grown_factor=None, grown="never"), replace(LIFE, end="alive", factor=None)]
    page = written(tmp_path, rows, WINDOWS, [], told=["Exploratory: 3."])
    assert "None of these bundles has a wear monitor" in page and "no monitor" in page and "over x3" in page
    assert "Exploratory: 3." in page
    assert not (tmp_path / "readings.csv").exists() and not (tmp_path / "monitor.png").exists()


def test_a_robot_that_fell_at_once_has_no_window(tmp_path: Path) -> None:
    """The page is made all the same."""
    fallen = replace(LIFE, end="fell", first_ratio=None, last_ratio=None)
    assert "fell" in written(tmp_path, [fallen], [], [])
    assert not (tmp_path / "windows.csv").exists()


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    """If this failed, hours of walks would end in a traceback."""
    with pytest.raises(StictionError, match=r"cannot be written to .*choose another --out"):
        written(tmp_path / "gone", [LIFE], [], [])
