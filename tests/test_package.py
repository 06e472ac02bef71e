"""The program as installed: what it needs, what it ships, and how it answers."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import stiction
from stiction.cli.main import ELSEWHERE, NEEDS, VERBS

PACKAGE = Path(stiction.__file__).parent
CHECKOUT = PACKAGE.parents[1]
POLICIES = sorted(PACKAGE.glob("policies/*/contract.json"))

EXTRAS = ("torch", "rsl_rl", "tensordict", "tensorboard", "safetensors", "onnx", "onnxscript", "mujoco")
"""What the base install does not have."""

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
    return dict(os.environ) | {"PYTHONPATH": os.pathsep.join((str(folder), str(PACKAGE.parent)))}


EVERY_VERB = """
import contextlib, importlib, io, json, sys
from stiction.cli.main import VERBS, main

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
print(json.dumps([missing, {command: call(*command.split()) for command in (*commands, *sys.argv[2:])}]))
"""
"""Says which packages cannot be imported, and how every verb answers: one process, since each start takes a second."""

WRONG = ("", "identfy", "--nonsense")
"""Words that are no command."""


@pytest.fixture(scope="session")
def answers(base_install: dict[str, str]) -> dict[str, tuple[int, str, str]]:
    """Return command -> status, output and errors: help of each verb, a flag that it has not, and some more."""
    verified = [f"verify {path.parent.name}" for path in POLICIES]
    command = [sys.executable, "-c", EVERY_VERB, json.dumps(EXTRAS), *WRONG, "identify nowhere", *verified]
    command.append("verify nowhere")
    done = subprocess.run(command, env=base_install, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    missing, found = json.loads(done.stdout)
    assert missing == list(EXTRAS), "torch or mujoco are in reach of the tests below"
    return found


def run(
    *arguments: str | Path, env: dict[str, str] | None = None, cwd: Path | None = None
) -> subprocess.CompletedProcess:
    """Run the program in a process of its own."""
    command = [sys.executable, "-m", "stiction", *map(str, arguments)]
    return subprocess.run(command, env=env, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


def sine_log(path: Path) -> None:
    """Write a noisy log of one joint, I = 0.02, B = 0.1, Coulomb friction 0.4: torque from the equation of motion."""
    time = np.arange(0.0, 12.0, 0.002)
    position = np.zeros_like(time)
    velocity = np.zeros_like(time)
    acceleration = np.zeros_like(time)
    for amplitude, frequency in ((0.5, 0.5), (0.2, 2.0)):
        omega = 2 * np.pi * frequency
        position += amplitude * np.sin(omega * time)
        velocity += amplitude * omega * np.cos(omega * time)
        acceleration -= amplitude * omega**2 * np.sin(omega * time)
    noise = np.random.default_rng(0)
    torque = 0.02 * acceleration + 0.1 * velocity + 0.4 * np.sign(velocity) + 0.02 * noise.standard_normal(time.size)
    position += 1e-5 * noise.standard_normal(time.size)
    columns = np.stack([time, position, velocity, torque], axis=1)
    np.savetxt(path, columns, delimiter=",", header="time,position.knee,velocity.knee,torque.knee", comments="")


def test_every_module_with_a_main_is_a_verb() -> None:
    """If this failed, a verb would exist that nobody can call."""
    elsewhere = {module.rpartition(".")[2].replace("_", "-") for module in ELSEWHERE.values()}
    for path in PACKAGE.glob("cli/*.py"):
        functions = {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}
        assert path.stem.replace("_", "-") in {*VERBS, *elsewhere, "main"} or "main" not in functions, (
            f"cli/{path.name} is not in VERBS"
        )


def test_help_of_every_verb_needs_no_extra(answers: dict[str, tuple[int, str, str]]) -> None:
    """If this failed, a user with the base install could not even read what a verb does."""
    for verb in VERBS:
        status, out, errors = answers[f"{verb} --help"]
        assert (status, errors) == (0, ""), verb
        assert f"stiction {verb}" in out


def test_the_overview_lists_every_verb_and_loads_no_room() -> None:
    """If this failed, `stiction --help` would take seconds."""
    code = "import sys; from stiction.cli.main import main; main(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    listed = re.findall(r"^  ([\w-]+) +\S", done.stdout.partition("Examples:")[0], re.MULTILINE)
    assert listed == list(VERBS)
    loaded = set(done.stderr.split())
    assert not loaded & {"numpy", "torch", "mujoco", "matplotlib", "tyro"}
    assert {name for name in loaded if name.count(".") == 1 and name.startswith("stiction.")} <= {
        "stiction.cli",
        "stiction.core",
    }


def test_the_version_is_that_of_the_package() -> None:
    """If this failed, a bug report would name the wrong version."""
    assert run("--version").stdout == f"stiction {metadata.version('stiction')}\n"


@pytest.mark.parametrize("words", WRONG)
def test_wrong_usage_ends_with_status_2(words: str, answers: dict[str, tuple[int, str, str]]) -> None:
    """If this failed, a script could not tell a typing error from a failure."""
    status, out, errors = answers[words]
    assert (status, out) == (2, "")
    assert all(verb in errors for verb in VERBS)
    assert "Traceback" not in errors


def test_an_unknown_flag_ends_with_status_2(answers: dict[str, tuple[int, str, str]]) -> None:
    """If this failed, a misspelt flag would be ignored or end in a traceback. A missing extra is said before."""
    for verb in VERBS:
        status, _, errors = answers[f"{verb} --no-such-flag-anywhere"]
        assert status == 2 or (verb in NEEDS and status == 1 and f"needs the extra {NEEDS[verb]!r}" in errors), errors
        assert "Traceback" not in errors


def test_identify_runs_on_the_base_install(base_install: dict[str, str], tmp_path: Path) -> None:
    """If this failed, an on-board computer would need a simulator to read its own friction."""
    sine_log(tmp_path / "knee.csv")
    done = run("identify", "knee.csv", "--out", "found", env=base_install, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    knee = json.loads((tmp_path / "found/joints.json").read_text())["joints"]["knee"]
    assert knee["inertia"]["value"] == pytest.approx(0.02, rel=0.02)
    assert knee["viscous_friction"]["value"] == pytest.approx(0.1, rel=0.02)
    assert knee["coulomb_friction"]["value"] == pytest.approx(0.4, rel=0.02)


@pytest.mark.parametrize("verb", ["identify", "verify"])
def test_a_missing_file_is_one_line_on_the_base_install(verb: str, answers: dict[str, tuple[int, str, str]]) -> None:
    """If this failed, a wrong path would end in a traceback, or in a complaint about a missing package."""
    status, out, errors = answers[f"{verb} nowhere"]
    assert (status, out) == (1, "")
    assert errors.count("\n") == 1 and "nowhere" in errors


def test_shipped_policies_verify_on_the_base_install(answers: dict[str, tuple[int, str, str]]) -> None:
    """If this failed, a policy that we ship could not be checked on the robot."""
    assert POLICIES
    for contract in POLICIES:
        status, _, errors = answers[f"verify {contract.parent.name}"]
        assert status == 0, errors


def test_shipped_policies_stay_small() -> None:
    """If this failed, the package would grow past what an on-board computer wants to download."""
    for contract in POLICIES:
        assert sum(path.stat().st_size for path in contract.parent.iterdir()) <= 3_000_000, contract
