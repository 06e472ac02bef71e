"""Policies that observe their joints' friction receive the value of the chosen source on each robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.evaluation import benches
from stiction.evaluation.benches import true_friction, unidentified_notes, with_known_friction
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, plan
from stiction.evaluation.summary import evaluate_all
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.observation import proprioception
from stiction.robots.catalog import find_robot
from stiction.virtual.bench import Bench
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SPEC = find_robot("saturn_lite")
BASE = EvaluationCfg((0.0, 0.1), ("vx=0.5",), episodes=1, seconds=1.5, settle=0.5)
GRID = GridCfg(BASE, ("mujoco", "mujoco-alone", "mujoco-alone+all"), robots=(3, 4), robot_levels=("0.1",))
FOUND = {"hip": 1.0, "thigh": 2.0, "shank": 9.0}
"""Friction identified on every bench [N m]: 4, 8 and 20 % of the torque limits."""


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Bundle]:
    """A policy that observes its joints' friction, and one that does not; both hardly move."""
    told = {"hip": 0.2, "thigh": 0.2, "shank": 0.2}
    contracts = {
        "listener": make_contract(observation=proprioception(18, known_kinds=3), known_friction=told),
        "other": make_contract(),
    }
    folder = tmp_path_factory.mktemp("b")
    return [
        read_bundle(make_bundle(folder / name, contract, make_network(contract, gain=1e-3)))
        for name, contract in contracts.items()
    ]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let benches identify `FOUND`, except robot 4's thighs and ML_hip; return the robots on a bench."""
    seen: list[str] = []

    def make(bench: Bench, folder: Path, workers: int) -> None:
        seen.append(bench.label)
        folder.mkdir(parents=True)
        joints = {}
        for name in SPEC.joint_names:
            value = FOUND[name[3:]]
            unknown = bench.case.seed == 4 and (name.endswith("thigh") or name == "ML_hip")
            joints[name] = JointRecord(coulomb_friction=None if unknown else Estimate(value, 0.1, (0.0, 10.0)))
        JointsFile(joints).write(folder / "joints.json")

    monkeypatch.setattr("stiction.virtual.bench.identify_on_bench", make)
    monkeypatch.setattr(benches, "has_entry", lambda folder, key: (folder / "joints.json").is_file())
    return seen


def told(bundles: list[Bundle], text: str, out: Path) -> dict[tuple[str, str, int | None], tuple[float, ...] | None]:
    """Return the friction observed by the listener, by engine, level and robot."""
    cfg = replace(GRID, base=replace(BASE, known_friction=text))
    walks = with_known_friction(plan([bundle.name for bundle in bundles], cfg), bundles, cfg, out)
    assert all(walk.known is None for walk in walks if walk.policy == "other")
    mine = [walk for walk in walks if walk.policy == "listener"]
    return {(walk.simulator.label, walk.level, walk.robot): walk.known for walk in mine}


def test_on_the_data_sheet_the_truth_is_the_level_and_on_a_virtual_robot_its_own(
    bundles: list[Bundle], tmp_path: Path, seen: list[str]
) -> None:
    """The true friction needs no bench; two virtual robots of one level have different joints."""
    observed = told(bundles, "true", tmp_path)
    for engine in ("mujoco", "mujoco-alone"):
        np.testing.assert_allclose(observed[engine, "0.1", None], [0.1] * 3)
        np.testing.assert_allclose(observed[engine, "0", None], [0.0] * 3)
    shares = [draw(SPEC, robot).friction.share for robot in (3, 4)]
    for robot, share in zip((3, 4), shares, strict=True):
        expected = [0.1 * share[kind::3].mean() for kind in range(3)]
        np.testing.assert_allclose(observed["mujoco-alone+all", "0.1", robot], expected)
        assert np.mean(observed["mujoco-alone+all", "0.1", robot]) == pytest.approx(0.1)
    assert not seen and observed["mujoco-alone+all", "0.1", 3] != observed["mujoco-alone+all", "0.1", 4]
    without = Case(3, "rest", parse_level("0"))
    np.testing.assert_array_equal(true_friction(without, SPEC), np.zeros(3))


def test_a_virtual_robot_is_told_what_its_own_bench_found(
    bundles: list[Bundle], tmp_path: Path, seen: list[str]
) -> None:
    """Each robot once, 4, 8 and 20 %; unknown thighs have the nominal friction, an unknown hip the other hips'."""
    observed = told(bundles, "bench", tmp_path)
    assert seen == [f"saturn_lite--mujoco--all--0.1--{robot}" for robot in (3, 4)]
    np.testing.assert_allclose(observed["mujoco-alone+all", "0.1", 3], [0.04, 0.08, 0.2])
    np.testing.assert_allclose(observed["mujoco-alone+all", "0.1", 4], [0.04, 0.2, 0.2])
    np.testing.assert_allclose(observed["mujoco-alone", "0.1", None], [0.1] * 3)
    wrong = told(bundles, "bench*0.5", tmp_path)
    np.testing.assert_allclose(wrong["mujoco-alone+all", "0.1", 3], [0.02, 0.04, 0.1])
    assert len(seen) == 2


def test_what_the_bench_did_not_tell_is_in_the_summary(bundles: list[Bundle], tmp_path: Path, seen: list[str]) -> None:
    """The summary has two notes on robot 4, none on robot 3 or the blind policy, and each observed friction."""
    cfg = replace(GRID, engines=("mujoco-alone+all",), base=replace(BASE, known_friction="bench"))
    assert unidentified_notes(plan(["listener", "other"], cfg), bundles, cfg, tmp_path / "bench") == []
    _, summary = evaluate_all(bundles, cfg, tmp_path)
    notes = [text for text in summary["warnings"] if "not identified" in text]
    assert len(notes) == 2 and all(
        text.startswith("friction of saturn_lite--mujoco--all--0.1--4 for listener: ") for text in notes
    )
    assert "ML_hip was not" in notes[0] and "nominal friction of training is taken, 20 %" in notes[1]
    mine, other = summary["rows"]
    assert mine["known_friction"]["3"] == pytest.approx((0.04, 0.08, 0.2)) and "known_friction" not in other
    assert summary["evaluation"]["known_friction"] == "bench"
