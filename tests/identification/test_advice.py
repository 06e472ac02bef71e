"""Which training is advised, from counts made by hand; and that the counts are those of the results."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from stiction.files.advice import TRAINING, TRANSFER, CommandCount, Source, TrainedWith
from stiction.files.following import judge_row
from stiction.files.joints import Estimate, JointRecord
from stiction.files.results import read_results
from stiction.files.straight import Following
from stiction.identification.advice import SHIPPED, STRAIGHT, advise, shipped
from stiction.identification.verdict import Thresholds, judge

RESULTS = Path(__file__).parents[2] / "results"

TABLES = ("physx.csv", "robots.csv")
"""What the advised policies did in other engines."""

METHODS = {"none": TrainedWith("none", 0.0, 0.0, 0.0), "deception": TrainedWith("deception", 0.2, 0.0, 1.2)}


def cell(method: str, level: float, follow: int, slow: int = 0, fast: int = 0, deviation: float = 0.1, engine="mujoco"):
    """Five seeds of one way."""
    return Following(method, engine, "coulomb", level, 5, follow, slow, fast, 5 - follow - slow - fast, deviation, "")


def sources(*cells: Following, others: tuple[Following, ...] = ()) -> dict[str, Source]:
    """Both studies; others: what the comparison of engines counted, of policies of its own."""
    return {
        name: Source("stiction", "abc", "saturn_lite", 6, ("p",), METHODS, own)
        for name, own in ((TRAINING, cells), (TRANSFER, others))
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
    told = advise(0.01, 0.01, sources(*ROWS))
    assert told.settings == {"method": "none", "level": 0.0, "law": "coulomb", "per": "robot"}
    assert "train with --method none." in told.text
    assert "none 4 of 5 (1 too fast); deception 0 of 5 (5 too fast)." in told.text
    told = advise(0.2, 0.2, sources(*ROWS))
    assert told.settings["method"] == "deception" and told.range == [0.0, pytest.approx(0.24)]
    named = replace(told, source=replace(told.source, command="stiction study friction --preset quick --parts 1"))
    assert "train with --preset quick --method deception --friction-level 0.2." in named.text
    assert "none 0 of 5 (5 too slow); deception 4 of 5 (1 too fast)." in told.text
    assert "has not been tried" not in told.text


def test_where_several_follow_with_as_many_seeds_the_deviation_is_what_decides_and_is_named() -> None:
    """If this failed, a training that others equal would be said to follow with the most seeds."""
    equal = sources(cell("none", 0.1, 5, deviation=0.1), cell("deception", 0.1, 5, deviation=0.05))
    said = "deception and none follow with the most seeds, and deception deviates least from the command: train with"
    assert said in advise(0.1, 0.1, equal).text
    nobody = sources(cell("none", 0.1, 0, slow=5), cell("deception", 0.1, 0, slow=5))
    assert "follow with the most seeds" not in advise(0.1, 0.1, nobody).text
    assert "deception follows with the most seeds: train" in advise(0.2, 0.2, sources(*ROWS)).text


def test_other_counts_are_another_advice() -> None:
    """If this failed, the advice would not come from the rows."""
    better = tuple(replace(one, follow=5, too_fast=0) if one.method == "deception" else one for one in ROWS)
    assert advise(0.01, 0.01, sources(*ROWS)).training.method == "none"
    assert advise(0.01, 0.01, sources(*better)).training.method == "deception"


def test_a_level_that_nobody_trained_or_tested_is_said_to_be_none() -> None:
    """3 % is compared at 1 and 10 %; 24 % at 20 %, the highest, where policies of level 0.2 stand for it."""
    assert advise(0.03, 0.03, sources(*ROWS)).levels == (0.01, 0.1)
    told = advise(0.24, 0.24, sources(*ROWS))
    assert told.levels == (0.2,) and "at the nearest level that was tested, 20 %" in told.text
    assert told.training.level == 0.2 and "training at 0.24 itself has not been tried" in told.text
    assert "beyond 20 % nothing was walked" in told.text
    assert "beyond" not in advise(0.2, 0.2, sources(*ROWS)).text


FIVE = (
    *(cell("none", 0.0, 5), cell("none", 0.1, 5), cell("none", 0.2, 0, slow=5), cell("none", 0.3, 0, slow=5)),
    *(cell("deception", 0.0, 5), cell("deception", 0.1, 5), cell("deception", 0.2, 5)),
    cell("deception", 0.3, 4, slow=1),
    *(cell("none", 0.4, 0, slow=5), cell("deception", 0.4, 0, slow=5)),
)


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.1, 0.2, "It covers 20 %: each of 5 seeds follows at 10 % and 20 %."),
        (
            *(0.15, 0.15),
            "Whether it covers 15 % is not known: every seed follows at 10 % and 20 %; between 10 % and 20 % nothing "
            "was walked.",
        ),
        (0.3, 0.3, "It does not cover 30 %: at 30 % 4 of 5 (1 too slow) follow."),
        (
            *(0.2, 0.25),
            "Whether it covers 25 % is not known: at 30 % 4 of 5 (1 too slow) follow; every seed follows at 20 %; "
            "between 20 % and 30 % nothing was walked.",
        ),
        (
            *(0.35, 0.35),
            "It does not cover 35 %: at 30 % 4 of 5 (1 too slow) follow; at 40 % 0 of 5 (5 too slow) follow; between "
            "30 % and 40 % nothing was walked.",
        ),
        (
            *(0.3, 0.45),
            "It does not cover 45 %: at 30 % 4 of 5 (1 too slow) follow; at 40 % 0 of 5 (5 too slow) follow; beyond "
            "40 % nothing was walked.",
        ),
    ],
)
def test_a_friction_is_covered_only_where_every_seed_follows_with_it(low: float, high: float, said: str) -> None:
    """Tested at 0, 10, 20, 30 and 40 %: at 45 % nobody follows, and between and beyond nobody walked.

    If this failed, somebody would train for a friction at which no policy was seen to walk, and be told that it does.
    """
    told = advise(low, high, sources(*FIVE))
    assert told.method == "deception" and said in told.coverage and said in told.text
    assert told.covered is told.to_dict()["covered"] is said.startswith("It covers ")


def test_a_level_above_a_gap_is_not_all_below_it() -> None:
    """With every seed at 40 % and not at 30 %: 40 % is covered, and what lies below it is not."""
    rows = (*(one for one in FIVE if one.friction_level < 0.4), cell("deception", 0.4, 5), cell("none", 0.4, 0, slow=5))
    told = advise(0.32, 0.4, sources(*rows))
    assert not told.covered
    said = "It covers 40 %, and not all below it: at 30 % 4 of 5 (1 too slow) follow; every seed follows at 40 %."
    assert said in told.coverage


@pytest.mark.parametrize("level", [0.1, 0.15, 0.25])
def test_two_seeds_do_not_tell(level: float) -> None:
    """Both follow at 10 and at 20 %: a third might not, so that nothing is covered, nor said to be borne."""
    two = tuple(replace(cell(method, tested, 2), seeds=2, fell=0) for method in METHODS for tested in (0.0, 0.1, 0.2))
    told = advise(level, level, sources(*two))
    assert not told.covered and told.borne_at is None and "fewer than 3 seeds do not tell" in told.coverage
    assert f"Whether it covers {100 * level:g} % is not known" in told.coverage
    three = tuple(replace(one, seeds=3, follow=3) for one in two)
    assert advise(0.1, 0.1, sources(*three)).covered and advise(0.1, 0.1, sources(*three)).borne_at == 0.1


@pytest.mark.parametrize(
    ("robot", "known"),
    [
        (None, "; of any other robot nothing is known directly."),
        ("go2", "; of Go2 nothing is known directly."),
        ("saturn_lite@kp=0.5", "; of saturn_lite@kp=0.5 nothing is known directly."),
        ("saturn_lite", "."),
    ],
)
def test_robot_ground_and_law_are_named(robot: str | None, known: str) -> None:
    """What one robot did on flat ground under one law says nothing of another robot's."""
    said = (
        f"That is of the hexapod Saturn Lite walking {STRAIGHT}, in simulation, on flat ground, under Coulomb friction"
    )
    for high in (0.1, 0.15, 0.45):
        assert advise(high, high, sources(*FIVE), robot).coverage.endswith(said + known)


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


