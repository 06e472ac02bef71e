"""`stiction identify` as a user types it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stiction.cli.main import main
from stiction.files.bam import load_joints
from stiction.files.log import Log, write_log
from stiction.identification.example import SATURN_LITE, example_log

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Write a log with its sidecar."""
    write_log(tmp_path / "swing.csv", example_log())
    return tmp_path / "swing.csv"


def test_json_alone_on_standard_output_and_files_in_the_folder(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Scripts parse standard output; training reads joints.json; people open report.html."""
    assert main(["identify", str(log), "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) >= {"joints", "warnings"} and printed["warnings"] == []
    names = ["fit.npz", "joints.json", "report.html", "settings.json", "training.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    joints = load_joints(tmp_path / "out" / "joints.json")
    assert joints.to_dict() == printed
    assert joints.nominal(["FL_shank"], "inertia")[0] == pytest.approx(SATURN_LITE.joint.inertia, rel=0.05)


def test_a_foreign_log_by_mapping_and_flags(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Other column names, torque in other units, no sidecar: all of it from flags, as documented for EMPS."""
    made = example_log()
    log, signals = tmp_path / "log.csv", made.joints["shank"]
    table = zip(made.time, signals.position, signals.target, signals.torque / 35.15, strict=True)
    log.write_text("t,qm,qg,vir\n" + "\n".join(",".join(map(repr, map(float, row))) for row in table) + "\n")
    flags = "--joint knee --columns time=t position=qm target=qg torque=vir --torque-scale 35.15 --kp 20 --kd 0.5"
    flags += " --torque-limit 45 --torque-source motor_side --test-condition bare_motor --json"
    assert main(["identify", str(log), *flags.split(), "--out", str(tmp_path / "out")]) == 0
    printed = json.loads(capsys.readouterr().out)
    knee = printed["joints"]["knee"]
    assert printed["warnings"] == [] and knee["torque_limit"] == 45
    assert knee["coulomb_friction"]["value"] == pytest.approx(0.442, rel=0.05)


def test_no_page_where_none_is_wanted(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Writes joints.json alone with page=false, and mentions no page."""
    assert main(["identify", str(log), "--out", str(tmp_path / "out"), "--set", "page=false"]) == 0
    assert capsys.readouterr().out.endswith("/out/joints.json\n")
    assert not (tmp_path / "out" / "report.html").exists() and (tmp_path / "out" / "joints.json").exists()


def test_people_get_the_answer_at_a_glance(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Friction, answer and next command, alone on its line, in five whole lines of a file; all else is on the page."""
    out = tmp_path / "my out"
    assert main(["identify", str(log), "--out", str(out), "--test-condition", "loaded"]) == 0
    facts, answer, step, command, why = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"Friction 0\.44\d* ± 0\.00\d+ N m, 0\.98 % of 45 N m, dead band 1\.3°", facts), facts
    assert answer == "Matters: A LITTLE" and step == "Next:"
    assert command == f"  stiction train --friction-from '{out}/training.json' --preset quick"
    assert why == f"why, and what is not known: {out}/report.html"
    page = (out / "report.html").read_text()
    assert (
        "N m s/rad" in page and "Coulomb friction predicts unseen blocks better" in page and "lost a tenth of" in page
    )


def test_the_next_command_is_the_whole_one_with_what_it_lacks(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Without a torque limit nothing can be trained: the same command again, with --torque-limit."""
    log.with_suffix(".json").unlink()
    arguments = ["identify", str(log), "--kp", "20", "--kd", "0.5", "--out", str(tmp_path / "o")]
    assert main(arguments) == 0
    command = capsys.readouterr().out.splitlines()[-2]
    assert command == f"  stiction {' '.join(arguments)} --torque-limit LIMIT --overwrite"
    assert main([*command.replace("LIMIT", "45").split()[1:]]) == 0
    assert "  stiction train --friction-from " in capsys.readouterr().out


@pytest.mark.parametrize("name", ["joints.csv", "fit.npz"])
def test_a_result_never_replaces_a_log_or_its_sidecar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, name: str
) -> None:
    """`joints.json` beside `joints.csv` would be its sidecar; `fit.npz` may be the log itself."""
    monkeypatch.chdir(tmp_path)
    write_log(Path(name), example_log())
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert main(["identify", name, "--out", "."]) == 1
    error = capsys.readouterr().err
    assert "--out" in error and name in error and error.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv"], "no log at none.csv; expected"),
        (["swing.cvs"], "no log at swing.cvs; did you mean 'swing.csv'? expected"),
        (["swing.csv", "--joint", "hip"], "unknown joint 'hip'"),
        (["swing.csv", "--kp", "-3"], "kp -3.0"),
        (["swing.csv", "--torque-limit", "1e9"], "torque limit 1e+09: expected at most 2000 N m"),
        (["swing.csv", "--to", "inf"], "swing.csv: to is inf; expected seconds"),
        (["swing.csv", "--init", "--repeat", "swing.csv"], "--init and --repeat exclude each other"),
        (["bare.csv", "--init", "--joint", "hip"], "its joints are shank, and a sidecar is of all of them"),
        (["swing.csv", "--out", "swing.csv/sub"], "cannot be made"),
        (["swing.csv", "--torque-scale", "1e6"], "beyond the torque limit 45"),
        ([".", "--init"], "is a directory"),
        (["loop.csv"], "no log at loop.csv"),
        (["swing.csv", "--up", "0", "0", "1"], "--up requires --robot; add --robot"),
        (["swing.csv", "--repeat", "half.csv"], "half.csv cannot be compared, leave it out or mend it: half.csv: "),
        (["swing.csv", "--set", "delay=1e200"], "delay 1e+200: expected at most 1"),
        (["swing.csv", "--out", "\udcff"], "'\\udcff' is no UTF-8 text, in which results name the command"),
    ],
)
def test_what_a_user_can_mend_is_one_line_and_status_1(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, arguments: list[str], message: str
) -> None:
    """No traceback, nothing on standard output, one line on standard error."""
    monkeypatch.chdir(log.parent)
    Path("half.csv").write_text("words, and no table\n")
    Path("loop.csv").symlink_to("loop.csv")
    Path("bare.csv").write_bytes(log.read_bytes())
    Path("limit.json").write_text('{"torque_limit": 2001}')
    assert main(["identify", *arguments]) == 1
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.strip()]
    assert captured.out == "" and len(lines) == 1
    assert lines[0].startswith("stiction identify: ") and message in lines[0]


def test_every_joint_of_a_log_is_identified(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """One result a joint, side by side; a joint that tells nothing is refused alone, with its reason, and null."""
    made = example_log()
    still = replace(made.joints["shank"], position=np.zeros(len(made.time)))
    joints = {"FL_hip": made.joints["shank"], "FR_hip": made.joints["shank"], "RL_hip": still}
    write_log(tmp_path / "three.npz", Log("three", made.time, joints, made.setup))
    out = tmp_path / "out"
    assert main(["identify", str(tmp_path / "three.npz"), "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "identifying FR_hip: done" in shown.err and "RL_hip: not identified: three.npz: position" in shown.out
    assert " at FL_hip, 0.98 % of 45 N m" in shown.out and shown.out.count("Next:") == 1
    assert [line.split()[0] for line in shown.out.splitlines()[-5:-1]] == ["joint", "FL_hip", "FR_hip", "RL_hip"]
    file = load_joints(out / "joints.json")
    assert list(file.joints) == ["FL_hip", "FR_hip", "RL_hip"]
    assert file.joints["FL_hip"].coulomb_friction == file.joints["FR_hip"].coulomb_friction
    assert file.joints["RL_hip"].coulomb_friction is None
    assert "<summary>FR_hip</summary>" in (out / "report.html").read_text()
