"""The cache: what makes an entry count, what does not, and what an interruption leaves behind."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from stiction.core import cache
from stiction.core.cache import (
    Ledger,
    has_entry,
    key_of,
    publish,
    publish_entry,
    read_entry,
    sealed,
)
from stiction_experiments.lab.files import cached, entry_file

CODE = "core/cache.py"


@dataclass(frozen=True)
class Setting:
    """Something with fields."""

    size: float
    names: tuple[str, ...] = ("a",)


def made(folder: Path, value: float, made_from: Any = 1) -> dict[str, Any]:
    """Make a number, or find it."""
    return cached(folder, "part", key_of(made_from, CODE), lambda: {"value": value})


def test_an_entry_is_made_once_for_the_same_settings(tmp_path: Path) -> None:
    """The second number would be the first one's if settings did not count, the third a waste if they always did."""
    assert made(tmp_path, 1.0) == {"value": 1.0}
    assert made(tmp_path, 2.0) == {"value": 1.0}
    assert made(tmp_path, 3.0, {"seed": 2}) == {"value": 3.0}
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".json", ".json"]


def test_every_field_is_in_the_key_and_the_order_of_a_mapping_is_not() -> None:
    """A robot with another torque limit would go by the walks of the old one."""
    assert key_of({"a": 1, "b": Setting(0.1)}) == key_of({"b": Setting(0.1), "a": 1})
    different = [Setting(0.1), Setting(0.2), Setting(0.1, ("b",)), [0.1, ["a"]], None, "", {}, []]
    assert len({key_of(one) for one in different} | {key_of(Setting(0.1), CODE)}) == len(different) + 1


@pytest.mark.parametrize("change", [{"code": "other", "packages": {}}, {"code": "", "packages": {"sapien": "4"}}])
def test_other_code_or_packages_make_it_anew(change: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes an entry anew where the code, the engine or packages differ."""
    monkeypatch.setattr(cache, "fingerprint", lambda *code: {"code": "", "packages": {}})
    assert made(tmp_path, 1.0) == made(tmp_path, 2.0) == {"value": 1.0}
    monkeypatch.setattr(cache, "fingerprint", lambda *code: change)
    assert made(tmp_path, 2.0) == {"value": 2.0}


def test_an_entry_that_fails_leaves_nothing(tmp_path: Path) -> None:
    """Half an entry would be read as a whole one."""
    with pytest.raises(ValueError, match="JSON"):
        made(tmp_path, float("nan"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("damage", ["", '{"value": 1', "[1.0]", "\xff"])
def test_a_damaged_entry_is_made_again(damage: str, tmp_path: Path) -> None:
    """A disk that lost its end must cost that part, and not the study."""
    made(tmp_path, 1.0)
    file = entry_file(tmp_path, "part", key_of(1, CODE), ".json")
    file.write_bytes(damage.encode("latin1"))
    assert made(tmp_path, 2.0) == made(tmp_path, 3.0) == {"value": 2.0}


@contextmanager
def interrupted() -> Iterator[None]:
    """Whatever is interrupted in here."""
    with pytest.raises(KeyboardInterrupt):
        yield


def test_a_file_is_published_whole_or_not_at_all(tmp_path: Path) -> None:
    """Keeps the old content until the new one is complete, and leaves no other file."""
    file = tmp_path / "deep" / "a.csv"
    with publish(file) as partial:
        partial.write_text("old")
        assert not file.exists() and partial.parent == file.parent
    with interrupted(), publish(file) as partial:
        partial.write_text("ne")
        raise KeyboardInterrupt
    assert file.read_text() == "old" and list(file.parent.iterdir()) == [file]
    with publish(file) as partial:
        partial.write_text("new")
    assert file.read_text() == "new" and list(file.parent.iterdir()) == [file]


def test_a_folder_is_published_whole_or_not_at_all(tmp_path: Path) -> None:
    """An entry that was begun anew must not have files of the old one, nor the old one's key."""
    folder = tmp_path / "robot"
    with publish_entry(folder, "first", "one robot") as partial:
        (partial / "log").mkdir()
        (partial / "log" / "old.csv").write_text("old")
    assert has_entry(folder, "first") and not has_entry(folder, "second")
    with interrupted(), publish_entry(folder, "second", "one robot") as partial:
        (partial / "new.csv").write_text("ne")
        raise KeyboardInterrupt
    assert has_entry(folder, "first") and (folder / "log" / "old.csv").exists()
    with publish_entry(folder, "second", "one robot") as partial:
        (partial / "new.csv").write_text("new")
    assert has_entry(folder, "second") and not has_entry(folder, "first")
    assert {path.name for path in folder.iterdir()} == {"new.csv", "entry.json"}
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"label": "robot"}', '{"key": "other"}', '{"key": ["mine"]}'])
def test_a_foreign_or_torn_key_is_nobodys(text: str, tmp_path: Path) -> None:
    """A folder of somebody else's would pass for what was asked for."""
    (tmp_path / "entry.json").write_text(text)
    assert not has_entry(tmp_path, "mine") and read_entry(tmp_path / "entry.json", "mine") is None
    assert not has_entry(tmp_path / "nothing", "mine")


