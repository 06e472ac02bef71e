"""A walk from `evaluate --log` to `identify`, as a user does it."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import walks
from stiction.cli import evaluate
from stiction.cli.identified import RESULTS
from stiction.cli.main import main
from stiction.files.bam import load_joints
from stiction.files.joints import read_training
from stiction.files.tables import write_csv
from stiction.files.walk import read_walk, write_walk
from without import run_without
from words import but

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log on disk, with friction of a tenth of the torque limit."""
    path = tmp_path_factory.mktemp("walk") / "walk.npz"
    write_walk(path, walks.walk(0.1 * walks.LIMITS[None], [walks.CURVE], seconds=6.0)[0])
    return path


def test_evaluate_writes_logs_that_identify_reads(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """One file per bundle, level, command and robot, in the folder asked for."""
    arguments = ["saturn_lite-flat-deception-0.2", "--friction-levels", "0", "0.1", "--commands", "vx=0.5"]
    arguments += ["--episodes", "2", "--seconds", "3", "--log", str(tmp_path / "logs"), "--log-robots", "1"]
    arguments += ["--log-seconds", "5", "--out", str(tmp_path / "out"), "--json"]
    assert evaluate.main(arguments) == 0
    names = [f"saturn_lite-flat-deception-0.2--{level}--vx=0.5--0.npz" for level in ("0", "0.1")]
    assert sorted(path.name for path in (tmp_path / "logs").iterdir()) == names
    assert json.loads(capsys.readouterr().out)["logs"] == names
    assert read_walk(tmp_path / "logs" / names[1]).header.command == "vx=0.5"
    assert main(["identify", str(tmp_path / "logs" / names[1]), "--out", str(tmp_path / "found")]) == 0
    ratio = load_joints(tmp_path / "found" / "joints.json").record("ML_shank").friction_ratio
    assert ratio is not None
    assert ratio.value == pytest.approx(0.1, abs=0.02)


def test_a_log_of_another_walk_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Its name says neither how long it is nor where torque was measured, and another --out has nothing to object."""
    arguments = ["evaluate", "saturn_lite-flat-deception-0.2", "--friction-levels", "0.1", "--commands", "vx=0.5"]
    arguments += ["--episodes", "1", "--seconds", "3", "--log", str(tmp_path / "logs"), "--log-robots", "1"]
    arguments += ["--log-seconds", "1"]
    other = [*arguments, "--log-torque", "output_side", "--out", str(tmp_path / "other")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    (log,) = (tmp_path / "logs").iterdir()
    before = log.read_bytes()
    capsys.readouterr()
    assert main(other) == 1
    assert f"{log} exists already, of another walk; choose another --log" in capsys.readouterr().err
    assert log.read_bytes() == before
    assert main([*arguments, "--out", str(tmp_path / "again")]) == 0, "the same walk is the same log"
    assert main([*other, "--overwrite"]) == 0
    assert read_walk(log).header.torque_source == "output_side"


def test_results_and_table(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Four files, a table at a glance, and each warning once on the page."""
    assert main(["identify", "--robot", "saturn_lite", str(log), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "_shank" in out and out.count("Next:") == 1
    folded = (tmp_path / "report.html").read_text().partition('class="why"')[2].partition("</details>")[0]
    assert folded.count("--mass-known") == 1
    assert {path.name for path in tmp_path.iterdir()} == set(RESULTS)
    assert read_training(tmp_path / "training.json")["friction"]["level"] > 0.1


def test_the_base_install_identifies_a_walk(log: Path, tmp_path: Path) -> None:
    """Dynamics of a shipped robot's links are NumPy's: neither torch nor a simulator is needed."""
    done = run_without(["torch", "mujoco"], "identify", str(log), "--out", str(tmp_path), "--json")
    assert done.returncode == 0, done.stderr
    assert "FL_shank" in json.loads(done.stdout)["joints"]


def test_bad_input_is_one_line(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The robot that walked, its masses, and a folder of its own."""
    own, other = tmp_path / "fit.npz", tmp_path / "other.npz"
    own.write_bytes(log.read_bytes())
    walk = read_walk(log)
    write_walk(other, replace(walk, header=replace(walk.header, robot="mine.robots:ROBOT")))
    (tmp_path / "file").write_text("")
    for path, options, message in (
        (log, ["--robot", "go1"], "go1"),
        (own, ["--out", str(tmp_path)], "choose another --out"),
        (other, [], "name it: --robot"),
        (log, ["--out", str(tmp_path / "file")], "choose another --out"),
    ):
        assert main(["identify", str(path), *but(("--out", str(tmp_path / "out")), *options)]) == 1
        error = capsys.readouterr().err.splitlines()
        assert [message in line for line in error if line.startswith("stiction identify: ")] == [True]
    assert own.read_bytes() == log.read_bytes()


@pytest.fixture(scope="module")
def table(log: Path) -> dict[str, np.ndarray]:
    """The signals of the same walk in columns, as somebody's logger writes them."""
    walk = read_walk(log)
    assert walk.joint_torque is not None and walk.specific_force is not None
    columns = {"time": walk.time}
    for index, name in enumerate(walk.header.joint_names):
        columns |= {f"position.{name}": walk.joint_position[:, index], f"torque.{name}": walk.joint_torque[:, index]}
    for role, labels, values in (
        ("quaternion", "wxyz", walk.quaternion),
        ("gyroscope", "xyz", walk.angular_velocity),
        ("accelerometer", "xyz", walk.specific_force),
    ):
        columns |= {f"{role}.{label}": column for label, column in zip(labels, values.T, strict=True)}
    return columns


def test_a_walk_in_others_columns(table: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """`identify walk LOG --robot` writes what a walking log gives, and says where contact is known from."""
    write_csv(tmp_path / "walk.csv", table)
    out = tmp_path / "out"
    arguments = ["identify", "walk", str(tmp_path / "walk.csv"), "--out", str(out)]
    assert main(arguments) == 1
    assert "of which robot is this walk? Its masses and lengths: --robot FILE" in capsys.readouterr().err
    assert main([*arguments, "--robot", "saturn_lite", "--torque-source", "motor_side", "--contact", "torque"]) == 0
    output = capsys.readouterr()
    assert "Friction " in output.out
    assert "No artists" not in output.err
    assert {path.name for path in out.iterdir()} == set(RESULTS)
    ratio = load_joints(out / "joints.json").record("ML_shank").friction_ratio
    assert ratio is not None and ratio.value == pytest.approx(0.1, abs=0.02)
    page = (out / "report.html").read_text()
    assert "Feet on the ground, from the motors" in page and "inertia and viscous friction are not stated" in page
