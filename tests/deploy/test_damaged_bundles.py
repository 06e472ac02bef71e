"""Hundreds of mutated bundles, every digest made anew: none that contradicts itself is accepted."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")

import bundle_damage
import contract_mutants
from counts import count
from processes import outcome


@pytest.mark.slow
def test_no_bundle_that_contradicts_itself_is_accepted(tmp_path: Path) -> None:
    """Rejects gains, limits, times and networks that contradict each other."""
    result = outcome("bundle_damage.py", tmp_path, "all")
    assert result["accepted"] == []
    assert result["wrong"] == []
    assert result["refused"] >= 240
    assert result["growth"] <= bundle_damage.MEMORY


@pytest.mark.slow
def test_no_damage_ends_in_a_traceback(tmp_path: Path) -> None:
    """Each damage is rejected in one line, or changes nothing of effect, such as a network's unused name."""
    bundles = count(40, 150)
    result = outcome("bundle_damage.py", tmp_path, "random", bundles, 0)
    assert result["wrong"] == []
    assert result["refused"] >= bundles * 2 / 3


@pytest.mark.slow
@pytest.mark.parametrize("name", contract_mutants.BUNDLES)
def test_no_field_of_a_contract_can_be_changed_unseen(name: str, tmp_path: Path) -> None:
    """Accepts mutants in free fields alone: names and records of the training that nothing on the robot reads."""
    result = contract_mutants.attack_contract(tmp_path / "bundle", *contract_mutants.BUNDLES[name]())
    assert result.surprising == [] and result.wrong == []
    assert result.refused >= count(900, 3000)
