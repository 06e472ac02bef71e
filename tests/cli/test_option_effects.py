"""Options that would have no effect: refused in one line that says what they are of, before anything is done."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.core.effects import OptionsOf, changed_options, check_effects
from stiction.core.errors import ConfigurationError

POLICY = "saturn_lite-flat-deception-0.2"
OF_VIEWER = "is of the viewer, which --static does not open, and would have no effect; leave one of them out"
OF_PAGE = "is of the page, which --loop does not make, and would have no effect"
OF_TRAINING = "is of the measurement of training, which --ground replaces, and would have no effect"


@dataclass(frozen=True)
class Inner:
    """Nested options."""

    deep: int = 1
    other: int = 2


@dataclass(frozen=True)
class Own:
    """Options of a verb."""

    log: bool = False
    log_seconds: float = 1.0
    inner: Inner = field(default_factory=Inner)


TABLE = (
    OptionsOf(("log_seconds", "inner.deep"), "--log", lambda own: own.log),
    OptionsOf(("inner",), "a log that is long", lambda own: own.log_seconds > 1, "leave it out"),
)


def test_only_what_was_changed_and_has_no_owner_is_refused() -> None:
    """A default would be refused, or a changed option without its owner taken."""
    for taken in (Own(), Own(log=True), Own(True, 2.0), Own(True, 2.0, Inner(5, 6))):
        check_effects(taken, Own(), TABLE)
    said = "^--log-seconds is of --log, and would have no effect; leave it out, or add that$"
    with pytest.raises(ConfigurationError, match=said):
        check_effects(Own(log_seconds=2.0), Own(), TABLE)
    with pytest.raises(ConfigurationError, match=r"^--inner\.deep is of --log, "):
        check_effects(Own(inner=Inner(5)), Own(), TABLE)
    with pytest.raises(ConfigurationError, match=r"^--inner\.other is of a log that is long, .*; leave it out$"):
        check_effects(Own(True, inner=Inner(other=5)), Own(), TABLE)
    assert [*changed_options(Own(True, 1.0, Inner(1, 3)), Own())] == ["log", "inner.other"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["view", POLICY, "--static", "OUT", "--port", "99999999"], f"--port {OF_VIEWER}"),
        (["view", POLICY, "--static", "OUT", "--host", "nowhere.example"], f"--host {OF_VIEWER}"),
        (["view", POLICY, "--static", "OUT", "--follow"], f"--follow {OF_VIEWER}"),
        (["view", POLICY, "--static", "OUT", "--out", "logs"], f"--out {OF_VIEWER}"),
        (["view", POLICY, "--static", "OUT", "--static-ratio", "7"], "--static-ratio is of --friction-law stribeck"),
        (["view", POLICY, "--seconds", "3"], "--seconds is of --static, and would have no effect"),
        (["view", POLICY, "--overwrite"], "--overwrite is of --static, and would have no effect"),
        (["demo", "--out", "OUT", "--loop", "--bundles", POLICY], f"--bundles {OF_PAGE}"),
        (["demo", "--out", "OUT", "--loop", "--train"], f"--train {OF_PAGE}"),
        (["demo", "--out", "OUT", "--loop", "--episodes", "2"], f"--episodes {OF_PAGE}"),
        (["demo", "--out", "OUT", "--loop", "--seconds", "2"], f"--seconds {OF_PAGE}"),
        (["demo", "--out", "OUT", "--loop", "--preset", "full"], f"--preset {OF_PAGE}"),
        (
            ["demo", "--out", "OUT", "--train", "--bundles", POLICY],
            "--train is of policies of its own, which --bundles",
        ),
        (["demo", "--out", "OUT", "--preset", "full"], "--preset is of --train, and would have no effect"),
        (["bench", "--ground", "--method", "none"], f"--method {OF_TRAINING}"),
        (["bench", "--ground", "--friction-level", "0.1"], f"--friction-level {OF_TRAINING}"),
        (["bench", "--ground", "--terrain", "stairs"], f"--terrain {OF_TRAINING}"),
        (["bench", "--ground", "--actuator", "net"], f"--actuator {OF_TRAINING}"),
        (["bench", "--ground", "--device", "cuda"], f"--device {OF_TRAINING}"),
        (["bench", "--method", "none", "--friction-level", "0.1"], "--friction-level is of a --method with friction"),
    ],
)
def test_what_would_have_no_effect_is_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Who asks for it would believe that it was done."""
    out = tmp_path / "out"
    assert main([str(out) if word == "OUT" else word for word in words]) == 1
    printed = capsys.readouterr().err
    assert said in printed and printed.count("\n") == 1 and not out.exists()
