"""Sentence 11, by hand-computed shares of a few repositories, and the list that was committed."""

import re
from pathlib import Path

import pytest

from stiction.core.records import read_rows
from stiction_experiments.lab.statistics import exact_interval
from stiction_experiments.paper.configurations import Configuration, shares, votes
from stiction_experiments.paper.decide import Test, decide, joined
from stiction_experiments.paper.page import judge
from stiction_experiments.paper.results import Results
from stiction_experiments.paper.rows import Walks

LIST = Path(__file__).parents[3] / "results/paper/configurations.csv"


def repository(
    number: int, joint_friction: str, in_2024: str = "", vote: str = "counts", part: str = "named"
) -> Configuration:
    """Return a row of configurations.csv."""
    texts = ("a.py", "c" * 40, "2025-01-01", "MuJoCo", "Go1")
    return Configuration(
        *(f"owner/{number}", part, vote, *texts, True, joint_friction, "", None, False, in_2024),
        *("d" * 40 if in_2024 else "", ""),
    )


def test_exact_interval_of_a_share():
    """None of ten: 0 to 1 − 0.025^(1/10) = 0.3085. Five of five: 0.025^(1/5) = 0.4782 to 1."""
    assert exact_interval(0, 10) == pytest.approx((0.0, 1 - 0.025**0.1))
    assert exact_interval(5, 5) == pytest.approx((0.025**0.2, 1.0))


def test_a_share_is_decided_where_its_interval_is_on_one_side():
    """One of ten: to 0.445, under one half. Three of ten: to 0.652, open. Ten of ten: from 0.692, over it."""
    tests = [Test("all", {n: float(n < yes) for n in range(10)}, kind="share", bound=0.5) for yes in (1, 3, 10)]
    decisions = decide(tests)
    assert [decision.outcome for decision in decisions] == ["holds", "undecided", "does not hold"]
    assert decisions[0].evidence == "all: 1 of 10, share 0.10 [0.00, 0.45]"
    assert decide([Test("all", {0: 1.0}, kind="share", bound=0.5)])[0].evidence == "all: 1 votes"


def test_a_share_leaves_the_correction_of_its_family():
    """One difference beside two shares is corrected by a factor of one: p = 0.0039 as alone."""
    higher = {10: 0.9, 11: 0.8, 12: 0.85, 13: 0.95, 14: 0.9}
    lower = {10: 0.8, 11: 0.7, 12: 0.65, 13: 0.85, 14: 0.8}
    share = Test("all", dict.fromkeys(range(10), 0.0), kind="share", bound=0.5)
    decisions = decide([share, Test("20 %", higher, lower), share])
    assert [decision.p for decision in decisions] == [None, pytest.approx(0.003883, rel=1e-3), None]
    assert joined(decisions) == "holds"


def test_copies_have_no_vote_and_draws_without_effect_are_a_no():
    """One of ten that count is a yes; in 2024 there were three of them, none a yes."""
    rows = [
        repository(0, "yes", "no"),
        repository(1, "without effect", "without effect"),
        *(repository(number, "no") for number in range(2, 9)),
        repository(9, "no", "no", part="drawn"),
        repository(10, "yes", vote="copy"),
        repository(11, "no", vote="out"),
    ]
    assert sum(votes(rows).values()) == 1.0 and len(votes(rows)) == 10
    assert votes(rows, in_2024=True) == {0: 0.0, 1: 0.0, 9: 0.0}
    assert {each.counted: (each.yes, each.repositories) for each in shares(rows)} == {
        "all": (1, 10),
        "in 2024": (0, 3),
        "named before": (1, 9),
        "drawn by lot": (0, 1),
        "all, and copies": (2, 11),
        "all, draws without effect as a yes": (2, 10),
        "in 2024, draws without effect as a yes": (1, 3),
    }
    judged = {one.number: one for one in judge(Results(Walks(()), configurations=rows))}
    # None of three: to 1 − 0.025^(1/3) = 0.708, over one half.
    assert judged["11"].outcome == "holds: all; undecided: in 2024"


def test_the_list_is_whole():
    """Each repository is listed once, with a commit, and each that counts with its file."""
    rows = read_rows(LIST, Configuration)
    assert len({row.repository.lower() for row in rows}) == len(rows)
    for row in rows:
        assert row.part in ("named", "drawn") and row.vote in ("counts", "copy", "out")
        assert row.joint_friction in ("yes", "no", "without effect")
        assert row.in_2024 in ("yes", "no", "without effect", "")
        assert re.fullmatch("[0-9a-f]{40}", row.commit) and bool(row.in_2024) == bool(row.commit_2024), row.repository
        assert bool(row.path) == (row.vote == "counts") and not (row.in_2024 and row.vote != "counts")
        assert bool(row.joint_friction_range) == (row.vote == "counts" and row.joint_friction != "no")
        assert row.vote != "copy" or row.note.removeprefix("of ") in {one.repository for one in rows}
