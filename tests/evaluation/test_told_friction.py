"""Friction observed by policies in an evaluation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bundles import linear_network, make_bundle, make_contract
from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.policies import FrictionSource, known_to, nominal_known, parse_source
from stiction.evaluation.rollout import friction_at
from stiction.evaluation.walk_logs import RecordCfg, record_walks
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.observation import proprioception
from stiction.joints.friction import Law
from stiction.robots.catalog import find_robot

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")
onnx = pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make a test network")

SPEC = find_robot("saturn_lite")
LAYOUT = proprioception(18, known_kinds=3)
CONTRACT = make_contract(observation=LAYOUT, known_friction={"hip": 0.2, "thigh": 0.2, "shank": 0.2})
BASE = EvaluationCfg((0.0, 0.1), ("vx=0.5",), episodes=1, seconds=1.5, settle=0.5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("contract", FrictionSource("contract")),
        ("true", FrictionSource("true")),
        ("true*0.7", FrictionSource("true", 0.7)),
        (" bench*1.3", FrictionSource("bench", 1.3)),
        ("0.15", FrictionSource(0.15)),
    ],
)
def test_what_is_told_is_named_by_a_text(text: str, expected: FrictionSource) -> None:
    """Parses the texts of --known-friction."""
    assert parse_source(text) == expected


@pytest.mark.parametrize(
    "text", ["", "truth", "true*", "true*x", "true*-1", "true*nan", "0.1*2", "contract*2", "1.2", "-1"]
)
def test_what_names_nothing_is_refused(text: str) -> None:
    """Rejects an error factor on a number or on the contract's friction, and unknown names."""
    with pytest.raises(StictionError, match=r"known friction .*expected contract, true, bench"):
        parse_source(text)
    with pytest.raises(StictionError, match="known friction"):
        replace(BASE, known_friction=text)


def told_to(text: str, law: Law | None = None) -> np.ndarray | None:
    """Return the friction observed on robots at 0 and 10 %."""
    law = law or Law()
    friction = friction_at(CONTRACT, np.array([0.0, 0.1]), law)
    return known_to(CONTRACT, SPEC, parse_source(text), law, friction)


def test_robots_of_a_batch_are_told_their_own_level() -> None:
    """The truth, or 30 % off; on the data sheet's robot a bench finds the truth; a number goes to all."""
    np.testing.assert_allclose(told_to("true"), [[0.0] * 3, [0.1] * 3])
    np.testing.assert_allclose(told_to("bench*0.7"), [[0.0] * 3, [0.07] * 3])
    np.testing.assert_allclose(told_to("0.15"), [[0.15] * 3] * 2)
    assert told_to("contract") is None
    other = make_contract()
    assert known_to(other, SPEC, FrictionSource("true"), Law(), friction_at(other, np.array([0.1]))) is None


def test_a_coefficient_is_told_as_in_training() -> None:
    """10 % of the load, a sixth of 31.8 kg x 9.81, over the torque limits."""
    expected = 0.1 * SPEC.mass * 9.81 / 6 / SPEC.joint_values("torque_limit")[:3]
    told = known_to(
        CONTRACT, SPEC, FrictionSource("true"), Law("load"), friction_at(CONTRACT, np.array([0.1]), Law("load"))
    )
    np.testing.assert_allclose(told, [expected])


def test_the_nominal_friction_of_training_is_that_of_the_contract() -> None:
    """20 % in every joint; of unlike joints the mean of each kind: 6 hips of 1 N m, of 25, are 4 %."""
    np.testing.assert_allclose(nominal_known(CONTRACT, SPEC), [0.2] * 3)
    friction = (1.0, 2.5, 4.5) * 6
    level = (0.04 + 0.1 + 0.1) / 3
    np.testing.assert_allclose(
        nominal_known(make_contract(friction=friction, friction_level=level), SPEC), [0.04, 0.1, 0.1]
    )


@pytest.fixture(scope="module")
def listener(tmp_path_factory: pytest.TempPathFactory) -> Bundle:
    """Return a bundle that stands; the action of its hips is five times their observed friction."""
    weights = np.zeros((LAYOUT.size, 18), np.float32)
    weights[-3, ::3] = 1.0
    model = linear_network(onnx, weights)
    return read_bundle(make_bundle(tmp_path_factory.mktemp("b") / "listener", CONTRACT, model))


@pytest.mark.parametrize(
    ("text", "shares"), [("contract", (0.2, 0.2)), ("true", (0.0, 0.1)), ("true*2", (0.0, 0.2)), ("0.1", (0.1, 0.1))]
)
def test_a_policy_walks_on_what_it_is_told(listener: Bundle, text: str, shares: tuple[float, float]) -> None:
    """Robots at 0 and 10 %: the target of each hip is action_scale x 5 f/τ_max from its place, from the first step."""
    asked = replace(BASE, known_friction=text)
    walks = record_walks(listener, asked, RecordCfg(robots=1, seconds=1.0))
    for walk, share in zip(walks, shares, strict=True):
        assert walk.log is not None
        moved = walk.log.joint_target - CONTRACT.array("standing")
        np.testing.assert_allclose(moved[:, ::3], CONTRACT.action_scale * 5 * share, atol=1e-6)
        assert not moved[:, 1::3].any()
