"""A real Go2, legs in the air: positions and targets alone, every joint, gravity included."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from stiction.files.joints import JointRecord
from stiction.identification.logs import open_log
from stiction.identification.pipeline import identify_log
from stiction.identification.setup import IdentifySetup

NAMES = tuple(f"{leg}_{kind}" for leg in ("FL", "FR", "RL", "RR") for kind in ("hip", "thigh", "calf"))


@pytest.fixture(scope="module")
def records() -> dict[str, JointRecord]:
    """Identify all twelve joints as `stiction identify` does."""
    folder = os.environ.get("STICTION_DATA")
    path = Path(folder or "") / "go2" / "traj_0.pt"
    if not folder or not path.is_file():
        pytest.skip("the Go2 record is not here: set STICTION_DATA to a folder with go2/traj_0.pt")
    setup = IdentifySetup(kp=20.0, kd=1.5, torque_limit=23.7, test_condition="in_air")
    results, refused = identify_log(open_log(path, names=NAMES), setup)
    assert not refused and tuple(results) == NAMES
    return {name: result.record for name, result in results.items()}


def test_newton_metres_are_not_printed(records: dict[str, JointRecord]) -> None:
    """Positions do not show the scale: null, the combinations, and the experiment that separates them."""
    for record in records.values():
        assert record.inertia is record.viscous_friction is record.coulomb_friction is record.motor_strength is None
        assert {"I/k", "(B + k·kd)/k", "f/k"} <= set(record.combinations)
        assert record.friction_ratio is not None and record.dead_band is not None and record.torque_source is None
        assert any("hang a known mass" in text for text in record.warnings)


def test_calves_have_well_more_friction_than_hips_and_thighs(records: dict[str, JointRecord]) -> None:
    """Calves have more friction than hips and thighs, as users report; every interval of a calf lies above the rest."""
    ends = {name: record.combinations["f/k"].interval95 for name, record in records.items()}
    lowest_calf = min(low for name, (low, _) in ends.items() if name.endswith("calf"))
    assert lowest_calf > max(high for name, (_, high) in ends.items() if not name.endswith("calf"))


def test_gravity_holds_the_link_up(records: dict[str, JointRecord]) -> None:
    """The torque in mid-range is known to a few hundredths even where offset and gravity are not told apart."""
    for record in records.values():
        held = record.combinations["holding torque at mid-range/k"]
        assert held.interval95[1] - held.interval95[0] < 0.1


def test_parts_of_the_log_agree_or_the_record_says_why(records: dict[str, JointRecord]) -> None:
    """A dispute about a parameter must be in the warnings with its reason, and inside the widened interval."""
    labels = {"viscous_friction": "(B + k·kd)/k", "coulomb_friction": "f/k", "inertia": "I/k"}
    agreeing = 0
    for record in records.values():
        for comparison in record.diagnostics["comparisons"]:
            agreeing += not comparison["disputed"]
            for name in comparison["disputed"]:
                low, high = record.combinations[labels[name]].interval95
                more = 1.5 if name == "viscous_friction" else 0.0
                assert all(low <= part["value"] + more <= high for part in comparison["values"][name])
                assert any(comparison["parts"][1] in text and name in text for text in record.warnings)
    assert agreeing >= 6
