"""What is said about friction, in words that do not claim more than is known."""

from __future__ import annotations

import pytest

from stiction.formats.joints import Estimate
from stiction.identify.verdict import verdict

FRICTION = Estimate(1.0, 0.1, (0.8, 1.2))


def ratio(high: float) -> Estimate:
    """Return a ratio whose interval ends at `high`."""
    return Estimate(0.9 * high, 0.05 * high, (0.8 * high, high))


@pytest.mark.parametrize(
    ("high", "word"), [(0.0098, "probably does not trouble"), (0.05, "may slow down"), (0.2, "probably lose much")]
)
def test_the_upper_end_decides(high: float, word: str) -> None:
    """A wide interval must not be read at its convenient end."""
    assert word in verdict(FRICTION, ratio(high), None, "loaded").text
    assert "Provisional" in verdict(FRICTION, ratio(high), None, "loaded").text


def test_the_level_has_a_margin_unless_the_joint_was_loaded() -> None:
    """0.0512 rounds up to 0.06 under load; on a bare motor twice that, 0.1024, rounds up to 0.11 and is labelled."""
    assert verdict(FRICTION, ratio(0.0512), None, "loaded").level == 0.06
    bare = verdict(FRICTION, ratio(0.0512), None, "bare_motor")
    assert bare.level == 0.11
    assert "lower bound" in bare.text and "chosen, not measured" in bare.text
    assert "lower bound" not in verdict(FRICTION, ratio(0.05), None, "loaded").text


def test_a_level_that_training_refuses_is_not_proposed() -> None:
    """A joint that takes half of its motor: twice that leaves nothing to walk with."""
    told = verdict(FRICTION, ratio(0.5), None, "in_air")
    assert told.level is None and "mend the joint" in told.text and "--friction-level" not in told.text


def test_what_is_not_known_is_said() -> None:
    """No limit: no judgement; no condition: said so; an interval over zero: friction is not proven."""
    unknown = verdict(FRICTION, None, None, None)
    assert unknown.level is None and "cannot be said" in unknown.text and "trouble" not in unknown.text
    assert "not stated" in verdict(FRICTION, ratio(0.05), None, None).text
    faint = Estimate(0.1, 0.1, (-0.1, 0.3))
    assert "does not prove" in verdict(faint, ratio(0.05), None, "loaded").text


def test_a_linear_axis_is_not_a_leg() -> None:
    """Policies and training levels are about legs."""
    text = verdict(FRICTION, ratio(0.2), Estimate(1e-5, 1e-6, (0.8e-5, 1.2e-5)), "loaded", "linear")
    assert text.level is None and "policy" not in text.text and " m (95 %" in text.text
