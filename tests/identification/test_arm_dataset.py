"""A recording of an arm of hobby servos tells the dead bands of its joints: the example and the page that uses it."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main

pytest.importorskip("pyarrow", reason="the package pyarrow, of the extra 'logs', is needed to read Parquet")

EXAMPLE = Path(__file__).parents[2] / "examples/06_arm_dataset.py"


def test_a_dead_band_comes_back_from_a_data_set_without_torque_and_gains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """30 Hz, degrees, gravity on the joint, targets held between frames: f/kp is in the interval, which is narrow."""
    monkeypatch.chdir(tmp_path)
    made = runpy.run_path(str(EXAMPLE))
    flags = ["--position-scale", "0.0174533", "--names", *made["NAMES"], "--kp", "1", "--kd", "0"]
    assert (
        main(["identify", "arm.parquet", *flags, "--torque-limit", "1", "--joint", "wrist_flex", "--out", "arm"]) == 0
    )
    band = json.loads((tmp_path / "arm/joints.json").read_text())["joints"]["wrist_flex"]["dead_band"]
    low, high = band["interval95"]
    assert low < made["FRICTION"][3] / made["KP"] < high and np.degrees(high - low) < 0.05
