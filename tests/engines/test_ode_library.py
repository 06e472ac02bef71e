"""ODE is found or the way to it is named, another version is not taken for it, and its last words are heard."""

from __future__ import annotations

import ctypes
import hashlib
import subprocess
import sys
from ctypes.util import find_library
from importlib import metadata
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.engines.catalog import binaries
from stiction.engines.ode import library as ode_functions
from stiction.engines.ode import library as ode_library
from stiction.engines.ode.library import taken_messages


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    """ODE, where it is installed."""
    try:
        return ode_library.ode_library()
    except StictionError as error:
        pytest.skip(str(error))


def test_how_to_get_it_is_said_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system has none and the wheel is not installed: the reader must not have to search."""

    def absent(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(ode_library, "SYSTEM_NAMES", ("libode.so.no",))
    monkeypatch.setattr(metadata, "files", absent)
    with pytest.raises(StictionError, match=r"\[engines\].*libode\.so\.no") as caught:
        ode_library.ode_library.__wrapped__()
    assert "\n" not in str(caught.value)


def test_the_wheel_is_looked_into(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its library has a number in its name that nobody knows beforehand; others begin alike."""

    class File(metadata.PackagePath):
        def locate(self) -> Path:
            return Path("/site") / self

    files = [File("dartpy.libs/libode-07a.so.8.2.0"), File("dartpy.libs/libassimp-5.so.6"), File("dartpy/libodex.py")]
    monkeypatch.setattr(metadata, "files", lambda name: files if name == "dartpy" else None)
    assert list(ode_library.candidates()) == [*ode_library.SYSTEM_NAMES, "/site/dartpy.libs/libode-07a.so.8.2.0"]


def test_another_build_has_another_digest(
    library: ctypes.CDLL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walks are known by it: what one library walked would go by the name of another."""
    file = ode_library.file_of(library.dWorldStep)
    assert "libode" in file.name
    assert ode_library.library_digest() == hashlib.sha256(file.read_bytes()).hexdigest()
    other = tmp_path / "libode.so"
    other.write_bytes(file.read_bytes() + b"0")
    monkeypatch.setattr(ode_library, "file_of", lambda function: other)
    assert ode_library.library_digest.__wrapped__() not in (None, ode_library.library_digest())


def test_the_file_of_a_function_is_where_the_loader_found_it() -> None:
    """The system's loader is asked, not a list of folders: the mathematics come from the C library's own file."""
    name = find_library("m")
    assert name is not None
    file = ode_library.file_of(ctypes.CDLL(name).cos)
    assert file.is_file() and file.name.startswith("libm")
    with pytest.raises(StictionError, match="not known to the system's loader"):
        ode_library.file_of(ctypes.c_void_p(1))


def test_without_ode_there_is_no_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    """What ODE walked is then not found, and engines that are packages have none at all."""

    def absent() -> None:
        raise StictionError("no ODE")

    monkeypatch.setattr(ode_library, "ode_library", absent)
    monkeypatch.setattr(ode_library, "library_digest", ode_library.library_digest.__wrapped__)
    assert [binaries(name) for name in ("ode", "ode-webots", "physx")] == [{"libode": None}, {"libode": None}, {}]


def test_what_is_not_ode_is_not_taken_for_it() -> None:
    """A library of the same name by somebody else."""
    with pytest.raises(StictionError, match="is not ODE"):
        ode_library.check_precision(ctypes.CDLL(None), "libc")


def test_single_precision_is_refused() -> None:
    """Numbers of half the size would be read as garbage."""

    class Single:
        @staticmethod
        def dGetConfiguration() -> bytes:
            return b"ODE ODE_EXT_trimesh ODE_single_precision"

    with pytest.raises(StictionError, match="single precision"):
        ode_library.check_precision(Single, "libode")


def test_a_function_that_is_missing_is_named() -> None:
    """ODE 0.11 has no threads of its own."""
    with pytest.raises(StictionError, match="dInitODE2"):
        ode_library.declare(ctypes.CDLL(None), "libode.so.1")


def test_moved_numbers_are_noticed(library: ctypes.CDLL, monkeypatch: pytest.MonkeyPatch) -> None:
    """In 0.11 the largest force was number 3: the motor would have none, and joints no friction."""
    ode_library.check_numbers(library, "libode")
    monkeypatch.setattr(ode_functions, "FORCE_MAX", 3)
    with pytest.raises(StictionError, match="another version"):
        ode_library.check_numbers(library, "libode")


def test_structures_have_the_sizes_of_the_headers() -> None:
    """As a C compiler lays them out in double precision; a field too few, and ODE writes beyond the end."""
    parts = (ode_functions.Mass, ode_functions.Feedback, ode_functions.Surface, ode_functions.ContactPoint)
    assert [ctypes.sizeof(part) for part in (*parts, ode_functions.Contact)] == [136, 128, 120, 96, 248]
    assert ode_functions.Contact.point.offset == 120


def test_messages_are_kept_and_taken_once(library: ctypes.CDLL) -> None:
    """On standard error they would be lost among others, or spoil a progress bar."""
    taken_messages()
    library.dMessage(ctypes.c_int(3), ctypes.c_char_p(b"s <= 0 (s=%.2f)"), ctypes.c_double(-0.25))
    assert taken_messages() == ["s <= 0 (s=-0.25)"] and not taken_messages()


def test_the_last_words_are_heard(library: ctypes.CDLL) -> None:
    """ODE ends the process after a failed assertion: that must not look like a crash without a reason."""
    code = "import ctypes, stiction.engines.ode.library as o; o.ode_library().dDebug(2, b'no body, %s', b'no')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode != 0 and "ODE gave up and ends this process: no body, no" in ended.stderr
