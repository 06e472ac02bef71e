"""The bars of the gait diagram."""

from __future__ import annotations

import numpy as np

from stiction_experiments.gait.page import bars


def test_bars_are_where_the_foot_is_down() -> None:
    """Down from the start for two steps, and for the last three of eight, at 0.02 s."""
    spans = bars(np.array([1, 1, 0, 0, 0, 1, 1, 1], bool), 0.02)
    np.testing.assert_allclose(spans, [(0.0, 0.04), (0.1, 0.06)])
    assert bars(np.zeros(4, bool), 0.02) == []
