"""A folder of results, or a file, is not written over by what has other settings or another content."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import pytest

from stiction.core.errors import ConfigurationError
from stiction.files.settings import SETTINGS, check_file, check_settings, results_folder


@dataclass(frozen=True)
class Inner:
    """Settings within settings."""

    gain: float = 2.0


@dataclass(frozen=True)
class Run:
    """Options of a verb."""

    out: Path
    log: Path = Path("log.csv")
    levels: tuple[float, ...] = (0.0, 0.1)
    inner: Inner = field(default_factory=Inner)
    jobs: int = 1
    overwrite: bool = False
    extra: int = 0
    free: ClassVar[tuple[str, ...]] = ("extra",)


RESULTS = ("results",)
"""Files that `write` writes."""


def write(options: Run, verb: str = "evaluate") -> None:
    """Write results."""
    with results_folder(options.out, verb, options, RESULTS, {"log": options.log}):
        (options.out / "results").write_text(str(options), encoding="utf-8")


def test_the_same_settings_go_on_and_others_are_refused(tmp_path: Path) -> None:
    """Continues with the same settings, and rejects others."""
    first = Run(tmp_path)
    write(first)
    write(replace(first, jobs=2, extra=1))
    with pytest.raises(ConfigurationError, match=r"levels 0.0 0.1, now 0.3; choose another --out, or add --overwrite"):
        write(replace(first, levels=(0.3,)))
    with pytest.raises(ConfigurationError, match=r"inner.gain 2.0, now 3.0"):
        check_settings(tmp_path, "evaluate", replace(first, inner=Inner(3.0)), RESULTS)
    with pytest.raises(ConfigurationError, match="has results of `stiction evaluate`;"):
        write(first, "excite")
    assert "0.3" not in (tmp_path / "results").read_text(encoding="utf-8")
    write(replace(first, levels=(0.3,), overwrite=True))
    assert json.loads((tmp_path / SETTINGS).read_text(encoding="utf-8"))["settings"]["levels"] == [0.3]


def test_a_persons_own_file_is_not_written_over(tmp_path: Path) -> None:
    """A robot.yaml that nobody's `robot show` wrote was replaced without a word."""
    (tmp_path / "robot.yaml").write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"has robot.yaml and no settings.json;"):
        check_settings(tmp_path, "robot show", Run(tmp_path), ("robot.xml", "robot.yaml"))
    with results_folder(tmp_path, "robot show", Run(tmp_path, overwrite=True), ("robot.yaml",)):
        pass
    check_settings(tmp_path, "robot show", Run(tmp_path), ("robot.yaml",))


def test_what_failed_notes_nothing_and_what_was_interrupted_does(tmp_path: Path) -> None:
    """Records nothing after a failure, and the settings after an interruption."""
    for error, noted in ((ConfigurationError("no such log"), False), (KeyboardInterrupt(), True)):
        with pytest.raises(type(error)), results_folder(tmp_path, "evaluate", Run(tmp_path), RESULTS):
            raise error
        assert (tmp_path / SETTINGS).exists() is noted


def test_a_folder_of_another_version_is_compared_by_what_both_have(tmp_path: Path) -> None:
    """Compares a folder of another version by the settings in both."""
    write(Run(tmp_path))
    there = json.loads((tmp_path / SETTINGS).read_text(encoding="utf-8"))
    there["settings"] = {"levels": [0.0, 0.1], "gone": 3}
    (tmp_path / SETTINGS).write_text(json.dumps(there), encoding="utf-8")
    write(Run(tmp_path))
    # An option that takes several took one, or none.
    for before, now in ((0.3, (0.3,)), (None, ())):
        there["settings"] = {"levels": before}
        (tmp_path / SETTINGS).write_text(json.dumps(there), encoding="utf-8")
        with pytest.raises(ConfigurationError, match="levels"):
            write(Run(tmp_path))
        write(Run(tmp_path, levels=now))


def test_results_of_which_nobody_knows_what_they_are_stay(tmp_path: Path) -> None:
    """Keeps results of unknown origin."""
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    check_settings(tmp_path, "identify", Run(tmp_path), ("joints.json",))
    (tmp_path / "joints.json").write_text("mine", encoding="utf-8")
    message = r"has joints.json and no settings.json; choose another --out, or add --overwrite"
    with (
        pytest.raises(ConfigurationError, match=message),
        results_folder(tmp_path, "identify", Run(tmp_path), ("joints.json", "report.html")),
    ):
        pass
    assert not (tmp_path / SETTINGS).exists()
    with results_folder(tmp_path, "identify", Run(tmp_path, overwrite=True), ("joints.json",)):
        pass
    check_settings(tmp_path, "identify", Run(tmp_path), ("joints.json",))


def test_a_run_that_died_or_failed_while_it_wrote_goes_on(tmp_path: Path) -> None:
    """Continues a run that was killed, or failed on a full disk."""
    run = Run(tmp_path)
    for words, verb, refused in ((RESULTS, "evaluate", False), ((), "evaluate", True), (RESULTS, "study wear", True)):
        out = tmp_path / f"{verb}-{len(words)}"
        with pytest.raises(OSError, match="full"), results_folder(out, verb, run, words):
            (out / "results").write_text("half", encoding="utf-8")
            raise OSError("full")
        if refused:
            with pytest.raises(ConfigurationError, match=r"has results and no settings.json"):
                check_settings(out, "evaluate", run, RESULTS)
        else:
            write(replace(run, out=out))
            assert {path.name for path in out.iterdir()} == {"results", SETTINGS}


def test_another_content_is_another_setting_and_another_place_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second log.csv, in another folder or edited in place, replaced the results of the first without a word."""
    out = tmp_path / "out"
    for folder, content in (("a", "1"), ("b", "2"), ("moved", "1")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "log.csv").write_text(content, encoding="utf-8")
    (tmp_path / "moved/log.csv").rename(tmp_path / "moved/swing.csv")
    monkeypatch.chdir(tmp_path / "a")
    write(Run(out))
    monkeypatch.chdir(tmp_path / "moved")
    write(Run(out, log=Path("swing.csv")))
    monkeypatch.chdir(tmp_path / "b")
    with pytest.raises(ConfigurationError, match=r"with other settings: log swing.csv, now log.csv; choose another"):
        write(Run(out))
    monkeypatch.chdir(tmp_path / "a")
    write(Run(out))
    Path("log.csv").write_text("3", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"with other settings: log log.csv had another content; choose"):
        write(Run(out))
    assert json.loads((out / SETTINGS).read_text(encoding="utf-8"))["inputs"]["log"].keys() == {"log.csv"}
    Path("log.csv").unlink()
    check_settings(out, "evaluate", Run(out), RESULTS, {"log": Path("log.csv")})  # Whoever reads it says so better.


def test_a_file_is_written_over_where_nothing_is_lost(tmp_path: Path) -> None:
    """Overwrites a file only where nothing is lost."""
    file, options = tmp_path / "shank.xml", Run(tmp_path)
    check_file(file, options, text="new")
    file.touch()
    check_file(file, options)  # of `mktemp`
    file.write_text("old", encoding="utf-8")
    check_file(file, options, text="old")
    check_file(file, replace(options, overwrite=True), text="new")
    check_file(Path("/dev/null"), options)
    check_file(tmp_path, options)
    for text in (None, "new", "longer"):
        with pytest.raises(ConfigurationError, match=r"shank.xml exists already; choose another --static, or add"):
            check_file(file, options, "--static", text)
