"""The one door: every kind of file comes out as the same log."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import logfiles
from stiction.core.errors import LogError
from stiction.identification.logs import open_log


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_canonical_logs_of_every_kind(tmp_path: Path, suffix: str) -> None:
    """Two joints with their signals, and the sidecar with one part for the calf."""
    log = open_log(logfiles.canonical(tmp_path, suffix))
    assert list(log.joints) == ["FL_hip", "FL_calf"] and log.notes == ()
    np.testing.assert_allclose(log.time, logfiles.TIME)
    np.testing.assert_allclose(log.joints["FL_calf"].target, logfiles.TARGET[:, 1], rtol=1e-8)
    assert log.joints["FL_calf"].velocity is None
    assert (log.setup_of("FL_hip").kp, log.setup_of("FL_calf").kp) == (20, 25)


def test_a_wide_table_without_time_needs_a_rate(tmp_path: Path) -> None:
    """The public scripts write no time: it is declared, by the caller or by the sidecar, and that is noted."""
    path = logfiles.wide_csv(tmp_path, time=False)
    with pytest.raises(LogError, match=r"no column of time.*--rate"):
        open_log(path)
    log = open_log(path, rate=50)
    np.testing.assert_allclose(log.time, np.arange(logfiles.SAMPLES) / 50)
    assert "50 Hz was declared" in log.notes[0]
    logfiles.sidecar(path, {"rate": 200, "names": ["hip", "knee"]})
    log = open_log(path)
    assert log.time[1] == pytest.approx(0.005) and list(log.joints) == ["hip", "knee"]
    for rate in (0, -1, np.nan, np.inf):
        with pytest.raises(LogError, match="expected a positive number of samples"):
            open_log(path, rate=rate)


@pytest.mark.parametrize("step", [0.0, 0.1])
def test_stamps_that_stand_still_give_way_to_a_rate(tmp_path: Path, step: float) -> None:
    """The refusal of such stamps asks for the rate; two logs in one file, whose stamps are equal too, stay refused."""
    path = logfiles.canonical(tmp_path, ".csv")
    header, *rows = path.read_text().splitlines()
    signals = [row.partition(",")[2] for row in rows]
    coarse = [f"{step * (index // 10):.1f},{row}" for index, row in enumerate(signals)]
    path.write_text("\n".join([header, *coarse, ""]))
    log = open_log(path, rate=50)
    np.testing.assert_allclose(log.time, np.arange(logfiles.SAMPLES) / 50)
    assert any("stand still: 50 Hz was declared" in note for note in log.notes)
    path.write_text("\n".join([header, *rows, *rows, ""]))
    with pytest.raises(LogError, match="a rate of its own"):
        open_log(path, rate=50)


def test_names_are_for_numbered_joints_and_must_fit(tmp_path: Path) -> None:
    """Rejects a list of names with another length than the log's joints."""
    path = logfiles.wide_csv(tmp_path)
    assert list(open_log(path, names=("a", "b")).joints) == ["a", "b"]
    for names in (("a",), ("a", "a"), ("a", "b", "c")):
        with pytest.raises(LogError, match="names for 2 joints"):
            open_log(path, names=names)
    with pytest.raises(LogError, match="the log names its joints, FL_hip, FL_calf"):
        open_log(logfiles.canonical(tmp_path, ".csv"), names=("a", "b"))


def test_missing_and_unknown_files_are_named(tmp_path: Path) -> None:
    """Whatever the suffix."""
    for name in ("x.mat", "x.csv", "x.mcap", "x"):
        with pytest.raises(LogError, match=f"no log at .*{name}"):
            open_log(tmp_path / name)
    with pytest.raises(LogError, match=r"is a directory.*\.mcap"):
        open_log(tmp_path)
    (tmp_path / "x.pkl").write_bytes(b"\x80\x04.")
    with pytest.raises(
        LogError,
        match=r"unknown kind of log '.pkl'; expected .csv .*, .mcap, .db3, .bag, .mat or .pt. A pickle, .*never opened",
    ):
        open_log(tmp_path / "x.pkl")
    with pytest.raises(LogError, match="names a topic of a bag"):
        open_log(logfiles.wide_csv(tmp_path), {"state": "/joint_states"})


@pytest.mark.parametrize(("make", "library"), [(logfiles.ros, "rosbags"), (logfiles.canonical, "pyarrow")])
def test_without_the_extra_one_line_says_what_to_install(tmp_path: Path, make: object, library: str) -> None:
    """The base install has neither library, and reads everything else."""
    path = make(tmp_path, ".parquet") if make is logfiles.canonical else make(tmp_path)  # type: ignore[operator]
    csv = logfiles.canonical(tmp_path, ".csv")
    for name in ("pyarrow", "rosbags"):
        (tmp_path / "absent" / name).mkdir(parents=True)
        (tmp_path / "absent" / name / "__init__.py").write_text(f"raise ModuleNotFoundError(name={name!r})")
    code = (
        "from pathlib import Path\n"
        "from stiction.identification.logs import open_log\n"
        f"open_log(Path({str(csv)!r}))\n"
        f"try: open_log(Path({str(path)!r}))\n"
        "except Exception as error: print(type(error).__name__, error)\n"
    )
    env = os.environ | {"PYTHONPATH": str(tmp_path / "absent")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=env)
    assert done.stdout.startswith("LogError") and f"need{'s' * (library == 'pyarrow')} {library}" in done.stdout, done
    assert "[logs]" in done.stdout and done.stdout.count("\n") == 1


@pytest.mark.parametrize("suffix", ["csv", "npz", "mcap", "mat"])
def test_a_damaged_sidecar_does_not_hide_the_log(tmp_path: Path, suffix: str) -> None:
    """Whoever never wrote the file beside the log could not see of which log it was said."""
    (tmp_path / "rand.json").write_text("xx{")
    (tmp_path / f"rand.{suffix}").write_bytes(bytes(range(256)))
    with pytest.raises(LogError, match=rf"^rand\.{suffix}, its sidecar: rand\.json: not JSON"):
        open_log(tmp_path / f"rand.{suffix}")


def test_a_link_is_refused_without_a_word_of_what_it_points_to(tmp_path: Path) -> None:
    """A log from a stranger may be a link to a file of the reader's; a link to a log is one."""
    (tmp_path / "secret").write_text("time,password\n1,hunter2\n")
    (tmp_path / "log.csv").symlink_to(tmp_path / "secret")
    with pytest.raises(LogError, match=r"log\.csv: a link to what cannot be read") as caught:
        open_log(tmp_path / "log.csv")
    assert "hunter2" not in str(caught.value) and "password" not in str(caught.value)
    (tmp_path / "secret").write_text('{"password": "hunter2"}')
    (tmp_path / "swing.csv").write_text("time,position\n1,2\n")
    (tmp_path / "swing.json").symlink_to(tmp_path / "secret")
    with pytest.raises(LogError, match=r"swing\.json: a link to what cannot be read") as caught:
        open_log(tmp_path / "swing.csv")
    assert "hunter2" not in str(caught.value) and "password" not in str(caught.value)
    (tmp_path / "data").mkdir()
    canonical = logfiles.canonical(tmp_path / "data", ".csv")
    (tmp_path / "run.csv").symlink_to(canonical)
    assert list(open_log(tmp_path / "run.csv").joints) == ["FL_hip", "FL_calf"]
