"""Which training is advised, from counts made by hand; and that the counts are those of the results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stiction.formats.advice import TRAINING, TRANSFER, Source, TrainedWith
from stiction.formats.following import Following
from stiction.formats.joints import Estimate, JointRecord
from stiction.identify.advice import SHIPPED, advise, shipped
from stiction.identify.verdict import Thresholds, judge

RESULTS = Path(__file__).parents[2] / "results"

METHODS = {"none": TrainedWith("none", 0.0, 0.0, 0.0), "deception": TrainedWith("deception", 0.2, 0.0, 1.2)}


def cell(method: str, level: float, follow: int, slow: int = 0, fast: int = 0, deviation: float = 0.1, engine="mujoco"):
    """Five seeds of one way."""
    return Following(method, engine, "coulomb", level, 5, follow, slow, fast, 5 - follow - slow - fast, deviation, "")


def sources(*cells: Following, elsewhere: tuple[Following, ...] = ()) -> dict[str, Source]:
    """Both studies."""
    return {
        name: Source("stiction", "abc", ("p",), METHODS, own)
        for name, own in ((TRAINING, cells), (TRANSFER, elsewhere))
    }


ROWS = (
    *(cell("none", 0.01, 4, fast=1), cell("none", 0.1, 0, slow=5, deviation=0.3), cell("none", 0.2, 0, slow=5)),
    *(
        cell("deception", 0.01, 0, fast=5),
        cell("deception", 0.1, 0, fast=5, deviation=0.2),
        cell("deception", 0.2, 4, fast=1),
    ),
)


def test_the_training_with_more_seeds_is_advised() -> None:
    """`none` at 1 %, where the other is too fast; `deception` at 20 %, where `none` is too slow."""
    told = advise(0.008, 0.012, sources(*ROWS))
    assert told.settings == {"method": "none", "level": 0.0, "law": "coulomb", "per": "robot"}
    assert "train with --method none." in told.text
    assert "none 4 of 5 (1 too fast); deception 0 of 5 (5 too fast)." in told.text
    told = advise(0.19, 0.2, sources(*ROWS))
    assert told.settings["method"] == "deception" and told.range == [0.0, pytest.approx(0.24)]
    assert "none 0 of 5 (5 too slow); deception 4 of 5 (1 too fast)." in told.text
    assert "has not been tried" not in told.text


def test_other_counts_are_another_advice() -> None:
    """If this failed, the advice would not come from the rows."""
    better = tuple(replace(one, follow=5, too_fast=0) if one.method == "deception" else one for one in ROWS)
    assert advise(0.008, 0.012, sources(*ROWS)).training.method == "none"
    assert advise(0.008, 0.012, sources(*better)).training.method == "deception"


def test_a_level_that_nobody_trained_or_tested_is_said_to_be_none() -> None:
    """3 % is nearest to 1 %; 24 % to 20 %, where policies of level 0.2 stand for it; 40 % is beyond all."""
    assert advise(0.03, 0.03, sources(*ROWS)).levels == (0.01,)
    assert "at the nearest level that was tested, 1 %" in advise(0.03, 0.03, sources(*ROWS)).text
    told = advise(0.24, 0.24, sources(*ROWS))
    assert told.training.level == 0.2 and "training at 0.24 itself has not been tried" in told.text
    assert "Nothing was tested beyond 20 %." in advise(0.4, 0.4, sources(*ROWS)).text
    assert "beyond" not in told.text.replace("Nothing was tested beyond 20 %.", "")


def test_where_no_seed_follows_that_is_said_and_the_least_deviation_chosen() -> None:
    """At 10 % one way is too slow with all seeds and the other too fast, by less."""
    told = advise(0.1, 0.1, sources(*ROWS))
    assert told.training.method == "deception" and "no training method follows with any seed there" in told.text
    assert "0 of 5 (5 too slow)" in told.text and "0 of 5 (5 too fast)" in told.text


def test_all_tested_levels_between_what_was_measured_and_the_margin_count() -> None:
    """From 1 to 20 %: both follow with four, none deviates by 0.5 in all and deception by 0.4."""
    told = advise(0.01, 0.2, sources(*ROWS))
    assert told.levels == (0.01, 0.1, 0.2) and told.training.method == "deception"
    assert "deception 0 of 5 (5 too fast) at 1 %, 0 of 5 (5 too fast) at 10 %, 4 of 5 (1 too fast) at 20 %" in told.text


def test_other_engines_are_quoted_and_the_training_s_is_not_counted_twice() -> None:
    """Of the chosen method alone, at the tested level nearest to the top, with the number of seeds."""
    others = (
        replace(cell("none", 0.01, 1, engine="physx"), seeds=3, too_slow=1, too_fast=2, fell=0),
        replace(cell("none", 0.01, 3), seeds=3, fell=0),
        cell("none", 0.2, 0, slow=5, engine="physx"),
    )
    told = advise(0.01, 0.02, sources(*ROWS, elsewhere=others))
    assert "at 1 %, pairs of a seed and a place: 1 of 3 (1 too slow, 2 too fast), of 3 seeds." in told.text
    assert told.to_dict()["elsewhere"] == {"physx": "1 of 3, 1 too slow, 2 too fast"}


def committed(changes=lambda row: row) -> dict[str, Source]:
    """Return what the studies make of the committed results; changes: row of the comparison -> another one."""
    friction = pytest.importorskip("stiction.studies.friction.assemble", reason="the extra 'train' is needed")
    from stiction.formats.results import read_summary
    from stiction.robots.catalog import find_robot
    from stiction.studies.replication import run

    trained = friction.judge_again(RESULTS / "friction-training/drawn-ground", {"command": "", "revision": ""})
    summary = read_summary(RESULTS / "replication" / "summary.json")
    records = [
        run._record(name, part | {"rows": [changes(row) for row in part["rows"]]}, summary["grids"][name])
        for name, part in summary["parts"].items()
    ]
    compared = run.judged(records, find_robot("saturn_lite"), summary)
    return {TRAINING: friction.source_of(trained), TRANSFER: run.source_of(compared)}


def test_the_package_s_file_is_that_of_the_results() -> None:
    """If this failed, somebody edited the file, or forgot to write it after the results changed."""
    assert shipped() == committed()


def test_rows_in_which_friction_costs_nothing_at_first_are_another_verdict() -> None:
    """At 1 % every policy is as fast as without friction: it is felt from 10 % on, and 5 % is called harmless.

    If this failed, the verdict would rest on numbers that somebody copied by hand.
    """
    summary = json.loads((RESULTS / "replication" / "summary.json").read_text())
    rows = [row for part in summary["parts"].values() for row in part["rows"]]
    bare = {key(row): row["speed_ratio"] for row in rows if row["friction_level"] == 0}

    def harmless(row: dict[str, Any]) -> dict[str, Any]:
        engine = {"physx+all": "physx+rest"}.get(row["engine"], row["engine"])
        if row["friction_level"] == 0.01 and (same := bare.get(key(row | {"engine": engine}))) is not None:
            return row | {"speed_ratio": same}
        return row

    sources = committed(harmless)
    assert Thresholds.of(shipped()).noticeable == 0.01 and Thresholds.of(sources).noticeable == 0.1
    ratio = Estimate(0.045, 0.002, (0.041, 0.05))
    record = JointRecord(coulomb_friction=ratio, friction_ratio=ratio, test_condition="loaded")
    before, now = (judge(record, one).text for one in (shipped(), sources))
    assert "It may slow down" in before and "probably does not trouble" in now
    assert sources[TRANSFER].revision == shipped()[TRANSFER].revision


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return by what rows of one policy under several frictions are one."""
    return row["policy"], row["method"], row["engine"], row["terrain"], row["command"]


def test_the_headline() -> None:
    """By the results of five seeds: `none` at 1 %, training with friction from 5 % on; the file is in the package."""
    assert SHIPPED.is_file()
    assert [advise(level, level).training.method for level in (0.01, 0.05)] == ["none", "deception"]
    assert {advise(level, level).training.level for level in (0.2, 0.25)} == {0.2}
    assert advise(0.05, 0.05).cells["deception"][0].follow == 5
