"""ODE is found or the way to it is named, another version is not taken for it, and its last words are heard."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from importlib import metadata

import pytest

from stiction.core.errors import StictionError
from stiction.engines.ode import library as ode_functions
from stiction.engines.ode import library as ode_library


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


def test_single_precision_is_refused() -> None:
    """Numbers of half the size would be read as garbage."""

    class Single:
        @staticmethod
        def dGetConfiguration() -> bytes:
            return b"ODE ODE_EXT_trimesh ODE_single_precision"

    with pytest.raises(StictionError, match="single precision"):
        ode_library.check_precision(Single, "libode")


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


def test_the_last_words_are_heard(library: ctypes.CDLL) -> None:
    """ODE ends the process after a failed assertion: that must not look like a crash without a reason."""
    code = "import ctypes, stiction.engines.ode.library as o; o.ode_library().dDebug(2, b'no body, %s', b'no')"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode != 0 and "ODE failed and ends this process: no body, no" in ended.stderr
