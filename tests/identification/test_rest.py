"""Joints that need more torque to start than to keep moving: judged by what holds them at rest."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from held import held_log
from stiction.exchange.physics import beyond_coulomb, joint_physics
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.identification.objections import no_friction_shown
from stiction.identification.pipeline import identify_joint
from stiction.identification.proposal import propose
from stiction.identification.verdict import judge
from stiction.report.identification import joint_row, lead_lines

LIMIT, KP = 12.0, 20.0


def about(value: float) -> Estimate:
    """Return an estimate known within 2 %."""
    return Estimate(value, abs(value) / 100, (value - abs(value) / 50, value + abs(value) / 50))


def held(rest: float, motion: float, condition: str = "in_air", **changes: object) -> JointRecord:
    """Return the record of a joint of 12 N m that holds `rest` and brakes with `motion` [N m]."""
    values = {"value": motion, "std": 0.01 * motion, "interval95": [0.98 * motion, 1.02 * motion]}
    fields = {
        "coulomb_friction": about(motion),
        "static_friction": about(rest),
        "friction_ratio": about(rest / LIMIT),
        "dynamic_ratio": about(motion / LIMIT),
        "dead_band": about(rest / KP),
        "friction_law": {"law": "stribeck", "parameters": {"coulomb_friction": values}, "over_strength": False},
        "torque_limit": LIMIT,
        "kp": KP,
        "test_condition": condition,
    }
    return JointRecord(**(fields | changes))


FOUR = [(2.4, 0.1), (1.5, 0.1), (1.0, 0.6), (3.0, 0.3)]


@pytest.mark.parametrize(("rest", "motion"), FOUR)
def test_verdict_and_level_are_decided_at_rest(rest: float, motion: float) -> None:
    """The first line has both numbers, the second one the share at rest, and the level covers twice that in the air."""
    record = held(rest, motion)
    told = judge(record)
    share = 100 * rest / LIMIT
    assert told.lines[0].startswith(f"Dry friction holds {rest:.4g} N m (95 %: ")
    assert f" at rest, {share:.4g} % (95 %: " in told.lines[0]
    assert f" of the torque limit 12 N m, and is {motion:.4g} N m (95 %: " in told.lines[0]
    assert f" in motion, {100 * motion / LIMIT:.4g} %, measured on a leg in the air" in told.lines[0]
    assert told.lines[1].startswith(f"Does it matter? Yes: at rest it is at least {0.98 * share:.4g} %;")
    assert told.level == math.ceil(100 * 2 * 1.02 * rest / LIMIT - 1e-9) / 100
    assert told.training is not None and told.training["method"] == "deception"
    assert told.lines[2].endswith("The fall of this joint's friction from rest to motion is not covered.")
    assert "by what holds the joint at rest" in told.text and "less certain than its interval says" in told.text
    assert [one.text.split(", ")[0] for one in told.placement] == ["Its f/τ_max at rest", "Its f/kp at rest"]
    assert judge(held(rest, motion, "loaded")).level == math.ceil(100 * 1.02 * rest / LIMIT - 1e-9) / 100


@pytest.mark.parametrize(("rest", "motion"), [(1.5, 0.1), (1.0, 0.6)])
def test_the_record_of_a_log_has_the_ratio_and_the_dead_band_at_rest(rest: float, motion: float) -> None:
    """From the log of a simulated joint, its friction at rest within a tenth."""
    record = identify_joint(held_log(rest, motion, seed=1, seconds=12.0)).record
    assert record.friction_ratio.value == pytest.approx(rest / LIMIT, rel=0.1)
    assert record.dead_band.value == pytest.approx(rest / KP, rel=0.1)
    assert record.dynamic_ratio.value == pytest.approx(motion / LIMIT, rel=0.05)
    assert record.friction_ratio.value == pytest.approx(record.static_friction.value / LIMIT)
    assert "Yes: at rest it is at least" in record.diagnostics["verdict"]["lines"][1]


def test_a_joint_whose_friction_at_rest_is_not_found_is_not_called_harmless() -> None:
    """2.4 N m at rest in too short a log: simulation and regression disagree, and there is no level."""
    record = identify_joint(held_log(2.4, 0.1, seed=1, seconds=12.0)).record
    assert [one.reason for one in record.objections] == ["estimators"]
    assert "holds the joint at rest" in record.objections[0].seen
    assert record.diagnostics["verdict"]["friction_level"] is None


def test_no_more_at_rest_changes_no_word() -> None:
    """Friction at rest that is not above that in motion is no news: words, level and ratio are Coulomb's."""
    plain = JointRecord(
        coulomb_friction=about(0.6), friction_ratio=about(0.05), dead_band=about(0.03), torque_limit=LIMIT
    )
    assert plain.holding_friction is None and plain.moving_friction == about(0.6)
    less = replace(plain, static_friction=about(0.5))
    assert less.holding_friction is None and judge(less) == judge(plain)
    assert judge(plain).lines[0].startswith("Dry friction is 0.6 N m") and "at rest" not in judge(plain).text


