"""Hundreds of mutated bundles, every digest made anew: none that contradicts itself is accepted, and nothing else goes
wrong.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("onnx", reason="the package onnx, of the extra 'train', is needed to make test networks")

import bundle_damage
import contract_mutants
from counts import count

SOURCES = Path(bundle_damage.__file__).parent


def attacked(folder: Path, *words: str) -> dict:
    """Return what `bundle_damage` says, from a process of its own, bounded in memory and each bundle in time."""
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        [sys.executable, str(SOURCES / "bundle_damage.py"), str(folder), *words],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.mark.slow
def test_no_bundle_that_contradicts_itself_is_accepted(tmp_path: Path) -> None:
    """If this failed, a robot would be driven with gains, limits, times or a network that are none of its policy's."""
    found = attacked(tmp_path, "all")
    assert found["accepted"] == []
    assert found["wrong"] == []
    assert found["refused"] >= 400
    assert found["growth"] <= bundle_damage.MEMORY


@pytest.mark.slow
def test_no_damage_ends_in_a_traceback(tmp_path: Path) -> None:
    """What damage leaves as it was may be accepted: a network's unused name, say; all else is one line."""
    bundles = count(40, 150)
    found = attacked(tmp_path, "random", str(bundles), "0")
    assert found["wrong"] == []
    assert found["refused"] >= bundles * 2 / 3


@pytest.mark.slow
@pytest.mark.parametrize("name", contract_mutants.BUNDLES)
def test_no_field_of_a_contract_can_be_changed_unseen(name: str, tmp_path: Path) -> None:
    """Accepts mutants in free fields alone: names and records of the training that nothing on the robot reads."""
    found = contract_mutants.attack_contract(tmp_path / "bundle", *contract_mutants.BUNDLES[name]())
    assert found.surprising == [] and found.wrong == []
    assert found.refused >= count(900, 3000)
