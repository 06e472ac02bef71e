"""The look that every page shares: one self-contained HTML file, readable in light and in dark, no network.

A page is a title, a lead, warnings, and sections made of blocks (`paragraph`, `table`, `picture`). Everything
is escaped by jinja2 except blocks made here, which come as `Markup`.
"""

from __future__ import annotations

import base64
import io
import mimetypes
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from itertools import groupby, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from stiction import __version__
from stiction.core import records
from stiction.core.errors import escaped
from stiction.core.files import publish

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INK = "#59636e"
"""Colour of every text of a figure, 6.1:1 on white; on a page it is the page's `--soft`, which follows the scheme."""

TEXT = 9.0
"""Size of text in a figure [pt]: 12 px on a page, where a figure has its natural width."""

WIDEST = 9.8
"""Width of a figure that a page shows whole in a window of 1280 px [in]."""

MOST_POINTS = 2000
"""Points of a line or cloud that a page draws one by one; more of them are a picture within the figure."""

COLORS = ("#2667a6", "#ff660d", "#0fa766", "#b47090", "#766324", "#813ee2")
"""Line colours that read on both backgrounds, and are apart to colour-blind eyes too: a test simulates them."""

STYLES = ("-", (0, (5, 1.5)), "-.", (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5, 1, 1.5)), (0, (2.5, 1)))
"""Line styles, distinguishable without colour."""

MARKS = ("o", "s", "^", "D", "v", "P")
"""Points of single policies, likewise."""


@dataclass(frozen=True)
class Section:
    """A headed part of a page."""

    title: str
    """Heading."""
    blocks: tuple[Markup, ...]
    """Content of the section, in order."""


@cache
def _environment() -> Environment:
    """Return the template engine, with escaping on for every template and undefined names an error."""
    folder = Path(__file__).parent / "templates"
    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["marked"] = marked
    return environment


def marked(text: str) -> Markup:
    """Return plain text escaped, with what stands between backticks as code: texts are shared with Markdown."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def render_block(name: str, *arguments: object) -> Markup:
    """Render one macro of `blocks.html`."""
    return Markup(getattr(_environment().get_template("blocks.html").module, name)(*arguments))


def paragraph(text: str) -> Markup:
    """Return a paragraph of plain text."""
    return render_block("paragraph", text)


def table(header: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "", grouped: bool = False) -> Markup:
    """Return a table of plain text; the first column is the row's name, columns of numbers align right, words left.

    grouped: rows of one first cell, which follow each other, stand under it as a heading, and the second is the name.
    """
    cells = [list(row) for row in rows]
    words = [any(map(_is_word, column)) for column in zip_longest([""] * len(header), *cells, fillvalue="")]
    if not grouped:
        return render_block("table", header, [("", cells)], words, caption)
    groups = [(name, [line[1:] for line in own]) for name, own in groupby(cells, key=lambda line: line[0])]
    return render_block("table", header[1:], groups, words[1:], caption)


def row_table(rows: Sequence[Any], caption: str = "", grouped: bool = False) -> Markup:
    """Return records of one kind, at least one, as a table of the columns that their fields describe, as `table`."""
    return table(records.header(rows[0]), map(records.texts, rows), caption, grouped)


BLANKS = ("", "-", "–", "none", "not known")
"""Cells without a number in a column of numbers."""


def _is_word(cell: str) -> bool:
    """Return whether a cell is text: not blank, not begun by a digit, a sign or a decimal point, or more than that."""
    begun = cell[:1].isdigit() or cell[:1] in "+-−."
    return cell not in BLANKS and (not begun or re.search(r"\b(too|fell|follows)\b", cell) is not None)


def picture(uri: str, caption: str = "", white: bool = False) -> Markup:
    """Return an image from a data URI (`file_uri`); the caption is also its alternative text.

    white: a figure that `save_figure` drew on white: where the page is dark, its lightness is turned around.
    """
    return render_block("picture", uri, caption, caption.replace("`", ""), white)


def row(*blocks: Markup) -> Markup:
    """Return blocks side by side where the window is wide enough."""
    return render_block("row", blocks)


def bullets(texts: Sequence[str]) -> Markup:
    """Return warnings that concern one part of a page."""
    return render_block("bullets", texts)


def fold(title: str, blocks: Sequence[Markup], anchor: str = "") -> Markup:
    """Return blocks behind a title that opens them: for pages with many alike parts. anchor: to link to, `#E10`."""
    return render_block("fold", title, blocks, anchor)


def settings_table(settings: Mapping[str, Any]) -> Markup:
    """Return settings, nested as in a summary, as a table of two columns: `friction levels`, `0, 0.1, 0.2`."""
    return table(("setting", "value"), _settings_rows(settings))


def _settings_rows(settings: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return the rows of settings; what is nested has the names above it in front."""
    rows = []
    for name, value in settings.items():
        label = f"{prefix}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            rows += _settings_rows(value, f"{label}, ")
        else:
            several = isinstance(value, list | tuple)
            rows.append((label, (", ".join(map(str, value)) if several else str(value)) or "–"))
    return rows


