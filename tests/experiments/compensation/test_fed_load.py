"""Friction fed forward while policies walk: under every law what `stiction evaluate --forward` feeds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.cli.main import main
from stiction.evaluation.benches import fed_at_level, forward_walks
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, Unit, walk_unit
from stiction.evaluation.metrics import combine
from stiction.files.bundle import Bundle, read_bundle
from stiction.joints.compensation import parse_compensation
from stiction_experiments.compensation import walking
from stiction_experiments.compensation.walking import walk_by

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

CFG = EvaluationCfg((0.1, 0.2), ("vx=0.5",), episodes=1, seconds=1.5, settle=0.5)
MEASURED = parse_compensation("measured")


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """A bundle whose network hardly moves: the robot stands."""
    contract = make_contract()
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "still", contract, make_network(contract, gain=1e-3)))


def test_a_level_is_a_torque_or_a_coefficient() -> None:
    """20 % of 25 and 45 N m are 5 and 9 N m; c = 0.2 is 0.2 N m per N m of the motor, and nothing without it."""
    limit = np.array([25.0, 45.0])
    for law in ("coulomb", "stribeck"):
        friction, load = fed_at_level(law, 0.2, limit)
        assert friction == pytest.approx([5.0, 9.0]) and load is None
    friction, load = fed_at_level("effort", np.array([[0.1], [0.2]]), limit)
    assert friction.tolist() == [[0.0, 0.0]] * 2 and load is not None and load.tolist() == [[0.1, 0.1], [0.2, 0.2]]


def torques(still: Bundle, law: str, torque: float, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """Return what is fed at fast joints whose gains ask for a torque [N m], of the robots of both levels, (2, J)."""
    made: list[Any] = []

    def evaluate(bundle: Bundle, cfg: EvaluationCfg, threads: int, compensation: Any) -> SimpleNamespace:
        made.append(compensation)
        return SimpleNamespace(rows=())

    monkeypatch.setattr(walking, "evaluate_bundle", evaluate)
    walk_by(still, replace(CFG, friction_law=law), MEASURED, 1)
    at = np.zeros((2, 18))
    return made[0].torque(at, at, at + 3.0, torque)


def test_friction_that_grows_with_load_is_fed_by_the_torque_of_the_motor(
    still: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 20 N m and a share of 0.75, c = 0.1 is 1.5 N m and c = 0.2 is 3 N m, in every joint; of no torque, none.

    Of Coulomb friction 0.75 of 20 % of 25 and 45 N m, 3.75 and 6.75 N m, whatever the motor does.
    """
    for torque in (20.0, -20.0):
        np.testing.assert_allclose(torques(still, "effort", torque, monkeypatch), [[1.5] * 18, [3.0] * 18])
    np.testing.assert_array_equal(torques(still, "effort", 0.0, monkeypatch), np.zeros((2, 18)))
    np.testing.assert_allclose(torques(still, "coulomb", 20.0, monkeypatch)[1], (3.75, 3.75, 6.75) * 6)


@pytest.mark.parametrize("law", ["coulomb", "effort"])
def test_a_policy_walks_as_stiction_evaluate_walks_it(still: Bundle, tmp_path: Path, law: str) -> None:
    """Two ways to feed the same friction would be two results of one question."""
    cfg = replace(CFG, friction_law=law, friction_levels=(0.2,), episodes=2)
    grid = GridCfg(cfg, forward=("still",), forward_by=("measured",))
    walked = combine(walk_unit(still, Unit(tuple(forward_walks([still], grid, tmp_path))), grid))
    (row,) = walk_by(still, cfg, MEASURED, 1)["rows"]
    (alone,) = walk_by(still, cfg, None, 1)["rows"]
    assert (row["policy"], row["friction_law"]) == ("still+measured", law)
    assert row["speed_ratio"] == pytest.approx(walked.speed_ratio, rel=1e-9)
    assert row["speed_ratio"] != pytest.approx(alone["speed_ratio"], rel=1e-3)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["effort"], "fed forward by error error=0.5 error=0.7 error=1.3 error=1.5 under the law effort: "),
        (["load", "--ways", "reference"], "fed forward by reference under the law load: "),
        (["efort"], "did you mean 'effort'"),
    ],
)
def test_a_law_that_a_way_cannot_feed_is_refused_in_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Fed as a torque, a coefficient would be a friction of 0.2 N m."""
    out = tmp_path / "out"
    assert main(["study", "compensation", "no-such-bundle", "--friction-law", *words, "--out", str(out)]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and not out.exists()
