"""The rules of judging, an example for every outcome."""

import numpy as np
import pytest

from stiction.core.statistics import t_interval
from stiction.evaluation.samples import Condition, Rate
from stiction.files.results import DIRECTIONS
from stiction_experiments.lab.claims import (
    Finding,
    Verdict,
    all_of,
    any_of,
    changed_verdicts,
    follows,
    larger,
    larger_paired,
    over_levels,
    rate_within,
    within,
)
from stiction_experiments.lab.evidence import Evidence, Measurement

HOLDS, FAILS = Finding("reproduces", "yes"), Finding("does not", "no")
OPEN, NONE = Finding("undecided", "perhaps"), Finding("not tested", "nothing")


@pytest.mark.parametrize(
    ("points", "outcome"),
    [
        ({0: 0.05, 1: 0.06, 2: 0.05}, "reproduces"),
        ({0: 0.95, 1: 0.96, 2: 0.95}, "does not"),
        ({0: 0.05, 1: 0.95, 2: 0.5}, "undecided"),
        ({0: 0.05}, "not tested"),
        ({}, "not tested"),
    ],
)
def test_a_mean_within_bounds(points: dict, outcome: str) -> None:
    """Only an interval over seeds that lies wholly on one side of the bound decides."""
    assert within("direct", Measurement(points), -np.inf, 0.2).outcome == outcome


def test_evidence_shows_mean_interval_and_every_seed() -> None:
    """Evidence has mean, interval and every seed: 1, 2, 3 have the interval 2 ± 2.48."""
    assert (
        within("x", Measurement({0: 1.0, 1: 2.0, 2: 3.0}), 0, 1).evidence == "x 2.00 [-0.48, 4.48] (1.00, 2.00, 3.00)"
    )
    assert within("x", Measurement({4: 1.0}), 0, 1).evidence == "x 1.00 (one seed)"


def test_a_difference() -> None:
    """The larger of two means is decided by the interval of their difference."""
    low, high = ("low", Measurement({0: 1.0, 1: 1.1})), ("high", Measurement({0: 2.0, 1: 2.1}))
    assert larger(high, low).outcome == "reproduces" and larger(low, high).outcome == "does not"
    assert larger(("noisy", Measurement({0: 0.0, 1: 3.0})), low).outcome == "undecided"
    assert larger(low, ("one", Measurement({0: 0.0}))).outcome == "not tested"
    same = "same", Measurement({0: 5.0, 1: 5.0})
    assert larger(same, same).outcome == "does not"


def test_pairs_of_seeds() -> None:
    """1, 2, 3 against 0.9, 1.9, 2.9: 0.1 each, lost in the spread between seeds unless policy by policy."""
    first, second = ("a", Measurement({0: 1.0, 1: 2.0, 2: 3.0})), ("b", Measurement({0: 0.9, 1: 1.9, 2: 2.9, 7: 9.0}))
    assert larger_paired(first, second).outcome == "reproduces"
    assert larger(first, second).outcome == "undecided"


def test_robots_must_agree_with_the_seeds() -> None:
    """Over seeds 0.9 and more; over robots 0.9, 0.9, 0.3 have 0.7 ± 4.303 · 0.2: other robots might be slow."""
    seeds = {0: 0.9, 1: 0.91, 2: 0.92}
    for robots, outcome in (
        ({}, "reproduces"),
        ({0: 0.9, 1: 0.91, 2: 0.92}, "reproduces"),
        ({0: 0.9, 1: 0.9, 2: 0.3}, "undecided"),
        ({0: 0.9}, "not tested"),
    ):
        assert within("x", Measurement(seeds, robots), 0.5, 2.0).outcome == outcome
        zero = Measurement(dict.fromkeys(seeds, 0.0), dict.fromkeys(robots, 0.0))
        assert larger_paired(("x", Measurement(seeds, robots)), ("zero", zero)).outcome == outcome


def test_several_things_at_once() -> None:
    """All parts must hold; one refuted part refutes, one untested part leaves untested."""
    assert all_of(HOLDS, HOLDS).outcome == "reproduces"
    assert all_of(HOLDS, NONE, FAILS).outcome == "does not"
    assert all_of(HOLDS, OPEN).outcome == "undecided"
    assert all_of(HOLDS, OPEN, NONE).outcome == "not tested"


def test_one_of_several_things() -> None:
    """One part that holds suffices; all must fail to refute."""
    assert any_of(FAILS, HOLDS, NONE) == HOLDS
    assert any_of(FAILS, OPEN).outcome == "undecided"
    assert any_of(FAILS, OPEN, NONE).outcome == "not tested"
    assert any_of(FAILS, FAILS).outcome == "does not"


@pytest.mark.parametrize(
    ("shares", "trials", "outcome"),
    [
        ((0.0, 0.0, 0.0), 24, "undecided"),  # Wilson: up to 0.138
        ((0.0, 0.0, 0.0), 40, "reproduces"),  # up to 0.088
        ((0.5, 0.5, 0.5), 40, "does not"),
        ((0.0, 0.0, 0.15), 4000, "undecided"),  # over seeds: up to 0.265
        ((0.0,), 4000, "not tested"),
    ],
)
def test_a_rate_is_decided_by_seeds_and_by_trials(shares: tuple, trials: int, outcome: str) -> None:
    """Both the interval over seeds and that over trials must decide."""
    rate = Rate(dict(enumerate(shares)), float(np.mean(shares)) * trials, trials)
    assert rate_within("falls", rate, -np.inf, 0.1).outcome == outcome