def data_uri(data: bytes, mime: str) -> str:
    """Return bytes as a `data:` URI, so that the page needs no file beside it."""
    return f"data:{mime};base64,{base64.b64encode(data).decode('ascii')}"


def file_uri(path: Path) -> str:
    """Return a file (an image, a clip) as a `data:` URI; the type comes from its name."""
    known = {".webp": "image/webp", ".webm": "video/webm"}
    mime = known.get(path.suffix.lower()) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return data_uri(path.read_bytes(), mime)


DPI = 130
"""Resolution of figures [1/in]."""

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

    figure = Figure(figsize=size, dpi=DPI, layout=None if fixed else "constrained")
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
        axis.tick_params(colors=INK, labelsize=TEXT)
        axis.grid(True, color=INK, alpha=0.22, linewidth=0.6)
        for text in (axis.xaxis.label, axis.yaxis.label, axis.title):
            text.set(color=INK, fontsize=TEXT)
        for spine in axis.spines.values():
            spine.set_edgecolor(INK)
    return figure, axes


def same_scale(axes: Sequence[Axes]) -> None:
    """Give panels of one quantity one vertical scale, from the lowest end of theirs to the highest."""
    ends = [end for axis in axes for end in axis.get_ylim()]
    for axis in axes:
        axis.set_ylim(min(ends), max(ends))


def labelled(axis: Axes) -> dict[str, Any]:
    """Return what was drawn on an axis by its label; `_a`, which matplotlib would hide, is a name too."""
    drawn: list[Any] = [*axis.lines, *axis.patches, *axis.collections, *axis.containers]
    return {label: one for one in drawn if not UNNAMED.fullmatch(label := str(one.get_label()))}


UNNAMED = re.compile(r"(_child\d+|_container\d+|_nolegend_)?")
"""Names that matplotlib gives to artists without a label."""


def legend(axis: Axes | Figure, drawn: dict[str, Any] | None = None, **settings: Any) -> None:
    """Add a legend to an axis of `new_figure` or to the whole figure, in the page's colours, where there is anything.

    drawn: label -> what was drawn, by default all that is `labelled` on the axis.
    """
    handles = labelled(axis) if drawn is None else drawn  # type: ignore[arg-type]
    if not handles:
        return
    # As long as two periods of the longest of `STYLES` in a thick line: shorter samples look alike.
    look: dict[str, Any] = {"fontsize": TEXT, "labelcolor": INK, "frameon": False, "handlelength": 4.0} | settings
    axis.legend(list(handles.values()), list(handles), **look)


