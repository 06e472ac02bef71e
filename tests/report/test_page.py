"""The page that every report is made of."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from markupsafe import escape

from stiction.core.errors import escaped
from stiction.report.page import (
    MOST_POINTS,
    TEXT,
    Section,
    figure_svg,
    label_ends,
    new_figure,
    paragraph,
    picture,
    render_page,
    row,
    table,
)


def test_text_is_escaped_everywhere_and_blocks_are_not() -> None:
    """A joint named like a tag must not become one, or a log could put script into a report."""
    evil = "<script>x</script>"
    blocks = (paragraph(evil), table([evil], [[evil, evil]], evil), picture("data:,", evil), row(paragraph(evil)))
    page = render_page(evil, [Section(evil, blocks)], lead=evil, warnings=[evil])
    assert "<script" not in page
    assert page.count("&lt;script&gt;x&lt;/script&gt;") == 13
    assert "<p>&lt;script" in page and '<div class="row">' in page


def test_the_page_needs_nothing_from_the_network() -> None:
    """A report is one file that can be sent by mail: no address in it."""
    page = render_page("title", [Section("part", (paragraph("text"),))])
    assert "http" not in page and "src=" not in page and "url(" not in page


@pytest.mark.parametrize("name", ["$\\frac$", "$x_{1}^$", "_hidden", "a_b^c{d}", "%$#&~\\", "[red]", "\x1b[2J <b>"])
def test_a_name_in_a_figure_is_no_formula(name: str, tmp_path: Path) -> None:
    """As a title, label, tick or in a legend, `$` made the drawing fail after hours of walks; `_` hid the name."""
    from stiction.report.page import labelled, legend, save_figure

    figure, axes = new_figure(1)
    (axis,) = axes
    axis.plot([1, 10], [1, 10], label=name)
    axis.errorbar([1], [2], yerr=[[1], [1]], label=f"{name}2")
    axis.set(xscale="log", title=name, xlabel=name, ylabel=name)
    axis.set_yticks([1, 2], [name, name])
    axis.text(1, 1, name)
    legend(axis)
    legend(figure, labelled(axis), loc="outside lower center")
    assert [text.get_text() for text in axis.get_legend().get_texts()] == [name, f"{name}2"]
    figure.suptitle(name)
    drawn = figure_svg(figure)
    assert drawn.startswith("<svg") and drawn.count(f">{escape(escaped(name))}</text>") >= 7
    assert "<b>" not in drawn and "\x1b" not in drawn
    for kind in ("svg", "png"):
        save_figure(figure, tmp_path / f"it.{kind}")
        assert (tmp_path / f"it.{kind}").stat().st_size > 1000
    ticks = [text.get_text() for text in axis.get_xticklabels()]
    assert {"1", "10"} <= set(ticks)


def test_a_figure_on_a_page_is_text_of_the_page_and_the_same_every_time() -> None:
    """Holds its text to 12 px and to the page's colour, has no address in it, and holds large clouds small."""
    texts = []
    for _ in range(2):
        figure, (axis,) = new_figure()
        axis.plot(range(MOST_POINTS + 1), range(MOST_POINTS + 1), label="one")
        axis.set_title("small", fontsize=5)
        label_ends(axis)
        texts.append(figure_svg(figure))
    assert texts[0] == texts[1] and len(texts[0]) < 30_000 and "http" not in texts[0]
    sizes = re.findall(r"<text style=\"font-size: ([\d.]+)px.*?fill: var\(--soft\)", texts[0])
    assert len(sizes) == texts[0].count("<text") and min(map(float, sizes)) == TEXT
