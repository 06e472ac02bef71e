"""Every process that we start leaves out the working folder: a `json.py` that lies there does not run."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from stiction.core.isolation import isolated_environment, python_module
from stiction.core.provenance import PACKAGE

NAMES = (
    *("json", "numpy", "pickle", "struct", "socket", "tempfile"),
    *("signal", "selectors", "stiction", "mujoco", "torch"),
)
"""Modules that somebody may leave in a folder; Python and we import all of them."""

WORK = """
import sys
from stiction.core.parallel import spread

if __name__ == "__main__":
    assert dict(spread(divmod, [(7, 2), (9, 4)], 2)) == {0: (3, 1), 1: (2, 1)}
"""
"""Two tasks in two processes."""


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder full of modules that leave a mark; returns the mark."""
    folder, mark = tmp_path / "sent", tmp_path / "mark"
    folder.mkdir()
    for name in NAMES:
        (folder / f"{name}.py").write_text(f"open({str(mark)!r}, 'a').write({name!r} + ' ')\nraise SystemExit(9)\n")
    monkeypatch.chdir(folder)
    return mark


def environment() -> dict[str, str]:
    """The environment of a user who finds the package that is tested, and protects nothing."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"} | {
        "PYTHONPATH": str(PACKAGE.parent)
    }


def test_the_trap_works(trap: Path) -> None:
    """Runs the trap without isolation; otherwise the tests below would prove nothing."""
    subprocess.run([sys.executable, "-c", "import json"], env=environment(), check=False)
    assert trap.read_text() == "json "


def test_a_module_of_ours_starts_without_the_working_folder(trap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Clips, first runs, trainings of a study: one way to start them; an empty entry of PYTHONPATH means the folder."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(("", str(PACKAGE.parent), "")))
    command = python_module("stiction", ["--version"])
    done = subprocess.run(command, env=isolated_environment(), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()[:1]) == (0, ["stiction"]), done.stderr
    assert not trap.exists()


def test_workers_start_without_the_working_folder(trap: Path, tmp_path: Path) -> None:
    """Multiprocessing starts them as `python -c`, which looks into the working folder before anything is said."""
    (tmp_path / "work.py").write_text(WORK)
    command = [sys.executable, str(tmp_path / "work.py")]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not trap.exists()


def test_there_is_no_other_way_to_start_a_process() -> None:
    """Starts every process through the functions that leave the working folder out."""
    for path in PACKAGE.rglob("*.py"):
        text, name = path.read_text(), path.relative_to(PACKAGE).as_posix()
        used = {ast.unparse(node) for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute | ast.Name)}
        if name != "core/isolation.py":
            assert "sys.executable" not in used, name
        if "ProcessPoolExecutor" in used:
            assert "isolate_workers" in used, name
        assert not used & {"os.system", "os.popen", "multiprocessing.Process", "os.execv", "os.execvp", "os.spawnv"}, (
            name
        )
