"""What is said about friction, in words that do not claim more than is known."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from stiction.core.errors import StictionError
from stiction.files.advice import TRAINING, TRANSFER, FrictionEffect, Source
from stiction.files.joints import Estimate, JointRecord, Objection
from stiction.identification.advice import shipped
from stiction.identification.verdict import Thresholds, TrainingNeed, is_leg, judge

FRICTION = Estimate(1.0, 0.1, (0.8, 1.2))


def ratio(high: float) -> Estimate:
    """Return a ratio whose interval ends at `high`."""
    return Estimate(0.9 * high, 0.05 * high, (0.8 * high, high))


def verdict(
    coulomb: Estimate | None,
    ratio: Estimate | None,
    dead_band: Estimate | None,
    condition: str | None,
    axis: str = "rotary",
    sources: dict[str, Source] | None = None,
) -> TrainingNeed:
    """Judge a joint of which only this is known."""
    record = JointRecord(
        coulomb_friction=coulomb, friction_ratio=ratio, dead_band=dead_band, test_condition=condition, axis=axis
    )
    return judge(record, sources)


@pytest.mark.parametrize(
    ("high", "word"), [(0.0098, "probably does not trouble"), (0.05, "may slow down"), (0.2, "probably lose much")]
)
def test_the_upper_end_decides(high: float, word: str) -> None:
    """A wide interval must not be read at its convenient end."""
    assert word in verdict(FRICTION, ratio(high), None, "loaded").text
    told = verdict(FRICTION, ratio(high), None, "loaded").text
    assert "Provisional" in told and "results/replication/README.md" in told


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


def test_friction_that_scatters_about_zero_is_said_to_be_at_most_its_upper_end() -> None:
    """Nobody can do anything with a motor that loses -0.4 % of its torque; 0.6 % is what it may lose."""
    faint, band = Estimate(-0.004, 0.005, (-0.014, 0.006)), Estimate(-1e-4, 1e-4, (-3e-4, 1e-4))
    told = verdict(Estimate(-0.08, 0.1, (-0.28, 0.12)), faint, band, "in_air")
    assert told.lines[0].startswith("No dry friction can be told from zero in this log: it is at most 0.12 N m")
    assert ", at most 0.6 % (95 %: -1.4 to 0.6) of the torque limit, measured on a leg in the air" in told.lines[0]
    assert "up to f/kp, at most 0.0001 rad" in told.text
    assert told.level is None and told.training is None and "No level is proposed" in told.lines[2]
    assert "told from zero" not in verdict(FRICTION, ratio(0.02), None, "in_air").text


LIMIT = {"torque_limit": 40.0}


@pytest.mark.parametrize(
    ("ends", "condition", "answer", "decides"),
    [
        ((0.012, 0.02), "loaded", "Yes", "at least 1.2 %"),
        ((0.012, 0.02), "loaded", "Yes", "every seed that was trained without friction still follows at 5 %, in"),
        ((0.004, 0.012), "loaded", "A little", "up to 1.2 %"),
        ((0.004, 0.006), "in_air", "A little", "2 times 0.6 %"),
        ((0.004, 0.2), "loaded", "Probably", "up to 20 %"),
        ((0.003, 0.004), "in_air", "No", "at most 0.4 %, even times 2"),
        ((-0.01, 0.03), "in_air", "Cannot be told", "up to 3 %"),
        ((-0.001, 0.002), "in_air", "No", "at most 0.2 %"),
    ],
)
def test_whether_it_matters_is_one_word_and_the_number_that_decides(
    ends: tuple[float, float], condition: str, answer: str, decides: str
) -> None:
    """By hand against the package's 1 % that slowed policies; a yes must hold at the interval's lower end.

    Up to 5 % every seed that was trained without friction follows: that it matters, and `--method none`, would be odd.
    """
    middle = sum(ends) / 2
    share = Estimate(middle, 0.001, ends)
    known = {"coulomb_friction": share.scaled(40.0), "friction_ratio": share, "test_condition": condition}
    told = judge(JointRecord(**known, **LIMIT))
    assert len(told.lines) == 3
    assert told.lines[1].startswith(f"Does it matter? {answer}: ") and decides in told.lines[1]
    unknown = judge(JointRecord(**known), legs=False)
    assert unknown.lines[1].startswith("Does it matter? Cannot be told without the task")


def test_of_walking_is_spoken_to_legs_alone() -> None:
    """An arm's owner reads three lines about walking policies, and nothing about the arm."""
    record = JointRecord(coulomb_friction=FRICTION, friction_ratio=ratio(0.03), test_condition="loaded", **LIMIT)
    arm, leg = judge(record, legs=False), judge(record)
    for word in ("walk", "polic", "leg", "train", "follow"):
        assert word not in arm.text and word not in " ".join(case.text for case in arm.what_if)
    assert "stiction convert" in arm.lines[2] and "stiction train --friction-from" in leg.lines[2]
    assert arm.level == leg.level == 0.03 and arm.training == leg.training
    assert is_leg("FL_calf_joint") and is_leg("left_hip_pitch")
    assert not any(map(is_leg, ("shoulder_pan", "joint", "wrist_3")))


