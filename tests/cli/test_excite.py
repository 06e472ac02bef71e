"""`stiction excite` as a user types it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from excitations import search_little
from stiction.cli.main import main
from stiction.files.design import load_design
from stiction.identification.logs import open_log

SHORT = "--duration 6 --rate 200 --torque-limit 45 --coulomb 0.44"
"""A log that is designed quickly."""


@pytest.fixture(autouse=True)
def short_search(monkeypatch: pytest.MonkeyPatch, undrawn: None) -> None:
    """Search and compare a little only: how good the motion is, is tested elsewhere, and so is the page."""
    search_little(monkeypatch)


def test_json_alone_on_standard_output_and_files_in_the_folder(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Scripts parse standard output; the controller plays the CSV back; its sidecar goes with the log."""
    out = tmp_path / "out"
    assert main(["excite", *SHORT.split(), "--joint", "FL_shank", "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "design.json").read_text())
    names = ["design.json", "design.npz", "report.html", "settings.json", "trajectory.csv", "trajectory.json"]
    assert sorted(path.name for path in out.iterdir()) == names
    log = open_log(out / "trajectory.csv")
    target = log.joints["FL_shank"].target
    assert target is not None and len(target) == 1201 and target[0] == target[-1] == 0.0
    assert (log.setup.kp, log.setup.torque_limit) == (printed["gains"]["kp"], 45.0)
    assert load_design(out / "design.json").command.startswith("stiction excite --duration 6")


def test_people_get_the_table_how_to_run_it_and_the_next_command(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """And the next command is one that `stiction identify` understands."""
    assert main(["excite", *SHORT.split(), "--fixed-gains", "--wanted", "1e-6", "--out", str(tmp_path / "x")]) == 0
    out = capsys.readouterr().out
    assert "coulomb_friction" in out and "Run at kp 20, kd 0.5, as fixed." in out and "at 200 Hz: 6 s" in out
    assert "For Coulomb friction to 0.0001 %" in out and "single sine" in out
    line = next(line for line in out.splitlines() if line.startswith("then: "))
    words = shlex.split(line.removeprefix("then: "))
    assert words[:3] == ["stiction", "identify", "LOG.csv"]
    assert main(words[1:]) == 1
    assert "LOG.csv" in capsys.readouterr().err


@pytest.mark.parametrize(("gravity", "condition"), [("--gravity-cos 1", "in_air"), ("", "bare_motor")])
def test_gravity_that_was_planned_for_will_be_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture, gravity: str, condition: str
) -> None:
    """Identification fits gravity in the air alone: the next command and the sidecar must both say so."""
    assert main(["excite", *SHORT.split(), *gravity.split(), "--out", str(tmp_path)]) == 0
    assert f" --test-condition {condition} --out" in capsys.readouterr().out
    assert open_log(tmp_path / "trajectory.csv").setup.test_condition == condition


def test_a_robot_fills_in_the_joint(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Position limits, gains, torque limit and friction are those of the robot's shank."""
    options = ["--robot", "saturn_lite", "--joint", "FL_shank", "--position-only", "--duration", "6", "--rate", "200"]
    assert main(["excite", *options, "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["setup"]["coulomb"] == 0.442 and printed["setup"]["kp"] == 100.0
    assert (printed["limits"]["low"], printed["limits"]["high"], printed["limits"]["torque"]) == (-2.6, -0.4, 45.0)
    assert printed["predicted"][2]["name"] == "coulomb_friction/k"
    assert any("only combinations are known" in text for text in printed["warnings"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--position-limits 0.6 -0.6", "--position-limits 0.6 -0.6"),
        ("--coulomb 50 --torque-limit 45", "could not move the joint"),
        ("--speed-limit 1e-5 --duration 6 --rate 200", "no motion within"),
        ("--robot saturn_lite --joint knee", "unknown joint 'knee'; known: hip, thigh, shank"),
        ("--robot spot --joint shank", "unknown robot 'spot'"),
        (
            "--robot go2 --joint FL_calf_joint --position-limits 1 2",
            "--position-limits 1 2: FL_calf_joint has -2.7227 to -0.83776 rad; give limits within",
        ),
        (
            "--robot go2 --joint FL_calf_joint --torque-limit 400",
            "--torque-limit 400: the motor of FL_calf_joint has 45.43 N m; give no more",
        ),
        ("--duration 6 --rate 200 --out taken/sub", "taken/sub cannot be made"),
    ],
)
def test_what_a_user_can_mend_is_one_line_and_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, options: str, message: str
) -> None:
    """No traceback, nothing on standard output, one line that names the mistake."""
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("")
    assert main(["excite", *options.split()]) == 1
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.startswith("stiction excite: ")]
    assert captured.out == "" and len(lines) == 1 and message in lines[0] and "Traceback" not in captured.err
