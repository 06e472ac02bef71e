"""Parts of studies that are kept: what makes one count, and what does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import PACKAGE
from stiction.transfer import kept
from stiction.transfer.kept import WALKING, keep


def made(folder: Path, value: float, made_from: dict[str, Any] | None = None) -> dict[str, Any]:
    """Keep a number."""
    return keep(folder, "part", made_from or {"seed": 1}, ("transfer/kept.py",), lambda: {"value": value})


def test_a_part_is_made_once_for_the_same_settings(tmp_path: Path) -> None:
    """The second number would be the first one's if settings did not count, the third a waste if they always did."""
    assert made(tmp_path, 1.0) == {"value": 1.0}
    assert made(tmp_path, 2.0) == {"value": 1.0}
    assert made(tmp_path, 3.0, {"seed": 2}) == {"value": 3.0}
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".json", ".json"]


@pytest.mark.parametrize("change", [{"code": "other", "packages": {}}, {"code": "", "packages": {"sapien": "4"}}])
def test_other_code_or_packages_make_it_anew(change: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another engine measured would go by the new one's name."""
    monkeypatch.setattr(kept, "made_by", lambda *code: {"code": "", "packages": {}})
    assert made(tmp_path, 1.0) == made(tmp_path, 2.0) == {"value": 1.0}
    monkeypatch.setattr(kept, "made_by", lambda *code: change)
    assert made(tmp_path, 2.0) == {"value": 2.0}


def test_a_part_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """Half a part would be read as a whole one."""
    with pytest.raises(ValueError, match="JSON"):
        made(tmp_path, float("nan"))
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_none_is_said_in_one_line(tmp_path: Path) -> None:
    """With the way out."""
    made(tmp_path, 1.0)
    next(tmp_path.iterdir()).write_text("half")
    with pytest.raises(StictionError, match="remove it, or give another --out"):
        made(tmp_path, 1.0)


def test_every_part_of_the_walking_code_is_there() -> None:
    """A file that was renamed would no longer count, and nobody would see it."""
    assert [pattern for pattern in WALKING if not list(PACKAGE.glob(pattern))] == []
