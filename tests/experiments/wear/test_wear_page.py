"""The page on wear: the sentence on top, the rows, and what is said of a monitor that is not there."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

from stiction_experiments.lab.study import write_report
from stiction_experiments.wear.lifetimes import Lifetime, Reading, Window
from stiction_experiments.wear.page import answers, lead, report

WALK = {"policy": "<b>p</b>", "friction_level": "0.1", "robot": 1000, "steady": None, "command": "vx=0.5"}
LIFETIME = Lifetime(
    **WALK,
    method="none",
    engine="physx",
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
GROWN = {"start": 0.3, "end": 3.0}
BOTH_WAYS = {"wear": GROWN, "commands": ["vx=0.5", "vx=-0.5"]}
METHOD = {
    "way": "deception",
    "friction_level": "0.1",
    "policies": {"p0": {"mean": 1.0, "alive": 0, "never": 0}, "p1": {"mean": 4.0, "alive": 2, "never": 0}},
    "mean": 2.0,
    "interval95": [1.5, 2.7],
    "at_least": None,
    "at_most": None,
}
CONTROL = {
    "steady": 0.3,
    "robots": 4,
    "read": 3,
    "ends": {"alive": 2, "too slow": 1},
    "alarms": {"unusual": 2, "grown": 0},
    "at_once": {"unusual": 1, "grown": 0},
    "interval95": {"unusual": [0.208, 0.939], "grown": [0.0, 0.562]},
}


def written(
    out: Path,
    lifetimes: list[Lifetime],
    windows: list[Window],
    readings: list[Reading],
    warnings: list[str] | None = None,
    **changes,
) -> str:
    """Write the study; return its page."""
    wear = {"joints": [], "start": 0.3, "end": 3.0, "seconds": 120.0}
    settings = {"engine": "physx", "cell": "all", "settle": 2.0, "window": 10.0}
    settings |= {"commands": ["vx=0.5", "vx=-0.5"], "wear": wear}
    made = {"command": "stiction study wear p", "revision": "abc", "machine": {"cpu": "a processor"}}
    summary = {"settings": settings, "groups": [GROUP], "ways": []} | changes
    write_report(out, report(lifetimes, windows, readings, summary), made | {"warnings": warnings or []})
    return (out / "report.html").read_text()


def test_the_answer_says_where_lifetimes_end_and_how_surely() -> None:
    """A mean with its interval where every lifetime ended, a bound where some robots follow to the last."""
    assert answers([GROUP]) == ["p at level 0.1: 2 too slow, 1 fell; lifetimes end at x1.50 (x1.20 to x1.90)."]
    open_end = GROUP | {"mean": None, "interval95": None, "ends": {"alive": 1, "too slow": 2}}
    assert answers([open_end])[0].endswith("1 alive, 2 too slow; no mean wear at the end.")
    assert answers([], [METHOD])[0].endswith("2 seeds: lifetimes end at x2.00 (x1.50 to x2.70).")
    bounded = METHOD | {"mean": None, "interval95": None, "at_least": 2.0}
    assert answers([], [bounded])[0].endswith("lifetimes end at ≥ x2.00.")


def test_one_sentence_says_from_and_up_to_which_wear_each_policy_follows() -> None:
    """It is the first thing on the page: the answer, for every level, also where some robots never slow down."""
    later = {"first": {"too fast": 3}, "begin": 1.57, "mean": None, "ends": {"alive": 2, "too slow": 1}}
    never = {"friction_level": "0.3", "mean": None, "ends": {"too slow from the start": 3}}
    groups = [GROUP, GROUP | never, GROUP | later | {"policy": "q"}]
    assert lead(groups, BOTH_WAYS) == (
        "While dry friction grows from 3 % to 30 % of the torque limit, p follows up to 15 %; "
        "q follows from 15.7 % on, to the end on 2 of 3 robots. "
        "While dry friction grows from 9 % to 90 % of the torque limit, p never follows."
    )


def test_wear_of_what_a_bench_found_stays_a_factor() -> None:
    """Friction of a bench differs from joint to joint, and is no share of the torque limit."""
    sentence = lead([GROUP | {"friction_level": "bench"}], BOTH_WAYS)
    assert sentence == "While dry friction grows from x0.30 to x3.00 of bench, p follows up to x1.50."


def test_robots_that_are_too_fast_at_first_are_said_to_be(tmp_path: Path) -> None:
    """A policy that outruns its command until friction slows it down does not follow from the start."""
    group = GROUP | {"first": {"too fast": 2, "follows": 1}, "begin": 1.5}
    row = replace(LIFETIME, first_ratio=1.44, begin=1.57, last_ratio=0.5)
    page = written(tmp_path, [row], WINDOWS, [], groups=[group])
    assert "1.44, too fast" in page and "x1.57" in page and "0.50, too slow" in page
    assert "2 too fast, 1 follows" in page and "x1.50" in page


def test_a_training_method_has_a_row_for_its_seeds(tmp_path: Path) -> None:
    """Its interval is over policies; a policy whose robots follow to the last is a lower bound."""
    page = written(tmp_path, [LIFETIME], WINDOWS, [], ways=[METHOD])
    assert "Training methods, over their seeds" in page and "x1.50 to x2.70" in page and "x1.00, ≥ x4.00" in page


def test_the_page_has_tables_and_figures_and_the_numbers_lie_beside_it(tmp_path: Path) -> None:
    """Self-contained and escaped; every number can be had as CSV."""
    second = replace(READING, time=22.0, estimate=None, low=None, high=None)
    page = written(tmp_path, [LIFETIME], WINDOWS, [READING, second])
    assert (
        "<b>p</b>" not in page and page.count('class="drawing"') == 2 and "http" not in page.replace("http-equiv", "")
    )
    assert "x1.25" in page and "x0.90" in page and "Exploratory" not in page
    for name, count in (("lives", 1), ("windows", 9), ("readings", 2)):
        with (tmp_path / f"{name}.csv").open(newline="") as file:
            assert len(list(csv.DictReader(file))) == count
    assert json.loads((tmp_path / "summary.json").read_text())["groups"][0]["mean"] == 1.5
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("wear.png", "monitor.png"))


def test_false_alarms_stand_beside_the_notices(tmp_path: Path) -> None:
    """Without them nobody could say what a notice is worth; rows of the files say in which walks nothing grew."""
    unread = CONTROL | {"steady": 2.0, "read": 0, "interval95": {"unusual": None, "grown": None}}
    others = [CONTROL | {"steady": 1.0, "ends": {"too fast from the start": 3}}, unread]
    group = GROUP | {"controls": [CONTROL, *others]}
    stayed = [replace(row, steady=0.3) for row in (LIFETIME, READING, *WINDOWS)]
    rows = [LIFETIME, stayed[0]], [*WINDOWS, *stayed[2:]], [READING, stayed[1]]
    page = written(tmp_path, *rows, groups=[group])
    assert (
        "2 of 3 (21% to 94%)" in page
        and "nothing read" in page
        and page.count("x1.25") == 1
        and "3 too fast from the start" in page
        and "not known" not in page
    )
    with (tmp_path / "lives.csv").open(newline="") as file:
        assert [row["steady"] for row in csv.DictReader(file)] == ["", "0.3"]
    assert "false alarms are not known" in written(tmp_path, *rows)


def test_a_bundle_without_a_monitor_is_said_to_have_none(tmp_path: Path) -> None:
    """And what an earlier study left there of one is gone; robots that were looked at before are named."""
    (tmp_path / "readings.csv").write_text("old")
    (tmp_path / "monitor.png").write_text("old")
    row = replace(LIFETIME, monitored=False, grown_factor=None, grown="never")
    rows = [row, replace(row, end="alive", factor=None)]
    page = written(tmp_path, rows, WINDOWS, [], warnings=["Exploratory: 3."])
    assert "None of these bundles has a wear monitor" in page and "alive" in page
    assert "Exploratory: 3." in page
    assert not (tmp_path / "readings.csv").exists() and not (tmp_path / "monitor.png").exists()
