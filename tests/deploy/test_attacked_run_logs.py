"""Hundreds of attacked logs of runs, and what else a loop leaves: one line or the truth, no traceback, no hang."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to identify a walk")

import run_log_attacks
from counts import count

SOURCES = Path(run_log_attacks.__file__).parent


def attacked(folder: Path, *words: str) -> dict:
    """Return what `run_log_attacks` says, from a process of its own, bounded in memory and each log in time."""
    path = os.pathsep.join(map(str, (SOURCES, *filter(None, sys.path))))
    done = subprocess.run(
        [sys.executable, str(SOURCES / "run_log_attacks.py"), str(folder), *words],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": path, "STICTION_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


@pytest.mark.slow
def test_no_log_that_contradicts_itself_is_taken(tmp_path: Path) -> None:
    """Parts of two runs, or in another order, become one log; a missing one is not told; a header's words crash."""
    found = attacked(tmp_path, ["made", "both"][count(0, 1)])
    assert found["wrong"] == []
    assert found["refused"] > 120 and found["taken"] >= 6
    assert found["growth"] < run_log_attacks.MEMORY


def test_attacks_by_chance_end_in_one_line_or_the_truth(tmp_path: Path) -> None:
    """Whatever a disk, an editor or a stranger does to one file of a run."""
    found = attacked(tmp_path, "random", str(count(50, 2000)), "0")
    assert found["wrong"] == []
    assert min(found["refused"], found["taken"]) > 5
    assert found["growth"] < run_log_attacks.MEMORY
