"""Base of every result: plain data, display in a notebook, files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from stiction.core.errors import FileError, escaped
from stiction.core.lock import output_folder

Progress = Callable[[str, float], None]
"""Called with the name of the work and the share of it that is done."""


def silent(name: str, share: float) -> None:
    """Report nothing."""


class Result(ABC):
    """A result: `str` has its lines, a notebook its table, `to_dict` its data, `save` its files."""

    @abstractmethod
    def lines(self) -> Sequence[str]:
        """Return what it says, in some three lines."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Return plain data: the JSON that the verb of this name prints with `--json`."""

    @abstractmethod
    def write(self, folder: Path) -> None:
        """Write the files into a folder that exists."""

    def table(self) -> Markup:
        """Return what a notebook shows under the lines."""
        return Markup()

    def save(self, path: str | Path) -> Path:
        """Write the files of the verb of this name into a folder, which is made; return it.

        Raises `FileError` where that cannot be, or another process writes the folder.
        """
        folder = Path(path)
        try:
            with output_folder(folder):
                self.write(folder)
        except OSError as error:
            raise FileError(f"cannot write to {folder}: {error.strerror or error}; choose another --out") from error
        return folder

    def __repr__(self) -> str:
        """Return the lines."""
        return "\n".join(map(escaped, self.lines()))

    def _repr_html_(self) -> str:
        """Return lines and table for a notebook, everything escaped, without any script."""
        lines = Markup("<br>").join(escape(escaped(line)) for line in self.lines())
        return str(Markup("<div><p>{}</p>{}</div>").format(lines, self.table()))


def html_table(header: Sequence[object], rows: Iterable[Sequence[object]]) -> Markup:
    """Return a plain table of text, every cell escaped."""

    def line(kind: str, cells: Sequence[object]) -> Markup:
        tag = Markup(kind)
        inner = Markup().join(Markup("<{0}>{1}</{0}>").format(tag, escaped(str(cell))) for cell in cells)
        return Markup("<tr>{}</tr>").format(inner)

    body = Markup().join(line("td", row) for row in rows)
    return Markup("<table><thead>{}</thead><tbody>{}</tbody></table>").format(line("th", header), body)
