"""`fit.npz`: the signals behind a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stiction.files.joints import FitSignals, read_fit, write_fit


def signals(count: int) -> FitSignals:
    """Return signals that are all the same ramp."""
    ramp = np.arange(float(count))
    return FitSignals(*[ramp] * 9, target=-ramp)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    """Each joint's signals come back under their names, and those that were None stay None."""
    write_fit(tmp_path / "fit.npz", {"a": signals(3), "b.c": signals(4)})
    again = read_fit(tmp_path / "fit.npz", "b.c")
    np.testing.assert_array_equal(again.target, [0, -1, -2, -3])
    assert again.simulated_torque is None
