"""Entry points: what an installed distribution brings is found by name, and what is missing is one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from stiction.cli.main import INSTALLED, main
from stiction.core.errors import ConfigurationError
from stiction.core.plugins import STUDIES, find_installed, installed_names


def install(folder: Path, distribution: str, value: str) -> None:
    """Put a distribution with one study, `tilt`, into a folder, as an installer would."""
    info = folder / f"{distribution}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(f"[{STUDIES}]\ntilt = {value}\n")


def test_an_entry_point_of_any_distribution_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A laboratory adds a study of its own by installing it."""
    monkeypatch.syspath_prepend(tmp_path)
    assert find_installed(STUDIES, "tilt") is None
    install(tmp_path, "mine", "stiction.core.plugins:STUDIES")
    assert find_installed(STUDIES, "tilt") == STUDIES and "tilt" in installed_names(STUDIES)


def test_two_of_one_name_and_broken_ones_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither is chosen by the order of installation; a module that is gone is named."""
    monkeypatch.syspath_prepend(tmp_path)
    install(tmp_path, "mine", "no.such.module:STUDY")
    with pytest.raises(ConfigurationError, match=r"no\.such\.module:STUDY failed to load: .*; reinstall"):
        find_installed(STUDIES, "tilt")
    install(tmp_path, "yours", "stiction.core.plugins:STUDIES")
    with pytest.raises(ConfigurationError, match="got one from mine and yours, expected one; uninstall the other"):
        find_installed(STUDIES, "tilt")


@pytest.mark.parametrize("verb", sorted(INSTALLED))
@pytest.mark.parametrize("word", ["--help", "gait"])
def test_a_verb_of_the_experiments_says_how_to_install_them(
    verb: str, word: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The product alone knows their names, and where they come from."""
    monkeypatch.setattr("stiction.core.plugins.metadata.entry_points", lambda **_: ())
    assert main([verb, word]) == (0 if word == "--help" else 1)
    out, error = capsys.readouterr()
    line = out if word == "--help" else error
    assert (out + error).count("\n") == 1 and "stiction-experiments, which is not installed; install it with: " in line
    assert "pip install" in line and "/experiments" in line
