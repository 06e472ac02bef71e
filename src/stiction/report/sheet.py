"""A table of text that is shown on a page and, as Markdown, in a README."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from stiction.report.page import paragraph, table


@dataclass(frozen=True)
class Sheet:
    """A table of text with a title."""

    title: str
    """What it shows."""
    header: tuple[str, ...]
    """Names of the columns."""
    rows: tuple[tuple[str, ...], ...]
    """The cells."""
    note: str = ""
    """What a reader must know."""

    def html(self) -> Markup:
        """Return it as a block of a page."""
        return table(self.header, self.rows, self.title)

    def markdown(self) -> str:
        """Return it as Markdown, a pipe in a cell escaped."""
        lines = [self.header, tuple("---" for _ in self.header), *self.rows]
        text = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        return f"**{self.title}**\n\n{text}\n" + (f"\n{self.note}\n" if self.note else "")

    def blocks(self) -> tuple[Markup, ...]:
        """Return the table and its note as blocks of a page."""
        return self.html(), *((paragraph(self.note),) if self.note else ())