def test_positions_alone_tell_it_over_the_strength() -> None:
    """Without newton metres the law's parameters, over k, say what holds the joint."""
    law = held(2.4, 0.1).friction_law | {"over_strength": True}
    law["parameters"] = law["parameters"] | {"static_friction": about(2.4).to_dict()}
    record = held(
        2.4, 0.1, coulomb_friction=None, static_friction=None, friction_law=law, combinations={"f/k": about(0.1)}
    )
    assert record.holding_friction == about(2.4)
    assert judge(record).lines[0].startswith("Dry friction holds 2.4 N m over the motor strength k (95 %: ")


def test_friction_in_motion_that_reaches_zero_is_no_objection_where_the_joint_is_held() -> None:
    """A motor with compensation that acts in motion alone: 2.4 N m at rest, nothing in motion that the log shows."""
    faint = Estimate(0.01, 0.02, (-0.03, 0.05))
    record = held(2.4, 0.1, coulomb_friction=faint, dynamic_ratio=faint.scaled(1 / LIMIT))
    assert no_friction_shown(record, faint) == () and judge(record).level == 0.41
    assert propose(JointsFile({"shank": record}))["joints"]["shank"]["friction_level"] == 0.41
    assert no_friction_shown(replace(record, static_friction=None), faint) != ()


def test_an_older_file_is_read_as_what_holds_the_joint() -> None:
    """Files without `dynamic_ratio` have Coulomb friction in the ratio; of other joints nothing changes."""
    record = held(2.4, 0.1)
    old = record.to_dict() | {"friction_ratio": about(0.1 / LIMIT).to_dict()}
    del old["dynamic_ratio"]
    read = JointRecord.from_dict(old, "joints.json")
    assert read.friction_ratio.value == pytest.approx(0.2) and read.dynamic_ratio == about(0.1 / LIMIT)
    assert JointRecord.from_dict(record.to_dict(), "joints.json") == record
    plain = replace(record, static_friction=None, friction_law=None, dynamic_ratio=None).to_dict()
    del plain["dynamic_ratio"]
    assert JointRecord.from_dict(plain, "joints.json").friction_ratio == record.friction_ratio


def test_what_is_proposed_names_both() -> None:
    """training.json: the level of the joint that is held most, its shares at rest and in motion."""
    told = propose(JointsFile({"hip": held(1.0, 0.6), "shank": held(2.4, 0.1)}))
    assert told["friction"]["level"] == 0.2 and told["friction"]["method"] == "deception"
    assert "holds it at rest, 20 % of the torque limit (0.833 % in motion)" in told["text"]
    assert told["joints"]["shank"]["friction_ratio"]["value"] == pytest.approx(0.2)
    assert told["joints"]["shank"]["dynamic_ratio"]["value"] == pytest.approx(0.1 / LIMIT)


def test_among_several_joints_the_one_that_is_held_most_comes_first() -> None:
    """Terminal and page name the joint by what holds it, and its row has both numbers."""
    records = {
        name: replace(record, diagnostics={"verdict": judge(record).to_dict()})
        for name, record in (("hip", held(0.65, 0.6)), ("shank", held(2.4, 0.1)))
    }
    lines = lead_lines(JointsFile(records))
    assert "shank has the most dry friction for its motor:" in lines
    assert any(line.startswith("Dry friction holds 2.4 N m") for line in lines)
    row = joint_row(records["shank"])
    assert row[0] == "0.1 (2.4 at rest)" and "20.00%" in row


def test_a_simulator_gets_friction_in_motion_and_says_so() -> None:
    """MuJoCo has one number: the one in motion, with a note that nothing more holds the model at rest."""
    found = joint_physics("shank", held(2.4, 0.1))
    assert found.friction == pytest.approx(0.1)
    notes = beyond_coulomb(held(2.4, 0.1))
    assert "static_friction 2.4 is not represented: at rest the model is held by its friction in motion alone" in notes
