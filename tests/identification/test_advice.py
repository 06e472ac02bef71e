"""Advised training, from counts made by hand; the counts are those of the results."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stiction.files.advice import TRAINING, Source, TrainedWith
from stiction.files.following import CommandCount
from stiction.files.joints import Estimate, JointRecord
from stiction.identification.advice import CONDITIONS, REFERENCE, SOURCES, advise, place, shipped

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
    ("low", "high", "claim"),
    [
        (0.1, 0.2, "It covers 20 %: in the simulator of the training every command is followed by 5 of 5 seeds at 10 "
                   "%, 5 of 5 seeds at 20 %."),
        (0.15, 0.15, "Whether it covers 15 % is not known: in the simulator of the training every command is followed "
                     "by 5 of 5 seeds at 10 %, 5 of 5 seeds at 20 %; nothing was walked between."),
        (0.3, 0.3, "It nearly covers 30 %, 72 of 75 pairs of seed and command: in the simulator of the training every "
                   "command is followed by 4 of 5 seeds at 30 %; the worst at 30 % is wz=1: too slow."),
        (0.2, 0.25, "Whether it covers 25 % is not known: in the simulator of the training every command is followed "
                    "by 5 of 5 seeds at 20 %, 4 of 5 seeds at 30 %; the worst at 30 % is wz=1: too slow; nothing was"),
        (0.35, 0.35, "It does not cover 35 %: in the simulator of the training every command is followed by 4 of 5 "
                     "seeds at 30 %, 0 of 5 seeds at 40 %; the worst at 40 % is wz=1: too slow; nothing was walked"),
        (0.4, 0.45, "It does not cover 45 %: in the simulator of the training every command is followed by 0 of 5 "
                    "seeds at 40 %; the worst at 40 % is wz=1: too slow; beyond 40 % nothing was walked."),
    ],
)  # fmt: skip
def test_a_friction_is_covered_only_where_every_seed_follows_every_command(low: float, high: float, claim: str) -> None:
    """Tested at 0, 10, 20, 30 and 40 %: at 40 % no seed follows, and no level between and beyond was walked."""
    told = advise(low, high, sources(*FIVE))
    assert told.method == "deception" and claim in told.coverage
    assert told.covered is told.to_dict()["covered"] is claim.startswith("It covers ")


def test_a_level_above_a_gap_is_not_all_below_it() -> None:
    """With every seed at 40 % and not at 30 %, 40 % is covered and lower levels are not."""
    told = advise(0.32, 0.4, sources(*FIVE[:-1], cell("deception", 0.4, 5)))
    assert not told.covered and told.coverage.startswith("It covers 40 %, and not all below it: ")


def test_covered_comes_before_share_and_share_before_miss() -> None:
    """A method with all seeds at every level wins; else the larger share of cells, then the smaller mean miss."""
    assert advise(0.2, 0.2, sources(cell("none", 0.2, 5), cell("deception", 0.2, 4))).method == "none"
    near = cell("none", 0.2, 0, followed=74), cell("deception", 0.2, 3, followed=70)
    assert advise(0.2, 0.2, sources(*near)).method == "none"
    equal = cell("none", 0.2, 3, miss=0.02), cell("deception", 0.2, 3, miss=0.01)
    assert advise(0.2, 0.2, sources(*equal)).method == "deception"
    # Within 5 % of the best share, where nobody follows all, the wider range: other joints may have less friction.
    alike = cell("none", 0.2, 3, followed=73), cell("deception", 0.2, 2, followed=70)
    assert advise(0.2, 0.2, sources(*alike)).method == "deception"
    # Two seeds say nothing of a training, however well they follow; at one of two levels is not everywhere.
    few = cell("none", 0.2, 2, seeds=2), cell("deception", 0.2, 5)
    assert advise(0.2, 0.2, sources(*few)).method == "deception"
    few = advise(0.2, 0.2, sources(cell("none", 0.2, 2, seeds=2)))
    assert not few.covered and "is not known" in few.coverage and "fewer than 3 seeds do not tell" in few.coverage


def test_nearly_covered_is_95_per_cent_and_no_large_miss() -> None:
    """72 of 75 with a miss of 0.05 m/s is nearly; with one of 0.11, or 71 of 75, or two seeds, it is not."""
    for changes, nearly in (({}, True), ({"largest_miss": 0.11}, False), ({"followed": 71}, False)):
        told = advise(0.2, 0.2, sources(cell("deception", 0.2, 4, **changes)))
        assert told.coverage.startswith("It nearly covers 20 %, 72 of 75") is nearly and not told.covered
    assert "nearly" not in advise(0.2, 0.2, sources(cell("deception", 0.2, 1, seeds=2, followed=29))).coverage


def test_two_are_named_where_seeds_do_not_tell_them_apart() -> None:
    """15 against 12 by every seed is p = 2/252; with one seed of each exchanged it is 52/252."""
    clear = cell("deception", 0.2, 5, each="15 15 15 15 15"), cell("none", 0.2, 0, each="12 12 12 12 12")
    assert advise(0.2, 0.2, sources(*clear)).as_good == {}
    mixed = cell("deception", 0.2, 4, each="15 15 15 15 12"), cell("none", 0.2, 1, each="12 12 12 12 15")
    told = advise(0.2, 0.2, sources(*mixed))
    assert told.as_good == {"none": pytest.approx(52 / 252)}
    assert "; by its seeds it cannot be told from none (p = 0.21). All of this" in told.coverage
    # Seeds that are not known one by one, and a method that the robot has to tell its friction, are not compared.
    assert advise(0.2, 0.2, sources(cell("deception", 0.2, 5), cell("none", 0.2, 5))).as_good == {}
    assert advise(0.2, 0.2, sources(clear[0], cell("told", 0.2, 5, each="15 15 15 15 15"))).as_good == {}


def test_of_trainings_that_are_alike_the_better_one_elsewhere_is_advised() -> None:
    """Both follow four of five in training; in PhysX `none` follows more at 20 %, and less at 10 %."""
    both = [cell(name, level, 4) for name in ("deception", "none") for level in (0.1, 0.2)]
    away = [
        cell(name, level, seeds, "physx")
        for name, walked in (("deception", (5, 2)), ("none", (1, 4)))
        for level, seeds in zip((0.1, 0.2), walked, strict=True)
    ]
    apart = cell("deception", 0.2, 0, "ode")
    assert advise(0.2, 0.2, sources(*both, *away, apart)).method == "none"
    assert advise(0.1, 0.2, sources(*both, *away, apart)).method == "deception"


def test_told_is_shown_and_never_chosen() -> None:
    """A policy that observes friction is shown and never advised for a robot that does not tell its friction."""
    told = advise(0.2, 0.2, sources(cell("deception", 0.2, 0), cell("told", 0.2, 5)))
    assert told.method == "deception" and not told.covered
    assert "Other methods: told, which the robot has to tell its friction, 5 of 5 seeds at 20 %." in told.comparison


def test_the_text_is_answer_evidence_transfer_and_limits() -> None:
    """Elsewhere the levels about the top are told, of every method, the advised one first."""
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
        "Other methods: none 0 of 5 seeds at 20 %. Elsewhere: in PhysX deception 5 of 5 seeds at 10 %, 3 of 5 seeds at "
        "24 % (worst wz=1: too slow), none 0 of 5 seeds at 20 %; on virtual robots deception 1 of 1 seeds at 20 %, not "
        "walked: none."
    )
    assert told.settings == {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    assert told.range == [0.0, pytest.approx(0.24)] and told.to_dict()["elsewhere"][1]["engine"] == "physx"
    alone = advise(0.15, 0.15, sources(*FIVE), "saturn_lite")
    assert alone.comparison.endswith("Elsewhere: nobody has walked there.")
    assert alone.coverage.endswith("in simulation.")


def test_the_package_s_file_is_that_of_the_results() -> None:
    """Somebody edited the file, or forgot to write it after the results changed, where this fails."""
    commands = pytest.importorskip("stiction_experiments.paper.counts", reason="the extra 'train' is needed")
    from stiction.files.following import count_commands

    part = shipped()[TRAINING]
    rows = commands.read_tables(next(RESULTS.rglob(name)) for name in part.tables)
    assert [asdict(count) for count in part.cells] == [
        asdict(count) for count in count_commands(rows, commands.way_of) if count.method in part.methods
    ]
    assert set(part.policies) == {row.policy for row in rows if commands.way_of(row) in part.methods}


def test_every_entry_has_a_source_and_a_condition() -> None:
    """Every entry has a source and a condition."""
    assert {entry.source for entry in REFERENCE} == set(SOURCES)
    assert {entry.condition for entry in REFERENCE} == set(CONDITIONS)
    assert len({entry.robot for entry in REFERENCE}) >= 7
    assert all(entry.note and 0 < entry.friction < entry.torque_limit for entry in REFERENCE)


def test_the_papers_ratios_come_out_of_its_table() -> None:
    """0.0481 of 35.55 N m is 0.135 %, 0.442 of 45 is 0.982 %; the paper prints 0.13 and 0.98 %."""
    paper = {entry.robot: 100 * entry.friction_ratio for entry in REFERENCE if entry.source == "paper"}
    assert paper == {"Unitree Go1": pytest.approx(0.1353, abs=1e-4), "Saturn Lite": pytest.approx(0.9822, abs=1e-4)}


def test_dead_bands_are_compared_where_the_gain_is_known() -> None:
    """Go2 hip: 0.16 N m at kp 20 is 0.008 rad; the AlienGo has no gain and is not counted."""
    about = Estimate(0.009, 0.001, (0.0075, 0.0105))
    record = JointRecord(friction_ratio=about, dead_band=about, test_condition="in_air")
    band, ratio = place(record, "dead_band"), place(record, "friction_ratio")
    assert band is not None and ratio is not None
    known = [entry for entry in REFERENCE if entry.condition == "in_air" and entry.kp is not None]
    assert (band.below, band.count) == (1, len(known)) and band.count < ratio.count
    assert band.text == (
        "Its f/kp is between Unitree Go2 hip (0.008 rad) and Unitree Go2 thigh (0.0097 rad) of 6 public joints "
        "measured on a leg in the air, 2 of them within its interval."
    )


def test_the_ends_of_the_ranking_are_named() -> None:
    """Above the largest and below the smallest; a linear axis, and a joint of no stated condition, has no rank."""
    for value, where in ((0.5, "above Dynamixel MX-64 servo (1.2 %), the largest,"), (1e-4, "below Dynamixel MX-106")):
        record = JointRecord(friction_ratio=Estimate(value, 0.0, (value, value)), test_condition="loaded")
        rank = place(record, "friction_ratio")
        assert rank is not None and f"is {where}" in rank.text and rank.text.endswith("measured under load.")
        for unknown in ({"test_condition": None}, {"axis": "linear"}, {"friction_ratio": None}):
            assert place(replace(record, **unknown), "friction_ratio") is None
