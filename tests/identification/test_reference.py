"""The table of public joints, and where a joint stands in it."""

from __future__ import annotations

import pytest

from stiction.files.joints import Estimate
from stiction.identification.reference import CONDITIONS, REFERENCE, SOURCES, place


def ratio(value: float, half: float = 0.0) -> Estimate:
    """Return an estimate with a symmetric interval."""
    return Estimate(value, half / 2, (value - half, value + half))


def test_every_entry_has_a_source_and_a_condition() -> None:
    """A number without a source would be an invention."""
    assert {entry.source for entry in REFERENCE} == set(SOURCES)
    assert {entry.condition for entry in REFERENCE} == set(CONDITIONS)
    assert len({entry.robot for entry in REFERENCE}) >= 12
    assert all(entry.note and 0 < entry.friction < entry.torque_limit for entry in REFERENCE)


def test_the_papers_ratios_come_out_of_its_table() -> None:
    """0.0481 of 35.55 N m is 0.135 %, 0.442 of 45 is 0.982 %; the paper prints 0.13 and 0.98 %."""
    paper = {entry.robot: 100 * entry.friction_ratio for entry in REFERENCE if entry.source == "paper"}
    assert paper == {"Unitree Go1": pytest.approx(0.1353, abs=1e-4), "Saturn Lite": pytest.approx(0.9822, abs=1e-4)}


def test_dead_bands_are_compared_where_the_gain_is_known() -> None:
    """Go2 hip: 0.16 N m at kp 20 is 0.008 rad; the AlienGo has no gain and is not counted."""
    placed = place(ratio(0.009), "in_air", "dead_band")
    known = [entry for entry in REFERENCE if entry.condition == "in_air" and entry.kp is not None]
    assert placed is not None and placed.count == len(known) < place(ratio(0.009), "in_air").count
    assert placed.next_below == "Unitree Go2 hip (0.008 rad)"
