"""`tools/walk_limits.py`: peak demands of a recorded walk in relation to the limits."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction.files.bundle import read_bundle, shipped_bundles

SCRIPTS = Path(__file__).parents[2] / "tools"


def test_what_a_walk_asks_is_of_what_was_walked_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings made up to reach a clip count as a walk, or a jump over a reset as a fast target."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    import walk_limits

    bundle = read_bundle(shipped_bundles()["saturn_lite-flat-none-0.2"])
    golden = bundle.golden
    assert golden.walked is not None and not golden.walked.all()
    usual = walk_limits.asked(bundle)
    made_up = replace(golden, joint_velocity=np.where(golden.walked[:, None], golden.joint_velocity, 99.0))
    assert walk_limits.asked(replace(bundle, vectors=made_up)) == usual
    parts = list(walk_limits.walks(golden))
    assert [part.stop - part.start for part in parts] == [200, 200, 200]
    # A target that leaps between two parts, and nowhere else.
    shift = np.repeat([0.0, 1.0, 2.0, 2.0], [200, 200, 200, len(golden) - 600])[:, None]
    leaping = walk_limits.asked(replace(bundle, vectors=replace(golden, target=golden.target + shift)))
    assert leaping == pytest.approx(usual)
    # Two joints at 3 and 4 rad/s, then at rest: sqrt(12.5), then over two readings sqrt(12.5 / 2).
    assert walk_limits.rolling_rms(np.array([[3.0, 4.0], [0.0, 0.0]]), 1) == pytest.approx([12.5**0.5, 0.0])
    assert walk_limits.rolling_rms(np.array([[3.0, 4.0], [0.0, 0.0]]), 2) == pytest.approx([6.25**0.5])
    sys.modules.pop("walk_limits")
