"""The simulation of trainings on many nodes, against what can be worked out by hand."""

from __future__ import annotations

import math
import sys
from importlib import util
from pathlib import Path

import pytest

FILE = Path(__file__).parents[2] / "tools/nodes.py"
SPEC = util.spec_from_file_location("nodes", FILE)
assert SPEC is not None and SPEC.loader is not None
nodes = util.module_from_spec(SPEC)
sys.modules["nodes"] = nodes
SPEC.loader.exec_module(nodes)


def test_without_losses_it_is_rounds() -> None:
    """Five trainings on two processors are three rounds; on four nodes, eight processors, one."""
    each = nodes.START + nodes.TRAINING + nodes.EVALUATION
    assert nodes.simulate(1, math.inf, 5, 0)[:2] == pytest.approx((3 * each, 5 * each))
    assert nodes.simulate(4, math.inf, 5, 0)[0] == pytest.approx(each)


def test_what_is_lost_is_work_since_a_checkpoint_and_starts() -> None:
    """Every loss costs less than a checkpoint's time and a start for each processor of the node, and the wait."""
    whole = nodes.TRAINING + nodes.EVALUATION
    for seed in range(20):
        end, busy, share = nodes.simulate(1, 900.0, 10, seed)
        assert end > 5 * (whole + nodes.START) and share == pytest.approx(1 - 10 * whole / busy)
        starts = (busy - 10 * whole) / (nodes.START + nodes.CHECKPOINT)
        assert starts < 10 + nodes.PROCESSORS * (end / 900.0) * 4
