"""Opening logs of every kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from stiction.formats.errors import StictionError
from stiction.formats.log import LogError
from stiction.identify.logs import open_log, parse_columns


def test_a_mapping_is_parsed() -> None:
    """`torque=vir` says that the column vir is the torque; a name may hold an equals sign."""
    assert parse_columns(["time=t", "torque=a=b"]) == {"time": "t", "torque": "a=b"}


@pytest.mark.parametrize("words", [["position"], ["position="], ["angle=q"], ["time=t", "time=u"]])
def test_a_bad_mapping_is_refused(words: list[str]) -> None:
    """The message repeats the word and lists the roles."""
    with pytest.raises(LogError, match=r"expected ROLE=NAME.*velocity"):
        parse_columns(words)


def test_a_matlab_log_is_read(tmp_path: Path) -> None:
    """Row or column vectors, scalars ignored."""
    savemat(tmp_path / "x.mat", {"t": np.arange(5.0), "q": np.arange(5.0)[:, None], "kp": 3.0, "other": np.ones(3)})
    log = open_log(tmp_path / "x.mat", {"time": "t", "position": "q"}, "knee")
    np.testing.assert_array_equal(log.joint("knee")[1].position, np.arange(5.0))
    with pytest.raises(LogError, match=r"no column 'kp'; the columns are t, q"):
        open_log(tmp_path / "x.mat", {"time": "t", "position": "kp"})


def test_a_missing_log_is_named(tmp_path: Path) -> None:
    """Whatever the suffix."""
    for name in ("x.mat", "x.csv", "x"):
        with pytest.raises(LogError, match=f"no log at .*{name}"):
            open_log(tmp_path / name)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1), replacement=st.binary(max_size=6), cut=st.integers(0, 6))
def test_damaged_matlab_gives_a_log_or_the_one_error(
    tmp_path: Path, place: float, replacement: bytes, cut: int
) -> None:
    """The binary reader raises many things; a user sees one."""
    good = tmp_path / "good.mat"
    if not good.exists():
        savemat(good, {"t": np.arange(50.0), "q": np.arange(50.0)}, do_compression=True)
    data = good.read_bytes()
    start = int(place * len(data))
    bad = tmp_path / "bad.mat"
    bad.write_bytes(data[:start] + replacement + data[start + cut :])
    try:
        open_log(bad, {"time": "t", "position": "q"})
    except StictionError as error:
        assert str(error)
