"""The policies of the comparison: one a training method and seed, no ablation among them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from stiction.core.errors import StictionError
from stiction.evaluation.policies import method_of
from stiction.files.bundle import Bundle, read_bundle
from stiction.learning.run import RunDirectory
from stiction.robots.catalog import find_robot
from stiction_experiments.replication.plan import (
    LOOP_SEEDS,
    comparison_runs,
    known_bench,
    parts_of,
)
from stiction_experiments.replication.run import check_methods, unrecorded
from stiction_experiments.replication.study import exported
from synthetic import place, write_run


def test_a_way_has_one_run_a_seed() -> None:
    """Three times the budget, or weak exploration, would count as `direct`."""
    names = [run.name for run in comparison_runs(Path("joints.json"))]
    assert len(set(names)) == len(names)
    assert not [name for name in names if "long" in name or "weak" in name or "strong" in name]
    assert names[0] == "coulomb20-none-s0"


def test_every_way_has_seeds_enough_for_a_verdict() -> None:
    """One seed carries none; seed by seed, so that a comparison that is cut short has the same seeds of each."""
    runs = comparison_runs(Path("joints.json"))
    assert LOOP_SEEDS == (0, 1, 2)
    seeds: dict[str, set[int]] = {run.condition.name: set() for run in runs}
    for run in runs:
        seeds[run.condition.name].add(run.seed)
    assert all(own >= {0, 1, 2} for own in seeds.values())
    assert [run.seed for run in runs] == sorted(run.seed for run in runs)
    assert {"coulomb20-none-s4", "coulomb20-iterative-s2", "stairs-deception-s2"} <= {run.name for run in runs}


def test_training_knows_a_robot_by_its_bench_and_none_that_is_reported() -> None:
    """The reported robots' friction would reach the policies that are judged on them."""
    bench = known_bench(find_robot("saturn_lite"))
    assert all(bench.case.seed not in part.grid.robots for part in parts_of("full"))
    told = [run for run in comparison_runs(Path("bench/joints.json")) if run.condition.name.startswith("identified")]
    assert {run.condition.name for run in told} == {"identified-point", "identified-range"}
    for run in told:
        assert run.arguments[run.arguments.index("--joints") + 1] == "bench/joints.json"
        assert "--friction-level" not in run.arguments  # it would override what was identified


def test_a_policy_of_identified_joints_is_a_way_of_its_own() -> None:
    """It would count as a second sample of `deception`."""
    file = {"name": "joints.json", "sha256": "0" * 64}
    contracts = [make_contract(method="deception", joints_file=joints_file) for joints_file in (None, file)]
    assert [method_of(contract) for contract in contracts] == ["deception", "identified"]
    alone = make_contract(method="direct", joints_file=file, friction_range=(0.2, 0.2))
    assert method_of(alone) == "point"


def test_two_policies_of_one_way_and_seed_are_refused(tmp_path: Path) -> None:
    """Their mean would count as one sample; of several seeds each is one."""
    first, same = (read_bundle(make_bundle(tmp_path / name, make_contract())) for name in ("a", "b"))
    other = read_bundle(make_bundle(tmp_path / "c", make_contract(seed=1)))
    check_methods([first, other])
    with pytest.raises(StictionError, match="a and b are both of the method 'none'"):
        check_methods([first, other, same])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"friction_law": "load", "friction": (0.2,) * 18}, "load friction 0.2 from 0 to 0"),
        ({"friction_level": 0.1}, "coulomb friction 0.1"),
        ({"friction_range": (0.0, 0.4)}, "from 0 to 0.4"),
        ({"terrain": "rough"}, "on rough"),
    ],
)
def test_policies_of_two_trainings_are_no_seeds_of_one(tmp_path: Path, change: dict, told: str) -> None:
    """Rejects seeds of different trainings; stairs are a group of their own."""
    plain = read_bundle(make_bundle(tmp_path / "plain", make_contract()))

    def like(name: str, **fields: object) -> Bundle:
        return replace(plain, name=name, contract=make_contract(**fields))

    first, second = like("first", terrain="stairs"), like("second", **({"terrain": "stairs", "seed": 1} | change))
    check_methods([plain, first, like("third", terrain="stairs", seed=1)])
    with pytest.raises(StictionError, match=f"first and second are both of the method 'none'.*{told}"):
        check_methods([plain, first, second])


def test_a_run_is_exported_again_where_it_says_something_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bundle that was kept would be of other joints than the run has now."""
    at = place(tmp_path, "toy", 0, "--friction-level", "0.2")
    write_run(at)
    monkeypatch.setattr(RunDirectory, "check_finished", lambda *rest: None)
    monkeypatch.setattr("stiction.evaluation.export.export_run", lambda run, folder: folder.mkdir())
    first = exported(at.path, tmp_path / "out")
    file = at.path / "config.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"identified": {"file": "j", "sha256": "0" * 64}}))
    assert first.is_dir() and exported(at.path, tmp_path / "out") != first


def test_policies_whose_settings_differ_are_no_seeds_of_one_training(tmp_path: Path) -> None:
    """The mean of two betas would be one confident row; what is not recorded is taken on trust, and named."""
    plain = read_bundle(make_bundle(tmp_path / "plain", make_contract()))

    def like(name: str, seed: int, settings: dict | None) -> Bundle:
        return replace(plain, name=name, contract=make_contract(seed=seed, settings=settings))

    older, one, same = like("older", 0, None), like("one", 1, {"teacher.quiet": 0}), like("same", 2, {})
    other = like("other", 3, {"teacher.quiet": 30, "num-envs": 4})
    check_methods([older, one, same])
    assert unrecorded([older, one, same]) == ["older"] and unrecorded([older]) == []
    words = "one and other are both of the method 'none', trained with num-envs 512 and with 4 \\(1 more differ\\); "
    with pytest.raises(StictionError, match=words):
        check_methods([older, one, same, other])
    stairs = replace(other, contract=replace(other.contract, terrain="stairs"))
    check_methods([older, one, same, stairs])
