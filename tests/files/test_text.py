"""Tables of text: what separates cells, what names them, and what is nobody's concern until it is asked for."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from stiction.core.errors import LogError
from stiction.files.tables import Table
from stiction.files.text import LONGEST_LINE, read_csv


def read(folder: Path, content: str | bytes, name: str = "log.csv") -> Table:
    """Write a file and read it."""
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return read_csv(folder / name)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("a,b\n0,1\n1,2\n", {"a": [0, 1], "b": [1, 2]}),
        ("# a b\n0 1\n1  2\n", {"a": [0, 1], "b": [1, 2]}),
        ("a;b\n0,5;1\n1,5;2\n", {"a": [0.5, 1.5], "b": [1, 2]}),
        ("a\tb\ns\trad\n0\t1\n1\t2\n", {"a": [0, 1], "b": [1, 2]}),
        (",a,b\n0,5,1\n1,6,2\n2,7,3\n", {"0": [0, 1, 2], "a": [5, 6, 7], "b": [1, 2, 3]}),
        ('"a" "b"\n"1" 5 1\n"2" 6 2\n"3" 7 3\n', {"0": [1, 2, 3], "a": [5, 6, 7], "b": [1, 2, 3]}),
        ("a,b\n0,1,\n1,2,\n2,3,\n", {"a": [0, 1, 2], "b": [1, 2, 3]}),
        ('"a, rad","b"\n"0","1"\n"1","2"\n', {"a, rad": [0, 1], "b": [1, 2]}),
        ("title\nserial 3\n\na,b,c\n0,1,2\n1,2,3\n", {"a": [0, 1], "b": [1, 2], "c": [2, 3]}),
        ("a,b\n0,1\n# a remark\n\n1,2\n", {"a": [0, 1], "b": [1, 2]}),
    ],
)
def test_how_it_is_written_is_found(tmp_path: Path, content: str, expected: dict[str, list[float]]) -> None:
    """Each of these is a file that somebody's program writes."""
    columns = read(tmp_path, content).columns
    for name, values in expected.items():
        np.testing.assert_array_equal(columns[name], values)


def test_encodings(tmp_path: Path) -> None:
    """A spreadsheet writes UTF-16, an old one Latin letters; a gzip file is unpacked; a picture is none of these."""
    content = "time,Drehmoment [N·m]\n0,1\n"
    for packed in (content.encode("utf-8-sig"), content.encode("utf-16"), content.encode("latin-1")):
        assert list(read(tmp_path, packed).columns) == ["time", "Drehmoment [N·m]"]
    assert "time" in read(tmp_path, gzip.compress(content.encode()), "log.csv.gz").columns
    with pytest.raises(LogError, match="not a whole gzip file"):
        read(tmp_path, gzip.compress(content.encode())[:-4], "log.csv.gz")
    with pytest.raises(LogError, match="not a text file"):
        read(tmp_path, b"\x89PNG\r\n\x1a\n\0\0")


def test_words_are_a_fault_of_their_column_alone(tmp_path: Path) -> None:
    """With the line in which the first stands; empty cells are counted, and no word."""
    table = read(tmp_path, "time,mode,gap,ok\n0,1,,true\n1,run,2,true\n2,stop,null,false\n")
    assert table.faults["mode"] == "log.csv: line 3: 'run' in column 'mode' is not a number"
    assert set(table.faults) == {"mode", "ok"} and table.blanks == {"gap": 2}
    np.testing.assert_array_equal(table.columns["gap"], [np.nan, 2, np.nan])
    table = read(tmp_path, "time,q,q\n0,1,2\n")
    assert "names 'q' twice" in table.faults["q"]


def test_times_are_seconds_from_the_first(tmp_path: Path) -> None:
    """ISO 8601 with and without a zone, and a time of day; a column that mixes them has a fault."""
    table = read(tmp_path, "t,u\n2026-01-02T03:04:05.25Z,03:04:05\n2026-01-02T04:04:05.5+01:00,03:04:05.125\n")
    np.testing.assert_allclose(table.columns["t"], [0, 0.25])
    np.testing.assert_allclose(table.columns["u"], [0, 0.125])
    assert table.starts["t"] == 1767323045.25 and not table.faults
    assert "is not a number" in read(tmp_path, "t\n2026-01-02T03:04:05Z\n2026-01-02T03:04:06\n").faults["t"]


@pytest.mark.parametrize("head", ["<!doctype html>\n<html>", "\ufeff <HTML lang='en'>"])
def test_a_page_of_html_is_called_one(tmp_path: Path, head: str) -> None:
    """Recognises a web page saved in place of a log."""
    page = f"{head}<body>{'x' * 2 * LONGEST_LINE}</body></html>\n"
    with pytest.raises(LogError, match=r"^log.csv: a page of HTML, no log; download the file itself"):
        read(tmp_path, page)
