"""Robots that wear out under a policy that walks: what is seen, kept, and said of the monitor."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bundles import make_wear
from stiction.core import cache
from stiction.core.errors import StictionError
from stiction.files.bundle import Bundle, read_bundle, shipped_bundles, write_bundle
from stiction.robots.catalog import find_robot
from stiction.virtual.hidden import draw
from stiction.virtual.robot import Wear
from stiction_experiments.wear import run as wear_study
from stiction_experiments.wear.lifetimes import Window
from stiction_experiments.wear.run import WearCfg, study_wear

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

SPEC = find_robot("saturn_lite")
WALKER = read_bundle(shipped_bundles()["saturn_lite-flat-deception-0.2"])
SHORT = WearCfg("mujoco", ("0.3",), robots=(3,), wear=Wear(start=0.1, seconds=6.0), settle=1.0, window=2.0)
SHORT = replace(SHORT, commands=("vx=0.5",))
ALONE = replace(SHORT, control=False)


def silent(name: str, share: float) -> None:
    """Show no progress."""


def watching(folder: Path, **changes) -> Bundle:
    """The walker with a monitor whose windows have 50 steps."""
    wear = make_wear(WALKER.contract, window=50, **changes)
    parts = (WALKER.contract, WALKER.policy, WALKER.golden, WALKER.card, wear)
    return read_bundle(write_bundle(folder / "watching", *parts))


def run(folder: Path, cfg: WearCfg = ALONE, **changes):
    """Wear robots out under the watching walker."""
    bundle = watching(folder, **changes)
    (folder / "robots").mkdir()
    return study_wear([bundle], [folder / "watching"], cfg, folder / "robots", 1, silent)


def test_friction_beyond_all_training_stops_a_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It walks at 3 % of the torque limit and not at 90; windows, wear and the monitor's truth are as asked for."""
    (row,), windows, readings = run(tmp_path, unusual=1e8)
    assert (row.policy, row.friction_level, row.robot, row.engine) == ("watching", "0.3", 3, "mujoco")
    assert row.first_ratio > 0.8 > row.last_ratio and row.end == "too slow" and 0.3 < row.factor < 2.6
    assert [window.time for window in windows] == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert [window.factor for window in windows] == pytest.approx([0.1 * 30 ** (at / 6) for at in (2, 3, 4, 5, 6, 6)])
    # The monitor pairs frames, so that its first window of 50 steps takes 51.
    assert [reading.time for reading in readings] == pytest.approx([2.02, 3.02, 4.02, 5.02, 6.02, 7.02])
    for reading in readings:
        assert reading.target == "level" and reading.factor == pytest.approx(
            0.1 * 30 ** (min(reading.time - 0.5, 6) / 6)
        )
        assert reading.true == pytest.approx(0.3 * reading.factor)
        assert reading.high - reading.low <= 0.04 + 1e-9 and not reading.unusual
    assert len({reading.estimate for reading in readings}) == 6 and row.monitored and row.unusual == "never"
    # Done once, it is not done again, unless robot or code are others.
    monkeypatch.setattr(wear_study, "walk", lambda *arguments, **others: pytest.fail("walked again"))
    folders = [tmp_path / "watching"], ALONE, tmp_path / "robots", 1, silent
    assert study_wear([read_bundle(tmp_path / "watching")], *folders) == ([row], windows, readings)
    with pytest.raises(pytest.fail.Exception):
        study_wear([WALKER], folders[0], replace(ALONE, robots=(2,)), *folders[2:])
    monkeypatch.setattr(cache, "fingerprint", lambda *code: {"code": "other"})
    with pytest.raises(pytest.fail.Exception):
        study_wear([WALKER], *folders)


def test_beside_it_the_same_robot_walks_with_friction_that_stays(tmp_path: Path) -> None:
    """At the wear where the other begins and at x1; the first window differs by growth alone, and by little."""
    cfg = replace(SHORT, wear=Wear(start=0.3, seconds=2.0), window=1.0)
    rows, windows, readings = run(tmp_path, cfg, unusual=1e8)
    assert [row.steady for row in rows] == [None, 0.3, 1.0] == list(dict.fromkeys(row.steady for row in windows))
    for steady in (0.3, 1.0):
        heard = [row for row in readings if row.steady == steady]
        assert {round(row.factor, 9) for row in (*windows, *heard) if row.steady == steady} == {steady}
        assert {round(row.true, 9) for row in heard} == {0.3 * steady}
    grown, stayed, _ = ([row.time for row in readings if row.steady == at] for at in (None, 0.3, 1.0))
    assert grown == stayed and rows[1].end == "alive"
    assert len(list((tmp_path / "robots").iterdir())) == 3
    assert replace(cfg, wear=Wear(start=1.0, seconds=2.0)).steady == (1.0,)


