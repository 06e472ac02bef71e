"""Options that require or exclude others: refused in one sentence, which is pinned here, before anything is done."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest

from stiction.cli.main import main
from stiction.core.effects import changed_options, check_effects, excludes, needs
from stiction.core.errors import ConfigurationError
from stiction.core.flags import ARGUMENT, FLAG

POLICY = "saturn_lite-flat-deception-0.2"


@dataclass(frozen=True)
class Inner:
    """Nested options."""

    deep: Annotated[int, FLAG] = 1
    shallow: int = 2


@dataclass(frozen=True)
class Verb:
    """Options of a verb."""

    to: str
    names: Annotated[tuple[str, ...], ARGUMENT] = ()
    log: bool = False
    log_seconds: float = field(default=1.0, metadata=needs("--log"))
    inner: Inner = field(
        default_factory=Inner, metadata=needs("--log-seconds 2", lambda cfg: cfg.log_seconds > 1, ("deep",))
    )
    model: str | None = field(default=None, metadata=needs("--to urdf, mujoco or webots"))
    loop: bool = field(default=False, metadata=excludes("--log", "--inner"))
    plan: bool = field(default=False, metadata=needs("--to urdf") | excludes(but=("--model",)))


@pytest.mark.parametrize(
    "options",
    [
        Verb("isaaclab"),
        Verb("isaaclab", log=True, log_seconds=2.0, inner=Inner(5, 6)),
        Verb("isaaclab", inner=Inner(1, 6)),
        Verb("mujoco", model="robot.xml"),
        Verb("isaaclab", loop=True, model=None),
        Verb("urdf", plan=True, model="robot.xml"),
    ],
)
def test_options_with_what_they_require_are_taken(options: Verb) -> None:
    """Accepts defaults, met requirements, and required options, which have no default to differ from."""
    check_effects(options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (Verb("x", log_seconds=2.0), "--log-seconds requires --log; add --log or remove --log-seconds"),
        (
            Verb("x", inner=Inner(5)),
            "--inner.deep requires --log-seconds 2; add --log-seconds 2 or remove --inner.deep",
        ),
        (
            Verb("isaaclab", model="robot.xml"),
            "--model requires --to urdf, mujoco or webots; add --to urdf, mujoco or webots or remove --model",
        ),
        (Verb("x", log=True, loop=True), "--loop and --log exclude each other; remove one of them"),
        (
            Verb("x", inner=Inner(1, 5), loop=True),
            "--loop and --set inner.shallow exclude each other; remove one of them",
        ),
        (Verb("x", plan=True), "--plan requires --to urdf; add --to urdf or remove --plan"),
        (Verb("urdf", log=True, plan=True), "--plan and --log exclude each other; remove one of them"),
        (Verb("urdf", ("a",), plan=True), "--plan and NAMES exclude each other; remove one of them"),
    ],
)
def test_the_first_option_without_effect_is_named(options: Verb, message: str) -> None:
    """Says in one sentence which option it is, what it requires or excludes, and what to do."""
    with pytest.raises(ConfigurationError) as refused:
        check_effects(options)
    assert str(refused.value) == message


def test_options_count_as_changed_against_other_defaults() -> None:
    """Compares with the defaults handed in, and yields nested options with their path."""
    changed = Verb("x", log=True, inner=Inner(1, 3))
    assert [*changed_options(changed)] == ["log", "inner.shallow"]
    assert [*changed_options(changed, Verb("x", log=True))] == ["inner.shallow"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["view", POLICY, "--static", "OUT", "--port", "99999999"], "--static and --port exclude"),
        (["view", POLICY, "--seconds", "3"], "--seconds requires --static"),
        (["demo", "--out", "OUT", "--loop", "--bundles", POLICY], "--loop and --bundles exclude"),
        (["demo", "--out", "OUT", "--preset", "full"], "--preset requires --train"),
        (["bench", "--ground", "--method", "none"], "--ground and --method exclude"),
        (["bench", "--method", "none", "--friction-level", "0.1"], "--friction-level requires --method direct or"),
    ],
)
def test_what_would_have_no_effect_is_refused(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Refuses in one line, before anything is written."""
    out = tmp_path / "out"
    assert main([str(out) if word == "OUT" else word for word in words]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and not out.exists()
