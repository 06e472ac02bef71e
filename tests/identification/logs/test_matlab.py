"""MATLAB 5 files, compressed and not, and how damaged ones are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stiction.core.errors import LogError
from stiction.identification.logs import open_log
from stiction.identification.logs.apart import read_mat


@pytest.mark.parametrize("compressed", [True, False])
def test_vectors_either_way_scalars_left_out(tmp_path: Path, compressed: bool) -> None:
    """Row and column vectors are read; shorter variables and text are no signals."""
    content = {"t": np.arange(5.0), "q": np.arange(5.0)[:, None], "kp": 3.0, "other": np.ones(3), "text": "abcde"}
    savemat(tmp_path / "x.mat", content | {"cell": np.array([1, "a"], dtype=object)}, do_compression=compressed)
    log = open_log(tmp_path / "x.mat", {"time": "t", "position": "q"}, "knee")
    np.testing.assert_array_equal(log.joint("knee")[1].position, np.arange(5.0))
    with pytest.raises(LogError, match=r"no column 'kp'; the columns are t, q"):
        open_log(tmp_path / "x.mat", {"time": "t", "position": "kp"})


@pytest.mark.parametrize("dtype", ["f8", "f4", "i8", "i4", "i2", "i1", "u1"])
def test_matrices_are_joints_whatever_their_numbers(tmp_path: Path, dtype: str) -> None:
    """Samples by joints or joints by samples: the longer side is time."""
    values = np.arange(24).reshape(12, 2).astype(dtype)
    savemat(tmp_path / "x.mat", {"t": np.arange(12.0), "q": values, "p": values.T})
    columns = read_mat(tmp_path / "x.mat").columns
    assert sorted(columns) == ["p_0", "p_1", "q_0", "q_1", "t"]
    np.testing.assert_array_equal(columns["q_1"], np.arange(1, 24, 2))
    np.testing.assert_array_equal(columns["p_1"], columns["q_1"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: b"hello", "not a MATLAB 5.0 file"),
        (lambda data: data[:126] + b"XX" + data[128:], "damaged MATLAB file"),
        (lambda data: data[:-3], "damaged MATLAB file"),
        (lambda data: data + data[128:], "comes twice"),
        (lambda data: data[:128], "no arrays of samples"),
        (lambda data: data + b"\x0f\0\0\0\xff\0\0\0garbage", "damaged MATLAB file"),
        (lambda data: data.replace(np.arange(50.0).tobytes(), bytes(400)[:-8], 1), "damaged MATLAB file"),
        (lambda data: data.replace(b"\x32\0\0\0", b"\x31\0\0\0", 1), "damaged MATLAB file"),
    ],
)
def test_damage_is_refused(tmp_path: Path, change: object, message: str) -> None:
    """Sizes, dimensions and the number of bytes must agree."""
    savemat(tmp_path / "x.mat", {"t": np.arange(50.0) + 0.5, "q": np.arange(50.0)}, do_compression=False)
    path = tmp_path / "x.mat"
    path.write_bytes(change(path.read_bytes()))  # type: ignore[operator]
    with pytest.raises(LogError, match=message):
        read_mat(path)
