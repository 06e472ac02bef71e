"""How files are written and opened: whole or not at all, and never what has no end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from stiction.core.errors import FileError, UnwrittenError
from stiction.core.files import publish, read_bounded, write_bytes, write_text


def test_what_fails_leaves_what_was_there(tmp_path: Path) -> None:
    """Half a file under the final name is read by the next command."""
    file = tmp_path / "joints.json"
    write_text(file, "old")
    full = pytest.raises(UnwrittenError, match=r"joints.json cannot be written: No space left on device; choose")
    with full, publish(file) as partial:
        partial.write_text("ne")
        raise OSError(28, "No space left on device")
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]


def test_a_folder_comes_back_where_its_replacement_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the two renames neither folder has the name: both were deleted, the old one and the new one."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    (folder / "contract.json").write_text("old")

    def stopped(self: Path, target: Path) -> Path:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", stopped)
    with pytest.raises(KeyboardInterrupt), publish(folder) as partial:
        partial.mkdir()
    assert list(tmp_path.iterdir()) == [folder] and (folder / "contract.json").read_text() == "old"


def test_a_link_is_replaced_and_a_device_written(tmp_path: Path) -> None:
    """A run folder from others with metrics.jsonl as a link would write into the file of its maker's choice."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "metrics.jsonl").symlink_to(tmp_path / "mine")
    write_text(tmp_path / "metrics.jsonl", "theirs")
    assert (tmp_path / "mine").read_text() == "mine" and not (tmp_path / "metrics.jsonl").is_symlink()
    write_text(Path("/dev/null"), "gone")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(UnwrittenError, match="No space left"):
        write_bytes(Path("/dev/full"), b"x" * 10)


@pytest.mark.parametrize("what", ["pipe", "device", "folder", "link to a device", "too large", "missing"])
def test_what_has_no_end_is_not_opened(what: str, tmp_path: Path) -> None:
    """A pipe in a folder from others waits for ever, /dev/zero fills the memory."""
    file = tmp_path / "config.json"
    if what == "pipe":
        os.mkfifo(file)
    elif what == "folder":
        file.mkdir()
    elif what == "link to a device":
        file.symlink_to("/dev/zero")
    elif what == "too large":
        file.write_bytes(bytes(11))
    with pytest.raises(FileError, match="expected a configuration"):
        read_bounded(Path("/dev/zero") if what == "device" else file, "a configuration", FileError, 10)


def test_a_pipe_that_nobody_reads_is_not_waited_for(tmp_path: Path) -> None:
    """It lies where a result is to be written; one that is read, as `>(less)` is, gets it."""
    pipe = tmp_path / "summary.json"
    os.mkfifo(pipe)
    with pytest.raises(UnwrittenError, match="cannot be written"):
        write_text(pipe, "x")
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_text(pipe, "read")
    assert os.read(reader, 9) == b"read"
    os.close(reader)


LOGS = ("csv", "csv.gz", "npz", "mcap", "jsonl", "db3", "parquet", "pt", "mat", "json")


@pytest.mark.parametrize(
    "name",
    [
        *("config.json", "metrics.jsonl", "walks.jsonl", "walk.npz", "results.csv", "rows.csv"),
        *(f"log.{kind}" for kind in LOGS),
    ],
)
def test_no_reader_waits_for_a_pipe(name: str, tmp_path: Path) -> None:
    """Each reader of files from others, by the name that leads to it; the test would never end."""
    from stiction.core.cache import Ledger
    from stiction.core.records import read_rows
    from stiction.files.plain import read_object
    from stiction.files.results import ResultRow, read_metrics, read_results
    from stiction.files.walk import read_walk
    from stiction.identification.logs import open_log

    file = tmp_path / name
    os.mkfifo(file)
    readers = {"config": lambda path: read_object(path, "it"), "metrics": read_metrics, "walks": Ledger}
    readers |= {"results": read_results, "rows": lambda path: read_rows(path, ResultRow)}
    read = (readers | {"walk": read_walk}).get(name.partition(".")[0], open_log)
    with pytest.raises(FileError):
        read(file)


def test_a_file_takes_no_folders_place(tmp_path: Path) -> None:
    """`convert --out FOLDER` would delete all that is in it, and leave a file under its name."""
    kept = tmp_path / "folder" / "kept"
    kept.parent.mkdir()
    kept.write_text("of years")
    with pytest.raises(UnwrittenError, match="folder cannot be written: is a folder; expected a file"):
        write_text(kept.parent, "new")
    assert kept.read_text() == "of years" and [*tmp_path.iterdir()] == [kept.parent]
