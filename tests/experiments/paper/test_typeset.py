"""Text of the report: every sentence stands in it once, its two forms have the same words, and a fault is one line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import stiction_experiments.paper as package
from stiction.core.errors import FileError
from stiction_experiments.paper.page import judge, report
from stiction_experiments.paper.results import Results
from stiction_experiments.paper.rows import Walks
from stiction_experiments.paper.typeset import sections_of, typeset

TEXT = Path(package.__file__).with_name("report.typ").read_text()


def test_every_sentence_is_answered_in_one_section() -> None:
    """The numbers of all tables of answers are those of the sentences, each once."""
    answered = [
        number.strip(' "') for numbers in re.findall(r"#answers\((.+)\)", TEXT) for number in numbers.split(",")
    ]
    assert sorted(answered) == sorted(row.number for row in judge(Results(Walks(()))))


def test_the_report_is_typeset_without_a_row() -> None:
    """Page and PDF without walks say that there are none, and are the same bytes each time."""
    page = report(Results(Walks(())))
    titles = [section.title for section in page.sections]
    assert titles[0] == "Summary" and titles[-1] == "Limits" and len(titles) == TEXT.count("\n= ") + 1
    text = "".join(block for section in page.sections for block in section.blocks)
    assert "These walks have not been made yet" in text and text.count("not walked") > 40
    assert text == "".join(block for section in report(Results(Walks(()))).sections for block in section.blocks)


def test_a_page_is_cut_at_its_headings() -> None:
    """Numbers of headings go, short cells stay whole, wide tables scroll."""
    made = typeset(b'#set heading(numbering: "1")\n= One & two\na\n= Last\n#table([b], [' + b"c " * 21 + b"])", {})
    assert made.pdf.startswith(b"%PDF") and [each.title for each in made.sections] == ["One & two", "Last"]
    first, last = (section.blocks[0] for section in made.sections)
    assert "<p>a</p>" in first and last.startswith('<div class="scroll"><table>')
    assert '<td class="words short">b</td>' in last and '<td class="words long">c c' in last
    assert sections_of("<body><p>no heading</p></body>") == ()


def test_a_fault_of_the_text_is_one_error() -> None:
    """A name that is not defined is a `FileError`."""
    with pytest.raises(FileError, match="unknown variable: nothing"):
        typeset(b"#nothing", {})
