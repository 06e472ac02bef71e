"""The rules of judging, an example for every outcome."""

import numpy as np
import pytest

from stiction_experiments.lab.claims import Finding, all_of, within

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
    assert within("direct", points, -np.inf, 0.2).outcome == outcome


def test_evidence_shows_mean_interval_and_every_seed() -> None:
    """Evidence has mean, interval and every seed: 1, 2, 3 have the interval 2 ± 2.48."""
    assert within("x", {0: 1.0, 1: 2.0, 2: 3.0}, 0, 1).evidence == "x 2.00 [-0.48, 4.48] (1.00, 2.00, 3.00)"
    assert within("x", {4: 1.0}, 0, 1).evidence == "x 1.00 (one seed)"


def test_several_things_at_once() -> None:
    """All parts must hold; one refuted part refutes, one untested part leaves untested."""
    assert all_of(HOLDS, HOLDS).outcome == "reproduces"
    assert all_of(HOLDS, NONE, FAILS).outcome == "does not"
    assert all_of(HOLDS, OPEN).outcome == "undecided"
    assert all_of(HOLDS, OPEN, NONE).outcome == "not tested"
