"""Findings that invalidate a fit: frequent mistakes, and their effect on levels, files and readers."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from counts import count
from stiction.cli.main import main
from stiction.core.errors import LogError, StictionError
from stiction.exchange.physics import joint_physics
from stiction.files.bam import load_joints
from stiction.files.joints import (
    Estimate,
    Finding,
    JointRecord,
    JointsFile,
    read_training,
)
from stiction.files.known_friction import bench_friction
from stiction.files.log import Log, write_log
from stiction.identification.example import LEG, SATURN_LITE, Excitation, example_log
from stiction.identification.findings import below_zero, drop_share, follows_position, no_friction_shown, unexplained
from stiction.identification.pipeline import identify_joint
from stiction.identification.setup import IdentifySetup
from stiction.identification.verdict import propose
from stiction_experiments.flags import RIGHT, drives, limbs
from stiction_experiments.flags import cases as wrong
from stiction_experiments.flags.study import all_cases, outcome

SHORT = Excitation(duration=8.0)
FRICTION = Estimate(0.44, 0.01, (0.42, 0.46))
GRAVITY_LEFT_OUT = Finding("follows_position", "the torque follows the position", "--gravity True")


def invalid(*errors: Finding, **fields) -> JointRecord:
    """Return a bare motor's record with errors."""
    known = dict.fromkeys(("inertia", "viscous_friction", "coulomb_friction"), FRICTION)
    known |= {"friction_ratio": FRICTION.scaled(1 / 44), "test_condition": "bare_motor"}
    return JointRecord(**(known | fields), findings=errors)


@pytest.mark.parametrize(
    ("mistake", "record", "reason"),
    [
        (wrong.without_gravity, wrong.leg, "follows_position"),
        (wrong.scale(1.2), wrong.motor, "controller"),
        (wrong.target_in_degrees, wrong.motor, "units"),
        (lambda case: wrong.unchecked(wrong.clipped(0.5)(case)), wrong.motor, "clipped"),
        (wrong.torque_of(wrong.leg), wrong.motor, "unexplained_torque"),
        (lambda case: case.flags(torque_limit=1.0), wrong.motor, "beyond_limit"),
    ],
    ids=["gravity", "scale", "degrees", "clipped", "joint", "limit"],
)
def test_no_level_comes_out_of_a_wrong_flag(mistake, record, reason: str) -> None:
    """A wrong flag gives no level; the remedy stands in its place, in the warnings and in the verdict."""
    case = mistake(record())
    result = identify_joint(case.log, setup=case.setup).record
    assert reason in [one.reason for one in result.objections]
    verdict = result.diagnostics["verdict"]
    assert verdict["friction_level"] is None and verdict["training"] is None and verdict["advice"] is None
    assert verdict["lines"][0].startswith("Do first: ") and result.warnings[0] == result.objections[0].seen
    assert propose(JointsFile({"shank": result}))["friction"] is None
    assert JointRecord.from_dict(result.to_dict(), "x").objections == result.objections


@pytest.mark.parametrize("record", [wrong.motor, wrong.leg, wrong.arm])
def test_right_flags_have_no_objection(record) -> None:
    """Right flags give no objection."""
    case = record()
    result = identify_joint(case.log, setup=case.setup).record
    assert result.objections == () and result.diagnostics["verdict"]["friction_level"] is not None


@pytest.mark.parametrize("unstated", [None, "loaded"])
def test_gravity_is_chosen_by_held_out_error_where_nobody_said(unstated: str | None) -> None:
    """A link of 2.2 N m is identified, and a bare motor gets none; the run names the choice and its reason."""
    for motor, there in ((LEG, True), (SATURN_LITE, False)):
        log = example_log(motor, SHORT)
        log = replace(log, setup=replace(log.setup, test_condition=unstated))
        result = identify_joint(log).record
        assert (result.gravity_sin is not None) == there and result.objections == ()
        assert result.diagnostics["gravity"].startswith(f"gravity was {'' if there else 'not '}fitted: on blocks")
        assert any(result.diagnostics["gravity"] in text for text in result.warnings) == (there or unstated is None)
        assert result.coulomb_friction.value == pytest.approx(0.442, rel=0.05)
    stated = identify_joint(example_log(LEG, SHORT), setup=IdentifySetup(gravity=False, test_condition="loaded"))
    assert stated.record.diagnostics["gravity"] is None and stated.record.objections


def test_torque_follows_position_by_hand() -> None:
    """A slope of three deviations or less is chance; the parameter that changes most decides."""
    follows = {"slope": 0.4, "std": 0.1, "changes": {"inertia": -0.3, "coulomb_friction": 0.05}}
    assert follows_position(follows, 0.1) == "inertia" and follows_position(follows, 0.3) is None
    assert follows_position(follows | {"std": 0.14}, 0.1) is None and follows_position(None, 0.0) is None


