"""What is said of a part that is not installed: all of it, before any work, and a command that leads to it."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

import pytest

from stiction.cli.main import NEEDS, main
from stiction.core import extras

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
SHA = "0" * 40


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'stiction[sim]'"),
        ({}, "pip install '.[sim]', in the folder of stiction's source"),
        ({"url": "file:///a%20b", "dir_info": {}}, "pip install '/a b[sim]'"),
        ({"url": "file:///a", "dir_info": {"editable": True}}, "pip install -e '/a[sim]'"),
        (
            {"url": "file:///w/stiction-1.whl", "archive_info": {}},
            "pip install 'stiction[sim] @ file:///w/stiction-1.whl'",
        ),
        (
            {"url": "https://a.b/c", "vcs_info": {"vcs": "git", "commit_id": SHA}},
            f"pip install 'stiction[sim] @ git+https://a.b/c@{SHA}'",
        ),
    ],
    ids=["index", "nobody knows", "folder", "editable", "wheel", "repository"],
)
def test_an_extra_comes_from_where_the_package_came(origin: dict | None, command: str) -> None:
    """A package that is on no index must not be looked for there: somebody else's may be."""
    assert extras.install_command("sim", origin) == command


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'stiction-experiments[cluster]'"),
        ({}, "pip install './experiments[cluster]', in the folder of stiction's source"),
        ({"url": "file:///a", "dir_info": {"editable": True}}, "pip install -e '/a/experiments[cluster]'"),
        (
            {"url": "file:///w/stiction-1.whl", "archive_info": {}},
            "pip install './experiments[cluster]', in the folder of stiction's source",
        ),
        (
            {"url": "https://a.b/c", "vcs_info": {"vcs": "git", "commit_id": SHA}},
            f"pip install 'stiction-experiments[cluster] @ git+https://a.b/c@{SHA}#subdirectory=experiments'",
        ),
    ],
    ids=["index", "nobody knows", "editable", "wheel", "repository"],
)
def test_the_experiments_come_from_where_the_package_came(origin: dict | None, command: str) -> None:
    """A wheel of the product does not hold them, and they are on no index unless it came from there."""
    assert extras.install_command("cluster", origin, part="experiments") == command


def test_the_extras_are_those_of_the_project() -> None:
    """Else a message would send people to an extra that there is not."""
    assert set(extras.EXTRAS) <= set(PROJECT["optional-dependencies"])
    assert (
        extras.extra_of("mujoco") == "sim" and extras.extra_of("torch") == "train" and extras.extra_of("numpy") is None
    )


@pytest.mark.parametrize("verb", NEEDS)
def test_what_is_missing_is_said_whole_and_before_any_work(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the one half now and the other after the next installation, nor after ten seconds of work."""
    packages = ("cryptography",) if NEEDS[verb] == "sign" else ("mujoco", "PIL")
    for package in packages:
        monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.chdir(tmp_path)
    assert main([verb]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"the extra {NEEDS[verb]!r}" in error
    assert all(package in error for package in packages) and not list(tmp_path.iterdir())
