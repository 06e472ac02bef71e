"""The canonical log: what is read, and that whatever is wrong is one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.log import read_table
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


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"time,position\n", "no samples"),
        (b"time,time,position\n0,1,2\n", "one different name"),
        (b"time,position\n0,1\n\n0,x\n", "line 4: 'x' in column 'position' is not a number"),
        (b"time,position\n0,1\n1\n", "line 3 has 1 values, the header names 2"),
        (b"time,position\n0,\xff\n", "'ÿ' in column 'position' is not a number"),
        (b"time,position\n0,\x00\n", "not a text file"),
        (b"clock,position\n0,1\n", "no column of time"),
        (b"time,angle\n0,1\n", "no column position"),
    ],
)
def test_a_bad_csv_is_one_line_that_names_the_trouble(tmp_path: Path, content: bytes, message: str) -> None:
    """A user must learn from the message what to repair."""
    with pytest.raises(LogError) as caught:
        open_log(written(tmp_path, content))
    assert message in str(caught.value) and "\n" not in str(caught.value)


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[1]", "holds a list; expected the sidecar"),
        ('{"kp": NaN}', "not a JSON number"),
        ('{"axis": "rotory"}', "expected rotary, linear; did you mean 'rotary'?"),
        ('{"schema_version": 1, "joints": {}}', "a result of `stiction identify`"),
    ],
)
def test_a_bad_sidecar_is_refused(tmp_path: Path, text: str, message: str) -> None:
    """A misspelt gain that is ignored would silently cost the dead band."""
    path = written(tmp_path, GOOD)
    path.with_suffix(".json").write_text(text)
    with pytest.raises(LogError, match=message):
        open_log(path)


def test_pickles_are_refused(tmp_path: Path) -> None:
    """A log from a stranger must not run code."""
    np.savez(tmp_path / "log.npz", time=np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogError, match="not a readable NPZ"):
        open_log(tmp_path / "log.npz")
