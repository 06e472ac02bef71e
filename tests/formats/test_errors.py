"""The one family of errors."""

from __future__ import annotations

import pytest

from stiction.formats.errors import LogError, StictionError


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("no column 'τ θ'; map it", "no column 'τ θ'; map it"),
        ("a\nb", "a\\nb"),
        ("\x1b[2J gone", "\\x1b[2J gone"),
        ("lone \ud800", "lone \\ud800"),
    ],
)
def test_a_message_is_one_printable_line(message: str, shown: str) -> None:
    """A column's name from a stranger's file must not write lines of its own, or steer the terminal."""
    assert str(LogError(message)) == str(StictionError(message)) == shown
