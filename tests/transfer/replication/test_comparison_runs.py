"""The policies of the comparison: one a way of training and seed, no ablation among them."""

from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.formats.bundle import read_bundle
from stiction.formats.errors import StictionError
from stiction.transfer.replication.run import check_ways
from stiction.transfer.replication.runs import comparison_runs


def test_a_way_has_one_run_a_seed() -> None:
    """Three times the budget, or weak exploration, would count as `direct`."""
    names = [run.name for run in comparison_runs()]
    assert len(set(names)) == len(names)
    assert not [name for name in names if "long" in name or "weak" in name or "strong" in name]
    assert names[0] == "coulomb20-none-s0"


def test_two_policies_of_one_way_and_seed_are_refused(tmp_path: Path) -> None:
    """Their mean would count as one sample; of several seeds each is one."""
    first, same = (read_bundle(make_bundle(tmp_path / name, make_contract())) for name in ("a", "b"))
    other = read_bundle(make_bundle(tmp_path / "c", make_contract(seed=1)))
    check_ways([first, other])
    with pytest.raises(StictionError, match="a and b are both of the way 'none'"):
        check_ways([first, other, same])