def test_errors_of_a_record_by_hand() -> None:
    """Each error appears at its bound and not before, with the value and the remedy."""
    (negative,) = below_zero("viscous_friction", Estimate(-0.2, 0.05, (-0.3, -0.1)), "this log", "look")
    assert negative.reason == "negative_friction" and negative.remedy == "look" and negative.severity == "error"
    assert negative.seen.startswith("viscous_friction comes out below zero (-0.3 to -0.1), which no joint has")
    assert not [*below_zero("viscous_friction", Estimate(-0.2, 0.05, (-0.3, 0.0)), "this log", "look")]
    (rest,) = unexplained(0.31, "friction", ": noise", "look")
    assert rest.text == "31% of the torque is not explained by friction, at most 30% may be: noise. Do first: look"
    assert not [*unexplained(0.3, "friction", ": noise", "look")]
    faint, static = Estimate(0.01, 0.01, (0.0, 0.02)), Estimate(0.3, 0.01, (0.28, 0.32))
    (none,) = no_friction_shown(JointRecord(axis="linear"), faint)
    assert "reaches zero (0 to 0.02 N): the log does not show" in none.seen
    assert not [*no_friction_shown(JointRecord(static_friction=static), faint)]
    assert not [*no_friction_shown(JointRecord(), FRICTION)]


def test_nobody_reads_a_level_from_an_invalid_fit() -> None:
    """Training's joints, a policy that observes friction, and a simulator's model omit or reject an invalid fit."""
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed for training")
    from stiction.task.randomization import identified_joints

    file = JointsFile({"shank": invalid(GRAVITY_LEFT_OUT)})
    with pytest.raises(StictionError, match="must not be used: the torque follows the position"):
        file.nominal(("FL_shank",), "coulomb_friction")
    with pytest.raises(StictionError, match="'shank' is not valid, nothing of it is used"):
        identified_joints(file, ("FL_shank",), np.array([0.01]), np.array([44.0]))
    told = bench_friction(file, ("FL_shank",), ("shank",), np.array([44.0]), np.array([0.2]))
    assert told.missing == ("FL_shank",)
    with pytest.raises(StictionError, match="record 'shank' is not valid, nothing of it is written"):
        joint_physics("shank", file.joints["shank"])


@pytest.mark.parametrize(
    ("viscous", "dry", "share"),
    [((-0.02, -0.005), (0.9, 1.1), 0.08), ((0.01, 0.03), (0.9, 1.1), 0.0), ((-0.02, -0.005), (-0.1, 2.1), np.inf)],
)
def test_friction_that_drops_with_speed_is_a_share_of_the_dry_one(viscous, dry, share: float) -> None:
    """−0.02 N m s/rad at 4 rad/s takes 0.08 N m off 1 N m; viscous friction above zero takes none."""
    slope, level = (Estimate(sum(ends) / 2, 0.01, ends) for ends in (viscous, dry))
    assert drop_share(slope, level, np.array([-4.0, 1.0])) == pytest.approx(share)


