"""The one door from the words of a command line to options: help on one screen, one line for what is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest

from stiction.core.flags import ARGUMENT, flag
from stiction.core.options import read_options


@dataclass(frozen=True)
class Walk:
    """Options of a walk."""

    robot: Annotated[str, ARGUMENT]
    """Robot that walks."""
    gait: Literal["tripod", "ripple"] | None = None
    """How. More of it in the second sentence."""
    seconds: float = 2.0
    """How long [s]."""
    steps: int = 3
    """How many; none are counted."""
    log: bool = True
    """Write it down."""
    pace: tuple[float, float] = (0.1, 0.5)
    """Slowest and fastest [m/s]."""
    reach: tuple[float, float] | None = None
    """From hip to hip [m]."""
    weights: tuple[tuple[str, float], ...] = ()
    """Purposes and their weights."""
    load: Annotated[float | None, flag("--on.back")] = None
    """On its back [kg]."""


TEXT = """Walk.

Example:
  stiction walk hexapod

A third paragraph."""
GROUPS = {"usually needed": ("--seconds",)}


def error_of(capsys: pytest.CaptureFixture, *words: str, status: int = 2) -> str:
    """Return what is printed where the words are not options."""
    with pytest.raises(SystemExit) as stop:
        read_options(Walk, words, "stiction walk", TEXT, groups=GROUPS)
    assert stop.value.code == status
    printed = capsys.readouterr()
    return printed.err if status else printed.out


def test_words_become_options() -> None:
    """Converts words to options."""
    assert read_options(Walk, ["go2", "--steps", "4", "--no-log"], "x", TEXT) == Walk("go2", steps=4, log=False)
    assert read_options(Walk, ["go2"], "x", TEXT, Walk("", seconds=9.0)).seconds == 9.0
    words = ["--pace", "-1e-3", "0.5", "go2", "--weights", "a", "1", "b", "-2", "--on.back", "None"]
    assert read_options(Walk, words, "x", TEXT) == Walk("go2", pace=(-1e-3, 0.5), weights=(("a", 1.0), ("b", -2.0)))
    assert read_options(Walk, ["--seconds=-1", "--", "-go2"], "x", TEXT) == Walk("-go2", seconds=-1.0)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("go2", "--secnds", "3"), ("unknown option --secnds", "did you mean '--seconds'?")),
        (("go2", "--gait", "tirpod"), ("--gait 'tirpod'", "expected tripod, ripple", "did you mean 'tripod'?")),
        (("go2", "--steps", "many"), ("--steps 'many'", "expected a whole number")),
        (("go2", "--on.back", "much"), ("--on.back", "'much'", "expected a number")),
        (("go2", "--pace", "0.3"), ("--pace '0.3': expected two numbers, such as 0.1 0.5",)),
        (("go2", "--weights", "speed"), ("--weights 'speed': expected a word and a number",)),
        (("go2", "--steps", "3", "--steps", "4"), ("--steps is given twice; give it once",)),
        (("go2", "--load", "3"), ("unknown option --load; did you mean '--on.back'?",)),
        (("go2", "--log=yes"), ("--log takes no value; --no-log is its opposite",)),
        (("go2", "--log", "--no-log"), ("--log and --no-log are one option, given twice",)),
        (("go2", "--seconds"), ("--seconds", "a value is missing")),
        (("go2", "go1"), ("go1", "unexpected argument")),
        ((), ("ROBOT is missing", "Robot that walks")),
        (("go2", "--\x1b[31m"), ("unknown option --\\u001b",)),
    ],
)
def test_wrong_words_are_one_line_with_status_2(
    capsys: pytest.CaptureFixture, words: tuple[str, ...], parts: tuple[str, ...]
) -> None:
    """Reports a typing mistake in one line with a suggestion."""
    text = error_of(capsys, *words)
    assert text.startswith("stiction walk: ") and text.count("\n") == 1 and "`stiction walk --help`" in text
    assert all(part in text for part in parts), text


def test_help_shows_what_is_needed_and_the_rest_on_demand(capsys: pytest.CaptureFixture) -> None:
    """Shows the common options first, and all on request."""
    brief, whole = error_of(capsys, "--help", status=0), error_of(capsys, "go2", "--help-all", status=0)
    assert "--seconds FLOAT" in brief and "--gait" not in brief and "7 more options: stiction walk --help-all" in brief
    assert "  stiction walk hexapod\n" in brief and "third paragraph" not in brief
    assert "usually needed:" in whole and "third paragraph" in whole and "more options" not in whole
    for part in (
        "--gait WORD",
        "--pace FLOAT FLOAT",
        "--reach FLOAT FLOAT",
        "--weights STR FLOAT ...",
        "second sentence. One of tripod, ripple.",
        "--log, --no-log",
        "ROBOT",
        "[2.0]",
    ):
        assert part in " ".join(whole.split()), part
    assert "None" not in whole


@dataclass(frozen=True)
class Ways:
    """Options that are paths."""

    source: Annotated[Path, ARGUMENT]
    """From where."""
    out: Path = Path("out")
    """To where."""
    more: tuple[Path, ...] = ()
    """And others."""
    note: str = ""
    """Remark."""
    dry: bool = False
    """Nothing is written."""


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["here", "--out", ""], "--out"),
        (["here", "--out="], "--out"),
        (["here", "--more", "a", ""], "--more"),
        ([""], "SOURCE"),
        (["--dry", ""], "SOURCE"),
    ],
)
def test_an_empty_path_is_refused(words: list[str], named: str, capsys: pytest.CaptureFixture) -> None:
    """`--out "$FOLDER"` with a variable that is not set would fill the folder that one is in."""
    with pytest.raises(SystemExit) as stop:
        read_options(Ways, words, "stiction way", TEXT)
    printed = capsys.readouterr().err
    assert stop.value.code == 2 and printed.count("\n") == 1
    assert f"{named} '': expected a path" in printed
    assert read_options(Ways, ["here", "--note", "", "--out", "."], "x", TEXT) == Ways(Path("here"), Path())


@pytest.mark.parametrize("words", [["0,0.1,0.2"], ["0,", "0.1,", "0.2"], ["0", "0.1", "0.2"], ["0,0.1", "0.2"]])
def test_lists_of_numbers_take_commas_and_blanks(words: list[str]) -> None:
    """As people write lists; a gap between two commas is no number, and one number alone takes none."""

    @dataclass(frozen=True)
    class Levels:
        levels: tuple[float, ...] = ()
        """Levels."""
        seed: int = 0
        """Seed."""

    assert read_options(Levels, ["--levels", *words], "it", "Do it.").levels == (0.0, 0.1, 0.2)
    for wrong in (["--levels", "0,,1"], ["--seed", "1,2"]):
        with pytest.raises(SystemExit):
            read_options(Levels, wrong, "it", "Do it.")
