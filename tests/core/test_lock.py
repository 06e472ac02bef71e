"""One writer a folder: the second is told who the first is, and a lock ends with its holder, however that ends."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from processes import python
from stiction.core import lock
from stiction.core.errors import FileError
from stiction.core.lock import LOCK, output_folder, replaced_folder

HOLD = """
import sys, time
from pathlib import Path
from stiction.core.lock import output_folder
with output_folder(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""

TRY = """
import sys
from pathlib import Path
from stiction.core.errors import FileError
from stiction.core.lock import output_folder
refused = 0
for number in range(int(sys.argv[2])):
    try:
        with output_folder(Path(sys.argv[1])):
            pass
    except FileError as error:
        refused, said = refused + 1, error
print(refused, said if refused else "")
"""


@contextmanager
def held(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that writes a folder."""
    other = python(HOLD, str(folder))
    try:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        yield other
    finally:
        other.kill()
        other.communicate()


def test_the_second_writer_is_told_who_the_first_is(tmp_path: Path) -> None:
    """Two runs in one folder would write a line each into the same figures."""
    with held(tmp_path / "deep" / "run") as other:
        holder = rf"is being written by process {other.pid} on .* since 20.*`-c "
        with pytest.raises(FileError, match=holder) as told, output_folder(tmp_path / "deep" / "run"):
            pass
        assert "choose another --out" in str(told.value)
        output = python(TRY, str(tmp_path / "deep" / "run"), "50").communicate()[0]
        assert output.startswith("50 ")


def test_a_killed_writer_holds_nothing(tmp_path: Path) -> None:
    """After a power cut nobody should have to find and remove a file."""
    with held(tmp_path) as other:
        other.kill()
        other.wait()
    assert (tmp_path / LOCK).exists()
    with output_folder(tmp_path):
        assert f'"pid": {os.getpid()},' in (tmp_path / LOCK).read_text()
    assert not (tmp_path / LOCK).exists()


def test_one_process_may_hold_it_twice(tmp_path: Path) -> None:
    """A study that trains into its own folder must not lock itself out, nor free it before it is done."""
    with output_folder(tmp_path):
        with output_folder(tmp_path / "." / "x" / ".."):
            pass
        assert python(TRY, str(tmp_path), "1").communicate()[0].startswith("1 ")
    assert python(TRY, str(tmp_path), "1").communicate()[0].startswith("0 ")


def test_a_folder_that_stays_empty_goes_again(tmp_path: Path) -> None:
    """A misspelt policy leaves nothing behind; a folder that was there, or in which something was written, stays."""
    with pytest.raises(FileError), output_folder(tmp_path / "new"):
        raise FileError("no such policy")
    with pytest.raises(FileError), replaced_folder(tmp_path / "new" / "bundle"):
        raise FileError("no such run")
    assert not (tmp_path / "new").exists()
    (tmp_path / "old").mkdir()
    with output_folder(tmp_path / "old"):
        pass
    with pytest.raises(FileError), output_folder(tmp_path / "written"):
        (tmp_path / "written" / "row.csv").write_text("1\n")
        raise FileError("the second row cannot be walked")
    assert (tmp_path / "old").exists() and (tmp_path / "written" / "row.csv").exists()


def test_a_lock_that_was_removed_meanwhile_is_taken_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its holder ends between the opening and the locking: a lock on a file without a name keeps nobody out."""
    flock, calls = lock.fcntl.flock, []

    def late(number: int, how: int) -> None:
        calls.append(number)
        if len(calls) == 1:
            (tmp_path / LOCK).unlink()
        flock(number, how)

    monkeypatch.setattr(lock.fcntl, "flock", late)
    with output_folder(tmp_path):
        assert len(calls) == 2
        assert python(TRY, str(tmp_path), "1").communicate()[0].startswith("1 ")


def test_what_a_lock_says_is_not_believed(tmp_path: Path) -> None:
    """The file may hold anything, such as what clears the terminal."""
    for content in ("", "[" * 5000, '{"pid": "x"}', '{"pid": 1, "host": "\x1b[2J", "since": "", "command": ""}'):
        with held(tmp_path):
            (tmp_path / LOCK).write_text(content)
            with pytest.raises(FileError, match="is being written by") as told, output_folder(tmp_path):
                pass
            assert str(told.value).isprintable()


def test_a_folder_that_cannot_be_locked_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in its place, a link in place of the lock, and a file system without locks."""
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be made"), output_folder(tmp_path / "file"):
        pass
    (tmp_path / LOCK).symlink_to(tmp_path / "file")
    with pytest.raises(FileError, match="cannot be written"), output_folder(tmp_path):
        pass

    def none(number: int, how: int) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(lock.fcntl, "flock", none)
    with pytest.raises(FileError, match="cannot be locked: Operation not supported"), output_folder(tmp_path / "a"):
        pass