def test_what_makes_a_fit_invalid_stands_in_the_place_of_the_answer() -> None:
    """First what to do, then why; neither level, training nor what-if, however certain the interval looks."""
    objection = Objection("follows_position", "the torque follows the position", "--gravity True")
    record = JointRecord(coulomb_friction=FRICTION, friction_ratio=ratio(0.2), test_condition="loaded", **LIMIT)
    told = judge(replace(record, objections=(objection, replace(objection, seen="and so on"))))
    assert told.lines[0] == "Do first: --gravity True." and "the torque follows the position" in told.lines[1]
    assert "And 1 more: and so on" in told.lines[1] and "no level" in told.lines[2]
    assert told.level is None and told.training is None and told.range is None and told.what_if == ()
    assert "1 N m" not in told.text and "--method" not in told.text


def test_a_linear_axis_is_not_a_leg() -> None:
    """Policies and training levels are about legs."""
    text = verdict(FRICTION, ratio(0.2), Estimate(1e-5, 1e-6, (0.8e-5, 1.2e-5)), "loaded", "linear")
    assert text.level is None and "policy" not in text.text and " m (95 %" in text.text


def test_the_range_and_the_settings_say_the_same_as_the_words() -> None:
    """From zero to 24 % of the limit, 1.2 times the level that is named; little friction, or none, calls for none."""
    told = verdict(FRICTION, ratio(0.25), None, "loaded")
    assert told.level == 0.25 and told.range == pytest.approx([0.0, 0.24])
    assert told.training == {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    assert "--preset quick, which is --method deception --friction-level 0.2." in told.text
    little = verdict(FRICTION, ratio(0.0098), None, "loaded")
    assert (little.level, little.training["method"], little.range) == (0.01, "none", [0.0, 0.0])


def test_what_to_run_is_not_said_to_cover_what_nobody_follows_with() -> None:
    """45 % of the limit, twice what the air measured: at 40 % two of five follow, at 50 % none; 15 % is covered."""
    told = verdict(FRICTION, ratio(0.225), None, "in_air")
    assert told.level == 0.45 and "has to cover 45 %" in told.text
    for said in (told.lines[2], told.details[-1]):
        assert "It does not cover 45 %: " in said and "at 40 % 2 of 5 (3 too slow) follow" in said
    assert "to cover 45 %." not in told.text
    good = verdict(FRICTION, Estimate(0.14, 0.005, (0.13, 0.15)), None, "loaded")
    assert "It covers 15 %: each of 5 seeds follows at 12 % and 15 %." in good.lines[2]
    assert "the hexapod Saturn Lite walking straight at 0.5 m/s, forward and backward, in simulation" in good.lines[2]
    cases = verdict(FRICTION, ratio(0.1), None, "loaded").what_if
    assert [case.text.endswith("which no training is known to.") for case in cases] == [True, False, False, True]


def test_another_robot_is_said_to_be_one() -> None:
    """The only robot that was walked is the hexapod: of a quadruped's joint nothing is known directly."""
    record = JointRecord(coulomb_friction=FRICTION, friction_ratio=ratio(0.12), test_condition="loaded", **LIMIT)
    said = {name: judge(record, robot=name) for name in ("saturn_lite", "go2", None)}
    assert "of Go2 nothing is known directly" in said["go2"].lines[2]
    assert "of any other robot nothing is known directly" in said[None].lines[2]
    assert "nothing is known directly" not in said["saturn_lite"].text
    assert all(one.to_dict()["robot"] == name for name, one in said.items())
    assert all("of the hexapod Saturn Lite on flat ground, under Coulomb" in one.lines[1] for one in said.values())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"load_coefficient": Estimate(0.1, 0.01, (0.08, 0.12)), "friction_law": {"regressor": "motor_torque"}},
         "What load adds to this joint's friction, 0.1 (95 %: 0.08 to 0.12) times |motor torque| [N m], is not"),
        ({"friction_law": {"law": "stribeck"}}, "What the stribeck law of this joint has beyond Coulomb's is not"),
        ({"friction_law": {"law": "coulomb"}}, ""),
    ],
)  # fmt: skip
def test_friction_that_is_not_coulombs_is_not_covered(changes: dict, said: str) -> None:
    """A training under Coulomb's law never met friction that grows with load, however well it follows with the rest."""
    share = Estimate(0.14, 0.005, (0.13, 0.15))
    told = judge(JointRecord(coulomb_friction=FRICTION, friction_ratio=share, test_condition="loaded", **changes))
    assert "It covers 15 %" in told.lines[2] and told.lines[2].endswith("is not covered.") == bool(said)
    assert told.uncovered.startswith(said) and bool(told.uncovered) == bool(said)
    assert told.to_dict()["uncovered"] == told.uncovered == (told.details[-1] if said else "")


