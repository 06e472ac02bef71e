"""A disk that fills, turns read-only, is gone or hangs while a robot runs: the run goes on, and says so."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed for a virtual robot")

from deployed import CONTRACT, JOINTS
from disks import read_only
from processes import stiction, wait_until
from run_log_attacks import HEADERS
from stiction.cli import deploy
from stiction.cli.main import main
from stiction.core.errors import UnwrittenError
from stiction.deploy.runtime import processes
from stiction.deploy.runtime.channel import Channel, row_layout, socket_pair, targets_layout
from stiction.deploy.runtime.processes import Logger
from stiction.deploy.runtime.recorder import Rows, record
from stiction.files.run_log import find_run_log, read_part, read_run_header, read_run_log, write_run_header

POLICY = "saturn_lite-flat-deception-0.2"
PATIENT = ("--armed", "--silence", "5", "--stale", "5", "--gap", "5", "--set", "safety.losses=1")
STAND = (*PATIENT, "--stand", "--robot-cell", "sensors", "--friction-level", "0")
READINGS, STEPS = row_layout(JOINTS, 6), targets_layout(CONTRACT)


def test_a_disk_that_fills_ends_the_log_and_not_the_run(tmp_path: Path) -> None:
    """A full disk ends the log with a message, and the robot keeps running."""
    room = 20_000  # Enough for header and report, and not for half a second of the log.
    done = subprocess.run(
        stiction("deploy", POLICY, *STAND, "--duration", "1", "--json", "--out", str(tmp_path / "run")),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
        # What Python compiled within it would be cut off too, and be found so by the next process.
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    assert "done: " in done.stderr and "its log is not whole: " in done.stderr and "File too large" in done.stderr
    report = json.loads(done.stdout)
    assert report == json.loads((tmp_path / "run" / "report.json").read_text())
    assert report["stop"] is None and report["periods"] > 10 and report["stage"] == "done"
    assert report["log_lost"] >= 1 and "File too large" in report["log_end"]
    assert report["virtual"]["damped"] is not None
    written = list((tmp_path / "run" / "log").glob("*.npz"))
    assert all(read_part(file, read_run_header(file.parent).run) for file in written)
    assert all(file.stat().st_size < room for file in written)


def test_a_folder_that_is_gone_is_said_at_once_and_the_stop_too(tmp_path: Path) -> None:
    """A run whose log ended hides why it was stopped, or the other way round."""
    log = tmp_path / "run" / "log"
    words = stiction("deploy", POLICY, *STAND, "--out", str(tmp_path / "run"))
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    wait_until(lambda: any(log.glob("readings-*.npz")), "no log came", 120.0)
    shutil.move(log, tmp_path / "moved")
    log.write_text("")
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "no log from now on, the run goes on: " in line:
            time.sleep(0.3)
            assert process.poll() is None
            process.terminate()
    assert process.wait() == 128 + signal.SIGTERM
    assert "stopped: operator: SIGTERM; its log is not whole: " in lines[-1] and "cannot be written" in lines[-1], lines
    assert json.loads((tmp_path / "run" / "report.json").read_text())["stop"]["rule"] == "operator"
    assert len(read_run_log(tmp_path / "moved").readings["time"]) > 10


def test_rows_of_the_most_joints_are_not_cut(tmp_path: Path) -> None:
    """A datagram has room for the rows of the most joints: none is truncated."""
    readings = row_layout(256, 6)
    write_run_header(tmp_path, HEADERS["walk"])
    ours, theirs = socket_pair()
    rows = Rows(Channel(ours, readings), readings)
    for number in range(20):
        rows.reading(float(number), {})
    rows.end()
    record(tmp_path, theirs, readings, STEPS, 10)
    ours.close()
    theirs.close()
    (file,) = tmp_path.glob("*.npz")
    assert len(read_part(file, read_run_header(tmp_path).run)["time"]) == 20


def test_a_read_only_folder_ends_the_logger_in_one_line(tmp_path: Path) -> None:
    """The logger ends in a traceback, of which the run says nothing."""
    write_run_header(tmp_path, HEADERS["walk"])
    ours, theirs = socket_pair()
    rows = Rows(Channel(ours, READINGS), READINGS)
    rows.reading(1.0, {"stage": 2.0})
    rows.end()
    with read_only(tmp_path), pytest.raises(UnwrittenError, match="Permission denied"):
        record(tmp_path, theirs, READINGS, STEPS, 10)
    ours.close()
    theirs.close()
    assert find_run_log(tmp_path) == tmp_path and len(list(tmp_path.iterdir())) == 1


def test_a_disk_that_hangs_holds_up_neither_the_run_nor_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The supervisor waits for a logger that waits for a disk, and the robot is stiff meanwhile."""
    monkeypatch.setattr(processes, "WRITING_SECONDS", 0.05)
    ours, theirs = socket_pair()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        logger = Logger(Rows(Channel(ours, READINGS), READINGS), process)
        for number in range(20_000):
            logger.rows.reading(float(number), {})
        assert not logger.ended_now() and logger.rows.lost > 0
        logger.finish()
        assert logger.summary()["log_end"] == "the disk did not take the rest within 0.05 s"
        theirs.close()
        logger.rows.end()
        assert not logger.rows.alive and not logger.ended_now()
        process.kill()
    ours.close()


@pytest.mark.parametrize("stop", [None, {"rule": "tilt"}])
def test_a_report_that_cannot_be_written_does_not_hide_how_the_run_ended(
    stop: dict[str, Any] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """The end of the run is printed although its report cannot be written."""
    report = {"stop": stop, "end": "as it ended", "log": None, "log_lost": 0, "log_end": None}
    monkeypatch.setattr(deploy, "_planned", lambda *_: lambda: report)
    words = ["deploy", POLICY, "--json", "--report", "/dev/full", "--out", str(tmp_path / "run")]
    assert main(words) == 1
    output = capsys.readouterr()
    assert json.loads(output.out) == report
    assert output.err == (
        "stiction deploy: as it ended; /dev/full cannot be written: No space left on device; choose another --out, or "
        "make room\n"
    )
