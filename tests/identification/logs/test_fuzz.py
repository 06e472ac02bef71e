"""Thousands of damaged inputs: a complete log or the one error, soon, in little memory, never a part as the whole.

Most by injuries to valid files (`tests/helpers/damage.py`, in processes with a bound on memory), others by hypothesis.
"""

from __future__ import annotations

import pickletools
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import damage
import logfiles
from bounded import read_here
from counts import count
from processes import outcome
from stiction.core.errors import StictionError
from stiction.identification.logs import apart, open_log

EACH = count(60, 650)
"""Injuries a kind of file; there are eighteen kinds."""


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have thousands of files read without a process for each: the parsers must hold by themselves, too."""
    monkeypatch.setattr(apart, "read_apart", apart.read_apart)
    read_here()


QUICK = settings(deadline=5000, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])


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


PARTS = st.one_of(
    st.sampled_from([opcode.code.encode("latin-1") for opcode in pickletools.opcodes]),
    st.sampled_from(
        [b"ctorch._utils\n_rebuild_tensor_v2\n", b"ctorch\nFloatStorage\n", b"cos\nsystem\n", b"(", b"Q", b"R"]
    ),
    st.sampled_from([b"X\x04\0\0\0time", b"X\x07\0\0\0storage", b"K\x00", b"K\x18", b"}", b"t", b"u", b"\x85", b"."]),
    st.binary(max_size=4),
)


@settings(QUICK, max_examples=count(250, 550))
@given(parts=st.lists(PARTS, max_size=40), ends=st.booleans())
def test_instructions_of_anything(tmp_path: Path, parts: list[bytes], ends: bool) -> None:
    """Programs for the machine that PACE's files were written for: none may run, none may hang."""
    path = tmp_path / "log.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("log/data.pkl", b"\x80\x02" + b"".join(parts) + (b"." if ends else b""))
        archive.writestr("log/data/0", bytes(96))
    with pytest.raises(StictionError) as caught:
        open_log(path)
    assert "\n" not in str(caught.value)


def test_what_would_inflate_to_gigabytes_is_refused_first(tmp_path: Path) -> None:
    """Declared sizes are read before anything is inflated, and no more than was declared is inflated."""
    with pytest.raises(StictionError, match="would inflate to 2147483647 bytes"):
        open_log(logfiles.bomb_npz(tmp_path))
    with pytest.raises(StictionError, match="not a whole bag"):
        open_log(logfiles.chunk(tmp_path / "bomb.mcap", bytes(2**28), 1000))
