"""The EMPS benchmark: a real drive, measured, against the values that its authors published."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from stiction.files.joints import Estimate, JointRecord
from stiction.identification.logs import open_log, parse_columns
from stiction.identification.model import Model
from stiction.identification.pipeline import identify_joint
from stiction.identification.setup import IdentifySetup

GTAU, KP, KV = 35.15065188, 160.18, 243.45
"""Constants in the record: N/V of the drive, and the gains of its loop, vir = kv (kp (qg − qm) − qm').

Least squares of the force on qg − qm, qm' and qm'' gives kp and kv within 0.2 % and 8.7 N s²/m on qm'': kv gtau
times 1.0 ms: the velocity that the loop uses is one sample late.
"""

PUBLISHED = {
    "inertia": (95.1089, 0.1085),
    "viscous_friction": (203.5034, 1.146),
    "coulomb_friction": (20.3935, 0.1012),
    "offset": (-3.1648, 0.0444),
}
"""Value and standard deviation by the authors' inverse-dynamics least squares."""


def identify_record(delay: float) -> JointRecord:
    """Identify the record with the loop's gains in N/m and N s/m, the velocity late by `delay` [s]."""
    folder = os.environ.get("STICTION_DATA")
    path = Path(folder or "") / "emps" / "DATA_EMPS.mat"
    if not folder or not path.is_file():
        pytest.skip("the EMPS record is not here: set STICTION_DATA to a folder with emps/DATA_EMPS.mat")
    columns = parse_columns(["time=t", "position=qm", "target=qg", "torque=vir"])
    setup = IdentifySetup(
        kp=GTAU * KV * KP,
        kd=GTAU * KV,
        torque_source="motor_side",
        test_condition="loaded",
        axis="linear",
        torque_scale=GTAU,
        velocity_delay=delay,
    )
    return identify_joint(open_log(path, columns, "carriage"), setup=setup).record


@pytest.fixture(scope="module")
def record() -> JointRecord:
    """Identify the record as its loop is: the velocity is one sample late."""
    return identify_record(0.001)


def test_without_the_delay_the_two_estimators_disagree_and_say_so() -> None:
    """A loop described without its delay costs output error 4 % of the mass: that must not pass in silence."""
    texts = [text for text in identify_record(0.0).warnings if "disagree on inertia" in text]
    assert texts and "--velocity-delay" in texts[0]


def test_both_estimators_agree_with_the_published_values(record: JointRecord) -> None:
    """Mass within 0.5 %, the rest within two published standard deviations; output error never differentiates."""
    simulated = record.diagnostics["output_error"]
    for name, (value, std) in PUBLISHED.items():
        for found in (getattr(record, name).value, simulated[name]["value"]):
            assert found == pytest.approx(value, rel=5e-3) if name == "inertia" else abs(found - value) < 2 * std, name


def test_simulation_is_as_good_as_the_published_one(record: JointRecord) -> None:
    """Published: 0.0138 % of the position, 0.229 % of the velocity, 5.85 % of the force; condition number 25.99."""
    errors = record.diagnostics["output_error"]["relative_errors"]
    assert errors["position"] < 1.38e-4 and errors["velocity"] < 1.1 * 2.29e-3 and errors["torque"] < 0.0585
    assert record.diagnostics["condition_number"] == pytest.approx(25.99, rel=0.1)


def test_intervals_admit_what_the_symmetric_law_lacks(record: JointRecord) -> None:
    """The published asymmetric fit has viscous friction of 167 and 240: an interval of ±2 N s/m would be a lie."""
    low, high = record.viscous_friction.interval95
    assert low < 203.5 < high and high - low > 10 * 1.146
    assert Estimate.from_dict(record.diagnostics["output_error"]["inertia"], "").interval95[0] < 95.1089
    assert all("disagree" not in text for text in record.warnings)


def test_the_asymmetric_law_is_chosen_and_within_a_hundredth_of_the_published_values(record: JointRecord) -> None:
    """By blocks that the fit did not see; the published deviations of this law are not known, 1 % is what is asked."""
    law = record.friction_law
    assert law["law"] == "asymmetric"
    published = (95.154, 166.706, 240.424, 20.144, 20.628)
    for name, value in zip(Model("asymmetric").names, published, strict=True):
        assert law["parameters"][name]["value"] == pytest.approx(value, rel=1e-2), name
    verdicts = {entry["law"]: entry["verdict"] for entry in law["candidates"]}
    assert verdicts["stribeck"] == "friction does not rise toward rest"


def test_instruments_change_nothing_on_a_clean_record(record: JointRecord) -> None:
    """An encoder of a thousand steps a millimetre leaves least squares no bias to correct."""
    found = record.diagnostics["instrumental_variable"]
    for name in PUBLISHED:
        assert found[name]["value"] == pytest.approx(getattr(record, name).value, rel=2e-3), name
