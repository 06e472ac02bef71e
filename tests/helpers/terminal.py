"""A pseudo-terminal for a command, and the screen that a person sees in it."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
from collections.abc import Sequence
from pathlib import Path

SEQUENCE = re.compile(r"\x1b\[([?]?)([\d;]*)([A-Za-z])|\x1b\](?:[^\x07\x1b]*)(?:\x07|\x1b\\)")
"""Control sequences, and the commands of an operating system such as a link."""

BEGIN = re.compile(r"\x1b(?:\[[?\d;]*|\][^\x07\x1b]*\x1b?)?$")
"""The beginning of a sequence whose end has not arrived."""

TAB = 8
"""Columns between tab stops."""


class Screen:
    """An ECMA-48 terminal, as far as progress displays need one: text, cursor, erasing and scrolling.

    Raises `ValueError` for any other control, since a real terminal may do anything with it.
    """

    def __init__(self, columns: int = 80, rows: int = 24) -> None:
        """Begin empty, the cursor at the top left."""
        self.columns, self.rows = columns, rows
        self.history: list[str] = []
        """Lines that were scrolled off the top."""
        self.cursor_shown = True
        self._cells = [[" "] * columns for _ in range(rows)]
        self._row = self._column = 0
        self._rest = ""

    @property
    def lines(self) -> list[str]:
        """All lines from the first one to the last that is not blank, without spaces at their ends."""
        shown = [*self.history, *("".join(cells).rstrip() for cells in self._cells)]
        while shown and not shown[-1]:
            shown.pop()
        return shown

    @property
    def column(self) -> int:
        """Column of the cursor."""
        return self._column

    def feed(self, text: str) -> None:
        """Take what a program writes; a sequence may arrive in pieces."""
        text = self._rest + text
        begin = BEGIN.search(text)
        self._rest = begin[0] if begin else ""
        position, end = 0, len(text) - len(self._rest)
        while position < end:
            if text[position] == "\x1b":
                sequence = SEQUENCE.match(text, position)
                if sequence is None:
                    raise ValueError(f"unknown sequence {text[position : position + 12]!r}")
                self._control(*sequence.groups())
                position = sequence.end()
            else:
                self._character(text[position])
                position += 1

    def _character(self, character: str) -> None:
        """Draw a character, or move as it says."""
        if character == "\n":
            self._next_row()
        elif character == "\r":
            self._column = 0
        elif character == "\b":
            self._column = max(0, self._column - 1)
        elif character == "\t":
            self._column = min(self.columns - 1, (self._column // TAB + 1) * TAB)
        elif not character.isprintable():
            raise ValueError(f"unknown control character {character!r}")
        else:
            if self._column == self.columns:
                self._column = 0
                self._next_row()
            self._cells[self._row][self._column] = character
            self._column += 1

    def _next_row(self) -> None:
        """Move down, scrolling at the bottom."""
        self._row += 1
        if self._row == self.rows:
            self.history.append("".join(self._cells.pop(0)).rstrip())
            self._cells.append([" "] * self.columns)
            self._row -= 1

    def _control(self, private: str | None, numbers: str | None, kind: str | None) -> None:
        """Do what a control sequence says."""
        if kind is None or kind == "m":
            return
        if private:
            if numbers != "25" or kind not in "hl":
                raise ValueError(f"unknown mode ?{numbers}{kind}")
            self.cursor_shown = kind == "h"
            return
        values = [int(number or 0) for number in (numbers or "").split(";")]
        steps = max(1, values[0])
        if kind in "AB":
            self._row = min(self.rows - 1, max(0, self._row + (steps if kind == "B" else -steps)))
        elif kind in "CD":
            self._column = min(self.columns - 1, max(0, self._column + (steps if kind == "C" else -steps)))
        elif kind == "G":
            self._column = min(self.columns, steps) - 1
        elif kind == "H":
            self._row, self._column = (max(1, value) - 1 for value in (*values, 1)[:2])
        elif kind == "K":
            cells = self._cells[self._row]
            begin, end = ((self._column, None), (None, self._column + 1), (None, None))[values[0]]
            cells[begin:end] = " " * len(cells[begin:end])
        elif kind == "J":
            self._cells[self._row + 1 :] = [[" "] * self.columns for _ in range(self._row + 1, self.rows)]
            self._control("", "0", "K")
        else:
            raise ValueError(f"unknown sequence {numbers}{kind}")


def run_in_terminal(command: Sequence[str], folder: Path, columns: int = 80, rows: int = 24) -> tuple[int, Screen]:
    """Run a command in a pseudo-terminal; return its exit status and the screen that it leaves."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    other = ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE")
    inherited = {name: value for name, value in os.environ.items() if name not in other}
    process = subprocess.Popen(
        command,
        cwd=folder,
        env=inherited | {"TERM": "xterm-256color"},
        stdin=slave,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    screen, decoder = Screen(columns, rows), codecs.getincrementaldecoder("utf-8")()
    try:
        while content := os.read(master, 65536):
            screen.feed(decoder.decode(content))
    except OSError:  # Linux: nobody has the other end any more
        pass
    finally:
        os.close(master)
        status = process.wait()
    return status, screen
