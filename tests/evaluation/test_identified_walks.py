"""Walks at identified friction: each joint its own, worked out by hand, in every engine that walks it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed")

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.deploy.check import check_bundle
from stiction.evaluation.benches import as_identified
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.grid import GridCfg, plan, units, walk_unit
from stiction.files.bundle import Bundle
from stiction.files.joints import Estimate, Finding, JointRecord, JointsFile
from stiction.files.results import read_results
from stiction.files.settings import SETTINGS

SHANKS = {"FL_shank": 4.5, "FR_shank": 13.5}
"""Dry friction [N m], 10 % and 30 % of 45 N m."""

INVALID = Finding("controller", "the gains are others", "say them")


def written(path: Path, **friction: float | None) -> Path:
    """Write a joints.json with this dry friction [N m]; None: a record that is not valid."""
    records = {
        name: JointRecord(
            coulomb_friction=Estimate(value or 40.0, 0.1, (0.0, 50.0)), findings=() if value else (INVALID,)
        )
        for name, value in friction.items()
    }
    JointsFile(records).write(path)
    return path


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Files of hips and thighs, 4 % and 10 % of 25 N m, and of three shanks, one of them not valid."""
    return [
        written(tmp_path / "legs.json", hip=1.0, thigh=2.5),
        written(tmp_path / "shanks.json", **SHANKS, ML_shank=None),
    ]


@pytest.fixture
def checked(bundle: Path) -> Bundle:
    """A bundle of a random network."""
    return check_bundle(bundle).bundle


def grid(**options: object) -> GridCfg:
    """Return a short grid of one command."""
    return GridCfg(EvaluationCfg(commands=("vx=0.5",), episodes=1, seconds=2.0, settle=0.5), **options)


def test_each_joint_has_its_own_friction_else_its_kinds(checked: Bundle, files: list[Path]) -> None:
    """Shanks without a valid record have 20 %: (6 * 4 + 6 * 10 + 10 + 30 + 4 * 20) / 18 = 11.333 %."""
    cfg, notes = as_identified(grid(), [checked], files)
    assert cfg.base.friction_levels == (0.113333,)
    contract = checked.contract
    kinds = dict(zip(contract.joint_names, contract.kinds, strict=True))
    expected = [SHANKS.get(name, {"hip": 1.0, "thigh": 2.5, "shank": 9.0}[kind]) for name, kind in kinds.items()]
    assert cfg.base.friction(contract)[0] == pytest.approx(expected)
    (note,) = notes
    assert "ML_shank" in note and "mean of the other joints" in note
    # Walked: the mean over moving joints is of these torques, 0.113 of each limit is not 4.17 N m.
    (row,) = [walk_unit(checked, unit, cfg) for unit in units(plan(["toy"], cfg), cfg)]
    assert row[0].mean_friction == pytest.approx(np.mean(expected), rel=1e-3)


def test_one_robot_alone_has_the_same_friction(checked: Bundle, files: list[Path]) -> None:
    """The engine with one robot walks the identified joints, not a share of each limit."""
    walked = {}
    for engine in ("mujoco", "mujoco-alone"):
        cfg, _ = as_identified(grid(engines=(engine,)), [checked], files)
        for shape in (cfg.base.friction_shape, ()):
            one = GridCfg(EvaluationCfg(**{**vars(cfg.base), "friction_shape": shape}), engines=(engine,))
            (unit,) = units(plan(["toy"], one), one)
            walked[engine, bool(shape)] = walk_unit(checked, unit, one)[0].mean_friction
    assert walked["mujoco-alone", True] == pytest.approx(walked["mujoco", True], rel=1e-3)
    assert walked["mujoco-alone", False] == pytest.approx(walked["mujoco", False], rel=1e-3)


def test_nothing_identified_of_a_kind_or_a_virtual_robot_is_refused(checked: Bundle, files: list[Path]) -> None:
    """A kind without a valid joint has no friction to walk with, and a virtual robot has its own."""
    with pytest.raises(StictionError, match=r"no valid dry friction of shank, expected"):
        as_identified(grid(), [checked], files[:1])
    with pytest.raises(StictionError, match="or a virtual one"):
        as_identified(grid(engines=("mujoco-alone+all",)), [checked], files)
    with pytest.raises(StictionError, match="a second 'hip'"):
        as_identified(grid(), [checked], [files[0], *files])


@pytest.mark.usefixtures("undrawn")
def test_the_verb_walks_the_files_and_remembers_them(
    bundle: Path, files: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Results name the level, their inputs are the files, and other files of the names are other settings."""
    words = ["evaluate", str(bundle), "--commands", "vx=0.5", "--episodes", "1", "--seconds", "3", "--out"]
    words += [str(tmp_path / "out"), "--jobs", "1", "--joints", *map(str, files)]
    assert main(words) == 0
    (row,) = read_results(tmp_path / "out/results.csv")
    assert row.friction_level == pytest.approx(0.113333)
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert any("ML_shank, " in text and "was not identified" in text for text in summary["warnings"])
    assert "joints" in json.loads((tmp_path / "out" / SETTINGS).read_text())["inputs"]
    written(files[0], hip=2.0, thigh=2.5)
    assert main(words) == 1 and "--overwrite" in capsys.readouterr().err
    assert main([*words, "--friction-levels", "0.1"]) == 1
    assert "--joints and --friction-levels exclude each other" in capsys.readouterr().err
