"""JSON objects: of a bounded size, and refused in one line that names file and field."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.core.errors import BundleError, FileError
from stiction.files.plain import object_text, read_object, take_version, write_object


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b'{"a": NaN}', "NaN is not a JSON number"),
        (b'{"a": 1, "b": {"c": 1, "c": 1}}', "the key 'c' is given twice"),
        (b"[]", "holds a list"),
        (b" " * 101, "over 100 bytes"),
    ],
)
def test_what_is_no_object_is_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    """A file that is damaged, too large or another one must not end in a traceback, or fill the memory."""
    path = tmp_path / "x.json"
    path.write_bytes(content)
    most = 100 if content == b" " * 101 else 2**20
    with pytest.raises(BundleError, match=message) as caught:
        read_object(path, "the thing", BundleError, most)
    assert str(caught.value).startswith("x.json: ") and str(caught.value).endswith("; expected the thing")
    for missing in (tmp_path / "none.json", tmp_path):
        with pytest.raises(FileError, match=r"cannot read .*; expected the thing"):
            read_object(missing, "the thing")


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Letters of every language stay readable; a number that JSON does not have is refused."""
    write_object(tmp_path / "x.json", {"schema_version": 1, "text": "μ"})
    assert "μ" in (tmp_path / "x.json").read_text(encoding="utf-8")
    assert take_version(read_object(tmp_path / "x.json", "it"), 1, "x.json") == {"text": "μ"}
    with pytest.raises(FileError, match=r"x\.json: schema version 1; this program reads version 2"):
        take_version(read_object(tmp_path / "x.json", "it"), 2, "x.json")
    with pytest.raises(ValueError, match="not JSON compliant"):
        object_text({"x": float("nan")})
