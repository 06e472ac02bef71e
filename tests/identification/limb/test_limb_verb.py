"""`stiction identify LOG --robot FILE`: four files, the numbers in them, and one line where something is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from limb_logs import ARM6, Truth, limb_logs

from stiction.cli.identified import RESULTS
from stiction.cli.main import main
from stiction.files.bam import load_joints
from stiction.files.joints import ARMATURE
from stiction.files.log import write_log

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Truth]:
    """Return a log of the arm of six joints, and its true parameters."""
    path = tmp_path_factory.mktemp("arm") / "arm.npz"
    ((log, truth),) = limb_logs(ARM6, [3], seconds=10.0)
    write_log(path, log)
    return path, truth


def test_a_log_and_a_robot_give_friction_of_every_joint(
    arm: tuple[Path, Truth], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """All six within a quarter, the error that was admitted said with the answer, and a page."""
    log, truth = arm
    assert main(["identify", str(log), "--robot", ARM6.robot, "--out", str(tmp_path)]) == 0
    assert "wrist_3" in capsys.readouterr().out
    page = (tmp_path / "report.html").read_text()
    assert "off by 10%" in page and "--model-error" in page
    assert {path.name for path in tmp_path.iterdir()} == set(RESULTS)
    joints = load_joints(tmp_path / "joints.json").joints
    for record, friction, rotor in zip(joints.values(), truth.coulomb_friction, truth.armature, strict=True):
        assert record.coulomb_friction is not None
        assert record.coulomb_friction.value == pytest.approx(friction, rel=0.25)
        assert record.combinations[ARMATURE].value == pytest.approx(rotor, rel=0.25)


def test_alone_the_joints_are_wrong_and_a_word_is_said(
    arm: tuple[Path, Truth], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The elbow without the model takes its neighbours' torques for its own; --robot is named as the way out."""
    log, truth = arm
    main(["identify", str(log), "--joint", "elbow", "wrist_3", "--out", str(tmp_path)])
    output = capsys.readouterr().out
    assert "--robot FILE" in output
    alone = load_joints(tmp_path / "joints.json").joints["elbow"].coulomb_friction
    assert alone is not None and abs(alone.value / truth.coulomb_friction[2] - 1) > 0.25


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--robot", "none.xml"], "there is no such"),
        (["--robot", "go3"], "unknown robot 'go3'"),
        (["--robot", "go2"], "unknown joint 'pan'"),
        (["--robot", ARM6.robot, "--joint", "pant"], "unknown joint 'pant'"),
        (["--robot", ARM6.robot, "--up", "0", "0", "0"], "direction up"),
    ],
)
def test_what_a_user_can_mend_is_one_line(
    arm: tuple[Path, Truth], tmp_path: Path, capsys: pytest.CaptureFixture, flags: list[str], message: str
) -> None:
    """Status 1, one line on standard error, nothing written."""
    assert main(["identify", str(arm[0]), *flags, "--out", str(tmp_path / "out")]) == 1
    captured = capsys.readouterr()
    assert message in captured.err and captured.err.count("\n") == 1 and not captured.out
    assert not (tmp_path / "out").exists()


def test_one_joint_can_be_asked_for_and_has_the_arm_s_model(
    arm: tuple[Path, Truth], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """The elbow as among all, and alone in the results; the motion of the others is taken off."""
    log, truth = arm
    flags = ["--robot", ARM6.robot, "--joint", "elbow"]
    assert main(["identify", str(log), *flags, "--out", str(tmp_path)]) == 0
    joints = load_joints(tmp_path / "joints.json").joints
    assert list(joints) == ["elbow"] and joints["elbow"].coulomb_friction is not None
    assert joints["elbow"].coulomb_friction.value == pytest.approx(truth.coulomb_friction[2], rel=0.25)
