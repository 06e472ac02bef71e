"""Messages for a part that is not installed: complete, before any work, with the command to install it."""

from __future__ import annotations

import json
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from stiction.cli.main import NEEDS, main
from stiction.cli.process import explained
from stiction.core import extras
from stiction.core.errors import StictionError
from stiction.engines.catalog import missing_engine
from stiction.robots.catalog import find_robot

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


def test_the_oldest_versions_are_those_of_the_project() -> None:
    """Else a version would be refused that the installation takes, or the other way round."""
    requirements = sum(PROJECT["optional-dependencies"].values(), PROJECT["dependencies"])
    for package, (_, oldest) in extras.OLDEST.items():
        distribution = extras.DISTRIBUTIONS.get(package, package)
        assert any(text.startswith(f"{distribution}>={oldest},<") for text in requirements), package


def _beside_mjlab(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the versions that mjlab 1.6 pins."""
    pinned = {"mujoco": "3.11.0", "rsl-rl-lib": "5.4.2"}
    real = extras.metadata.version
    monkeypatch.setattr(extras.metadata, "version", lambda name: pinned.get(name) or real(name))


@pytest.mark.parametrize("verb", [verb for verb, extra in NEEDS.items() if extra != "sign"])
def test_an_older_simulator_is_told_in_a_line(
    verb: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside mjlab: what is there, what is needed, and how to have both."""
    _beside_mjlab(monkeypatch)
    assert main([verb]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "MuJoCo 3.11 is installed; 4.0 is needed" in error
    assert "uv tool install " in error and f"[{NEEDS[verb]}]" in error


def _printed(capsys: pytest.CaptureFixture, *words: str) -> str:
    """Return what a command prints."""
    assert main([*words]) == 0
    return capsys.readouterr().out


def test_mjlab_gets_an_environment_of_its_own(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this one its pins would take the MuJoCo of everything else away."""
    monkeypatch.setitem(sys.modules, "mjlab", None)
    assert main(["doctor", "--mjlab", "Mjlab-Velocity-Flat-Unitree-Go1"]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "python3 -m venv .venv-mjlab && .venv-mjlab/bin/pip install " in error
    with pytest.raises(StictionError, match=r"'mjlab\S*' is not installed; .* environment of its own: python3 -m venv"):
        import_module("stiction.mjlab")


def test_what_an_older_simulator_lacks_is_no_fault_of_stiction(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module of MuJoCo 4, an engine, and an error that nobody foresaw."""
    assert extras.outdated("train") is None and extras.outdated("logs") is None
    _beside_mjlab(monkeypatch)
    message = "MuJoCo 3.11 is installed; 4.0 is needed: mjlab pins older ones"
    lacking = ModuleNotFoundError("No module named 'mujoco.batch'", name="mujoco.batch")
    assert str(extras.missing_extra(lacking, "this verb")).startswith(message)
    missing = ModuleNotFoundError("No module named 'onnxscript'", name="onnxscript")
    lacks = str(extras.missing_extra(missing, "this verb"))
    assert f"'onnxscript' is not installed; this verb needs the extra 'train'; {message}" in lacks and "second" in lacks
    rows = json.loads(_printed(capsys, "list", "engines", "--json"))["engines"]
    assert len(rows) >= 4 and all(row["install"].startswith(message) and not row["here"] for row in rows)
    missing = ModuleNotFoundError("No module named 'mujoco'", name="mujoco")
    assert "the package 'mujoco' is not installed" in str(extras.missing_extra(missing, "this verb"))
    assert message in str(missing_engine("mujoco", find_robot("go1")))
    monkeypatch.setitem(sys.modules, "mujoco", sys)
    monkeypatch.delitem(sys.modules, "mjlab", raising=False)
    assert explained(AttributeError("no attribute 'x'"), "robot").startswith(message)
    monkeypatch.setitem(sys.modules, "mjlab", sys)
    assert explained(AttributeError("no attribute 'x'"), "doctor").startswith("unforeseen AttributeError")
