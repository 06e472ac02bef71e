"""`stiction evaluate` asked for what would have no effect."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.files.settings import SETTINGS

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--static-ratio", "2"], "--static-ratio requires --friction-law stribeck;"),
        (["--robots", "7"], "--robots requires --engines mujoco+all;"),
        (["--robot-levels", "0.1"], "--robot-levels requires --engines mujoco+all;"),
        (["--forward-by", "error"], "--forward-by requires --forward;"),
        (["--callable-period", "-1"], "--callable-period requires --policy-callable;"),
        (["--log-torque", "output_side"], "--log-torque requires --log;"),
        (["--judge-again", "--episodes", "7"], "--judge-again and BUNDLES exclude"),
        (["--known-friction", "0.1"], "--known-friction requires a policy trained with --task.known-friction;"),
        (["--commands", "vx=1e9"], "expected at most 20 m/s or rad/s along each axis"),
    ],
)
def test_what_would_have_no_effect_is_refused(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Refuses options without effect in one line, and writes nothing."""
    out = tmp_path / "out"
    assert main(["evaluate", "saturn_lite-flat-deception-0.2", *words, "--out", str(out)]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1 and not out.exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nope"], "unknown policy 'nope'"),
        (["runs/nope"], "runs/nope does not exist"),
        (["saturn_lite-flat-deception-0.2", "--engines", "bullet", "--seconds", "1"], "unknown engine 'bullet'"),
        (["saturn_lite-flat-deception-0.2", "--terrains", "stairs"], "terrain 'stairs' has no size"),
    ],
)
def test_a_name_that_there_is_not_is_said_before_what_else_is_wrong(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Reports an unknown name in one line before comparing settings with those of earlier results."""
    (tmp_path / SETTINGS).write_text('{"verb": "evaluate", "settings": {"bundles": ["mine"], "seconds": 9.0}}')
    assert main(["evaluate", *words, "--out", str(tmp_path)]) == 1
    printed = capsys.readouterr().err
    assert message in printed and "other settings" not in printed and printed.count("\n") == 1
