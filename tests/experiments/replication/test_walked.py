"""Parts that are not asked for: what was walked of them stands, and is never replaced by less."""

from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract, make_network
from stiction.core.errors import StictionError
from stiction.evaluation import benches
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, plan, plan_forward
from stiction.files.bundle import Bundle, read_bundle
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.files.observation import proprioception
from stiction.files.results import write_summary
from stiction.robots.catalog import find_robot
from stiction.virtual.bench import Bench
from stiction_experiments.replication import run as walked
from stiction_experiments.replication.page import run_blocks, warnings
from stiction_experiments.replication.plan import Part, Size, parts_of
from stiction_experiments.replication.run import TOLD, replicate

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

FLAT = GridCfg(EvaluationCfg((0.0, 0.1), ("vx=0.5",), episodes=2, seconds=1.0, settle=0.0), ("mujoco",))

FIRST, SECOND = (Part(name, f"The {name} part", FLAT) for name in ("first", "second"))


@pytest.fixture
def still(tmp_path: Path) -> Bundle:
    """A bundle that walks nowhere in particular."""
    return read_bundle(make_bundle(tmp_path / "still", make_contract()))


def test_a_policy_that_is_told_friction_is_told_what_the_bench_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2.5 N m on a bench is 10 % of the limit of hip and thigh; the nominal friction of its training is 20 %.

    Virtual robots tell their benches' friction, and the page says so.
    """
    kinds = {"hip": 0.2, "thigh": 0.2, "shank": 0.2}
    contract = make_contract(observation=proprioception(18, known_kinds=3), known_friction=kinds)
    told = read_bundle(make_bundle(tmp_path / "told", contract, make_network(contract, gain=1e-3)))

    def make(bench: Bench, folder: Path, workers: int) -> None:
        folder.mkdir(parents=True)
        result = JointRecord(coulomb_friction=Estimate(2.5, 0.1, (2.0, 3.0)))
        JointsFile(dict.fromkeys(bench.spec.joint_names, result)).write(folder / "joints.json")

    monkeypatch.setattr("stiction.virtual.bench.identify_on_bench", make)
    monkeypatch.setattr(benches, "has_entry", lambda folder, key: (folder / "joints.json").is_file())
    grid = replace(FLAT, engines=("mujoco", "mujoco-alone+all"), robots=(3,), robot_levels=("0.3",))
    result = replicate([told], [replace(FIRST, grid=grid)], tmp_path)
    shares = {(row["engine"], row["friction_level"]): row["known_friction"] for row in result.parts[0].details}
    assert shares["mujoco", 0.1]["data sheet"] == pytest.approx((0.1, 0.1, 0.1))
    ((robot, share),) = next(known for (engine, _), known in shares.items() if engine == "mujoco-alone+all").items()
    limits = find_robot("saturn_lite").joint_values("torque_limit")[:3]
    assert robot == "3" and share == pytest.approx(2.5 / limits)
    assert result.summary["told"] == TOLD and TOLD.partition("`")[0] in "".join(run_blocks(result))


def test_what_could_not_be_walked_is_said_before_the_numbers(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that is left out would be missing from one way alone, and nobody would see it; kept or walked now."""
    sentences = ["Robot 4 is left out"]
    monkeypatch.setattr(
        walked, "forward_notes", lambda bundles, grid, benches: sentences if benches.parent.name == "first" else []
    )
    result = replicate([still], (FIRST, SECOND), tmp_path)
    assert [part.warnings for part in result.parts] == [sentences, []]
    assert "The first part. Robot 4 is left out" in warnings(result)


def test_a_report_is_not_replaced_by_one_of_fewer_parts(
    still: Bundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a comparison in the place of a whole one; with all parts nothing is walked twice, and a cell is one row."""
    result = replicate([still], (FIRST, SECOND), tmp_path)
    assert [len(part.rows) for part in result.parts] == [2, 0]
    write_summary(tmp_path / "summary.json", result.plain)
    monkeypatch.setattr("stiction.evaluation.run.walk_unit", lambda *rest: pytest.fail("walked"))
    with pytest.raises(StictionError, match="also has the parts first, and would be replaced; add them to --parts"):
        replicate([still], (SECOND,), tmp_path)
    assert replicate([still], (FIRST, SECOND), tmp_path).samples == result.samples


def test_policies_that_fit_no_part_are_refused(still: Bundle, tmp_path: Path) -> None:
    """A page without a row would look like a comparison."""
    with pytest.raises(StictionError, match="no policy fits any part"):
        replicate([still], (replace(FIRST, stairs=True),), tmp_path)


@pytest.mark.parametrize("size", ["quick", "full"])
def test_what_is_fed_forward_is_walked_plain_in_another_part(size: Size) -> None:
    """Walked plain twice it costs hours on a core; walked plain nowhere it has nothing to stand beside."""
    parts = {part.name: part for part in parts_of(size)}
    # Plain walks know no way to feed, and go by the first name of those.
    grid = replace(parts["forward"].grid, forward=("a",), forward_by=("error",))
    planned = set(plan(["a"], parts["robot"].grid))
    assert plan(["a"], grid) == []
    assert plan_forward(grid) and set(plan_forward(grid)) <= planned
