"""Joints with more friction at rest than in motion, judged by their torque at rest."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from held import held_log
from identification.test_verdict import SOURCES
from stiction.core.decode import from_plain
from stiction.exchange.physics import beyond_coulomb, joint_physics
from stiction.exchange.urdf import urdf_snippet
from stiction.files.joints import Estimate, JointRecord, JointsFile
from stiction.identification.pipeline import identify_joint
from stiction.identification.verdict import judge, propose
from stiction.task.friction import FrictionCfg
from task.test_env import make

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
    # By what holds it over the limit, its lower end or, where that may be harmless, its upper one.
    ends = (f"at least {0.98 * share:.4g} %; ", f"up to {1.02 * share:.4g} %, and under load")
    assert " f/τ_max at rest is " in told.lines[1] and any(end in told.lines[1] for end in ends)
    assert told.level == math.ceil(100 * 2 * 1.02 * rest / LIMIT - 1e-9) / 100
    assert told.training is not None and told.advice is not None
    assert "which draws " in told.lines[2] and f"Counted is Coulomb's law, {told.advice.flags}" in told.lines[2]
    assert "by what holds the joint at rest" in told.text
    assert [one.text.split(", ")[0] for one in told.placement] == ["Its f/τ_max at rest", "Its f/kp at rest"]
    assert judge(held(rest, motion, "loaded")).level == math.ceil(100 * 1.02 * rest / LIMIT - 1e-9) / 100


def test_what_holds_and_what_brakes_is_drawn_as_the_intervals_have_it() -> None:
    """1.5 over 1 N m within 2 %: 1.44 to 1.56, 0.133 of the limit in motion, 0.2 at rest as in the training counted."""
    record = held(1.5, 1.0, "loaded", stribeck_velocity=Estimate(0.08, 0.02, (0.04, 0.12)))
    told = propose(JointsFile({"shank": record, "hip": held(0.3, 0.3)}))
    shape = {"static_ratio": [1.44, 1.56], "stribeck_velocity": [0.04, 0.12]}
    assert told["friction"] == {"method": "deception", "level": 0.133, "law": "stribeck", "per": "robot", **shape}
    assert told["range"] == [0.0, 0.24]
    cfg = from_plain(FrictionCfg, json.loads(json.dumps(told["friction"])))
    assert cfg.joint_law.static_ratio * cfg.level * cfg.last.range[1] == pytest.approx(0.24, rel=0.01)
    assert (
        "The training draws 1.44 to 1.56 times as much friction at rest as in motion, gone over 0.04 to" in told["text"]
    )
    assert "--friction-level 0.2: as much friction at rest, no fall from it." in told["text"]
    numbers = make(num_envs=64, friction=cfg).host.law.numbers[0]
    for name, (low, high) in shape.items():
        assert low - 1e-6 <= numbers[name].min() < 0.4 * low + 0.6 * high < numbers[name].max() <= high + 1e-6


def test_a_fall_at_once_and_a_ratio_beyond_training_are_said() -> None:
    """A breakaway law has no speed: one is chosen, and said to be; 24 is more than the 10 that training takes."""
    told = judge(held(2.4, 0.1))
    assert told.training["static_ratio"] == [10.0, 10.0] and told.training["stribeck_velocity"] == [0.02, 0.1]
    assert told.training["level"] == pytest.approx(0.1 * told.advice.settings["level"])
    assert "draws 10 times as much" in told.proposal and "are chosen" in told.proposal
    assert "(the most that training takes; this joint's is 24)" in told.proposal


def test_without_friction_in_training_none_rises() -> None:
    """A joint that a training without friction covers has no law with a rise, and the rise is said not to be met."""
    told = judge(held(0.48, 0.4, "loaded"), SOURCES)
    assert told.training["method"] == "none" and "static_ratio" not in told.training
    assert told.lines[2].endswith("The fall of this joint's friction from rest to motion is not covered.")


@pytest.mark.parametrize(("rest", "motion"), [(2.4, 0.1), (0.5, 0.3)])
def test_friction_at_rest_is_found_in_a_short_log(rest: float, motion: float) -> None:
    """12 s are enough: both frictions within 2.5 %, and their intervals hold the truth."""
    record = identify_joint(held_log(rest, motion, seed=1, seconds=12.0)).record
    assert record.objections == () and record.friction_law["law"] == "breakaway"
    for estimate, true in ((record.static_friction, rest), (record.coulomb_friction, motion)):
        assert estimate is not None and estimate.value == pytest.approx(true, rel=0.025)
    low, high = record.static_friction.interval95
    assert low <= rest <= high and record.friction_ratio.value == pytest.approx(rest / LIMIT, rel=0.01)
    drawn = propose(JointsFile({"shank": record}))["friction"]
    assert drawn["law"] == "stribeck" and drawn["static_ratio"][0] <= min(rest / motion, 10) <= drawn["static_ratio"][1]


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


def test_a_simulator_gets_friction_in_motion_and_says_so() -> None:
    """MuJoCo has one number: the one in motion, with a note that nothing more holds the model at rest."""
    physics = joint_physics("shank", held(2.4, 0.1))
    assert physics.friction == pytest.approx(0.1)
    notes = " ".join(beyond_coulomb(held(2.4, 0.1)))
    assert "static_friction 2.4 is not represented, breakaway over moving: 24 (--friction static writes it)" in notes


def test_a_simulator_gets_friction_at_rest_where_that_is_asked_for() -> None:
    """A simulator gets friction at rest alone, and a note on that in motion; a joint with one friction keeps it."""
    physics = joint_physics("shank", held(2.4, 0.1), which="static")
    assert physics.friction == pytest.approx(2.4)
    notes = " ".join(urdf_snippet([physics]).notes)
    assert "static_friction" not in notes and "stribeck, is replaced by its Coulomb and viscous part" in notes
    warning = "at rest, 2.4, breakaway over moving: 24: in motion it has 0.1, and the model is braked by too much"
    assert any(warning in note for note in physics.notes)
    plain = replace(held(2.4, 0.1), static_friction=None, friction_law=None)
    assert joint_physics("shank", plain, which="static").friction == pytest.approx(0.1)