MUJOCO = FrictionEffect("mujoco", 3, 1.1, noticeable=0.04, speed_loss=0.05, dead_band=0.018, onset=0.09, severe=0.3)
PHYSX = replace(MUJOCO, engine="physx", noticeable=0.02, speed_loss=0.03, dead_band=0.009, onset=0.061, severe=0.2)
ROBOTS = replace(PHYSX, engine="physx+all", speed_loss=0.011, onset=0.059, frictionless_speed=0.71)


def found(*effects: FrictionEffect) -> dict[str, Source]:
    """Return what the package says of trainings, with other effects of friction."""
    return shipped() | {TRANSFER: replace(shipped()[TRANSFER], effects=effects)}


def test_the_most_sensitive_engine_sets_the_thresholds() -> None:
    """Felt at 2 % in PhysX, at 4 % in MuJoCo; the cost is that of engines in which no policy was trained."""
    thresholds = Thresholds.of(found(MUJOCO, PHYSX, ROBOTS))
    assert (thresholds.noticeable, thresholds.severe, thresholds.dead_band) == (0.02, 0.2, 0.009)
    assert "friction of 2 % of the torque limit cost such policies 1 to 3 %" in thresholds.text
    assert "with 9 % in the simulator" in thresholds.text and "with 6 % in PhysX and on virtual" in thresholds.text
    assert "without friction" not in thresholds.text and "71 % without friction." in Thresholds.of(found(ROBOTS)).text


def test_other_effects_are_another_verdict() -> None:
    """1.5 % of the limit slows a policy by the package's file, and does not where 2 % is the least that was felt."""
    judged = {
        name: verdict(FRICTION, ratio(0.015), None, "loaded", sources=sources)
        for name, sources in (("shipped", shipped()), ("other", found(MUJOCO, PHYSX)))
    }
    assert "may slow down" in judged["shipped"].text and "does not trouble" in judged["other"].text
    assert "may slow down" not in judged["other"].text.split("At 2 times")[0]
    worn = {name: one.what_if[-1].text for name, one in judged.items()}
    assert all("may slow down" in text for text in worn.values())


