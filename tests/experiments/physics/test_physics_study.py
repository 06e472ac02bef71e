"""The comparison of physics: same starts in each, evaluation's numbers on rows, and distances worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import StictionError
from stiction.deploy.policy import load_policy
from stiction.evaluation.rollout import Rollout, friction_at
from stiction.files.bundle import read_bundle
from stiction.files.contract import robot_of
from stiction.robots.physics import EXACT
from stiction_experiments.physics import walks as physics_study
from stiction_experiments.physics.config import WalkCfg
from stiction_experiments.physics.walks import REFERENCE, PhysicsRow, bias, compare


def test_every_physics_has_the_same_walks(bundle: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two names for one physics give the same numbers: a difference is one of physics."""
    monkeypatch.setattr(physics_study, "SETTINGS", {name: (EXACT, 0.005) for name in (REFERENCE, "rows")})
    cfg = WalkCfg((0.0, 0.2), episodes=2, seconds=3.0)
    rows = compare({"toy": read_bundle(bundle)}, cfg)
    assert [(row.physics, row.level, row.direction) for row in rows] == [
        (physics, level, direction)
        for physics in (REFERENCE, "rows")
        for level in (0.0, 0.2)
        for direction in ("forward", "backward")
    ]
    for one, other in zip(rows[:4], rows[4:], strict=True):
        assert (one.speed_ratio, one.standard_error, one.falls) == (
            other.speed_ratio,
            other.standard_error,
            other.falls,
        )


def test_a_step_that_is_named_keeps_the_control_period(bundle: Path) -> None:
    """A tenth of the step, ten times as many: the policy must be asked as often."""
    data = read_bundle(bundle)
    contract = data.contract

    def rollout(**changes: float) -> Rollout:
        policy = load_policy(contract, data.policy, (1,))
        friction = friction_at(contract, np.zeros(1))
        return Rollout(contract, policy, robot_of(contract), friction, [np.random.default_rng(0)], **changes)

    plain, fine = rollout().fleet, rollout(timestep=contract.physics_timestep / 10).fleet
    assert (plain.timestep, plain.decimation) == (contract.physics_timestep, contract.decimation)
    assert (fine.timestep, fine.decimation) == (contract.physics_timestep / 10, 10 * contract.decimation)


def test_distances_leave_out_stalls_and_falls() -> None:
    """At its stall a policy's speed is decided by little; a fallen robot has none."""

    def row(physics: str, level: float, ratio: float, falls: int = 0) -> PhysicsRow:
        return PhysicsRow(physics, "p", level, "forward", ratio, 0.01, falls)

    ratios = {0.0: (1.0, 0.75, 0.5), 0.1: (0.9, 0.8, 0.8), 0.2: (0.2, 0.6, 0.9)}
    rows = [row(REFERENCE, level, fine) for level, (fine, _, _) in ratios.items()]
    rows += [row("rows", level, coarse) for level, (_, coarse, _) in ratios.items()]
    for name in physics_study.SETTINGS:
        if name not in (REFERENCE, "rows"):
            rows += [row(name, level, fast, falls=level == 0.0) for level, (_, _, fast) in ratios.items()]
    biases = bias(rows)
    assert biases["rows"] == pytest.approx(
        {
            "largest_from_rows": 0.0,
            "mean_from_rows": 0.0,
            "largest_from_reference": 0.25,
            "mean_from_reference": 0.175,
        }
    )
    assert biases["plastic"]["largest_from_reference"] == pytest.approx(0.1)
    assert biases["plastic"]["largest_from_rows"] == pytest.approx(0.0)


def test_what_cannot_be_walked_is_refused() -> None:
    """One line that says what was expected."""
    for wrong in ({"friction_levels": ()}, {"friction_levels": (9.0,)}, {"episodes": 1}, {"seconds": 2.0}):
        with pytest.raises(StictionError, match="expected"):
            WalkCfg(**wrong)
