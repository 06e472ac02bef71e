"""`training.json`: written, read, and refused where it is something else."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.files.joints import read_training, write_training


def test_what_was_written_is_read(tmp_path: Path) -> None:
    """The version is added, nothing is lost."""
    write_training(tmp_path / "training.json", {"friction": {"method": "direct", "level": 0.1}, "text": "μ"})
    assert read_training(tmp_path / "training.json") == {
        "schema_version": 2,
        "friction": {"method": "direct", "level": 0.1},
        "text": "μ",
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"schema_version": 2, "joints": {}}', "'friction'"),
        (b'{"schema_version": 1, "friction": {}}', "version 1"),
        (b'{"schema_version": 2, "friction": null, "text": "no\\nratio"}', "no ratio"),
    ],
)
def test_anything_else_is_refused_with_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    """A joints.json given by mistake, a broken file, a proposal of nothing."""
    (tmp_path / "training.json").write_bytes(content)
    with pytest.raises(StictionError, match=message) as caught:
        read_training(tmp_path / "training.json")
    assert "\n" not in str(caught.value)
