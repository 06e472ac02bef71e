"""Contracts of policies of other papers' methods: their names in results, with and without the methods installed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_bundle, make_contract
from method_entries import without_methods
from stiction.core.errors import BundleError, ConfigurationError
from stiction.deploy.check import check_bundle
from stiction.evaluation.export import write_card
from stiction.evaluation.policies import method_of, method_texts
from stiction.files.contract import read_contract
from stiction.files.method import EXPERIMENTAL, find_method, installed_methods
from stiction_experiments.methods import dreamwaq, friction, hinf

CONTRACTS = {
    "compensation": {"compensation": (0.05,) * 18, "compensation_speeds": (0.2, 0.3), "friction_range": (0.16, 0.24)},
    "dreamwaq": {"friction_range": (0.0, 0.24)},
    "finetune": {"friction_range": (0.16, 0.24)},
    "hinf": {"disturber": "friction", "friction_range": (0.0, 0.24)},
    "iterative": {"friction_range": (0.16, 0.24)},
}
"""Method -> what its contracts say."""

NAMES = {
    "compensation": "compensation",
    "dreamwaq": dreamwaq.FRICTIONAL,
    "finetune": "finetune",
    "hinf": "hinf-joints",
    "iterative": "iterative",
}
"""Method -> name in results of such a contract."""


def test_all_methods_are_installed() -> None:
    """Every entry point loads, and is the method of its name, with words for people on each of its names in results."""
    assert {method.name for method in installed_methods()} == set(CONTRACTS) == set(EXPERIMENTAL)
    assert {*NAMES.values()} <= method_texts().keys()


@pytest.mark.parametrize("name", CONTRACTS)
def test_a_bundle_is_verified_without_its_method(name: str, tmp_path: Path) -> None:
    """Its name is a word then; where the method is installed, results call it as the method does."""
    contract = make_contract(method=name, **CONTRACTS[name])
    text = contract.to_json().encode()
    assert method_of(read_contract(text)) == NAMES[name] and find_method(name).description in write_card(contract)
    with without_methods():
        assert check_bundle(make_bundle(tmp_path / "bundle", contract)).bundle.contract == contract
        assert read_contract(text) == contract and method_of(contract) == name
        assert f"| trained with | {name} |" in write_card(contract)
        with pytest.raises(ConfigurationError, match=f"'{name}' needs stiction-experiments, .*: pip install "):
            find_method(name)


@pytest.mark.parametrize("wrong", [{"method": "Magic"}, {"method": "a" * 41}, {"disturber": "a b"}, {"disturber": 1}])
def test_words_of_other_methods_are_bounded(wrong: dict[str, object]) -> None:
    """They stand in tables, pages and terminals."""
    data = json.loads(make_contract(method="hinf", **CONTRACTS["hinf"]).to_json())
    with pytest.raises(BundleError, match=f"{next(iter(wrong))}'? is .*; expected (null, or )?(a name of 1|text)"):
        read_contract(json.dumps(data | wrong).encode())


def test_friction_of_the_load_alone_is_friction() -> None:
    """A policy that learned with it would stand in the tables of those that never met any."""
    load = {"friction_range": (0.0, 0.0), "friction_load": (0.0, 0.1)}
    contracts = [
        make_contract(method=name, **load, **more)
        for name, more in (("dreamwaq", {}), ("hinf", {"disturber": "force"}))
    ]
    assert {contract.trained for contract in contracts} == {"with friction of up to 0.1 of the load"}
    assert [method_of(contract) for contract in contracts] == [dreamwaq.FRICTIONAL, f"hinf{hinf.WITH_FRICTION}"]
    none = replace(contracts[0], friction_load=(0.0, 0.0))
    assert (none.trained, method_of(none)) == ("without friction", "dreamwaq")


def test_friction_added_by_the_error_has_a_name_of_its_own() -> None:
    """Compensation by the error is another method than that by the speed of the joints."""
    contract = make_contract(method="compensation", **CONTRACTS["compensation"] | {"compensation_speeds": None})
    assert method_of(contract) == friction.BY_ERROR