@pytest.mark.parametrize("file", ["joints.json", "log/joint.csv", "entry.json"])
def test_every_flipped_bit_of_an_entry_is_found(file: str, tmp_path: Path) -> None:
    """A robot's identified friction that rotted, or was made larger by hand, would be walked with; also a lost file."""
    folder = tmp_path / "robot"

    def make() -> None:
        with publish_entry(folder, "mine", "one robot") as partial:
            (partial / "log").mkdir()
            (partial / "joints.json").write_text('{"friction": 0.1}')
            (partial / "log" / "joint.csv").write_text("time\n0\n")

    make()
    content = (folder / file).read_bytes()
    for at in range(len(content)):
        for bit in (0, 4):
            changed = bytearray(content)
            changed[at] ^= 1 << bit
            (folder / file).write_bytes(changed)
            same = file == "entry.json" and json.loads(content) == _json(bytes(changed))
            assert has_entry(folder, "mine") == same, (at, bit)
    (folder / file).unlink()
    assert not has_entry(folder, "mine")
    make()
    assert has_entry(folder, "mine")


def _json(content: bytes) -> object:
    """Return what some bytes hold as JSON, if they do."""
    try:
        return json.loads(content)
    except ValueError:
        return None


def test_a_ledger_goes_on_behind_a_line_that_was_cut_off(tmp_path: Path) -> None:
    """An interruption loses the line that it cut, and none before or after it."""
    path = tmp_path / "walks.jsonl"
    Ledger(path).extend([{"key": "a", "worth": 1}, {"key": "b", "worth": 2}])
    path.write_text(path.read_text()[:-4])
    ledger = Ledger(path)
    assert ledger.get("a") == {"key": "a", "worth": 1} and ledger.get("b") is None
    ledger.extend([{"key": "c", "worth": 3}])
    ledger.extend([{"key": "b", "worth": 4}])
    again = Ledger(path)
    assert [again.get(key) for key in "abc"] == [{"key": key, "worth": n} for key, n in (("a", 1), ("b", 4), ("c", 3))]
    assert len(path.read_text().splitlines()) == 3 and json.loads(path.read_text().splitlines()[-1])["key"] == "b"


def altered(line: str) -> str:
    """The line with another number in it."""
    return line.replace('"worth": 2', '"worth": 9')


def contradicted(line: str) -> str:
    """The line, and one of the same key that another program wrote properly."""
    return line + "\n" + json.dumps(sealed({"key": "b", "worth": 9}))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (altered, "line 2 damaged, altered"),
        (lambda line: line[:20] + line[21:], "line 2 damaged"),
        (lambda line: line[: len(line) // 2], "line 2 damaged"),
        (lambda line: json.dumps({"key": "b", "worth": 2}), "without a digest"),
        (contradicted, "line 3 damaged, altered, contradicted"),
        (lambda line: "[" * 100_000, "line 2 damaged"),
    ],
)
def test_a_line_that_was_altered_does_not_count(change: Callable[[str], str], what: str, tmp_path: Path) -> None:
    """A number that somebody changed would be a result; what is not whole, or said twice, is found and made anew."""
    path = tmp_path / "walks.jsonl"
    Ledger(path).extend([{"key": key, "worth": worth} for worth, key in enumerate("abc", start=1)])
    lines = path.read_text().splitlines()
    lines[1] = change(lines[1])
    path.write_text("\n".join(lines) + "\n")
    with pytest.warns(UserWarning, match=what):
        ledger = Ledger(path)
    assert [ledger.get(key) is None for key in "abc"] == [False, True, False]
