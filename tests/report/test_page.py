"""The page that every report is made of."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import pytest

from stiction.report.page import (
    Section,
    data_uri,
    figure_uri,
    new_figure,
    paragraph,
    picture,
    render_page,
    row,
    settings_table,
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


def test_backticks_become_code_and_stay_escaped() -> None:
    """Sentences are shared with the Markdown tables; between backticks a tag is still text."""
    assert "<p>try <code>a &lt;b&gt;</code> or ` alone</p>" in paragraph("try `a <b>` or ` alone")
    page = render_page("t", [], lead="`x`", warnings=["`y`"])
    assert "<code>x</code>" in page and "<code>y</code>" in page


def test_the_page_needs_nothing_from_the_network() -> None:
    """A report is one file that can be sent by mail: no address in it."""
    page = render_page("title", [Section("part", (paragraph("text"),))])
    assert "http" not in page and "src=" not in page and "url(" not in page


def test_a_figure_becomes_a_png() -> None:
    """The figure must be embedded as an image that browsers show."""
    figure, axes = new_figure(2, 1)
    axes[1].plot([0, 1], [0, 1])
    uri = figure_uri(figure)
    head = "data:image/png;base64,"
    assert uri.startswith(head)
    assert base64.b64decode(uri[len(head) :]).startswith(b"\x89PNG")


def test_data_uri_is_base64_of_the_bytes() -> None:
    """`hi` in base64 is `aGk=`."""
    assert data_uri(b"hi", "text/plain") == "data:text/plain;base64,aGk="


def test_columns_of_words_align_left_and_numbers_right() -> None:
    """A definition that hangs on the right edge cannot be read; a dash does not make a column of numbers words."""
    rows = [["a", "-1.5", "far"], ["b", "–", "12 away"], ["c", "not known", ""]]
    block = table(["name", "number", "meaning"], rows)
    assert block.count('<td class="words short">') == 3 and block.count("<td>") == 3


def test_settings_are_a_table_and_no_code() -> None:
    """Braces and quotes are for files: nested settings are named by all names above them."""
    block = settings_table({"friction_levels": [0.0, 0.2], "commands": {"student": ("vx=0.5",)}, "robots": []})
    found = re.findall(r"<t[dh][^>]*>([^<]*)</t[dh]>", block)
    assert found == ["setting", "value", "friction levels", "0.0, 0.2", "commands, student", "vx=0.5", "robots", "–"]


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
