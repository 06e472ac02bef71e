"""What makes a fit invalid: mistakes that people make, and what becomes of a level, of files and of their readers."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.exchange.physics import joint_physics
from stiction.formats.joints import (
    FRICTION_REACHES_ZERO,
    Estimate,
    JointRecord,
    JointsFile,
    Objection,
    load_joints,
    read_training,
)
from stiction.formats.known_friction import bench_friction
from stiction.formats.log import write_log
from stiction.identify.example import LEG, SATURN_LITE, Excitation, SensorNoise, example_log
from stiction.identify.objections import follows_position
from stiction.identify.pipeline import identify_joint
from stiction.identify.proposal import propose
from stiction.identify.setup import IdentifySetup
from stiction.studies.flags import cases as wrong
from stiction.studies.flags.study import outcome

SHORT = Excitation(duration=8.0)
FRICTION = Estimate(0.44, 0.01, (0.42, 0.46))
GRAVITY_LEFT_OUT = Objection("follows_position", "the torque follows the position", "--gravity True")


def invalid(*objections: Objection, **fields) -> JointRecord:
    """Return a bare motor's record with objections."""
    known = dict.fromkeys(("inertia", "viscous_friction", "coulomb_friction"), FRICTION)
    known |= {"friction_ratio": FRICTION.scaled(1 / 44), "test_condition": "bare_motor"}
    return JointRecord(**(known | fields), objections=objections)


@pytest.mark.parametrize(
    ("mistake", "record", "reason"),
    [
        (wrong.without_gravity, wrong.leg, "follows_position"),
        (wrong.scale(4 / 3), wrong.motor, "controller"),
        (wrong.target_in_degrees, wrong.motor, "units"),
        (lambda given: wrong.unchecked(wrong.clipped(0.5)(given)), wrong.motor, "clipped"),
        (wrong.torque_of(wrong.leg), wrong.motor, "unexplained_torque"),
        (lambda given: given.flags(torque_limit=1.0), wrong.motor, "beyond_limit"),
    ],
    ids=["gravity", "scale", "degrees", "clipped", "joint", "limit"],
)
def test_no_level_comes_out_of_a_wrong_flag(mistake, record, reason: str) -> None:
    """And what to do stands in the place of the answer, in the warnings and in the verdict."""
    given = mistake(record())
    found = identify_joint(given.log, setup=given.setup).record
    assert reason in [one.reason for one in found.objections]
    verdict = found.diagnostics["verdict"]
    assert verdict["friction_level"] is None and verdict["training"] is None and verdict["advice"] is None
    assert verdict["lines"][0].startswith("Do first: ") and found.warnings[0] == found.objections[0].seen
    assert propose(JointsFile({"shank": found}))["friction"] is None
    assert JointRecord.from_dict(found.to_dict(), "x").objections == found.objections


@pytest.mark.parametrize("record", [wrong.motor, wrong.leg, wrong.arm])
def test_right_flags_have_no_objection(record) -> None:
    """A gate that is always shut protects nobody."""
    given = record()
    found = identify_joint(given.log, setup=given.setup).record
    assert found.objections == () and found.diagnostics["verdict"]["friction_level"] is not None


def test_noise_that_kd_feeds_back_is_no_wrong_gain() -> None:
    """The logged torque differs from the controller's by more than 15 %, but no multiple of it is nearer: a warning."""
    log = example_log(SATURN_LITE, SHORT, SensorNoise(torque=0.4, ripple=0.2))
    found = identify_joint(log).record
    assert found.diagnostics["controller_mismatch"] > 0.15 and found.objections == ()
    assert any("output error is not done" in text for text in found.warnings)


@pytest.mark.parametrize("unstated", [None, "loaded"])
def test_gravity_is_chosen_by_held_out_error_where_nobody_said(unstated: str | None) -> None:
    """A link of 2.2 N m is found, and a bare motor gets none; the run says which, and why."""
    for motor, there in ((LEG, True), (SATURN_LITE, False)):
        log = example_log(motor, SHORT)
        log = replace(log, setup=replace(log.setup, test_condition=unstated))
        found = identify_joint(log).record
        assert (found.gravity_sin is not None) == there and found.objections == ()
        assert found.diagnostics["gravity"].startswith(f"gravity was {'' if there else 'not '}fitted: on blocks")
        assert any(found.diagnostics["gravity"] in text for text in found.warnings) == (there or unstated is None)
        assert found.coulomb_friction.value == pytest.approx(0.442, rel=0.05)
    stated = identify_joint(example_log(LEG, SHORT), setup=IdentifySetup(gravity=False, test_condition="loaded"))
    assert stated.record.diagnostics["gravity"] is None and stated.record.objections


