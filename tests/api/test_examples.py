"""The examples as their readers run them: from an empty folder, script by script and cell by cell."""

from __future__ import annotations

import ast
import json
import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from excitations import search_little

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS, NOTEBOOKS = sorted(EXAMPLES.glob("*.py")), sorted(EXAMPLES.glob("*.ipynb"))


def test_all_of_them_are_here_and_short() -> None:
    """Six scripts and two notebooks, each of which a person reads in a minute."""
    assert (len(SCRIPTS), len(NOTEBOOKS)) == (6, 2)
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < 60 for path in SCRIPTS)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_runs(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    """It ends well, says something, and warns of nothing; a motion is searched for among few."""
    pytest.importorskip("mujoco", reason="the extra 'sim' is needed to simulate")
    search_little(monkeypatch)
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    output = capfd.readouterr()
    assert output.out and "Traceback" not in output.err


def test_a_plain_script_identifies_several_joints(tmp_path: Path) -> None:
    """Without `if __name__ == "__main__"`: workers that run the script again would end in BrokenProcessPool."""
    notebook = json.loads((EXAMPLES / "identify.ipynb").read_text(encoding="utf-8"))
    script = tmp_path / "plain.py"
    script.write_text("\n".join([*code_of(notebook), "print(repr(result))"]))
    environment = os.environ | {"STICTION_THREADS": "2"}
    path = [str(Path(entry).absolute()) for entry in environment.get("PYTHONPATH", "").split(os.pathsep) if entry]
    environment["PYTHONPATH"] = os.pathsep.join(path)
    command = [sys.executable, str(script)]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Friction ") and "\nMatters: " in done.stdout and not done.stderr
    assert all(f"\n{joint}, 0.4" in done.stdout for joint in ("hip", "knee"))


def code_of(notebook: dict[str, Any]) -> list[str]:
    """Return the code of each cell."""
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells run in one namespace, what a cell ends with can be shown, and it is kept without outputs."""
    pytest.importorskip("mujoco", reason="the extra 'sim' is needed to simulate")
    monkeypatch.chdir(tmp_path)
    notebook = json.loads(file.read_text(encoding="utf-8"))
    assert all(not cell.get("outputs") and not cell.get("execution_count") for cell in notebook["cells"])
    namespace: dict[str, Any] = {"__name__": "__main__"}
    shown = 0
    for code in code_of(notebook):
        tree = ast.parse(code)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, file.name, "exec"), namespace)
        if last is not None:
            exec(compile(f"shown_ = {ast.unparse(last)}", file.name, "exec"), namespace)
            value = namespace["shown_"]
            shown += hasattr(value, "_repr_html_") and "<table>" in value._repr_html_()
    assert shown >= 1
    assert not list(tmp_path.iterdir())
