"""Help of every verb: on one screen, with examples whose options exist."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

from stiction.cli.main import GROUPS, VERBS, main
from stiction.learning.config import TrainCfg
from stiction_experiments.lab.command import study_names

SCREEN = 48
"""Lines of a terminal that fills a laptop's screen."""

PROGRAMS = [
    *([verb] for verb in VERBS if verb != "study"),
    ["identify", "walk"],
    *(["robot", w] for w in ("check", "show")),
]
PROGRAMS += [["study", name] for name in study_names()]


def help_of(capsys: pytest.CaptureFixture, *words: str) -> str:
    """Return what a verb prints when it is asked for help."""
    try:
        assert main(list(words)) == 0
    except SystemExit as stop:
        assert not stop.code
    return capsys.readouterr().out


@pytest.mark.parametrize("words", PROGRAMS, ids=[" ".join(words) for words in PROGRAMS])
def test_examples_are_in_every_help_and_their_options_exist(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    """The first thing that a reader copies is there, and runs; and help does not scroll far: `doctor` had 222 lines."""
    monkeypatch.setenv("COLUMNS", "100")
    program = " ".join(["stiction", *words])
    text = help_of(capsys, *words, "--help-all")
    examples = [line for line in re.findall(r"^  (stiction .*)$", text, re.MULTILINE) if line.startswith(program)]
    assert examples and "%%" not in text, text
    assert not re.search(r"`[A-Z][A-Z_0-9]+`|, see `[A-Z]|Cfg\b|\bNone\b|\{FLOAT", text), "a name of the code"
    brief = help_of(capsys, *words, "--help")
    assert re.findall(r"^  stiction .*$", brief, re.MULTILINE)
    assert brief.count("\n") <= 1.25 * SCREEN
    for example in examples:
        flags = [word for word in shlex.split(example) if word.startswith("--")]
        verb = shlex.split(example)[1 : 1 + len(words)]
        assert verb == words
        assert words == ["robot"] or all(re.search(rf"^\s+.*{flag}\b", text, re.MULTILINE) for flag in flags), example


def test_the_overview_groups_every_verb_once_in_80_columns(capsys: pytest.CaptureFixture) -> None:
    """Under what a person wants to do; each verb is one line."""
    assert sorted(verb for verbs in GROUPS.values() for verb in verbs) == sorted(VERBS)
    lines = help_of(capsys, "--help").splitlines()
    assert max(map(len, lines)) <= 80
    assert [line[:-1] for line in lines if line[:-1] in GROUPS] == ["Measure", "Train", "Check", "Run", "Tools"]
    assert all(sum(line.startswith(f"  {verb} ") for line in lines) == 1 for verb in VERBS)


def test_training_is_explained_on_one_screen(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lists 15 to 25 options on one screen; --help-all lists the rest."""
    monkeypatch.setenv("COLUMNS", "100")
    brief, whole = help_of(capsys, "train", "--help"), help_of(capsys, "train", "--help-all")
    assert brief.count("\n") <= SCREEN
    named = re.findall(r"^  (--[\w.-]+)", brief, re.MULTILINE)
    everything = re.findall(r"^  (--[\w.-]+)", whole, re.MULTILINE)
    assert "--view" in named
    assert 15 <= len(named) <= 25 and set(named) < set(everything)


@pytest.mark.parametrize("words", PROGRAMS, ids=[" ".join(words) for words in PROGRAMS])
def test_flags_are_few(capsys: pytest.CaptureFixture, words: list[str]) -> None:
    """At most 60 of a training, and 40 of others; the rest are settings."""
    flags = set(re.findall(r"^  (--[\w.-]+)", help_of(capsys, *words, "--help-all"), re.MULTILINE))
    assert len(flags) <= (60 if words == ["train"] else 40), sorted(flags)


def places(options: Any, place: str = "") -> Iterator[str]:
    """Yield the paths of all fields of an options dataclass."""
    for field in fields(options):
        value = getattr(options, field.name)
        yield from places(value, f"{place}{field.name}.") if is_dataclass(value) else (f"{place}{field.name}",)


def test_all_settings_of_a_training_are_listed(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lists every field of the configuration with what it means, as a preset has it, within 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    text = help_of(capsys, "train", "--preset", "quick", "--set", "help")
    listed = re.findall(r"^  ([a-z][\w.]*)", text, re.MULTILINE)
    # A method's own settings are listed under its name.
    assert (
        {*places(TrainCfg())} - {"method_settings"} < {*listed}
        and len(listed) > 100
        and max(map(len, text.splitlines())) <= 80
    )
    plain = " ".join(text.split())
    assert (
        "teacher.iterations INT Rollouts, each followed by an update. Default: 440. Flag: --teacher.iterations."
        in plain
    )
    assert not re.search(r"\s(?:INT|FLOAT|BOOL|WORD|STR|PATH) Default:", plain), "a setting without a meaning"
    assert "stiction train --set help" in help_of(capsys, "train", "--help")