def test_torque_follows_position_by_hand() -> None:
    """A slope of three deviations or less is chance; the parameter that changes most decides."""
    follows = {"slope": 0.4, "std": 0.1, "changes": {"inertia": -0.3, "coulomb_friction": 0.05}}
    assert follows_position(follows, 0.1) == "inertia" and follows_position(follows, 0.3) is None
    assert follows_position(follows | {"std": 0.14}, 0.1) is None and follows_position(None, 0.0) is None


def test_nobody_reads_a_level_from_an_invalid_fit() -> None:
    """Training's joints, a policy that is told, a simulator's model: each leaves it out or refuses, and says why."""
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed for training")
    from stiction.locomotion.randomization import identified_joints

    file = JointsFile({"shank": invalid(GRAVITY_LEFT_OUT)})
    with pytest.raises(StictionError, match="must not be used: the torque follows the position"):
        file.nominal(("FL_shank",), "coulomb_friction")
    with pytest.raises(StictionError, match="'shank' is not valid, nothing of it is used"):
        identified_joints(file, ("FL_shank",), np.array([0.01]), np.array([44.0]))
    told = bench_friction(file, ("FL_shank",), ("shank",), np.array([44.0]), np.array([0.2]))
    assert told.missing == ("FL_shank",)
    with pytest.raises(StictionError, match="record 'shank' is not valid, nothing of it is written"):
        joint_physics("shank", file.joints["shank"])


def test_friction_that_cannot_be_told_from_zero_costs_nothing_but_itself() -> None:
    """Inertia stands; friction is used as zero where it is at most 1 % of the limit, which nobody notices."""
    nothing = Objection(FRICTION_REACHES_ZERO, "the interval reaches zero", "log for longer")
    share = Estimate(0.007, 0.007, (-0.007, 0.02))
    wide = invalid(nothing, coulomb_friction=Estimate(0.3, 0.3, (-0.3, 0.9)), friction_ratio=share)
    assert wide.objection_to("inertia") is None and wide.objection_to("coulomb_friction") == nothing
    small = replace(wide, friction_ratio=Estimate(0.001, 0.001, (-0.001, 0.003)))
    assert small.objection_to("coulomb_friction") is None
    assert joint_physics("shank", wide).friction is None and joint_physics("shank", wide).armature == 0.44
    assert JointsFile({"shank": small}).nominal(("FL_shank",), "coulomb_friction") == (0.3,)


def test_no_training_file_is_written_and_an_old_one_goes(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Else the next command trains with what the run before proposed; the missing file's reason stands beside it."""
    write_log(tmp_path / "shank.csv", example_log(SATURN_LITE, SHORT))
    out = tmp_path / "out"
    command = ["identify", str(tmp_path / "shank.csv"), "--joint", "shank", "--out", str(out)]
    assert main(command) == 0
    assert (out / "training.json").exists()
    right = capsys.readouterr().out
    assert right.startswith("Dry friction is 0.4") and right.splitlines()[1].startswith("Does it matter? ")
    assert main([*command, "--torque-scale", "2", "--overwrite"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert not (out / "training.json").exists() and load_joints(out / "joints.json").joints["shank"].objections
    assert told[0].startswith("Do first: check --torque-scale") and "2 times kp" in told[1]
    page = (out / "report.html").read_text()
    assert page.index("Do first: check") < page.index("what was found")
    with pytest.raises(StictionError, match=r"no training\.json, .* shank: the logged torque is 2 times"):
        read_training(out / "training.json")


@pytest.mark.slow
def test_no_answer_is_confident_and_wrong() -> None:
    """The whole suite of results/identification: what is stated is right, or rests on what nothing in the log shows."""
    folder = os.environ.get("STICTION_DATA")
    if not folder:
        pytest.skip("the measured records are not here: set STICTION_DATA to a folder with emps and go2")
    rows = [outcome(case) for case in wrong.cases(Path(folder))]
    assert [row for row in rows if row.confident and not row.invisible] == []
    assert all("as declared" in row.said for row in rows if row.confident)
    assert sum(bool(row.caught) for row in rows) >= 31
