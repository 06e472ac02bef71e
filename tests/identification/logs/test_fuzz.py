"""Thousands of damaged inputs: a complete log or the one error, soon, in little memory, never a part as the whole.

By injuries to valid files (`tests/helpers/damage.py`, in processes with a bound on memory).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import damage
import logfiles
from bounded import read_here
from counts import count
from processes import outcome
from stiction.core.errors import StictionError
from stiction.identification.logs import apart, open_log

EACH = count(60, 650)
"""Injuries a kind of file; there are sixteen kinds."""


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have thousands of files read without a process for each: the parsers must hold by themselves, too."""
    monkeypatch.setattr(apart, "read_apart", apart.read_apart)
    read_here()


@pytest.mark.slow
def test_thousands_of_injuries(tmp_path: Path) -> None:
    """A log from a stranger, or from a full disk, must not crash, hang, exhaust or mislead."""
    names = list(damage.KINDS)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(
            lambda kinds: outcome("damage.py", tmp_path, EACH, 0, *kinds), (names[::2], names[1::2])
        )
    results = first | second
    assert results.keys() == damage.KINDS.keys()
    wrong = [f"{kind}: {text}" for kind, result in results.items() for text in result["wrong"]]
    assert not wrong, wrong[:10]
    assert max(result["slowest"] for result in results.values()) < damage.LONGEST
    assert max(result["growth"] for result in results.values()) < 2**27
    for kind, result in results.items():
        assert result["taken"] + result["refused"] == EACH and min(result["taken"], result["refused"]) > 0, kind


def between_variables(data: bytes) -> set[int]:
    """Return where the variables of a MAT v5 file end."""
    ends, place = set(), 128
    while place < len(data):
        place += 8 + int.from_bytes(data[place + 4 : place + 8], "little")
        ends.add(place)
    return ends


UNENDING = ("csv", "wide", "sidecar", "tabs", "records")
"""Kinds in which every line stands for itself, so that a part of them is whole."""


@pytest.mark.parametrize("kind", [kind for kind in damage.KINDS if kind not in UNENDING])
def test_a_file_that_was_cut_off_is_refused(tmp_path: Path, kind: str) -> None:
    """Wherever a copy stopped: a part of a log must not pass for the whole of it.

    A MATLAB file has no end mark: cut exactly between two variables it is a whole file of fewer.
    """
    whole = damage.KINDS[kind](tmp_path)
    data, cut = whole.read_bytes(), tmp_path / f"cut{whole.suffix}"
    lengths = {*range(0, len(data), max(1, len(data) // 100)), *range(max(0, len(data) - 40), len(data))}
    for length in lengths - (between_variables(data) if whole.suffix == ".mat" else set()):
        cut.write_bytes(data[:length])
        with pytest.raises(StictionError):
            open_log(cut)


@pytest.mark.parametrize("kind", ["csv", "wide"])
def test_a_table_that_was_cut_off_is_refused_or_says_so(tmp_path: Path, kind: str) -> None:
    """CSV promises no number of lines: one without end is refused if cells are missing, else left out, and said."""
    whole = damage.KINDS[kind](tmp_path)
    data, cut = whole.read_bytes(), tmp_path / "cut.csv"
    values = np.loadtxt(whole, delimiter=",", skiprows=1)
    start = data.index(b"\n") + 1
    for length in {*range(start, len(data), 7), *range(len(data) - 200, len(data) + 1)}:
        cut.write_bytes(data[:length])
        try:
            log = open_log(cut)
        except StictionError:
            continue
        lines = data[:length].count(b"\n") - 1
        np.testing.assert_array_equal(log.time, values[:lines, 0])
        assert bool(log.notes) == (data[length - 1 : length] != b"\n")


def test_what_would_inflate_to_gigabytes_is_refused_first(tmp_path: Path) -> None:
    """Declared sizes are read first, and no more than the declared size is inflated."""
    with pytest.raises(StictionError, match="would inflate to 2147483647 bytes"):
        open_log(logfiles.bomb_npz(tmp_path))
    with pytest.raises(StictionError, match="not a whole bag"):
        open_log(logfiles.chunk(tmp_path / "bomb.mcap", bytes(2**28), 1000))
