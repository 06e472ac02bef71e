"""The program as installed: what it needs, what it ships, and how it answers."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import stiction
from installs import make_files, promised
from stiction.cli.main import GROUPS, VERBS
from stiction.core import extras

PACKAGE = Path(stiction.__file__).parent
CHECKOUT = PACKAGE.parents[1]
POLICIES = sorted(PACKAGE.glob("policies/*/contract.json"))

EXTRAS = tuple(sorted({package for packages in extras.EXTRAS.values() for package in packages} - {"PIL"}))
"""Packages that the base install lacks; Pillow comes with matplotlib."""

CONTRACTS = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
BASE = ["stiction.api", "stiction.cli"]
BASE += next(one["source_modules"] for one in CONTRACTS if one["name"].startswith("No simulator on the robot"))
"""Rooms that the base install imports, but for the identification from walks."""

BLOCKER = f"""
import importlib.abc, sys

class Blocker(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocker())
"""


@pytest.fixture(scope="session")
def base_install(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return an environment in which the packages of the extras cannot be imported."""
    folder = tmp_path_factory.mktemp("base_install")
    (folder / "sitecustomize.py").write_text(BLOCKER)
    return dict(os.environ) | {
        "PYTHONPATH": os.pathsep.join((str(folder), str(PACKAGE.parent), str(CHECKOUT / "tests/helpers")))
    }


EVERY_VERB = """
import contextlib, importlib, io, json, pkgutil, sys
import pytest
from blank_figures import blank_figures
from excitations import search_little
from stiction.cli.main import GROUPS, VERBS, main

def call(*words):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = main(list(words))
        except SystemExit as end:
            status = end.code or 0
    return status, out.getvalue(), err.getvalue()

missing = []
for package in json.loads(sys.argv[1]):
    try:
        importlib.import_module(package)
    except ModuleNotFoundError:
        missing.append(package)
commands = [f"{verb} {word}" for verb in VERBS for word in ("--help", "--no-such-flag-anywhere")]
with blank_figures(), pytest.MonkeyPatch.context() as patch:
    search_little(patch)
    answers = {command: call(*command.split()) for command in (*commands, *sys.argv[3:])}
broken = {}
for room in json.loads(sys.argv[2]):
    for module in pkgutil.walk_packages(importlib.import_module(room).__path__, f"{room}."):
        try:
            importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            broken[module.name] = error.name
print(json.dumps([missing, answers, broken]))
"""
"""Prints the packages that cannot be imported, the answers of every verb, and the modules that cannot be imported.

One process, since each start takes a second.
"""

WRONG = ("", "identfy", "--nonsense")
"""Words that are no command."""


@pytest.fixture(scope="session")
def tried(
    base_install: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[str, tuple[int, str, str]], dict[str, str]]:
    """Return command -> status, output and errors, and module -> package that it lacks, on the base install.

    The commands: help of each verb, a flag that it has not, all that the base install promises, and some more.
    """
    folder = tmp_path_factory.mktemp("base")
    make_files(folder)
    words = [*WRONG, "demo", "identify nowhere", "verify nowhere", *(f"verify {path.parent.name}" for path in POLICIES)]
    words += [" ".join(words) for _, *words in promised("")]
    command = [sys.executable, "-c", EVERY_VERB, json.dumps(EXTRAS), json.dumps(BASE), *words]
    done = subprocess.run(command, env=base_install, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    missing, answers, broken = json.loads(done.stdout)
    assert missing == list(EXTRAS), "a package of an extra is in reach of the tests below"
    return answers, broken


@pytest.fixture(scope="session")
def answers(tried: tuple[dict[str, tuple[int, str, str]], dict[str, str]]) -> dict[str, tuple[int, str, str]]:
    """Return command -> status, output and errors on the base install."""
    return tried[0]


def run(
    *arguments: str | Path, env: dict[str, str] | None = None, cwd: Path | None = None
) -> subprocess.CompletedProcess:
    """Run the program in a process of its own."""
    command = [sys.executable, "-m", "stiction", *map(str, arguments)]
    return subprocess.run(command, env=env, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


def test_every_module_with_a_main_is_a_verb() -> None:
    """Every module of cli with a `main` is listed in `VERBS`."""
    for path in PACKAGE.glob("cli/*.py"):
        functions = {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}
        assert path.stem.replace("_", "-") in {*VERBS, "import-policy", "main"} or "main" not in functions, (
            f"cli/{path.name} is not in VERBS"
        )


def test_help_of_every_verb_needs_no_extra(answers: dict[str, tuple[int, str, str]]) -> None:
    """Help of every verb works on the base install."""
    for verb in VERBS:
        status, out, errors = answers[f"{verb} --help"]
        assert (status, errors) == (0, ""), verb
        assert f"stiction {verb}" in out


def test_the_overview_lists_every_verb_and_loads_no_room() -> None:
    """`stiction --help` lists every verb, and imports only stiction.cli and stiction.core."""
    code = "import sys; from stiction.cli.main import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    listed = re.findall(r"^  ([\w-]+) +\S", done.stdout.partition("Examples:")[0], re.MULTILINE)
    assert listed == [verb for verbs in GROUPS.values() for verb in verbs]
    loaded = set(done.stderr.split())
    assert not loaded & {"numpy", "torch", "mujoco", "matplotlib", "yaml"}
    assert {name for name in loaded if name.count(".") == 1 and name.startswith("stiction.")} <= {
        "stiction.cli",
        "stiction.core",
    }


@pytest.mark.parametrize("words", WRONG)
def test_wrong_usage_ends_with_status_2(words: str, answers: dict[str, tuple[int, str, str]]) -> None:
    """Wrong usage lists the verbs on stderr and ends with status 2."""
    status, out, errors = answers[words]
    assert (status, out) == (2, "")
    assert all(verb in errors for verb in VERBS)
    assert "Traceback" not in errors


def test_the_base_install_runs_what_it_promises(answers: dict[str, tuple[int, str, str]]) -> None:
    """README's commands and every verb without an extra succeed while every package of an extra is out of reach."""
    for _, *words in promised(""):
        status, _, errors = answers[" ".join(words)]
        assert status == 0, (words, errors)


def test_rooms_of_the_base_install_import_no_extra(
    tried: tuple[dict[str, tuple[int, str, str]], dict[str, str]],
) -> None:
    """Only the identification from walks, which has MuJoCo's model of the robot, lack a package on import."""
    assert {name: package for name, package in tried[1].items() if ".walking." not in name} == {}


@pytest.mark.parametrize("verb", ["identify", "verify"])
def test_a_missing_file_is_one_line_on_the_base_install(verb: str, answers: dict[str, tuple[int, str, str]]) -> None:
    """A missing file is one line that names it, with status 1."""
    status, out, errors = answers[f"{verb} nowhere"]
    assert (status, out) == (1, "")
    assert errors.count("\n") == 1 and "nowhere" in errors


def test_shipped_policies_verify_on_the_base_install(answers: dict[str, tuple[int, str, str]]) -> None:
    """Every shipped policy passes `stiction verify`."""
    assert POLICIES
    for contract in POLICIES:
        status, _, errors = answers[f"verify {contract.parent.name}"]
        assert status == 0, errors
