"""A virtual robot is identified from its bench log alone, once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from hinges import Hinges
from stiction.core import cache
from stiction.core.cache import has_entry
from stiction.core.errors import StictionError
from stiction.engines.catalog import ENGINES, EngineSpec
from stiction.files.bam import load_joints
from stiction.robots.catalog import find_robot
from stiction.virtual import bench as identification
from stiction.virtual.bench import Bench, BenchCfg, identify_on_bench
from stiction.virtual.cases import Case, parse_level
from stiction.virtual.hidden import draw
from stiction_experiments.bench import robots as bench_study
from stiction_experiments.bench.robots import IdentifiedFriction, study_benches

SPEC = find_robot("saturn_lite")
SHANKS = tuple(name for name in SPEC.joint_names if name.endswith("shank"))
BENCH = Bench("hinges", Case(3, "friction", parse_level("0.05")), SPEC, BenchCfg(("shank",), 4.0))


@pytest.fixture(autouse=True)
def engines(monkeypatch: pytest.MonkeyPatch) -> list[Hinges]:
    """Build every robot of independent hinges; return those that were built."""
    built: list[Hinges] = []

    def build(*rest) -> Hinges:
        built.append(Hinges(*rest))
        return built[-1]

    monkeypatch.setitem(ENGINES, "hinges", EngineSpec("hinges", build))
    monkeypatch.setattr(bench_study, "missing_engine", lambda name, spec: None)
    return built


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[IdentifiedFriction]]:
    """The study of one robot: its folder, and what was found beside the truth."""
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ENGINES, "hinges", EngineSpec("hinges", Hinges))
        patch.setattr(bench_study, "missing_engine", lambda name, spec: None)
        rows, failed = study_benches([BENCH], out)
    assert not failed
    return out, rows


def test_a_study_holds_what_was_found_against_the_truth_and_keeps_the_truth_to_itself(studied) -> None:
    """Friction of hinges is found within 4 %; the robot's folder has none of the numbers that were drawn."""
    out, rows = studied
    assert [row.joint for row in rows] == list(SHANKS)
    truth = 0.05 * 45.0 * draw(SPEC, 3).friction.share[2::3]
    np.testing.assert_allclose([row.friction for row in rows], truth)
    np.testing.assert_allclose([row.identified for row in rows], truth, rtol=0.04)
    assert [row.strength for row in rows] == [1.0] * 6 and [row.load for row in rows] == [0.0] * 6
    folder = out / BENCH.label
    assert {file.name for file in folder.iterdir()} == {
        *("bench.npz", "bench.json", "joints.json", "training.json", "entry.json"),
    }
    told = "".join(file.read_text() for file in folder.glob("*.json"))
    assert not [value for value in truth if f"{value:.5g}" in told]


def test_what_is_there_is_not_made_again(studied, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Minutes a robot; but what code or robot have changed since must not pass for theirs."""
    out, rows = studied
    copytree(out, tmp_path, dirs_exist_ok=True)
    other = replace(BENCH, case=replace(BENCH.case, seed=4))
    made: list[str] = []

    def counted(bench: Bench, *rest):
        made.append(bench.label)
        return "it is broken"

    monkeypatch.setattr(bench_study, "judge_bench", counted)
    again, failed = study_benches([BENCH, other], tmp_path)
    assert made == [other.label] and failed == {other.label: "it is broken"}
    assert [row.identified for row in again] == pytest.approx([row.identified for row in rows])
    assert has_entry(tmp_path / BENCH.label, BENCH.key)
    assert not has_entry(tmp_path / BENCH.label, replace(BENCH, cfg=BenchCfg(("shank",), 7.0)).key)
    monkeypatch.setattr(cache, "fingerprint", lambda *patterns: {"code": "other"})
    assert not has_entry(tmp_path / BENCH.label, BENCH.key)


def test_a_bench_that_tells_nothing_says_so_in_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Raised, it would end what the robot was put on its bench for; a folder that cannot be written still is."""

    def refuse(log, workers: int) -> None:
        raise StictionError("it hardly moves")

    monkeypatch.setattr(identification, "identify_log", refuse)
    identify_on_bench(BENCH, tmp_path / "robot")
    assert has_entry(tmp_path / "robot", BENCH.key)
    records = load_joints(tmp_path / "robot" / "joints.json").joints
    assert tuple(records) == SHANKS and {one.coulomb_friction for one in records.values()} == {None}
    with pytest.raises(StictionError, match=r"null .* it hardly moves"):
        load_joints(tmp_path / "robot" / "joints.json").nominal(SHANKS, "coulomb_friction")
    (tmp_path / "file").write_text("")
    with pytest.raises(StictionError, match="cannot be written"):
        identify_on_bench(BENCH, tmp_path / "file")
