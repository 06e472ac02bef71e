"""`tools/dead_sensors.py`: a walk with a dead sensor, exchanged joints, and what is a false alarm."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The script as a module."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "tools"))
    import dead_sensors

    yield dead_sensors
    sys.modules.pop("dead_sensors")


def test_a_dead_angle_and_an_exchanged_joint_are_found(script: ModuleType) -> None:
    """Both within 300 ms of their begin, and nothing before: the same policy walks a second without an alarm."""
    bundle, record = script.read_policies()[0], []
    row = script.walk(bundle, 0, 2.0, "frozen-angle")
    assert row["rule"] in ("frozen angle", "velocity and angle") and 0 < row["found_ms"] < 300
    row = script.walk(bundle, 0, 1.2, record=record)
    assert (row["seconds"], row["rule"], row["largest_tilt"]) == (1.2, "", "")
    assert len(record) == 600 and script.is_found(bundle, record, 2, 300)


def test_only_a_robot_that_lies_fell(script: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A robot that went on upright, and one that a rule on sensors stopped, are false alarms; one that lay is none."""
    ends = [("", ""), ("predicted tilt", 3.0), ("predicted tilt", 0.5), ("frozen angle", "")]
    shares = dict.fromkeys(script.SENSORS, 0.1)
    rows = [{"seconds": 900.0, "rule": rule, "largest_tilt": tilt} | shares for rule, tilt in ends]
    script.add(tmp_path / "walks.csv", rows)
    script.report(tmp_path)
    assert capsys.readouterr().out.startswith("4 walks, 1.00 robot-hours, 1 falls, 2 false alarms")
