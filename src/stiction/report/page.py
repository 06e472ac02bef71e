"""The look that every page shares: one self-contained HTML file, readable in light and in dark, no network.

A page is a title, a lead, warnings, and sections made of blocks (`paragraph`, `table`, `picture`, `video`). Everything
is escaped by jinja2 except blocks made here, which come as `Markup`.
"""

from __future__ import annotations

import base64
import io
import mimetypes
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from stiction import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK = "#7d8590"
"""Grey that reads on white and on near-black: axes and labels of the figures, whose background is transparent."""

COLORS = ("#3b82c4", "#d97a3a", "#4c9f70", "#b3589a", "#c4a13b", "#6b6fc4")
"""Line colours, chosen to read on both backgrounds."""


@dataclass(frozen=True)
class Section:
    """A headed part of a page."""

    title: str
    """Heading."""
    blocks: tuple[Markup, ...]
    """What stands under it, in order."""


@cache
def _environment() -> Environment:
    """Return the template engine, with escaping on for every template and undefined names an error."""
    folder = Path(__file__).parent / "templates"
    found = Environment(loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    found.filters["marked"] = marked
    return found


def marked(text: str) -> Markup:
    """Return plain text escaped, with what stands between backticks as code: texts are shared with Markdown."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _block(name: str, *arguments: object) -> Markup:
    """Render one macro of `blocks.html`."""
    return Markup(getattr(_environment().get_template("blocks.html").module, name)(*arguments))


def paragraph(text: str) -> Markup:
    """Return a paragraph of plain text."""
    return _block("paragraph", text)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> Markup:
    """Return a table of plain text; the first column is the row's name, columns of numbers align right, words left."""
    cells = [list(row) for row in rows]
    words = [any(map(_is_word, column)) for column in zip_longest([""] * len(header), *cells, fillvalue="")]
    return _block("table", header, cells, words, caption)


BLANKS = ("", "-", "–", "none", "not known")
"""What stands in a column of numbers where there is no number."""


def _is_word(cell: str) -> bool:
    """Return whether a cell is text: not blank, and not begun by a digit, a sign or a decimal point."""
    return cell not in BLANKS and not (cell[0].isdigit() or cell[0] in "+-−.")


def picture(uri: str, caption: str = "") -> Markup:
    """Return an image from a data URI (`figure_uri`, `file_uri`); the caption is also its alternative text."""
    return _block("picture", uri, caption)


def video(uri: str, caption: str = "") -> Markup:
    """Return a looping, muted clip (mp4, webm) from a data URI; an animated WebP or GIF goes into `picture`."""
    return _block("video", uri, caption)


def row(*blocks: Markup) -> Markup:
    """Return blocks side by side where the window is wide enough."""
    return _block("row", blocks)


def bullets(texts: Sequence[str]) -> Markup:
    """Return warnings that concern one part of a page."""
    return _block("bullets", texts)


def fold(title: str, blocks: Sequence[Markup]) -> Markup:
    """Return blocks behind a title that opens them: for pages with many alike parts."""
    return _block("fold", title, blocks)


def data_uri(data: bytes, mime: str) -> str:
    """Return bytes as a `data:` URI, so that the page needs no file beside it."""
    return f"data:{mime};base64,{base64.b64encode(data).decode('ascii')}"


def file_uri(path: Path) -> str:
    """Return a file (an image, a clip) as a `data:` URI; the type comes from its name."""
    known = {".webp": "image/webp", ".webm": "video/webm"}
    mime = known.get(path.suffix.lower()) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return data_uri(path.read_bytes(), mime)


MARGINS = (0.75, 0.12, 0.55, 0.15)
"""Left, right, bottom and top of a figure with fixed margins [in]."""


def new_figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (8.0, 3.2), fixed: bool = False
) -> tuple[Figure, list]:
    """Return a matplotlib figure in the page's colours and its axes as a flat list; no window and no global state.

    fixed: margins that are the same for every figure, for pages with many: laying out to fit draws everything twice.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout=None if fixed else "constrained")
    if fixed:
        left, right, bottom, top = MARGINS
        width, height = size
        sides = {"left": left / width, "right": 1 - right / width}
        figure.subplots_adjust(**sides, bottom=bottom / height, top=1 - top / height, hspace=0.15)
    FigureCanvasAgg(figure)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axis in axes:
        axis.set_facecolor("none")
        axis.set_prop_cycle(color=COLORS)
        axis.tick_params(colors=INK, labelsize=8)
        axis.grid(True, color=INK, alpha=0.22, linewidth=0.6)
        axis.xaxis.label.set(color=INK, fontsize=9)
        axis.yaxis.label.set(color=INK, fontsize=9)
        axis.title.set(color=INK, fontsize=10)
        for spine in axis.spines.values():
            spine.set_edgecolor(INK)
    return figure, axes


def legend(axis) -> None:
    """Add a legend to an axis of `new_figure`, in the page's colours."""
    axis.legend(fontsize=8, labelcolor=INK, frameon=False)


def figure_uri(figure: Figure) -> str:
    """Return a figure as a PNG `data:` URI with a transparent background."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, transparent=True)
    return data_uri(buffer.getvalue(), "image/png")


def render_page(title: str, sections: Sequence[Section], lead: str = "", warnings: Sequence[str] = ()) -> str:
    """Return the page as one HTML text; `lead` is the answer in a sentence or two, shown under the title."""
    return (
        _environment()
        .get_template("page.html")
        .render(title=title, sections=sections, lead=lead, warnings=warnings, version=__version__)
    )
