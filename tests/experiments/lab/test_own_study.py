"""A study that lies outside the package, and how studies are found by name."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.core.records import column
from stiction.files.bundle import read_bundle, shipped_bundles
from stiction_experiments.lab.command import find_study, study_names
from stiction_experiments.lab.study import ParallelOptions, Report, Study, UsageError, Work, namesakes

MADE: list[float] = []
"""Levels that were measured, and not read from a file."""


@dataclass(frozen=True)
class Row:
    """A row of braking.csv."""

    level: float = field(metadata=column("friction", form=".0%"))
    time: float = field(metadata=column("time to rest", "s", ".2f"))


@dataclass(frozen=True, kw_only=True)
class BrakingOptions(ParallelOptions):
    """Options of the study."""

    levels: tuple[float, ...] = (0.1, 0.2)
    """Dry friction over inertia [rad/s²]."""


def run(options: BrakingOptions, work: Work) -> Report:
    """Say when a joint at 1 rad/s comes to rest."""
    if min(options.levels) < 0:
        raise UsageError("a level below zero")
    work.begin()

    def brake(level: float) -> dict[str, float]:
        MADE.append(level)
        return {"time": 1.0 / level}

    rows = [
        Row(level, work.cached(f"at-{level:g}", {"level": level}, partial(brake, level))["time"])
        for level in options.levels
    ]
    work.progress("braking", 1.0)
    return Report(title="<Braking>", lead=f"It rests after {rows[0].time:g} s.", tables={"braking": rows})


STUDY = Study("when a joint comes to rest", "Let a joint come to rest.", BrakingOptions, run)

NAME = f"{__name__}:STUDY"


def test_a_study_of_ones_own_is_one_module(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Arguments, table, summary, page and resume come from the framework."""
    MADE.clear()
    out = tmp_path / "out"
    arguments = ["study", NAME, "--levels", "0.5", "0.25", "--out", str(out)]
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines() == ["It rests after 2 s.", f"report: {out / 'report.html'}"]
    assert (out / "braking.csv").read_text() == "level,time\n0.5,2\n0.25,4\n"
    page = (out / "report.html").read_text()
    for text in (
        "time to rest [s]",
        ">50%<",
        ">4.00<",
        "&lt;Braking&gt;",
        "It rests after 2 s.",
        "--levels 0.5",
    ):
        assert text in page, text
    summary = json.loads((out / "summary.json").read_text())
    assert summary["warnings"] == []
    assert {"schema_version", "command", "revision", "machine"} <= summary.keys()
    assert MADE == [0.5, 0.25]
    assert main([*arguments, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again.pop("command").endswith("--json") and summary.pop("command") and again == summary
    assert MADE == [0.5, 0.25], "what was measured before was measured again"


def test_wrong_calls_of_it_are_told_as_of_any_study(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Wrong usage is status 2, what cannot be done 1, each in one line."""
    for arguments, status, message in (
        (["--levels", "-1"], 2, f"stiction study {NAME}: a level below zero"),
        (["--jobs", "0"], 1, "--jobs 0: expected at least 1"),
        (["--out", str(tmp_path / "file" / "out")], 1, "cannot be made"),
    ):
        (tmp_path / "file").write_text("")
        assert main(["study", NAME, *arguments]) == status
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    with pytest.raises(SystemExit, match="2"):
        main(["study", NAME, "--levels"])
    assert f"stiction study {NAME}: --levels: a value is missing" in capsys.readouterr().err
    for name, message in (("nowhere.at.all:STUDY", "cannot be imported"), (f"{__name__}:MADE", "expected a Study")):
        assert main(["study", name]) == 1
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1


def test_policies_that_the_package_has_replaced_are_named() -> None:
    """A page of walks of an earlier policy must not look as if it were about the one of that name now."""
    (name, path), *_ = shipped_bundles().items()
    told = {"seed": 2, "revision": "441582ac71d4"}
    (message,) = namesakes({name: told | {"digest": "another"}, "my-own": told | {"digest": "x"}})
    assert f"{name} (seed 2, revision 441582ac71d4)" in message and "my-own" not in message
    (message,) = namesakes({name: told | {"digest": "another", "phases": 2}})
    assert ", two phases, revision " in message
    assert namesakes({name: told | {"digest": read_bundle(path).digest}}) == []


def test_every_folder_of_studies_is_a_study(capsys: pytest.CaptureFixture) -> None:
    """A study that is not listed would not be found; a misspelt one is told the nearest."""
    assert {"engines", "damping", "paper"} <= set(study_names())
    assert main(["study", "--help"]) == 0
    listed = capsys.readouterr().out
    assert max(map(len, listed.splitlines())) <= 80
    words = " ".join(listed.split())
    assert all(f"{name} {find_study(name).question}" in words for name in study_names())
    with pytest.raises(SystemExit, match="2"):
        main(["study", "dampin"])
    assert "unknown study 'dampin'; did you mean 'damping'?" in capsys.readouterr().err


def test_a_name_that_is_nearly_a_study_is_told(capsys: pytest.CaptureFixture) -> None:
    """The nearest name stands in the message."""
    with pytest.raises(SystemExit, match="2"):
        main(["study", "weer"])
    assert "unknown study 'weer'; did you mean 'wear'?" in capsys.readouterr().err


def test_a_study_connects_to_its_cluster_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second connection is refused by Ray: the study would fail when all of its work is done."""
    used: list[str | None] = []

    @contextmanager
    def connect(address: str | None, folder: Path) -> Iterator[None]:
        assert folder.is_dir() and address not in used
        used.append(address)
        yield

    monkeypatch.setattr("stiction_experiments.lab.study.use_cluster", connect)
    assert STUDY.main(["--cluster", "somewhere:1", "--out", str(tmp_path / "braking")], "study braking") == 0
    assert used == ["somewhere:1"] and (tmp_path / "braking" / "braking.csv").exists()