def test_a_comparison_in_which_friction_was_not_noticeable_is_refused() -> None:
    """If this failed, a file of one seed, which has no interval, would call every friction harmless."""
    with pytest.raises(StictionError, match="several training seeds"):
        Thresholds.of(found(replace(MUJOCO, noticeable=None, speed_loss=None, dead_band=None)))
    with pytest.raises(StictionError, match="replicate --advice"):
        Thresholds.of({name: shipped()[TRAINING] for name in (TRAINING, TRANSFER)})


def test_friction_without_newton_metres_is_judged_by_its_ratio() -> None:
    """A log of positions alone: the words say whose units these are, and an interval over zero is still noticed."""
    told = verdict(None, ratio(0.02), Estimate(0.02, 0.001, (0.018, 0.022)), "in_air")
    assert told.level == 0.04 and "Newton metres are not known" in told.text
    assert "told from zero" in verdict(None, Estimate(0.01, 0.01, (-0.01, 0.03)), None, "in_air").text
    assert "newton metres" not in verdict(None, None, None, None).text


def test_a_joint_stands_among_joints_of_its_condition() -> None:
    """Ratio and dead band are placed; nothing is where nobody said what hung on the motor."""
    told = verdict(FRICTION, ratio(0.02), Estimate(0.02, 0.001, (0.018, 0.022)), "in_air")
    assert [item.quantity for item in told.placement] == ["friction_ratio", "dead_band"]
    assert all(item.text in told.text and item.condition == "in_air" for item in told.placement)
    assert verdict(FRICTION, ratio(0.02), None, None).placement == ()


def test_a_wide_dead_band_is_not_excused_by_a_small_ratio() -> None:
    """0.8 % looks harmless, but the robot behind that judgement had gains at which 1 % was 0.0045 rad."""
    wide, narrow = (Estimate(band, 1e-4, (0.9 * band, 1.1 * band)) for band in (0.005, 0.004))
    assert "felt more" in verdict(FRICTION, ratio(0.008), wide, "loaded").text
    assert "felt more" not in verdict(FRICTION, ratio(0.008), narrow, "loaded").text


def test_seals_and_wear_are_worked_out_and_labelled() -> None:
    """0.3, 1.5, 2 and 3 times 10 % under load; three times 30 % is beyond training."""
    band = Estimate(0.02, 0.001, (0.018, 0.022))
    cases = verdict(FRICTION, ratio(0.1), band, "loaded").what_if
    assert [case.friction_level for case in cases] == [0.03, 0.15, 0.2, 0.3]
    assert [case.dead_band.value for case in cases] == pytest.approx([0.006, 0.03, 0.04, 0.06])
    assert all(case.text.startswith("What if ") for case in cases) and "the paper saw 70 % less" in cases[0].text
    assert all("not measured" in case.text for case in cases[1:])
    worst = verdict(FRICTION, ratio(0.3), band, "loaded").what_if[-1]
    assert worst.friction_level is None and "mend the joint" in worst.text
    assert verdict(FRICTION, None, None, None).what_if == ()
    assert verdict(FRICTION, ratio(0.1), band, "loaded", "linear").what_if == ()


def test_the_plain_data_go_through_json() -> None:
    """Pages and the command line draw it from `joints.json`."""
    told = verdict(FRICTION, ratio(0.02), None, "in_air")
    data = json.loads(json.dumps(told.to_dict(), allow_nan=False))
    assert data["friction_level"] == told.level and data["text"] == told.text
    assert data["what_if"][0]["friction_ratio"]["value"] == pytest.approx(0.3 * 0.018)
    assert data["placement"][0]["count"] == told.placement[0].count and data["what_if"][0]["dead_band"] is None
