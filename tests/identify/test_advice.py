"""Which training is advised, from counts made by hand; and that the counts are those of the results."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.formats.advice import TRAINING, TRANSFER, Source, Way
from stiction.formats.following import Following
from stiction.identify.advice import SHIPPED, advise, shipped

WAYS = {"none": Way("none", 0.0, 0.0, 0.0), "deception": Way("deception", 0.2, 0.0, 1.2)}


def cell(way: str, level: float, follow: int, slow: int = 0, fast: int = 0, deviation: float = 0.1, engine="mujoco"):
    """Five seeds of one way."""
    return Following(way, engine, "coulomb", level, 5, follow, slow, fast, 5 - follow - slow - fast, deviation, "")


def sources(*cells: Following, elsewhere: tuple[Following, ...] = ()) -> dict[str, Source]:
    """Both studies."""
    return {
        name: Source("stiction", "abc", ("p",), WAYS, own) for name, own in ((TRAINING, cells), (TRANSFER, elsewhere))
    }


ROWS = (
    *(cell("none", 0.01, 4, fast=1), cell("none", 0.1, 0, slow=5, deviation=0.3), cell("none", 0.2, 0, slow=5)),
    *(
        cell("deception", 0.01, 0, fast=5),
        cell("deception", 0.1, 0, fast=5, deviation=0.2),
        cell("deception", 0.2, 4, fast=1),
    ),
)


def test_the_way_with_more_seeds_is_advised() -> None:
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
    assert advise(0.008, 0.012, sources(*ROWS)).way.method == "none"
    assert advise(0.008, 0.012, sources(*better)).way.method == "deception"


def test_a_level_that_nobody_trained_or_tested_is_said_to_be_none() -> None:
    """3 % is nearest to 1 %; 24 % to 20 %, where policies of level 0.2 stand for it; 40 % is beyond all."""
    assert advise(0.03, 0.03, sources(*ROWS)).levels == (0.01,)
    assert "at the nearest level that was tested, 1 %" in advise(0.03, 0.03, sources(*ROWS)).text
    told = advise(0.24, 0.24, sources(*ROWS))
    assert told.way.level == 0.2 and "training at 0.24 itself has not been tried" in told.text
    assert "Nothing was tested beyond 20 %." in advise(0.4, 0.4, sources(*ROWS)).text
    assert "beyond" not in told.text.replace("Nothing was tested beyond 20 %.", "")


def test_where_no_seed_follows_that_is_said_and_the_least_deviation_chosen() -> None:
    """At 10 % one way is too slow with all seeds and the other too fast, by less."""
    told = advise(0.1, 0.1, sources(*ROWS))
    assert told.way.method == "deception" and "no way of training follows with any seed there" in told.text
    assert "0 of 5 (5 too slow)" in told.text and "0 of 5 (5 too fast)" in told.text


def test_all_tested_levels_between_what_was_measured_and_the_margin_count() -> None:
    """From 1 to 20 %: both follow with four, none deviates by 0.5 in all and deception by 0.4."""
    told = advise(0.01, 0.2, sources(*ROWS))
    assert told.levels == (0.01, 0.1, 0.2) and told.way.method == "deception"
    assert "deception 0 of 5 (5 too fast) at 1 %, 0 of 5 (5 too fast) at 10 %, 4 of 5 (1 too fast) at 20 %" in told.text


def test_other_engines_are_quoted_and_the_training_s_is_not_counted_twice() -> None:
    """Of the chosen way alone, at the tested level nearest to the top, with the number of seeds."""
    others = (
        replace(cell("none", 0.01, 1, engine="physx"), seeds=3, too_slow=1, too_fast=2, fell=0),
        replace(cell("none", 0.01, 3), seeds=3, fell=0),
        cell("none", 0.2, 0, slow=5, engine="physx"),
    )
    told = advise(0.01, 0.02, sources(*ROWS, elsewhere=others))
    assert "at 1 %, pairs of a seed and a place: 1 of 3 (1 too slow, 2 too fast), of 3 seeds." in told.text
    assert told.to_dict()["elsewhere"] == {"physx": "1 of 3, 1 too slow, 2 too fast"}


def test_the_package_s_counts_are_those_of_the_results() -> None:
    """If this failed, somebody edited the file, or forgot to write it after the results changed."""
    rows = pytest.importorskip("stiction.transfer.experiment.again", reason="the extra 'train' is needed")
    from stiction.transfer.experiment.advice import source_of
    from stiction.transfer.replication import advice, again

    results = Path(__file__).parents[2] / "results"
    made = {"command": "", "revision": ""}
    assert shipped()[TRAINING] == source_of(rows.judge_again(results / "friction-training", made))
    known, found = shipped()[TRANSFER], advice.source_of(again.judge_again(results / "replication", made))
    assert [asdict(one) for one in known.cells] == [asdict(one) for one in found.cells]
    assert (known.command, known.revision, known.policies, known.ways) == (
        *(found.command, found.revision, found.policies, found.ways),
    )


def test_the_headline() -> None:
    """By the results of five seeds: `none` up to 5 %, training with friction at 20 %; the file is in the package."""
    assert SHIPPED.is_file()
    assert [advise(level, level).way.method for level in (0.01, 0.05)] == ["none", "none"]
    assert {advise(level, level).way.level for level in (0.2, 0.25)} == {0.2}
    assert advise(0.05, 0.05).cells["deception"][0].too_fast == 5
