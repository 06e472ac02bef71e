"""Onsets, and the axis on which they agree."""

import pytest

from stiction.learning.arguments import parse
from stiction_experiments.friction.evaluation import AXES, axis_scales, collapse, onset_level, onsets
from stiction_experiments.friction.evidence import TrainingEvidence
from stiction_experiments.friction.records import Onset
from synthetic import condition_rows


def test_the_onset_is_interpolated() -> None:
    """0.9 at 10 %, 0.7 at 20 %: 0.8 at 15 %. If it failed, the budget would be read off at the wrong friction."""
    assert onset_level([0.0, 0.1, 0.2], [1.0, 0.9, 0.7]) == pytest.approx(0.15)
    assert onset_level([0.0, 0.1], [1.0, 0.9]) is None
    assert onset_level([0.0, 0.1], [0.5, 0.9]) == 0.0


def test_axes_by_hand() -> None:
    """Shank 45 N m, kp 100, action scale 0.25, σ 0.8: level 0.2 is 0.09 rad, and 9 / 20 of the first actions."""
    scales = axis_scales(parse(["--preset", "two-phase"]).config)
    assert [0.2 * scales[axis] for axis in AXES] == pytest.approx([0.2, 0.09, 0.45])


def variants(**levels: float) -> list[Onset]:
    """Onsets of robots: kp doubled halves what a level is in f/kp and against the first actions."""
    kp = {"base": 1.0, "kp05": 0.5, "kp2": 2.0}
    return [
        Onset(name, "direct", level, dict(zip(AXES, (1.0, 0.45 / kp[name], 2.25 / kp[name]), strict=True)))
        for name, level in levels.items()
    ]


def test_onsets_that_do_not_move_with_kp_agree_on_the_torque_limit() -> None:
    """If this failed, the friction budget would be drawn over the wrong number."""
    found = collapse("direct", variants(base=0.2, kp05=0.2, kp2=0.21))
    assert found.axis == "f/τ_max"
    assert found.spread == pytest.approx({"f/τ_max": 1.05, "f/kp [rad]": 4 / 1.05, "f/(kp·scale·σ)": 4 / 1.05})


def test_onset_is_that_of_the_slower_direction_over_seeds() -> None:
    """Backward, means of two seeds: 0.99 at 0, 0.63 at 20 %, so 0.8 at 0.2 * 0.19 / 0.36; forward is faster."""
    rows = condition_rows("coulomb20-deception", {0.0: (1.2, 1.0), 0.2: (0.9, 0.5)}, backward=0.9)
    cfg = parse(["--preset", "two-phase"]).config
    found = onsets(TrainingEvidence.of_runs(rows), {"coulomb20-deception": cfg})
    assert [o.condition for o in found] == ["coulomb20-deception"]
    assert found[0].level == pytest.approx(0.2 * 0.19 / 0.36)
