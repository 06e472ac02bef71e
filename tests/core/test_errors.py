"""The family of errors: one printable line each, of the right kind, with the nearest name where one was misspelt."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from stiction.cli.main import find_verb
from stiction.core.errors import (
    BundleError,
    ConfigurationError,
    EngineError,
    FileError,
    LogError,
    PolicyError,
    RobotError,
    StictionError,
    TrainingError,
    check_once,
    nearest,
    unknown_name,
)
from stiction.learning.config import TrainCfg

POLICY = "saturn_lite-flat-none-0.2"
"""A shipped policy."""


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("no column 'τ θ'; map it", "no column 'τ θ'; map it"),
        ("a\nb", "a\\nb"),
        ("\x1b[2J gone", "\\x1b[2J gone"),
        ("lone \ud800", "lone \\ud800"),
    ],
)
def test_a_message_is_one_printable_line(message: str, shown: str) -> None:
    """A column's name from a stranger's file must not write lines of its own, or steer the terminal."""
    assert str(LogError(message)) == str(StictionError(message)) == shown


@pytest.mark.parametrize(
    ("name", "known", "suggestion"),
    [
        ("shnk", ("hip", "thigh", "shank"), "unknown joint 'shnk'; did you mean 'shank'? known: hip, thigh, shank"),
        ("x", ("hip", "thigh"), "unknown joint 'x'; known: hip, thigh"),
        ("x", (), "unknown joint 'x'; known: none"),
        ("x", tuple("abcdefghijklmnopqrstuvwyz"), "known: a, b, c"),
    ],
)
def test_the_nearest_name_is_named(name: str, known: tuple[str, ...], suggestion: str) -> None:
    """Names the nearest of 18 joints, and none where none is near."""
    message = unknown_name("joint", name, known)
    assert suggestion in message
    assert message.endswith(" and 1 more") == (len(known) == 25)


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("train --method none --set teacher.epochs=0", ConfigurationError),
        ("evaluate {policy} --commands jump", ConfigurationError),
        ("convert nothing.json --to mujoco", FileError),
        ("identify nothing.csv", LogError),
        ("verify damaged", BundleError),
        ("evaluate compensating --engines physx --forward compensating", PolicyError),
        ("excite --robot spot", RobotError),
        ("evaluate {policy} --engines gazebo", EngineError),
        ("export unfinished", TrainingError),
    ],
)
def test_a_mistake_at_the_command_line_is_of_its_kind(
    words: str, kind: type[StictionError], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Distinguishes an unknown robot from a full disk by the class of the error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "damaged").mkdir()
    verb, *rest = shlex.split(words.format(policy=POLICY))
    if "unfinished" in rest:
        _start_run(Path("unfinished"))
    if "compensating" in rest:
        _compensating(Path("compensating"))
    with pytest.raises(StictionError) as caught:
        find_verb(verb)(rest)
    assert type(caught.value) is kind


def _start_run(path: Path) -> None:
    """Begin a run and train nothing."""
    from stiction.learning.run import RunDirectory

    RunDirectory.create(path, TrainCfg(), "stiction train", None)


def _compensating(path: Path) -> None:
    """Write a bundle whose policy compensates friction in its targets."""
    from dataclasses import replace

    from bundles import make_bundle, make_contract

    contract = make_contract()
    make_bundle(path, replace(contract, compensation=(0.1,) * contract.num_joints))


def test_what_was_given_twice_is_refused_however_it_was_typed() -> None:
    """Work that is done twice would count twice."""
    check_once("levels", ("0.1", "0.2"))
    check_once("ways", (), least=0)
    for values, options in ((("0.1", "0.1"), {}), ((), {}), (("0.1", "0.10"), {"same": float})):
        with pytest.raises(ConfigurationError, match="expected at least one, each once"):
            check_once("levels", values, **options)
    with pytest.raises(ConfigurationError, match="ways: got 3 3, expected each once"):
        check_once("ways", (3, 3), least=0)


def test_only_similar_words_are_proposed() -> None:
    """Dashes that all flags share make no two of them alike."""
    assert nearest("--frobnicate", ["--robot", "--out"]) == ""
    assert nearest("--terrains", ["--terrain"]) == "; did you mean '--terrain'?"
