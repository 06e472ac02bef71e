"""Settings, the options without a flag: `--set path=value` and `--config FILE`, by the one decoder of plain data."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import pytest

from stiction.core.errors import ConfigurationError
from stiction.core.flags import ARGUMENT, FIXED, FLAG, FLAT, SETTING, flag
from stiction.core.options import read_options, read_parsed


@dataclass(frozen=True)
class Teacher:
    """A group of settings."""

    gamma: float = 0.99
    """Discount."""
    layers: tuple[int, ...] = (64, 32)
    """Hidden layers."""
    span: tuple[float, float] | None = None
    """Slowest and fastest [m/s]."""
    kind: Literal["small", "large"] = "small"
    """Size."""
    iterations: Annotated[int, FLAG] = 700
    """Rollouts."""
    method: Annotated[str, flag("--method")] = "direct"
    """How."""

    def __post_init__(self) -> None:
        """Refuse discounts out of range."""
        if not 0 < self.gamma <= 1:
            raise ConfigurationError(f"teacher.gamma is {self.gamma}; expected more than 0 and at most 1")


@dataclass(frozen=True)
class Config:
    """A configuration."""

    teacher: Teacher = field(default_factory=Teacher)
    hidden: Annotated[Teacher, FIXED] = field(default_factory=Teacher)
    seed: int = 0
    """Seed."""
    contacts: Annotated[int, SETTING] = 32
    """Contacts."""


@dataclass(frozen=True)
class Verb:
    """Options of a verb."""

    log: Annotated[Path, ARGUMENT]
    """Log to read."""
    config: Annotated[Config, FLAT] = field(default_factory=Config)
    """All of it."""
    preset: Literal["full", "quick"] = "full"
    """Defaults of the rest."""
    out: Path = Path("out")
    """Where to."""


def read(*words: str) -> Verb:
    """Return the options that words give."""
    return read_options(Verb, ["a.log", *words], "stiction verb", "Does it.\n\n  stiction verb a.log", groups={})


def error_of(capsys: pytest.CaptureFixture, *words: str, status: int = 2) -> str:
    """Return what is printed where the words end the program."""
    with pytest.raises(SystemExit) as stop:
        read(*words)
    assert stop.value.code == status
    printed = capsys.readouterr()
    return printed.err if status else printed.out


@pytest.mark.parametrize(
    ("words", "teacher"),
    [
        (["--set", "teacher.gamma=0.98"], Teacher(gamma=0.98)),
        (["--set=teacher.gamma=1e-3"], Teacher(gamma=1e-3)),
        (["--set", "teacher.gamma=1"], Teacher(gamma=1.0)),
        (["--set", "teacher.layers=[8]", "--set", "teacher.kind=large"], Teacher(layers=(8,), kind="large")),
        (["--set", "teacher.span=[0.5, 1e1]"], Teacher(span=(0.5, 10.0))),
        (["--set", "teacher.span=null"], Teacher()),
        (["--set", "teacher.iterations=3"], Teacher(iterations=3)),
        (["--teacher.iterations", "3", "--method", "none"], Teacher(iterations=3, method="none")),
    ],
)
def test_a_setting_is_given_by_its_path(words: list[str], teacher: Teacher) -> None:
    """Reads the value as YAML, and as the type of the field; a field with a flag is a setting too."""
    group = read(*words).config.teacher
    assert group == teacher and isinstance(group.gamma, float)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "teacher.gama=0.9"], "--set teacher.gama: unknown setting; did you mean 'teacher.gamma'?"),
        (["--set", "gamma=0.9"], "--set gamma: unknown setting; did you mean 'teacher.gamma'?"),
        (
            ["--set", "teacher=3"],
            "--set teacher: a group of settings; expected one of teacher.gamma, teacher.layers",
        ),
        (["--set"], "--set: a value is missing; expected PATH=VALUE; `--set help` lists the settings"),
        (["--set", "teacher.gamma=much"], "--set teacher.gamma is much; expected a finite number"),
        (["--set", "teacher.gamma=.nan"], "--set teacher.gamma is nan; expected a finite number"),
        (["--set", "teacher.gamma=[1"], "--set teacher.gamma: is not YAML"),
        (["--set", "teacher.layers=8"], "--set teacher.layers is 8; expected a list"),
        (["--set", "teacher.iterations=2.5"], "--set teacher.iterations is '2.5'; expected a whole number"),
        (["--set", "teacher.kind=huge"], "--set teacher.kind is 'huge'; expected small, large"),
        (["--set", "teacher.gamma=1", "--set", "teacher.gamma=1"], "--set teacher.gamma is given twice; give it once"),
        (
            ["--set", "teacher.method=none", "--method", "none"],
            "--set teacher.method and --method are one option, given twice; give it once",
        ),
        (["--teacher.gamma", "0.9"], "unknown option --teacher.gamma; did you mean '--set teacher.gamma=VALUE'?"),
        (["--teacher.method", "none"], "unknown option --teacher.method; did you mean '--method'?"),
    ],
)
def test_a_wrong_setting_is_one_line_with_status_2(
    capsys: pytest.CaptureFixture, words: list[str], message: str
) -> None:
    """Names the setting, what was expected, and the nearest name."""
    text = error_of(capsys, *words)
    assert message in text and text.startswith("stiction verb: ") and text.count("\n") == 1


def test_a_file_gives_settings_that_words_override(tmp_path: Path) -> None:
    """Takes nested YAML and JSON; --set and flags are nearer."""
    (tmp_path / "a.yaml").write_text("teacher: {gamma: 0.5, layers: [1, 2]}\nteacher.kind: large\nseed: 4\n")
    (tmp_path / "a.json").write_text(json.dumps({"teacher": {"gamma": 0.5, "iterations": 9}, "seed": 4}))
    words = ["--config", str(tmp_path / "a.yaml"), "--seed", "5", "--set", "teacher.layers=[3]"]
    assert read(*words).config == Config(Teacher(0.5, (3,), kind="large"), seed=5)
    assert read("--config", str(tmp_path / "a.json")).config == Config(Teacher(0.5, iterations=9), seed=4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("teacher: {gama: 0.5}", "a.yaml: teacher.gama: unknown setting; did you mean 'teacher.gamma'?"),
        ("teacher: {gamma: many}", "a.yaml: teacher.gamma is many; expected a finite number"),
        ("teacher: 3", "a.yaml: teacher is 3; expected settings with values"),
        ("- 3", "a.yaml: the file is [3]; expected settings with values"),
        ("seed: 1\nseed: 2", "is given twice"),
        ("teacher: {gamma: 1}\nteacher.gamma: 1", "a.yaml: teacher.gamma is given twice"),
        ("a: &b 1\nseed: *b", "an alias (*name) is not read"),
    ],
)
def test_a_wrong_file_is_one_line_with_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture, text: str, message: str
) -> None:
    """Names the file, the setting and what was expected."""
    (tmp_path / "a.yaml").write_text(text)
    printed = error_of(capsys, "--config", str(tmp_path / "a.yaml"))
    assert message in printed and printed.count("\n") == 1
    assert "cannot read" in error_of(capsys, "--config", str(tmp_path / "b.yaml"))


def test_the_list_of_settings_has_defaults_flags_and_meanings(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lists every setting within the terminal, with the flag of those that have one; both helps name the list."""
    monkeypatch.setenv("COLUMNS", "80")
    text = error_of(capsys, "--set", "help", status=0)
    assert max(map(len, text.splitlines())) <= 80
    for part in (
        "teacher.gamma FLOAT Discount. Default: 0.99.",
        "teacher.layers INT ... Hidden layers. Default: [64,32].",
        "teacher.span FLOAT FLOAT Slowest and fastest [m/s]. Default: null.",
        "teacher.kind WORD Size. One of small, large. Default: small.",
        "teacher.method STR How. Default: direct. Flag: --method.",
        "contacts INT Contacts. Default: 32.",
    ):
        assert part in " ".join(text.split()), part
    assert "hidden" not in text and "log" not in text
    for help_word in ("--help", "--help-all"):
        assert "5 settings: stiction verb --set help" in error_of(capsys, help_word, status=0)


def test_defaults_follow_from_what_is_given() -> None:
    """Hands all that is given, by its key, to the function that chooses defaults."""

    def default(parsed: dict[str, object]) -> Verb:
        return Verb(Path(), Config(seed=len(parsed)), "quick")

    words = ["a.log", "--set", "teacher.gamma=0.5", "--preset", "full"]
    options, base, parsed = read_parsed(Verb, words, "stiction verb", "", default)
    assert options == Verb(Path("a.log"), Config(Teacher(0.5), seed=3), "full") and base == default(
        dict.fromkeys("abc")
    )
    assert parsed.typed["config.teacher.gamma"] == "--set teacher.gamma" and parsed.typed["preset"] == "--preset"
