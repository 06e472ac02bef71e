"""Evaluation: rows for every level and command, reproducible; rejects invalid conditions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import linear_network, make_bundle, make_contract
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.evaluation.evaluate import EvaluationCfg, evaluate_bundle
from stiction.evaluation.walk_logs import RecordCfg, record_walks
from stiction.files.bundle import Bundle

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")

SHORT = EvaluationCfg(friction_levels=(0.0, 0.3), episodes=2, seconds=2.0, settle=0.5)


@pytest.fixture
def checked(bundle: Path) -> Bundle:
    """A bundle of a random network."""
    return check_bundle(bundle).bundle


def test_a_row_for_every_level_and_command_in_order(checked: Bundle) -> None:
    """Rows have every level and command once, in order."""
    result = evaluate_bundle(checked, SHORT)
    labels = [(row.friction_level, row.command, row.episodes, row.policy) for row in result.rows]
    expected = [(level, command, 2, "toy") for level in (0.0, 0.3) for command in ("vx=0.5", "vx=-0.5")]
    assert labels == expected
    assert [set(metrics.summary_only) for metrics in result.metrics] == [
        {"group_share", "moving_share", "mean_friction", "crossed"}
    ] * 4


def test_a_law_is_evaluated_whatever_the_policy_was_trained_with(checked: Bundle) -> None:
    """Coulomb: 0.3 of limits of 25, 25 and 45 N m. Rows, logs and levels say which law."""
    torques = [metrics.mean_friction for metrics in evaluate_bundle(checked, SHORT).metrics]
    assert torques == pytest.approx([0.0, 0.0, 9.5, 9.5])
    cfg = replace(SHORT, friction_law="load", friction_levels=(0.0, 0.05), commands=("vx=0.5",))
    result = evaluate_bundle(checked, cfg)
    assert {row.friction_law for row in result.rows} == {"load"}
    none, some = (metrics.mean_friction or 0.0 for metrics in result.metrics)
    assert none == 0.0 and 1.0 < some < 6.0
    walk = record_walks(checked, cfg, RecordCfg(robots=1, seconds=1.0))[1]
    assert (walk.law, walk.file_name) == ("load", "load-0.05--vx=0.5--0.npz")


def test_a_policy_that_lies_down_falls(tmp_path: Path) -> None:
    """A network that folds the shanks as far as they go counts as fallen."""
    contract = make_contract()
    weights = np.zeros((contract.observation.size, 18), np.float32)
    command = 10 * contract.observation.frame_size + 6
    weights[command, 2::3] = -100.0
    weights[command, 1::3] = 100.0
    bundle = check_bundle(make_bundle(tmp_path / "lying", contract, linear_network(onnx, weights))).bundle
    cfg = EvaluationCfg(friction_levels=(0.0,), commands=("vx=0.5", "stand"), episodes=2, seconds=3.0, settle=0.5)
    lying, standing = evaluate_bundle(bundle, cfg).rows
    assert lying.fall_rate == 1.0
    assert standing.fall_rate == 0.0
    assert standing.tracking_error < 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"friction_levels": (0.95,)}, "friction level"),
        ({"friction_levels": (0.95,), "friction_law": "load"}, "coefficients"),
        ({"friction_law": "rust"}, "friction law"),
        ({"friction_levels": (0.1, 0.1)}, "each once"),
        ({"commands": ("vx=0.5", "vx=.5")}, "each once"),
        ({"seconds": 2.5}, "at least 1 s"),
        ({"settle": -1.0}, "settle"),
        ({"action_delay": float("nan")}, "action delay"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(change: dict, message: str) -> None:
    """One clear line before any physics runs."""
    with pytest.raises(StictionError, match=message):
        EvaluationCfg(**change)


def test_more_robots_at_once_than_memory_holds_are_refused(checked: Bundle) -> None:
    """2 levels, 2 commands and 6000 episodes of 20 s are 480 000 robot-seconds; none is simulated."""
    cfg = EvaluationCfg(friction_levels=(0.0, 0.1), episodes=6000)
    with pytest.raises(StictionError, match="24000 robots at once for 20 s each are more than 400000 robot-seconds"):
        evaluate_bundle(checked, cfg)
