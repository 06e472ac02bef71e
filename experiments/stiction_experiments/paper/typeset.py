"""Typesets the report: its text, which reads rows and figures by their names, becomes a PDF and sections of a page."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import matplotlib
import typst
from markupsafe import Markup

from stiction.core.errors import FileError
from stiction.report.page import Section, finished

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Typeset:
    """A report in both of its forms."""

    pdf: bytes
    sections: tuple[Section, ...]
    """One for each heading."""


def typeset(text: bytes, files: Mapping[str, bytes]) -> Typeset:
    """Typeset a text in the language of Typst; the same input makes the same bytes.

    files: name in the text -> content. Raises `FileError` where the text has a fault.
    """
    # The types of typst know no texts of several files, its documentation does.
    sources: Any = {"main.typ": text} | dict(files)
    try:
        pdf = typst.compile(sources, format="pdf", timestamp=datetime.fromtimestamp(0, UTC))
        page = typst.compile(sources, format="html")
    except RuntimeError as fault:
        raise FileError(f"report.typ cannot be typeset: {fault}") from fault
    return Typeset(pdf, sections_of(page.decode("utf-8")))


def sections_of(page: str) -> tuple[Section, ...]:
    """Return the headed parts of a typeset page; what stands before the first heading is its title."""
    body = page[page.index("<body>") + len("<body>") : page.rindex("</body>")]
    _, *rest = re.split(r"<h2>(?:\d+ )?(.*?)</h2>", body)
    return tuple(
        Section(html.unescape(title), (_block(part),)) for title, part in zip(rest[::2], rest[1::2], strict=True)
    )


SHORT, LONG = 15, 40
"""Letters of a cell up to which it is not broken into lines, and from which on it is wide."""


def _block(part: str) -> Markup:
    """Return a part of the body in the looks of our pages: words to the left, and what is wide scrolls by itself."""
    part = re.sub(r"<td>(.*?)</td>", lambda cell: _cell(cell[1]), part, flags=re.DOTALL)
    part = part.replace("<th>", '<th class="words">').replace("<img ", '<img class="white" ')
    return Markup(re.sub(r"<table>.*?</table>", r'<div class="scroll">\g<0></div>', part, flags=re.DOTALL))


def _cell(content: str) -> str:
    size = " short" if len(content) < SHORT else " long" if len(content) > LONG else ""
    return f'<td class="words{size}">{content}</td>'


def drawn(figure: Figure | None) -> bytes:
    """Return a figure as SVG whose letters are lines, as no font has to be there; an empty one for None."""
    if figure is None:
        return b'<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"/>'
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "stiction"}):
        finished(figure).savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    return buffer.getvalue()