def test_no_fall_of_any_seed_is_no_certainty() -> None:
    """No fall in 16 walks of 5 seeds: a point over seeds, and Wilson's 3.8415 / (16 + 3.8415) = 0.1936 over walks."""
    rate = Rate(dict.fromkeys(range(5), 0.0), 0.0, 16)
    assert t_interval([*rate.seeds.values()]) == (0.0, 0.0)
    assert rate.interval == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.1936, abs=1e-4))
    assert rate_within("falls", rate, -np.inf, 0.19).outcome == "undecided"
    assert rate_within("falls", rate, -np.inf, 0.20).outcome == "reproduces"


def test_nothing_walked_has_no_rate() -> None:
    """Zero trials give `not tested`."""
    assert rate_within("falls", Rate({}, 0.0, 0), 0.0, 0.1) == Finding("not tested", "falls not evaluated")


@pytest.mark.parametrize(
    ("findings", "outcome", "start"),
    [
        ([(0.0, FAILS), (0.1, HOLDS), (0.2, HOLDS)], "reproduces", "at 0.1"),
        ([(0.1, FAILS), (0.2, FAILS)], "does not", "at 0.1"),
        ([(0.01, FAILS), (0.1, FAILS), (0.2, HOLDS), (0.3, HOLDS)], "only above x", "x = 0.1; at 0.1: no; at 0.2: yes"),
        (
            [(0.01, FAILS), (0.1, OPEN), (0.2, HOLDS)],
            "only above x",
            "x = 0.01; undecided at 0.1; at 0.01: no; at 0.1: perhaps; at 0.2: yes",
        ),
        ([(0.01, FAILS), (0.1, OPEN), (0.2, FAILS)], "undecided", "is refuted at 0.01, 0.2, undecided at 0.1"),
        (
            [(0.01, FAILS), (0.1, OPEN), (0.2, HOLDS), (0.3, OPEN)],
            "undecided",
            "it holds at 0.2, is refuted at 0.01, undecided at 0.1, 0.3",
        ),
        (
            [(0.01, OPEN), (0.1, FAILS), (0.2, HOLDS)],
            "undecided",
            "it holds at 0.2, is refuted at 0.1, undecided at 0.01",
        ),
        ([(0.1, OPEN), (0.2, HOLDS)], "undecided", "it holds at 0.2, undecided at 0.1; at 0.1: perhaps"),
        ([(0.1, HOLDS), (0.2, FAILS)], "only up to x", "x = 0.1; at 0.1"),
        ([(0.1, HOLDS), (0.2, HOLDS), (0.3, FAILS), (0.4, FAILS)], "only up to x", "x = 0.2; at 0.2: yes; at 0.3: no"),
        ([(0.1, HOLDS), (0.2, OPEN)], "undecided", "it holds at 0.1, undecided at 0.2"),
        (
            [(0.1, HOLDS), (0.2, FAILS), (0.3, OPEN)],
            "undecided",
            "it holds at 0.1, is refuted at 0.2, undecided at 0.3",
        ),
        ([(0.1, HOLDS), (0.2, FAILS), (0.3, HOLDS)], "undecided", "it holds at 0.1, 0.3, is refuted at 0.2; at 0.1"),
        ([(0.1, FAILS), (0.2, OPEN)], "undecided", "is refuted at 0.1, undecided at 0.2"),
        ([(0.1, OPEN), (0.2, OPEN)], "undecided", "at 0.1: perhaps; at 0.2: perhaps"),
        ([(0.1, NONE), (0.2, NONE)], "not tested", "at 0.1: nothing"),
        (
            [(0.1, NONE), (0.2, HOLDS), (0.3, NONE)],
            "reproduces",
            "at 0.2: yes; judged at 0.2 alone, not tested at 0.1, 0.3",
        ),
        ([(0.1, NONE), (0.2, FAILS), (0.3, HOLDS)], "only above x", "x = 0.2; at 0.2: no; at 0.3: yes; judged"),
        ([], "not tested", ""),
    ],
)
def test_over_levels(findings: list, outcome: str, start: str) -> None:
    """Names the friction between refuted and held levels, and the levels that are open or untested."""
    finding = over_levels(findings)
    assert finding.outcome == outcome and finding.evidence.startswith(start)


def test_each_virtual_robot_has_to_be_followed_on() -> None:
    """Two seeds on two robots, at 0.6 and 1.4 or at 0.95 and 1.05: all means are 1.0, and the first follow nowhere."""

    def judged(*ratios: float) -> Finding:
        rows = [
            {
                **{"method": "none", "engine": "physx+all", "friction_law": "real", "friction_level": 0.1},
                **{"terrain": "flat", "command": command, "seed": seed, "speed_ratio": 1.0, "fall_rate": 0.0},
                **{"robots": {str(at): ratio for at, ratio in enumerate(ratios)}, "episodes": len(ratios)},
            }
            for seed in (0, 1)
            for command in DIRECTIONS
        ]
        return follows(Evidence.of(rows), "none", Condition("physx+all", 0.1, "real"), "none")

    apart, near = judged(0.6, 1.4), judged(*[0.95, 1.05] * 4)
    assert apart.outcome == "does not" and "0 of 2 seeds follow, 2 too slow, 2 too fast" in apart.evidence
    assert near.outcome == "reproduces" and "2 of 2 seeds follow" in near.evidence


def test_changes_are_kept_from_the_first_judgement_on() -> None:
    """A change of verdict stays listed when the same rows are judged again."""
    first, second = (
        Verdict("V1", "s", f"asked {n}", outcome, "") for n, outcome in ((1, "undecided"), (2, "does not"))
    )
    change = {"id": "V1", "before": "undecided", "asked_before": "asked 1", "now": "does not", "asked": "asked 2"}
    assert changed_verdicts([first], [second]) == [change]
    assert changed_verdicts([second], [second], [change]) == [change]
    assert changed_verdicts([second], [second]) == [] == changed_verdicts([], [second])
