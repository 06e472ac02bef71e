"""The canonical log: what is read, and that whatever is wrong is one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stiction.core.errors import LogError, StictionError
from stiction.files.log import JointSignals, Log, LogSetup, read_table, write_log
from stiction.identification.logs import open_log

GOOD = b"time,position.knee,torque.knee\n0,1,2\n0.5,3,-4e-1\n"


def written(folder: Path, content: bytes, name: str = "log.csv") -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_bytes(content)
    return path


def test_a_csv_becomes_signals_by_joint(tmp_path: Path) -> None:
    """Columns must reach the joint and the role that their names say."""
    log = open_log(written(tmp_path, GOOD))
    name, signals = log.joint(None)
    assert name == "knee" and log.source == "log.csv"
    np.testing.assert_array_equal(log.time, [0, 0.5])
    np.testing.assert_array_equal(signals.position, [1, 3])
    np.testing.assert_array_equal(signals.torque, [2, -0.4])
    assert signals.target is None and signals.velocity is None


def test_bare_names_belong_to_the_joint_that_was_named(tmp_path: Path) -> None:
    """A log of one joint need not repeat its name in every column."""
    log = open_log(written(tmp_path, b"time,position\n0,1\n1,2\n"), joint="hip")
    assert list(log.joints) == ["hip"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty"),
        (b"time,position\n", "no samples"),
        (b"time,time,position\n0,1,2\n", "one different name"),
        (b"time,\n0,1\n", "no column position"),
        (b"time,position\n0,1\n\n0,x\n", "line 4: 'x' in column 'position' is not a number"),
        (b"time,position\n0,1\n1\n", "line 3 has 1 values, the header names 2"),
        (b"time,position\n0,1,2\n", "header names 2"),
        (b"time,position\n0,\xff\n", "'ÿ' in column 'position' is not a number"),
        (b"time,position\n0,\x00\n", "not a text file"),
        (b"clock,position\n0,1\n", "no column of time"),
        (b"time,angle\n0,1\n", "no column position"),
    ],
)
def test_a_bad_csv_is_one_line_that_names_the_trouble(tmp_path: Path, content: bytes, said: str) -> None:
    """A user must learn from the message what to repair."""
    with pytest.raises(LogError) as caught:
        open_log(written(tmp_path, content))
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_missing_files_and_joints_are_named(tmp_path: Path) -> None:
    """Each message lists what there is instead."""
    path = written(tmp_path, GOOD)
    with pytest.raises(LogError, match="no log at"):
        open_log(tmp_path / "none.csv")
    with pytest.raises(LogError, match="cannot read"):
        read_table(tmp_path / "none.csv")
    for read in (open_log, read_table):
        with pytest.raises(LogError, match=r"unknown kind .*'.doc'; expected a? ?.csv"):
            read(written(tmp_path, GOOD, "log.doc"))
    with pytest.raises(LogError, match=r"unknown joint 'hip'.*knee"):
        open_log(path).joint("hip")


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".parquet"])
def test_what_is_written_is_read_again(tmp_path: Path, suffix: str) -> None:
    """Logs that the program writes are logs that it reads, the sidecar included."""
    signals = JointSignals(position=np.array([0.25, -1.5]), target=np.array([0.0, 1e-3]))
    log = Log("x", np.array([0.0, 0.01]), {"FL_hip": signals}, LogSetup(kp=20.0, test_condition="in_air"))
    write_log(tmp_path / f"swing{suffix}", log)
    again = open_log(tmp_path / f"swing{suffix}")
    assert again.setup == log.setup
    np.testing.assert_array_equal(again.time, log.time)
    np.testing.assert_array_equal(again.joint("FL_hip")[1].target, [0.0, 1e-3])
    assert again.joint("FL_hip")[1].torque is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[1]", "holds a list; expected the sidecar"),
        ('{"kP": 1}', "unknown field 'kP'; did you mean 'kp'"),
        ('{"kp": "20"}', "expected a finite number"),
        ('{"kp": true}', "expected a finite number"),
        ('{"kp": NaN}', "no number of JSON"),
        ('{"axis": "bent"}', "expected one of rotary, linear"),
        ('{"axis": "rotory"}', "expected one of rotary, linear; did you mean 'rotary'?"),
        ('{"schema_version": 1, "joints": {}}', "a result of `stiction identify`"),
        ('{"axis": []}', r"axis is '\[\]'; expected text"),
    ],
)
def test_a_bad_sidecar_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """A misspelt gain that is ignored would silently cost the dead band."""
    path = written(tmp_path, GOOD)
    path.with_suffix(".json").write_text(text)
    with pytest.raises(LogError, match=said):
        open_log(path)


def test_pickles_are_refused(tmp_path: Path) -> None:
    """A log from a stranger must not run code."""
    np.savez(tmp_path / "log.npz", time=np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogError, match="not a readable NPZ"):
        open_log(tmp_path / "log.npz")


def test_a_text_called_npz_is_refused_without_bad_advice(tmp_path: Path) -> None:
    """NumPy takes whatever is no archive for a pickle, and tells the user how to load it unsafely."""
    with pytest.raises(LogError, match="not an NPZ file") as caught:
        open_log(written(tmp_path, b"hello", "log.npz"))
    assert "pickle" not in str(caught.value)


def test_npz_arrays_that_are_asked_for_must_be_as_long_as_the_time(tmp_path: Path) -> None:
    """A part must not be taken for the whole."""
    np.savez(tmp_path / "a.npz", time=np.zeros(3), position=np.zeros(2))
    with pytest.raises(LogError, match=r"'position' has shape \(2,\); expected 3 samples"):
        open_log(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", time=np.zeros((3, 1, 1)))
    with pytest.raises(LogError, match=r"no arrays of samples.*time \(3, 1, 1\)"):
        open_log(tmp_path / "b.npz")


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(edits=st.lists(st.tuples(st.integers(0, len(GOOD) - 1), st.binary(max_size=3)), min_size=1, max_size=4))
def test_damaged_csv_gives_a_log_or_the_one_error(tmp_path: Path, edits: list[tuple[int, bytes]]) -> None:
    """No damage to the bytes may end in a traceback, or in columns of different lengths."""
    damaged = GOOD
    for place, replacement in edits:
        damaged = damaged[:place] + replacement + damaged[place + 1 :]
    try:
        log = open_log(written(tmp_path, damaged))
    except StictionError:
        return
    for signals in log.joints.values():
        for values in vars(signals).values():
            assert values is None or values.shape == log.time.shape


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1), replacement=st.binary(max_size=6), cut=st.integers(0, 6))
def test_damaged_npz_gives_a_log_or_the_one_error(tmp_path: Path, place: float, replacement: bytes, cut: int) -> None:
    """The zip reader, the inflater and the header parser raise many things; a user sees one."""
    good = tmp_path / "good.npz"
    if not good.exists():
        np.savez_compressed(good, time=np.arange(50.0), position=np.arange(50.0))
    data = good.read_bytes()
    start = int(place * len(data))
    try:
        open_log(written(tmp_path, data[:start] + replacement + data[start + cut :], "bad.npz"))
    except StictionError as error:
        assert str(error)
