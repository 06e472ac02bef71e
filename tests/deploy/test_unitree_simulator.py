"""`tools/unitree_simulator.py`: the velocity of a walk on the maker's simulator by hand; an absent simulator."""

from __future__ import annotations

import argparse
import json
import math
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stiction.files import run_log

TOOL = Path(__file__).parents[2] / "tools/unitree_simulator.py"


def test_the_velocity_is_along_the_heading_and_by_the_simulation_s_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that looks along y, simulated at half of real time, goes 0.4 m/s; its settling is left out."""
    time = np.arange(0.0, 10.0, 0.02)
    readings = {"time": time, "stage": np.where(time < 1.0, 1.0, 2.0)}
    monkeypatch.setattr(run_log, "read_run_log", lambda folder: SimpleNamespace(readings=readings))
    (tmp_path / "report.json").write_text(json.dumps({"end": "done"}))
    turned = (math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4))
    path = [(t, t / 2, 0.0, 0.4 * t / 2 if t >= 3.0 else 5.0 * t, 0.3, *turned) for t in time]
    seen: dict[str, Any] = {"path": path, "commands": 7, "right": 6}
    asked = argparse.Namespace(bundle=Path("x/none"), friction=0.15, command="vx=0.5")
    row = runpy.run_path(str(TOOL))["measured"](asked, seen, tmp_path, 0)
    assert row.reached == pytest.approx(0.4) and row.pace == pytest.approx(0.5)
    assert (row.policy, row.friction, row.end, row.commands, row.right) == ("none", 0.15, "done", 7, 6)


def test_a_simulator_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    """Rejects a folder that is not the simulator's, without running or importing its files."""
    words = [sys.executable, str(TOOL), "bundle", "--simulator", str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "without unitree_mujoco.py" in done.stderr.splitlines()[-1]
