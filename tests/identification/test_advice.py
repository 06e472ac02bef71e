"""Which training is advised, from counts made by hand; and that the counts are those of the results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stiction.files.advice import TRAINING, TRANSFER, CommandCount, Source, TrainedWith
from stiction.files.straight import Following
from stiction.identification.advice import advise, shipped

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
