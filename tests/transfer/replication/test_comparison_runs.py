"""The policies of the comparison: one a way of training and seed, no ablation among them."""

from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.formats.bundle import read_bundle
from stiction.formats.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.transfer.replication.plan import parts_of
from stiction.transfer.replication.run import check_ways
from stiction.transfer.replication.runs import comparison_runs, known_bench
from stiction.transfer.ways import way_of


def test_a_way_has_one_run_a_seed() -> None:
    """Three times the budget, or weak exploration, would count as `direct`."""
    names = [run.name for run in comparison_runs(Path("joints.json"))]
    assert len(set(names)) == len(names)
    assert not [name for name in names if "long" in name or "weak" in name or "strong" in name]
    assert names[0] == "coulomb20-none-s0"


def test_training_knows_a_robot_by_its_bench_and_none_that_is_reported() -> None:
    """The reported robots' friction would reach the policies that are judged on them."""
    bench = known_bench(find_robot("saturn_lite"))
    assert all(bench.case.seed not in part.grid.robots for part in parts_of("full"))
    run = next(run for run in comparison_runs(Path("bench/joints.json")) if run.condition.name.endswith("identified"))
    assert run.arguments[run.arguments.index("--joints") + 1] == "bench/joints.json"
    assert "--friction-level" not in run.arguments  # it would override what was identified


def test_a_policy_of_identified_joints_is_a_way_of_its_own() -> None:
    """It would count as a second sample of `deception`."""
    file = {"name": "joints.json", "sha256": "0" * 64}
    contracts = [make_contract(method="deception", joints_file=given) for given in (None, file)]
    assert [way_of(contract) for contract in contracts] == ["deception", "identified"]


def test_two_policies_of_one_way_and_seed_are_refused(tmp_path: Path) -> None:
    """Their mean would count as one sample; of several seeds each is one."""
    first, same = (read_bundle(make_bundle(tmp_path / name, make_contract())) for name in ("a", "b"))
    other = read_bundle(make_bundle(tmp_path / "c", make_contract(seed=1)))
    check_ways([first, other])
    with pytest.raises(StictionError, match="a and b are both of the way 'none'"):
        check_ways([first, other, same])
