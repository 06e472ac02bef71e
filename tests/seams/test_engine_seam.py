"""An engine from outside of the package: conformance suite and evaluation take it by its dotted name alone."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.engines.catalog import find_engine
from stiction_experiments.engines.conformance.suite import CHECKS

pytestmark = pytest.mark.usefixtures("undrawn")

MODULE = """
from stiction.engines.catalog import EngineSpec
from stiction.engines.mujoco_engine import MujocoEngine

class MyEngine(MujocoEngine):
    name = "mine"

ENGINE = EngineSpec("mine", MyEngine)
CLASS = MyEngine
"""

NAME = "engine_of_mine:ENGINE"


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module with an engine, on the path of this process and of those that it starts."""
    file = tmp_path / "lib" / "engine_of_mine.py"
    file.parent.mkdir()
    file.write_text(MODULE)
    monkeypatch.syspath_prepend(file.parent)
    monkeypatch.delitem(sys.modules, "engine_of_mine", raising=False)
    return file


def test_it_goes_through_the_conformance_suite_on_a_robot_of_choice(mine: Path, tmp_path: Path) -> None:
    """Nobody could trust what a policy does in an engine that was never compared with the others."""
    out = tmp_path / "engines"
    assert main(["study", "engines", "--engines", NAME, "--robot", "go1", "--no-walks", "--out", str(out)]) == 0
    with (out / "conformance.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["check"] for row in rows} == set(CHECKS) and {row["engine"] for row in rows} == {NAME}
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["robot"], summary["failures"]) == ("go1", 0)


def test_a_policy_walks_in_it_in_several_processes(mine: Path, bundle: Path, tmp_path: Path, capsys) -> None:
    """A worker that does not find the engine stops an evaluation of hours. It is MuJoCo, and must walk as MuJoCo."""
    walks = ["--friction-levels", "0.1", "--commands", "vx=0.5", "--episodes", "1", "--seconds", "3", "--robots", "7"]
    engines = [NAME, "mujoco-alone", f"{NAME}+delays"]
    assert main(["evaluate", str(bundle), "--engines", *engines, *walks, "--jobs", "2", "--out", str(tmp_path)]) == 0
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = {row.pop("engine"): row for row in csv.DictReader(file)}
    assert list(rows) == engines
    assert rows[NAME] == rows["mujoco-alone"] != rows[f"{NAME}+delays"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("engine_of_mine:CLASS", "is not an EngineSpec"),
        ("engine_of_mine:NOTHING", "the module engine_of_mine has no 'NOTHING'"),
        ("engine_of_nobody:ENGINE", "cannot be imported"),
        (":ENGINE", "cannot be imported"),
        ("mujoko", "did you mean 'mujoco'[?] known: mujoco, physx, ode, ode-webots; give a custom one"),
    ],
)
def test_a_name_that_leads_to_no_engine_is_refused(mine: Path, name: str, message: str) -> None:
    """The message says what was looked for and what there is."""
    with pytest.raises(StictionError, match=message):
        find_engine(name)