def test_other_engines_are_quoted_of_the_advised_policies_alone() -> None:
    """Of the chosen method, at the tested level nearest to the top, place by place; the training's is counted once.

    If this failed, what other policies did elsewhere would be told as what the advised ones do.
    """
    there = (
        replace(cell("none", 0.01, 1, engine="physx"), seeds=3, too_slow=1, too_fast=2, fell=0),
        *(cell("none", 0.2, 0, slow=5, engine="physx"), cell("deception", 0.01, 5, engine="physx")),
        replace(cell("none", 0.1, 5, engine="physx+all"), friction_law="real"),
    )
    told = advise(0.01, 0.01, sources(*ROWS, *there))
    assert told.method == "none" and told.cells["none"] == ROWS[:1]
    assert told.text.endswith(
        "The same policies elsewhere, the nearest level that they walked with there: in PhysX 1 of 3 (1 too slow, 2 "
        "too fast) at 1 %; on virtual robots 5 of 5 at 10 %."
    )
    assert told.to_dict()["elsewhere"] == {
        "physx": {"1 %": "1 of 3, 1 too slow, 2 too fast"},
        "physx+all": {"10 %": "5 of 5"},
    }
    alone = advise(0.01, 0.01, sources(*ROWS, *there[:1]))
    assert alone.text.endswith(
        "The same policies elsewhere: in PhysX 1 of 3 (1 too slow, 2 too fast) at 1 %; on virtual robots they have not "
        "walked."
    )


def test_what_other_policies_did_elsewhere_is_not_quoted() -> None:
    """The comparison of engines has policies of its own, trained on other ground, under the same names."""
    others = (cell("none", 0.01, 3, engine="physx"), cell("deception", 0.01, 2, engine="physx+all"))
    told = advise(0.01, 0.01, sources(*ROWS, others=others))
    assert told.elsewhere == () and told.to_dict()["elsewhere"] == {}
    assert told.text.endswith(
        "In other engines and on virtual robots these policies have not walked: how they do there is not known."
    )


