"""Code that a command ran, from its begin to its end."""

from pathlib import Path

import pytest

from stiction.core import provenance as origin
from stiction.core.provenance import Origin, code_digest


def test_code_that_changes_under_a_command_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hours of walks would be labelled with the revision of their end, and mix two without a word."""
    monkeypatch.setattr(origin, "PACKAGE", tmp_path)
    revisions = iter(("new",))
    monkeypatch.setattr(origin, "provenance", lambda: {"revision": "old", "machine": {}})
    monkeypatch.setattr(origin, "git_revision", lambda: next(revisions))
    (tmp_path / "walk.py").write_text("speed = 1\n")
    began = Origin.now()
    assert began.provenance == {"revision": "old", "machine": {}}
    assert began.warnings() == []
    (tmp_path / "walk.py").write_text("speed = 2\n")
    (warning,) = began.warnings()
    assert "from revision old to new" in warning


def test_code_is_known_by_names_and_content_and_by_nothing_else(tmp_path: Path) -> None:
    """A file that is renamed, or moved between two files' ends, is other code; what Python compiles is none."""
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "a.py").write_text("x")
    first = code_digest(tmp_path)
    (tmp_path / "sim" / "a.pyc").write_bytes(b"compiled")
    (tmp_path / "notes.md").write_text("words")
    assert code_digest(tmp_path) == first
    (tmp_path / "sim" / "a.py").rename(tmp_path / "sim" / "b.py")
    assert code_digest(tmp_path) != first
