"""Tables: whole or not at all."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.tables import read_npz, read_npz_arrays, read_parquet, write_parquet
from stiction.files.text import read_csv


def test_a_last_line_without_an_end_is_left_out_and_said(tmp_path: Path) -> None:
    """`0.12` may be what is left of `0.1234`: no reader can tell, so it must not be taken."""
    path = tmp_path / "x.csv"
    path.write_text("time,q\n0,0.5\n1,0.12")
    table = read_csv(path)
    np.testing.assert_array_equal(table.columns["time"], [0])
    assert table.notes == ("line 3, the last, has no line end and may be cut off in a number: it is left out",)
    path.write_text("time,q\n0,0.5\n1")
    assert read_csv(path).notes == ("line 3, the last, has no line end and has 1 of 2 values: it is left out",)


def test_a_matrix_becomes_columns_and_what_is_no_signal_is_left_out(tmp_path: Path) -> None:
    """Gains and names may stand in the same file."""
    np.savez(tmp_path / "x.npz", t=np.arange(3.0), q=np.arange(6).reshape(3, 2), kp=20.0, names=np.array(["a", "b"]))
    assert list(read_npz(tmp_path / "x.npz").columns) == ["t", "q_0", "q_1"]
    np.savez(tmp_path / "x.npz", q=np.asfortranarray(np.arange(6.0).reshape(3, 2)), big=np.arange(3, dtype=">f4"))
    table = read_npz(tmp_path / "x.npz").columns
    np.testing.assert_array_equal(table["q_1"], [1, 3, 5])
    np.testing.assert_array_equal(table["big"], [0, 1, 2])


@pytest.mark.parametrize("shape", ["(2,)", "(4,)", "(3, 10**9)", "(-3,)", "(3,)*3"])
def test_a_header_that_does_not_fit_its_bytes_is_refused(tmp_path: Path, shape: str) -> None:
    """Fewer would be a silent part, more a crash or an empty memory."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.arange(3.0))
    data = buffer.getvalue()
    header = data.replace(b"(3,), }".ljust(20), f"{shape}, }}".encode().ljust(20))
    assert header != data
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("time.npy", header)
    with pytest.raises(LogError, match=r"not a readable NPZ file of plain arrays \(time.npy"):
        read_npz_arrays(tmp_path / "x.npz")


def test_large_files_are_refused_by_their_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before they are read."""
    monkeypatch.setattr("stiction.core.memory.SHARES", 2**28)
    (tmp_path / "x.csv").write_text("time,q\n0,1\n")
    with pytest.raises(LogError, match="the file has 11 bytes; at most 8 are read: cut it into parts, or allow more"):
        read_csv(tmp_path / "x.csv")


def test_parquet_keeps_numbers_stamps_and_holes(tmp_path: Path) -> None:
    """A null becomes NaN, stamps seconds from the first; text is no signal."""
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    stamps = arrow.array([1_700_000_000_000_000_000 + 5_000_000 * i for i in range(3)], arrow.timestamp("ns"))
    columns = {"time": stamps, "q": arrow.array([1.5, None, 3.5]), "n": arrow.array([1, 2, 3]), "mode": ["a", "b", "c"]}
    parquet.write_table(arrow.table(columns), tmp_path / "x.parquet")
    read_back = read_parquet(tmp_path / "x.parquet")
    table = read_back.columns
    assert list(table) == ["time", "q", "n", "mode"] and list(read_back.faults) == ["mode"]
    np.testing.assert_allclose(table["time"], [0, 0.005, 0.01], atol=1e-12)
    np.testing.assert_array_equal(table["q"], [1.5, np.nan, 3.5])
    columns["time"] = arrow.array([None, 1, 2], arrow.timestamp("ns"))
    parquet.write_table(arrow.table(columns), tmp_path / "x.parquet")
    with pytest.raises(LogError, match="a time stamp is missing"):
        read_parquet(tmp_path / "x.parquet")


def test_a_damaged_page_is_found_by_its_checksum(tmp_path: Path) -> None:
    """Detects a damaged page in a file of this program."""
    write_parquet(tmp_path / "x.parquet", {"q": np.random.default_rng(0).random(100)})
    data = bytearray((tmp_path / "x.parquet").read_bytes())
    data[300] ^= 1
    (tmp_path / "x.parquet").write_bytes(data)
    with pytest.raises(LogError, match=r"not a readable Parquet file \(could not verify page integrity"):
        read_parquet(tmp_path / "x.parquet")
