"""Which training is advised, from counts made by hand; and that the counts are those of the results."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.files.advice import TRAINING, TRANSFER, Source, TrainedWith
from stiction.files.following import CommandCount
from stiction.identification.advice import advise, shipped

RESULTS = Path(__file__).parents[2] / "results"

METHODS = {
    "none": TrainedWith("none", 0.0, 0.0, 0.0),
    "deception": TrainedWith("deception", 0.2, 0.0, 1.2),
    "told": TrainedWith("deception", 0.2, 0.0, 1.2),
}


def cell(method: str, level: float, follow_all: int, engine: str = "mujoco", seeds: int = 5, **more) -> CommandCount:
    """Return the counts of fifteen commands; who does not follow all misses three of them."""
    missed = 3 * (seeds - follow_all)
    counts = {"cells": 15 * seeds, "followed": 15 * seeds - missed, "miss": 0.01, "largest_miss": 0.05}
    worst = "wz=1: too slow" if missed else ""
    return CommandCount(method, engine, "coulomb", level, seeds, follow_all, **(counts | {"worst": worst} | more))


def sources(*cells: CommandCount) -> dict[str, Source]:
    """Return the part of a study with these counts."""
    return {TRAINING: Source("stiction study --preset quick", "abc", "saturn_lite", 6, ("p",), METHODS, cells)}


FIVE = (
    *(cell("none", 0.0, 5), cell("none", 0.1, 5), *(cell("none", level, 0, followed=10) for level in (0.2, 0.3, 0.4))),
    *(cell("deception", 0.0, 5), cell("deception", 0.1, 5), cell("deception", 0.2, 5)),
    *(cell("deception", 0.3, 4), cell("deception", 0.4, 0, followed=40)),
)


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (0.1, 0.2, "It covers 20 %: in the simulator of the training every command is followed by 5 of 5 seeds at 10 "
                   "%, 5 of 5 seeds at 20 %."),
        (0.15, 0.15, "Whether it covers 15 % is not known: in the simulator of the training every command is followed "
                     "by 5 of 5 seeds at 10 %, 5 of 5 seeds at 20 %; nothing was walked between."),
        (0.3, 0.3, "It does not cover 30 %: in the simulator of the training every command is followed by 4 of 5 seeds "
                   "at 30 %; the worst at 30 % is wz=1: too slow."),
        (0.2, 0.25, "Whether it covers 25 % is not known: in the simulator of the training every command is followed "
                    "by 5 of 5 seeds at 20 %, 4 of 5 seeds at 30 %; the worst at 30 % is wz=1: too slow; nothing was"),
        (0.35, 0.35, "It does not cover 35 %: in the simulator of the training every command is followed by 4 of 5 "
                     "seeds at 30 %, 0 of 5 seeds at 40 %; the worst at 40 % is wz=1: too slow; nothing was walked"),
        (0.4, 0.45, "It does not cover 45 %: in the simulator of the training every command is followed by 0 of 5 "
                    "seeds at 40 %; the worst at 40 % is wz=1: too slow; beyond 40 % nothing was walked."),
    ],
)  # fmt: skip
def test_a_friction_is_covered_only_where_every_seed_follows_every_command(low: float, high: float, said: str) -> None:
    """Tested at 0, 10, 20, 30 and 40 %: at 40 % nobody follows, and between and beyond nobody walked."""
    told = advise(low, high, sources(*FIVE))
    assert told.method == "deception" and said in told.coverage
    assert told.covered is told.to_dict()["covered"] is said.startswith("It covers ")


def test_a_level_above_a_gap_is_not_all_below_it() -> None:
    """With every seed at 40 % and not at 30 %: 40 % is covered, and what lies below it is not."""
    told = advise(0.32, 0.4, sources(*FIVE[:-1], cell("deception", 0.4, 5)))
    assert not told.covered and told.coverage.startswith("It covers 40 %, and not all below it: ")


def test_covered_comes_before_share_and_share_before_miss() -> None:
    """A method with all seeds at every level wins; else the larger share of cells, then the smaller mean miss."""
    assert advise(0.2, 0.2, sources(cell("none", 0.2, 5), cell("deception", 0.2, 4))).method == "none"
    near = cell("none", 0.2, 0, followed=74), cell("deception", 0.2, 3, followed=70)
    assert advise(0.2, 0.2, sources(*near)).method == "none"
    equal = cell("none", 0.2, 3, miss=0.02), cell("deception", 0.2, 3, miss=0.01)
    assert advise(0.2, 0.2, sources(*equal)).method == "deception"
    # Two seeds say nothing of a training, however well they follow; at one of two levels is not everywhere.
    few = cell("none", 0.2, 2, seeds=2), cell("deception", 0.2, 5)
    assert advise(0.2, 0.2, sources(*few)).method == "deception"
    few = advise(0.2, 0.2, sources(cell("none", 0.2, 2, seeds=2)))
    assert not few.covered and "is not known" in few.coverage and "fewer than 3 seeds do not tell" in few.coverage


def test_told_is_shown_and_never_chosen() -> None:
    """The robot has to tell its friction: what follows best with it is no training for a robot that does not."""
    told = advise(0.2, 0.2, sources(cell("deception", 0.2, 0), cell("told", 0.2, 5)))
    assert told.method == "deception" and not told.covered
    assert "Other methods: told, which the robot has to tell its friction, 5 of 5 seeds at 20 %." in told.comparison


def test_the_text_is_answer_evidence_transfer_and_limits() -> None:
    """Elsewhere the tested level nearest to the top counts, of the advised method alone."""
    there = (
        *(cell("deception", 0.1, 5, "physx"), cell("deception", 0.24, 3, "physx"), cell("none", 0.2, 0, "physx")),
        replace(cell("deception", 0.2, 1, "physx+all", seeds=1), friction_law="real"),
        replace(cell("deception", 0.2, 0, "ode"), friction_law="load"),
    )
    told = advise(0.2, 0.2, sources(*FIVE, *there), "go2")
    assert told.command == "stiction train --friction-from training.json --preset quick"
    assert told.flags == "--method deception --friction-level 0.2"
    assert told.coverage == (
        "It covers 20 %: in the simulator of the training every command is followed by 5 of 5 seeds at 20 %. All of "
        "this is of the hexapod Saturn Lite, on flat ground, under Coulomb friction, in simulation; of Go2 nothing is "
        "known directly."
    )
    assert told.comparison == (
        "Other methods: none 0 of 5 seeds at 20 %. The advised policies elsewhere: on virtual robots 1 of 1 seeds at "
        "20 %; in PhysX 3 of 5 seeds at 24 % (worst wz=1: too slow)."
    )
    assert told.settings == {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    assert told.range == [0.0, pytest.approx(0.24)] and told.to_dict()["elsewhere"][1]["engine"] == "physx"
    alone = advise(0.15, 0.15, sources(*FIVE), "saturn_lite")
    assert alone.comparison.endswith("elsewhere: they have not walked there.")
    assert alone.coverage.endswith("in simulation.")


def test_the_package_s_file_is_that_of_the_results() -> None:
    """Somebody edited the file, or forgot to write it after the results changed, where this fails."""
    commands = pytest.importorskip("stiction_experiments.friction.commands", reason="the extra 'train' is needed")
    from stiction.files.following import count_commands
    from stiction.files.results import read_summary
    from stiction.robots.catalog import find_robot
    from stiction_experiments.replication import run

    part = shipped()[TRAINING]
    rows = commands.read_tables(next(RESULTS.rglob(name)) for name in part.tables)
    assert [asdict(count) for count in part.cells] == [
        asdict(count) for count in count_commands(rows, commands.way_of) if count.method in part.methods
    ]
    assert set(part.policies) == {row.policy for row in rows if commands.way_of(row) in part.methods}
    summary = read_summary(RESULTS / "replication" / "summary.json")
    records = [run._record(name, part, summary["grids"][name]) for name, part in summary["parts"].items()]
    assert shipped()[TRANSFER] == run.source_of(run.judged(records, find_robot("saturn_lite"), summary))
