"""XML from strangers, read without surprises and changed in places."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stiction.core.errors import StictionError
from stiction.exchange import urdf as module
from stiction.exchange.urdf import parse_markup, set_attributes


def test_tags_are_found_where_they_stand() -> None:
    """Quotes may hold `>`, comments may hold tags, letters may take several bytes."""
    data = "<?xml version='1.0' encoding='utf-8'?>\n<!-- <joint/> ü --><a x='é > 1'><b  y=\"2\" /><c></c></a>".encode()
    markup = parse_markup(data, "test")
    assert [data[tag.start : tag.end].decode() for tag in markup.tags] == ["<a x='é > 1'>", '<b  y="2" />', "<c>"]
    assert [tag.parent for tag in markup.tags] == [None, 0, 0]
    assert data[markup.closes[2] :].startswith(b"</c>") and 1 not in markup.closes
    assert [up.name for up in markup.ancestors(markup.tags[2])] == ["a"] and markup.tags[2].inside == {"a"}


def test_attributes_are_replaced_in_place_or_appended() -> None:
    """Order, quotes and spacing of the others stay; a word inside another value is no attribute."""
    tag = b"<joint  note=\"damping='9'\"\n damping = '1' xdamping=\"2\" />"
    expected = b'<joint  note="damping=\'9\'"\n damping = "0.5" xdamping="2" armature="3" />'
    assert set_attributes(tag, {"damping": "0.5", "armature": "3"}) == expected
    assert set_attributes(b"<joint>", {"a": "1"}) == b'<joint a="1">'
    assert set_attributes(b"<joint/>", {"a": "1"}) == b'<joint a="1"/>'


def test_edits_leave_everything_else_as_it_was() -> None:
    """Windows line ends and a mark at the beginning included."""
    data = b"\xef\xbb\xbf<a>\r\n\t<b/>\r\n</a>\r\n"
    markup = parse_markup(data, "test")
    inner = markup.tags[1]
    noted = data.replace(b"<a>", b"<a>\n<!--\n  by - -hand\n-->").replace(b"<b/>", b"<x/>")
    assert markup.edited([(inner.start, inner.end, b"<x/>")], ["by --hand"]).encode() == noted


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b'<!DOCTYPE a [<!ENTITY x "y">]><a>&x;</a>', "document type"),
        (b'<!doctype a SYSTEM "file:///etc/passwd"><a/>', "document type|not well-formed"),
        (b"<a><b></a>", "not well-formed"),
        ("<?xml version='1.0' encoding='utf-16'?><a/>".encode("utf-16"), "not well-formed"),
        (b"<?xml version='1.0' encoding='latin-1'?><a/>", "save it as UTF-8"),
        (b"<a>" * 300 + b"</a>" * 300, "within each other"),
    ],
)
def test_what_is_dangerous_or_broken_is_refused(data: bytes, message: str) -> None:
    """Entities read files and grow without bound; depth costs time."""
    with pytest.raises(StictionError, match=message):
        parse_markup(data, "model.xml")


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    """Only the one error."""
    try:
        markup = parse_markup(data, "any")
    except StictionError:
        return
    assert module.edited(markup.data, []).encode() == data
