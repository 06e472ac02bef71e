"""The page that every report is made of."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.report.page import (
    Section,
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
    from stiction.report.page import figure_uri, labelled, legend, new_figure, save_figure

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
    assert figure_uri(figure).startswith("data:image/png")
    for kind in ("svg", "png"):
        save_figure(figure, tmp_path / f"it.{kind}")
        assert (tmp_path / f"it.{kind}").stat().st_size > 1000
    ticks = [text.get_text() for text in axis.get_xticklabels()]
    assert any("mathdefault" in text for text in ticks)
    assert all(text.get_parse_math() for text in axis.get_xticklabels())
