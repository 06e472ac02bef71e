"""Verdicts on the paper's sentences: from several seeds, by stated thresholds, and none from one."""

from __future__ import annotations

import pytest

from stiction.core.errors import StictionError
from stiction_experiments.gait.claims import judge, seed_means
from stiction_experiments.gait.measure import BOTH, NEITHER, NO_TROT, NO_UNSYNC, GaitRow, trained_variant


def row(
    variant: str, seed: int, together: float = 0.0, sided: float = 0.0, moving: float = 1.0, command: str = "vx=0.5"
):
    """Return one row with what the sentences are about."""
    shares = (0.8, 0.4, 0.4, 0.0, 0.0, together, 0.9, -0.9, sided)
    return GaitRow(f"{variant}-{seed}", variant, seed, command, "tripod", 1.0, 0.0, moving, *shares)


def rows(**numbers: list[tuple[float, float]]) -> list[GaitRow]:
    """Return rows of variants with `-` as `_`; numbers: together share and one-sidedness of seeds 0, 1, ..."""
    return [
        row(name.replace("_", "-"), seed, *pair) for name, pairs in numbers.items() for seed, pair in enumerate(pairs)
    ]


def outcomes(made: list[GaitRow]) -> list[str]:
    """Return what became of each sentence."""
    return [verdict.outcome for verdict in judge(made)]


def test_the_interval_decides() -> None:
    """0.7, 0.8, 0.9: mean 0.8, standard deviation 0.1, t(2) = 4.3027, interval 0.5516 to 1.0484; a pronk has 0.5."""
    assert outcomes(rows(neither=[(0.7, 0.0), (0.8, 0.0), (0.9, 0.0)]))[0] == "reproduces"
    assert outcomes(rows(neither=[(0.6, 0.0), (0.7, 0.0), (0.8, 0.0)]))[0] == "undecided"
    assert outcomes(rows(neither=[(0.1, 0.0), (0.1, 0.0)]))[0] == "does not"


def test_the_papers_story_reproduces() -> None:
    """Pronk without both and without r_trot, hop without r_unsync, none of it with both, in three seeds each."""
    made = rows(
        both=[(0.0, 0.1)] * 3,
        no_trot=[(0.9, 0.0), (0.95, 0.0), (1.0, 0.0)],
        no_unsync=[(0.0, 0.9)] * 3,
        neither=[(0.9, 0.2)] * 3,
    )
    assert outcomes(made) == ["reproduces"] * 3


def test_one_seed_decides_nothing_and_no_seed_is_not_tested() -> None:
    """However clear its number is."""
    made = rows(both=[(0.0, 0.0)] * 3, no_trot=[(1.0, 0.0)])
    assert outcomes(made) == ["not tested", "not tested", "not tested"]
    assert "one seed" in judge(made)[1].evidence


def test_a_mixture_of_trainings_has_no_verdict() -> None:
    """Policies that differ in more than their gait rewards would blame the rewards for it."""
    made = rows(neither=[(0.9, 0.0)] * 3)
    assert judge(made)[0].outcome == "reproduces"
    assert {verdict.outcome for verdict in judge(made, alike=False)} == {"not tested"}


def test_commands_are_averaged_by_seed_and_standing_is_left_out() -> None:
    """0.2 and 0.6 are 0.4 for one seed, not two samples; a robot that stands has no gait."""
    made = [
        row(NEITHER, 0, 0.2),
        row(NEITHER, 0, 0.6, command="vx=-0.5"),
        row(NEITHER, 1, 0.9, moving=0.1),
        row(BOTH, 0, 0.7),
    ]
    assert seed_means(made, NEITHER, "together_share") == {0: pytest.approx(0.4)}
    assert "standing still: seed 1" in judge(made)[0].evidence


@pytest.mark.parametrize(
    ("options", "variant"),
    [
        ("", BOTH),
        ("--set task.rewards.trot=0", NO_TROT),
        ("--set task.rewards.trot=0 --set task.rewards.unsync=0.0", NEITHER),
        ("--task.rewards.trot 0", NO_TROT),
        ("--seed 3 --task.rewards.unsync=0.0", NO_UNSYNC),
        ("--task.rewards.trot 0 --task.rewards.unsync 0 --out runs/x", NEITHER),
        ("--task.rewards.trot 0 --task.rewards.trot 1", BOTH),
    ],
)
def test_the_training_command_tells_the_variant(options: str, variant: str) -> None:
    """A wrong label would turn the ablation upside down."""
    assert trained_variant(f"stiction train --method none {options}") == variant


@pytest.mark.parametrize("command", ["made by hand", "stiction train --resume runs/x"])
def test_a_command_that_does_not_tell_is_refused(command: str) -> None:
    """The default would be a guess."""
    with pytest.raises(StictionError, match="--variants"):
        trained_variant(command)
    with pytest.raises(StictionError, match="expected a number"):
        trained_variant("stiction train --set task.rewards.trot=none")