def name_plainly(figure: Figure) -> Figure:
    """Make no text of a figure do anything nor be under `TEXT`, and return the figure: names come from files, and `$`
    is no formula. Numbers of a logarithmic axis are `0.01`: the exponent of 10⁻² is smaller.
    """
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    class Plain(LogFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return f"{x:g}" if super().__call__(x, pos) else ""

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        for formatter, put in (
            (axis.get_major_formatter(), axis.set_major_formatter),
            (axis.get_minor_formatter(), axis.set_minor_formatter),
        ):
            if isinstance(formatter, LogFormatter):
                put(Plain(10.0, formatter.labelOnlyBase, formatter.minor_thresholds))
    for text in figure.findobj(Text):
        text.set_text(escaped(text.get_text()))
        text.set_usetex(False)
        text.set_parse_math(False)
        text.set_fontsize(max(text.get_fontsize(), TEXT))
    return figure


def finished(figure: Figure) -> Figure:
    """Make the texts of a figure plain, lay it out, and return it: it is to be drawn, on a page and into files.

    A figure that lays itself out does so for every file, and is drawn twice for each.
    """
    layout = name_plainly(figure).get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine(None)
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, of the kind that its file's name says, on white. Raises `FileError` as `publish`."""
    buffer = io.BytesIO()
    finished(figure).savefig(buffer, format=path.suffix[1:], dpi=DPI, facecolor="white")
    data = buffer.getvalue()
    with publish(path) as partial:
        partial.write_bytes(paletted(data) if path.suffix == ".png" else data)


def paletted(png: bytes) -> bytes:
    """Return a PNG file of 64 colours: a figure has a handful and their edges, and is a third of the size."""
    from PIL import Image

    buffer = io.BytesIO()
    few = Image.open(io.BytesIO(png)).convert("RGB").quantize(64, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def figure_svg(figure: Figure) -> str:
    """Return a figure as an SVG element for a page: its text is text, in the page's font and colour.

    Lines and clouds of more than `MOST_POINTS` are pictures within it.
    """
    import matplotlib
    from matplotlib.collections import PathCollection
    from matplotlib.lines import Line2D

    for line in figure.findobj(Line2D):
        line.set_rasterized(len(line.get_xdata()) > MOST_POINTS)  # type: ignore[arg-type]
    for cloud in figure.findobj(PathCollection):
        cloud.set_rasterized(len(cloud.get_offsets()) > MOST_POINTS)  # type: ignore[arg-type]
    buffer = io.BytesIO()
    # Names of shapes from their content alone: equal figures are equal texts, and two on a page share what is equal.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "stiction"}):
        finished(figure).savefig(buffer, format="svg", dpi=DPI, transparent=True, metadata={"Date": None})
    text = buffer.getvalue().decode("utf-8")
    for pattern, by in UNUSED.items():
        text = re.sub(pattern, by, text, flags=re.DOTALL)
    return text


UNUSED = {
    r"^.*?(?=<svg)": "",
    r"<metadata>.*?</metadata>|<defs>\s*<style.*?</defs>": "",
    r"<!--.*?-->": "",
    r' xmlns(:xlink)?="[^"]*"': "",
    r'<g id="\w+?">': "<g>",
    r"\n\s*": "\n",
    r"[\x00-\x09\x0b-\x1f\x7f]": "\ufffd",
    "'DejaVu Sans'[^;\"]*": "inherit",
    f"(?<=: ){INK}": "var(--soft)",
}
"""Pattern in an SVG file of matplotlib -> its replacement on a page."""


def figure_block(figure: Figure, caption: str) -> Markup:
    """Return a figure as a block of a page; the caption is also its name to who cannot see it."""
    return render_block("drawing", Markup(figure_svg(figure)), caption, caption.replace("`", ""))


FEWEST_LISTED = 3
"""Sections from which on a page begins with a list of them."""

MOST_WARNINGS = 3
"""Warnings that stand above the contents; of more, all but the first are folded under it."""

LONGEST_COMMAND = 160
"""Characters of the command that are shown on top of a page: the whole of a longer one is in its last section."""


def render_page(
    title: str,
    sections: Sequence[Section],
    lead: str | Sequence[str] = "",
    warnings: Sequence[str] = (),
    command: str = "",
    date: str = "",
    refresh: float = 0.0,
    opening: Sequence[Markup] = (),
    figure: Markup | None = None,
    card: Markup | None = None,
) -> str:
    """Return the page as one HTML text: what made it and when, the answer, warnings, contents, sections.

    lead: the answer in a sentence or two, or lines, the first of which is the answer; command: that made what is shown;
    date: of the page, by default today; refresh: time after which a browser loads the page anew [s], 0: never; opening:
    blocks above the answer, side by side; in a narrow window all but the first come below it; figure: that shows the
    answer, below it; card: the answer at a glance, below which lead and warnings are folded away.
    """
    lines = [lead] if isinstance(lead, str) else list(lead)
    shown = 1 if len(warnings) > MOST_WARNINGS and card is None else len(warnings)
    short = command if len(command) <= LONGEST_COMMAND else f"{command[:LONGEST_COMMAND].rsplit(' ', 1)[0]} …"
    drawn = f"Drawn on {date or datetime.now().astimezone().date().isoformat()}"
    return (
        _environment()
        .get_template("page.html")
        .render(
            title=title,
            sections=sections,
            anchors=anchors([section.title for section in sections]),
            listed=len(sections) >= FEWEST_LISTED,
            made=drawn + (f"; what it shows was made by `{short}`." if command else "."),
            opening=opening,
            figure=figure,
            card=card,
            lead=[line for line in lines if line],
            warnings=warnings[:shown],
            more=warnings[shown:],
            version=__version__,
            refresh=round(refresh),
        )
    )


def anchors(titles: Sequence[str]) -> list[str]:
    """Return the anchor of each heading: its words, and a number where another has the same."""
    names = ["-".join(re.findall(r"[a-z0-9]+", title.lower()))[:60] or "part" for title in titles]
    seen = [names[:index].count(name) for index, name in enumerate(names)]
    return [f"{name}-{count + 1}" if count else name for name, count in zip(names, seen, strict=True)]


class Spread(NamedTuple):
    """Spread of the training seeds at one place of the horizontal axis."""

    place: float
    """Position on the horizontal axis, in its unit."""
    mean: float
    """Mean over the seeds."""
    low: float | None
    """Lower end of its 95 % t-interval; None for one seed."""
    high: float | None
    """Upper end."""
    each: str
    """Every seed's, separated by blanks."""


def line_look(name: str, names: Sequence[str]) -> dict[str, Any]:
    """Return colour and style of a line, the same in every figure with these names; no two of 36 have both alike."""
    number = list(names).index(name)
    round_, place = divmod(number, len(COLORS))
    return {"color": COLORS[place], "linestyle": STYLES[(place + round_) % len(STYLES)]}


def mark_look(name: str, names: Sequence[str]) -> str:
    """Return the mark of a line's points, the same in every figure with these names."""
    return MARKS[list(names).index(name) % len(MARKS)]


CLOSEST = 0.065
"""Least distance of two names at the ends of lines, over the height of their axis."""


def label_ends(axis: Axes) -> None:
    """Write the name of every line at its right end, beside the axis, joined to it by a stroke in its colour."""
    named = [line for line in axis.lines if not str(line.get_label()).startswith("_")]
    heights = {index: np.asarray(line.get_ydata(), dtype=float) for index, line in enumerate(named)}
    low, high = axis.get_ylim()
    ends = sorted((float(values[-1]), index) for index, values in heights.items() if values.size)
    places = spaced([(value - low) / (high - low) for value, _ in ends], CLOSEST)
    for (value, index), place in zip(ends, places, strict=True):
        end = min(max((value - low) / (high - low), 0.0), 1.0)
        look: dict[str, Any] = {"color": named[index].get_color(), "clip_on": False, "label": "_nolegend_"}
        axis.plot([1.0, 1.015], [end, place], transform=axis.transAxes, linewidth=1.2, **look)
        text = str(named[index].get_label())
        look = {"color": INK, "va": "center", "annotation_clip": False, "fontsize": TEXT}
        axis.annotate(text, (1.0, place), (1.02, place), "axes fraction", **look)


def spaced(places: Sequence[float], least: float) -> list[float]:
    """Return ascending places moved apart to at least a distance, within 0 to 1 where they fit there."""
    positions: list[float] = []
    for place in places:
        positions.append(max(place, positions[-1] + least) if positions else max(place, 0.0))
    over = max(0.0, positions[-1] - 1.0) if positions else 0.0
    if over:
        # Pushed beyond the top: back down from there, each as far as it must.
        ceiling = 1.0
        for index in range(len(positions) - 1, -1, -1):
            positions[index] = min(positions[index], ceiling)
            ceiling = positions[index] - least
    return positions


def draw_seeds(axis: Axes, points: Sequence[Spread], method: str, methods: Sequence[str]) -> None:
    """Draw one training method: the mean as a line, its interval as a band, every seed as a point."""
    look = line_look(method, methods)
    axis.plot([p.place for p in points], [p.mean for p in points], linewidth=1.8, label=method, **look)
    for point in points:
        each = [float(one) for one in point.each.split()]
        axis.plot([point.place] * len(each), each, linestyle="", marker=".", markersize=3, color=look["color"])
    known = [(point.place, point.low, point.high) for point in points if point.low is not None]
    if known:
        middle, low, high = zip(*known, strict=True)
        axis.fill_between(middle, low, high, color=look["color"], alpha=0.13, linewidth=0)


@dataclass(frozen=True)
class Sheet:
    """A table of text with a title."""

    title: str
    """Heading of the table."""
    header: tuple[str, ...]
    """Names of the columns."""
    rows: tuple[tuple[str, ...], ...]
    """The cells."""
    note: str = ""
    """Remark for the reader."""

    def html(self) -> Markup:
        """Return it as a block of a page."""
        return table(self.header, self.rows, self.title)

    def markdown(self) -> str:
        """Return it as Markdown, a pipe in a cell escaped."""
        text = records.markdown(self.header, self.rows)
        return f"**{self.title}**\n\n{text}\n" + (f"\n{self.note}\n" if self.note else "")

    def blocks(self) -> tuple[Markup, ...]:
        """Return the table and its note as blocks of a page."""
        return self.html(), *((paragraph(self.note),) if self.note else ())