def committed(changes=lambda row: row) -> dict[str, Source]:
    """Return what the studies make of the committed results; changes: row of the comparison -> another one."""
    friction = pytest.importorskip("stiction_experiments.friction.assemble", reason="the extra 'train' is needed")
    from stiction.files.results import read_summary
    from stiction.robots.catalog import find_robot
    from stiction_experiments.replication import run

    trained = friction.judge_again(RESULTS / "friction-training/rows", {"command": "", "revision": ""})
    summary = read_summary(RESULTS / "replication" / "summary.json")
    records = [
        run._record(name, part | {"rows": [changes(row) for row in part["rows"]]}, summary["grids"][name])
        for name, part in summary["parts"].items()
    ]
    compared = run.judged(records, find_robot("saturn_lite"), summary)
    folder = RESULTS / "friction-training/rows"
    there = friction.read_elsewhere([folder / name for name in TABLES], folder)
    return {TRAINING: friction.source_of(trained, there, TABLES), TRANSFER: run.source_of(compared)}


def test_the_package_s_file_is_that_of_the_results() -> None:
    """If this failed, somebody edited the file, or forgot to write it after the results changed."""
    # The counts over all commands are another test's.
    straight = shipped() | {TRAINING: replace(shipped()[TRAINING], commands=())}
    assert straight == committed()


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
    assert "is the least that slowed walking policies in simulation, by 1 %, of the hexapod" in before
    assert "It may slow down" in before and "probably does not trouble" in now
    assert sources[TRANSFER].revision == shipped()[TRANSFER].revision


def key(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return by what rows of one policy under several frictions are one."""
    return row["policy"], row["method"], row["engine"], row["terrain"], row["command"]


def test_the_headline() -> None:
    """By the results of five seeds: `none` up to 4 %, training with friction from 5 % on; the file is in the package.

    20 % is covered, 24 % lies between two levels that were walked, and 45 % is beyond what any seed follows.
    """
    assert SHIPPED.is_file()
    assert [advise(level, level).training.method for level in (0.01, 0.05)] == ["none", "deception"]
    assert {advise(level, level).training.level for level in (0.2, 0.25)} == {0.2}
    assert advise(0.05, 0.05).cells["deception"][0].follow == 5
    assert [advise(0.15, level).covered for level in (0.2, 0.24, 0.45)] == [True, False, False]
    assert "It covers 20 %: each of 5 seeds follows at 15 % and 20 %" in advise(0.15, 0.2).text
    assert "It does not cover 45 %" in advise(0.22, 0.45).text
    elsewhere = "in PhysX 4 of 5 (1 too fast) at 20 %; on virtual robots 4 of 5 (1 too slow) at 20 %."
    assert elsewhere in advise(0.2, 0.2).text


def test_all_commands_are_told_at_the_nearest_level() -> None:
    """Straight walks alone promise too much: turns and slow walks are counted beside them, place by place."""
    counts = (
        CommandCount("none", "mujoco", 0.1, 5, 3, 75, 73, "wz=1, too slow"),
        CommandCount("none", "mujoco", 0.2, 5, 0, 75, 20, "vx=0.2, too slow"),
        CommandCount("none", "physx", 0.1, 5, 5, 75, 75, ""),
        CommandCount("direct", "mujoco", 0.1, 5, 5, 75, 75, ""),
    )
    part = sources(*FIVE)[TRAINING]
    advice = advise(0.1, 0.1, {TRAINING: replace(part, commands=counts)})
    assert advice.method == "none" and advice.text.endswith(
        "At 10 %, of all commands (turns, sideways, slow and fast walks, standing): in the simulator of the training, "
        "3 of 5 seeds follow all, 73 of 75 pairs of seed and command follow (worst: wz=1, too slow); in PhysX, 5 of 5 "
        "seeds follow all, 75 of 75 pairs of seed and command follow."
    )
    assert len(advice.to_dict()["all_commands"]) == 3 and "all commands" not in advise(0.1, 0.1, {TRAINING: part}).text


def test_the_counts_over_all_commands_are_those_of_the_rows() -> None:
    """Advice of numbers that no row has would be invented."""
    folder = RESULTS / "friction-training" / "rows"
    rows = {robot: read_results(folder / f"commands{robot and '-'}{robot}.csv") for robot in ("", "1000", "1001")}
    counts = shipped()[TRAINING].commands
    assert {count.engine.partition(" ")[2] for count in counts} == set(rows)
    for count in counts:
        engine, _, robot = count.engine.partition(" ")
        wanted = count.method, engine, count.friction_level
        here = [row for row in rows[robot] if (row.method, row.engine, row.friction_level) == wanted]
        verdicts = [verdict for row in here if (verdict := judge_row(row)) is not None]
        missed = {verdict.row.policy for verdict in verdicts if not verdict.follows}
        assert (count.cells, count.followed) == (len(here), sum(verdict.follows for verdict in verdicts)) != (0, 0)
        assert count.follow_all == count.seeds - len(missed) and count.seeds == len({row.policy for row in here})
