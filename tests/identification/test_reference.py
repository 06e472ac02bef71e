"""The table of public joints, and where a joint stands in it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stiction.files.joints import Estimate, JointRecord
from stiction.identification.reference import CONDITIONS, REFERENCE, SOURCES, place


def test_every_entry_has_a_source_and_a_condition() -> None:
    """A number without a source would be an invention."""
    assert {entry.source for entry in REFERENCE} == set(SOURCES)
    assert {entry.condition for entry in REFERENCE} == set(CONDITIONS)
    assert len({entry.robot for entry in REFERENCE}) >= 7
    assert all(entry.note and 0 < entry.friction < entry.torque_limit for entry in REFERENCE)


def test_the_papers_ratios_come_out_of_its_table() -> None:
    """0.0481 of 35.55 N m is 0.135 %, 0.442 of 45 is 0.982 %; the paper prints 0.13 and 0.98 %."""
    paper = {entry.robot: 100 * entry.friction_ratio for entry in REFERENCE if entry.source == "paper"}
    assert paper == {"Unitree Go1": pytest.approx(0.1353, abs=1e-4), "Saturn Lite": pytest.approx(0.9822, abs=1e-4)}


def test_dead_bands_are_compared_where_the_gain_is_known() -> None:
    """Go2 hip: 0.16 N m at kp 20 is 0.008 rad; the AlienGo has no gain and is not counted."""
    about = Estimate(0.009, 0.001, (0.0075, 0.0105))
    record = JointRecord(friction_ratio=about, dead_band=about, test_condition="in_air")
    band, ratio = place(record, "dead_band"), place(record, "friction_ratio")
    assert band is not None and ratio is not None
    known = [entry for entry in REFERENCE if entry.condition == "in_air" and entry.kp is not None]
    assert (band.below, band.count) == (1, len(known)) and band.count < ratio.count
    assert band.text == (
        "Its f/kp is between Unitree Go2 hip (0.008 rad) and Unitree Go2 thigh (0.0097 rad) of 6 public joints "
        "measured on a leg in the air, 2 of them within its interval."
    )


def test_the_ends_of_the_ranking_are_named() -> None:
    """Above the largest and below the smallest; a linear axis, and a joint of no stated condition, has no rank."""
    for value, where in ((0.5, "above Dynamixel MX-64 servo (1.2 %), the largest,"), (1e-4, "below Dynamixel MX-106")):
        record = JointRecord(friction_ratio=Estimate(value, 0.0, (value, value)), test_condition="loaded")
        rank = place(record, "friction_ratio")
        assert rank is not None and f"is {where}" in rank.text and rank.text.endswith("measured under load.")
        for unknown in ({"test_condition": None}, {"axis": "linear"}, {"friction_ratio": None}):
            assert place(replace(record, **unknown), "friction_ratio") is None
