"""The public names of `stiction`: that they are there, quick, typed, documented, and do what their docstrings show."""

from __future__ import annotations

import ast
import doctest
import inspect
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import stiction

FUNCTIONS = [name for name in stiction.PUBLIC if name != "StictionError"]


def test_importing_stiction_loads_nothing_heavy() -> None:
    """Else every script waits for a simulator that it may not need, or may not have."""
    code = "import sys, stiction; dir(stiction); print([m for m in ('numpy', 'scipy', 'torch', 'mujoco', 'matplotlib') "
    code += "if m in sys.modules])"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert process.stdout.strip() == "[]"


def test_type_checkers_see_the_names_that_there_are() -> None:
    """A name that is in the stub alone type-checks and fails; one in the table alone is not found by editors."""
    stub = ast.parse(Path(stiction.__file__).with_name("__init__.pyi").read_text(encoding="utf-8"))
    typed = {
        alias.asname: (node.module or "").removeprefix("stiction.")
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert typed == stiction.PUBLIC
    assert set(dir(stiction)) == {*stiction.PUBLIC, "__version__"} and len(stiction.PUBLIC) == 17


def test_no_package_has_the_name_of_a_function() -> None:
    """Importing a package binds its name in `stiction`, where it would hide the function."""
    packages = {path.parent.name for path in Path(stiction.__file__).parent.glob("*/__init__.py")}
    assert not packages & {*stiction.PUBLIC}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_docstrings_do_what_they_show(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An example that does not run is worse than none."""
    if name in ("evaluate", "check_robot"):
        pytest.importorskip("mujoco", reason="the extra 'sim' is needed to simulate")
    if name in ("train", "export"):
        pytest.importorskip("torch", reason="the extra 'train' is needed to train")
    monkeypatch.chdir(tmp_path)
    function = inspect.unwrap(getattr(import_module(f"stiction.{stiction.PUBLIC[name]}"), name))
    tests = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    runner = doctest.DocTestRunner()
    assert sum(runner.run(test).attempted for test in tests) >= 1
    assert runner.failures == 0
    assert list(tmp_path.iterdir()) == []


def test_a_package_that_is_missing_is_named_in_one_line(tmp_path: Path) -> None:
    """A user of the base install is told what to install, by the same family of errors."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['mujoco'] = None\n")
    code = "import stiction\ntry:\n    stiction.check_robot('go1')\nexcept stiction.StictionError as e:\n    print(e)\n"
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path}
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True, env=environment
    )
    assert "[sim]" in process.stdout and process.stdout.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "args", "options", "message"),
    [
        ("load_log", (None,), {}, "load_log: path is None; expected str or Path"),
        ("load_log", ("x.csv",), {"colums": {}}, "load_log: unknown option 'colums'; did you mean 'columns'? known: "),
        ("load_log", ("x.csv",), {"rate": "fast"}, "load_log: rate is 'fast'; expected float or None"),
        ("identify", (None,), {}, "no log given; expected one of load_log or from_arrays"),
        ("identify", ("x.csv",), {"torque_source": "motor"}, "output_side; did you mean 'motor_side'?"),
        ("excite", ("go2",), {}, "excite: too many positional arguments; expected excite(robot=..., joint=..."),
        ("load_robot", (stiction,), {}, "load_robot: robot is a module; expected str or Path"),
        ("evaluate", (5,), {}, "evaluate: policies is 5; expected LoadedPolicy or str or Path or Callable"),
        (
            "evaluate",
            ("a",),
            {"frction_levels": [0]},
            "unknown option 'frction_levels'; did you mean 'friction_levels'",
        ),
        ("train", (), {}, "train: missing a required argument: 'out'; expected train(out, robot=..."),
        ("export", (None,), {}, "export: run is None; expected Trained or str or Path"),
    ],
)
def test_a_wrong_argument_is_one_line_that_names_it(
    name: str, args: tuple, options: dict, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a mistake would end deep inside, as a TypeError of pathlib, or as a KeyError of a preset."""
    if name in ("evaluate", "train"):
        pytest.importorskip("torch", reason="the extra 'train' is needed to train")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(stiction.StictionError) as caught:
        getattr(stiction, name)(*args, **options)
    assert message in str(caught.value) and not list(tmp_path.iterdir())
