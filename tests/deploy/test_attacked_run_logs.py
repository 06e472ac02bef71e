"""Hundreds of attacked logs of runs, and what else a loop leaves: one line or the truth, no traceback, no hang."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to identify a walk")

import run_log_attacks
from counts import count
from processes import outcome


@pytest.mark.slow
def test_no_log_that_contradicts_itself_is_taken(tmp_path: Path) -> None:
    """Parts of two runs, or in another order, become one log; a missing one is not told; a header's words crash."""
    result = outcome("run_log_attacks.py", tmp_path, ["made", "both"][count(0, 1)])
    assert result["wrong"] == []
    assert result["refused"] > 120 and result["taken"] >= 6
    assert result["growth"] < run_log_attacks.MEMORY


def test_attacks_by_chance_end_in_one_line_or_the_truth(tmp_path: Path) -> None:
    """Whatever a disk, an editor or a stranger does to one file of a run."""
    result = outcome("run_log_attacks.py", tmp_path, "random", count(50, 2000), 0)
    assert result["wrong"] == []
    assert min(result["refused"], result["taken"]) > 5
    assert result["growth"] < run_log_attacks.MEMORY