def test_one_joint_wears_and_is_watched(tmp_path: Path) -> None:
    """The truth is that joint's own share of the level times the wear; what the map does not tell is not said."""
    estimated = (*(name != "ML_shank" for name in SPEC.joint_names), True)
    cfg = replace(ALONE, wear=Wear(("ML_shank",), 0.3, 3.0, 2.0), window=1.0)
    (row,), _, readings = run(tmp_path, cfg, unusual=1e-9, estimated=estimated)
    (reading,) = readings
    share = draw(SPEC, 3).friction.share[SPEC.joint_names.index("ML_shank")]
    assert reading.target == "ML_shank" and reading.true == pytest.approx(0.3 * share * reading.factor)
    assert (reading.estimate, reading.low, reading.high, reading.unusual) == (None, None, None, True)
    assert (row.unusual, row.grown, row.held) == ("at once", "never", None)
    part = json.loads(next((tmp_path / "robots").iterdir()).read_text())
    assert sorted(part) == ["entry_sha256", "fell", "readings", "windows"]
    assert part["readings"][0]["target"] == "ML_shank"


def test_what_a_walk_means_is_judged_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where walks are judged otherwise, cached ones would go on under the old judgement."""
    seen = {
        "windows": [{"time": 3.0, "factor": 0.2, "ratio": 1.0}],
        "readings": [],
        "fell": 3.5,
    }
    monkeypatch.setattr(wear_study, "record_walk", lambda one, bundle: seen)
    (tmp_path / "robots").mkdir()
    path = shipped_bundles()["saturn_lite-flat-deception-0.2"]
    (row,), windows, _ = study_wear([WALKER], [path], ALONE, tmp_path / "robots", 1, silent)
    assert (row.end, row.time, row.factor) == ("fell", 3.5, pytest.approx(0.1 * 30 ** (3.5 / 6)))
    assert windows == [Window(row.policy, "0.3", 3, None, 3.0, 0.2, 1.0, command="vx=0.5")]
    monkeypatch.setattr(wear_study, "record_walk", lambda *rest: pytest.fail("walked again"))
    monkeypatch.setattr("stiction_experiments.lab.straight.FOLLOWS", (1.1, 1.2))
    (row,), *_ = study_wear([WALKER], [path], ALONE, tmp_path / "robots", 1, silent)
    assert row.end == "too slow from the start"


def test_a_robot_walks_both_ways_and_is_one_row(tmp_path: Path) -> None:
    """A file for each walk; windows say which command was given."""
    cfg = replace(ALONE, commands=("vx=0.5", "vx=-0.5"), wear=Wear(start=0.1, seconds=2.0), window=1.0)
    (row,), windows, readings = run(tmp_path, cfg, unusual=1e8)
    assert row.command == "vx=0.5 vx=-0.5" and len(list((tmp_path / "robots").iterdir())) == 2
    forward, backward = ([one.ratio for one in windows if one.command == command] for command in cfg.commands)
    assert row.first_ratio in (forward[0], backward[0]) and forward != backward
    assert abs(row.first_ratio - 1) == max(abs(forward[0] - 1), abs(backward[0] - 1))
    assert {one.command for one in readings} == set(cfg.commands)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"commands": ("stand",)}, "asks for motion"),
        ({"commands": ()}, "commands: got none, expected at least one, each once"),
        ({"commands": ("vx=0.5", "vx=0.5")}, "each once"),
        ({"commands": ("vx=0.5", "vx=0.50")}, "each once"),
        ({"levels": ()}, "at least one"),
        ({"robots": (3, 3)}, "each once"),
        ({"levels": ("0.1", "0.10")}, "each once"),
        ({"levels": ("0",)}, "level 0 cannot wear"),
        ({"levels": ("heavy",)}, "friction level 'heavy'"),
        ({"cell": "rest"}, "has no friction"),
        ({"window": 9.0}, "windows that fit"),
        ({"every": 0.0}, "windows that fit"),
    ],
)
def test_what_cannot_be_worn_out_is_refused(change: dict, message: str) -> None:
    """Before anything walks, in one line."""
    with pytest.raises(StictionError, match=message):
        replace(SHORT, **change)