@pytest.mark.usefixtures("undrawn")
def test_no_training_file_is_written_and_an_old_one_goes(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Else the next command trains with what the run before proposed; the missing file's reason stands beside it. All
    is written, and the status is 1, for a script to see.
    """
    write_log(tmp_path / "shank.csv", example_log(SATURN_LITE, SHORT))
    out = tmp_path / "out"
    command = ["identify", str(tmp_path / "shank.csv"), "--joint", "shank", "--out", str(out)]
    assert main(command) == 0
    assert (out / "training.json").exists()
    right = capsys.readouterr().out
    assert right.startswith("Friction 0.4") and right.splitlines()[1].startswith("Matters: ")
    assert main([*command, "--torque-scale", "2", "--overwrite"]) == 1
    told = capsys.readouterr().out.splitlines()
    assert not (out / "training.json").exists() and load_joints(out / "joints.json").joints["shank"].objections
    assert told[:2] == ["Friction not stated: the fit is not valid", "Matters: CANNOT BE TOLD"]
    assert told[2].startswith("error: the logged torque is 2 times kp") and any(
        line.startswith("Next: check --torque-scale") for line in told
    )
    page = (out / "report.html").read_text()
    assert page.index("Do first: check") < page.index("what was found")
    with pytest.raises(StictionError, match=r"training\.json is missing, .* shank: the logged torque is 2 times"):
        read_training(out / "training.json")


@pytest.mark.slow
def test_no_answer_is_confident_and_wrong() -> None:
    """Every estimate is right, or depends on a property that the log does not show; all cases with STICTION_FULL=1."""
    folder = os.environ.get("STICTION_DATA")
    if not folder:
        pytest.skip("the measured records are not here: set STICTION_DATA to a folder with emps and go2")
    rows = [outcome(case) for case in list(all_cases(Path(folder)))[:: count(6, 1)]]
    assert [row for row in rows if row.confident or row.false_alarm] == []
    assert sum(bool(row.caught) for row in rows if row.mistake != RIGHT) >= count(13, 80)


@pytest.mark.parametrize(
    ("right", "change", "reason"),
    [
        (drives.servo, wrong.flags(kt=3.0), "negative_friction"),
        (drives.weighed, wrong.flags(resistance=2.0), "pendulum_weight"),
        (drives.weighed_alone, wrong.flags(pendulum_angle=0.8), "pendulum_angle"),
        (limbs.leg, limbs.torques(2.0), "torque_scale"),
        (limbs.voltage_leg, wrong.flags(kt=0.5), "torque_scale"),
    ],
    ids=["kt", "R", "hangs", "limb", "limb by voltage"],
)
def test_no_level_comes_out_of_a_wrong_motor(right, change, reason: str) -> None:
    """A contradiction in the data is the first objection, and no estimate is stated."""
    for _, _, record in change(right()).identified():
        assert record.objections[0].reason == reason
        assert record.diagnostics["verdict"]["friction_level"] is None


@pytest.mark.parametrize(
    ("right", "flag"),
    [
        (drives.servo, "--kt"),
        (drives.weighed_alone, "--pendulum-mass"),
        (drives.weighed, None),
        (limbs.voltage_leg, "--kt"),
        (wrong.motor, None),
        (lambda: wrong.unchecked(wrong.motor()), "--torque-scale"),
    ],
    ids=["servo", "pendulum alone", "pendulum and kt", "limb", "gains", "no gains"],
)
def test_the_verdict_names_what_its_scale_rests_on(right, flag: str | None) -> None:
    """The log stays the same if all torques grow: with the right flags too the first line says by whose word they do
    not; and where a weight and the motor's constants, or the gains, say the same, it is nobody's.
    """
    for _, friction, record in right().identified():
        verdict = record.diagnostics["verdict"]
        low, high = record.coulomb_friction.interval95
        assert record.objections == () and abs(record.coulomb_friction.value / friction - 1) < 0.1 and low < high
        assert (flag in verdict["assumes"]) if flag else (verdict["assumes"] == [])
        assert ("all of it if" in verdict["lines"][0]) == (flag is not None)


def altered(time: float = 1.0, **factors: float) -> Log:
    """Return a bare motor's log with its stamps and some of its signals multiplied."""
    log = example_log(SATURN_LITE, SHORT)
    own = log.joints["shank"]
    changed = replace(own, **{name: factor * getattr(own, name) for name, factor in factors.items()})
    return replace(log, time=time * log.time, joints={"shank": changed})


@pytest.mark.parametrize(
    ("log", "message"),
    [
        (
            altered(torque=0.4),
            r"--torque-scale \(about 2.5 would fit\), --position-scale \(about 0.4\) and .* \(about --kp 8 --kd 0.2\)",
        ),
        (altered(time=10.0), r"check --kd \(about 5 would fit\) and the stamps .*: a log about 0.1 times as long"),
        (altered(position=180 / np.pi, target=180 / np.pi), "--position-scale 0.0174533 if the angles are degrees"),
    ],
    ids=["amperes", "stamps", "degrees"],
)
def test_what_contradicts_the_gains_says_which_flag_would_fit(log: Log, message: str) -> None:
    """The remedy names the flag that fits, and never advises to leave the gains out."""
    remedy = identify_joint(log).record.objections[0].remedy
    assert re.search(message, remedy) and "leave" not in remedy


def exchanged() -> Log:
    """Return a bare motor's log with torque and target in each other's columns."""
    log = example_log(SATURN_LITE, SHORT)
    own = log.joints["shank"]
    return replace(log, joints={"shank": replace(own, torque=own.target, target=own.torque)})


@pytest.mark.parametrize(
    ("log", "gains", "message"),
    [
        (altered(torque=-1.0), True, r"check --torque-scale \(about -1 would fit\), and that all columns"),
        (altered(position=-1.0), True, "turn the position's sign round in the log.* runs against its target"),
        (altered(position=-1.0), False, "must be positive: turn the position's sign round"),
        (exchanged(), True, "check that all columns are this joint's, and none are exchanged"),
    ],
    ids=["torque", "position", "no gains", "exchanged"],
)
def test_a_sign_or_a_column_that_the_log_contradicts_is_named(log: Log, gains: bool, message: str) -> None:
    """A wrong sign or column is named, in place of a fit that turns the torque round."""
    log = log if gains else replace(log, setup=replace(log.setup, kp=None, kd=None))
    with pytest.raises(LogError, match=message) as caught:
        identify_joint(log)
    assert "--gravity" not in str(caught.value)
