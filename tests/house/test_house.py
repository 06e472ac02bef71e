"""Rules beyond linters: no file is executed when read, verbs import late, dependencies are declared.

Import contracts are in pyproject.toml and checked by `make check`. Rules are functions of a syntax tree, each tested on
code that it forbids before it is applied to the house.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from importlib import metadata
from pathlib import Path

import pytest

from plain_words import reread_docstrings, vague_variables, violations
from source_tree import (
    BY_NAME,
    HOUSE,
    MODULES,
    NAMES,
    PRODUCT,
    all_imports,
    imports,
    imports_at_the_top,
    package_of,
    tree_of,
)

ROOT = Path(__file__).parents[2]

PICKLES = frozenset({"pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"})
"""Modules that execute what they read."""

LONGEST_MODULE = 500
LONGEST_FUNCTION = 70
MOST_BY_POSITION = 20

OF_ROS = frozenset({"rclpy", "sensor_msgs", "std_msgs"})
"""Packages of a ROS 2 installation, which are on no index; who asks for that transport has them."""


def forbidden_calls(tree: ast.Module) -> list[str]:
    """Return what would execute code from a file: pickles, eval and exec, torch's save and load."""
    calls = [f"import {name}, line {line}" for name, line in imports(ast.walk(tree)) if name.split(".")[0] in PICKLES]
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in {"eval", "exec", "torch.load", "torch.save"}:
                calls.append(f"{called}(), line {node.lineno}")
            calls += [
                f"allow_pickle, line {node.lineno}"
                for keyword in node.keywords
                if keyword.arg == "allow_pickle" and ast.unparse(keyword.value) != "False"
            ]
        elif isinstance(node, ast.ImportFrom) and node.module == "torch":
            calls += [f"torch.{a.name}, line {node.lineno}" for a in node.names if a.name in {"load", "save"}]
    return calls


def loaded(start: Path) -> dict[str, list[str]]:
    """Return the packages outside the house that the import of a module loads -> the chain of modules to them."""
    outside: dict[str, list[str]] = {}
    seen, waiting = {start}, [(start, [NAMES[start]])]
    while waiting:
        path, chain = waiting.pop()
        for name, _ in imports(imports_at_the_top(tree_of(path)), package_of(path)):
            if not name.startswith(("stiction.", "stiction_experiments.")):
                outside.setdefault(name.split(".")[0], chain)
                continue
            parts = name.split(".")
            for target in {BY_NAME.get(".".join(parts[:count])) for count in range(1, len(parts) + 1)} - {None, *seen}:
                seen.add(target)
                waiting.append((target, [*chain, NAMES[target]]))
    return outside


def test_the_rules_find_what_they_forbid() -> None:
    """The import scanners resolve relative, lazy and transitive imports."""
    source = "from ..sim import native\nfrom . import log\nimport numpy\ndef f():\n    from stiction.task import env\n"
    modules = [name for name, _ in imports(ast.walk(ast.parse(source)), "stiction.identification")]
    assert modules == ["stiction.sim.native", "stiction.identification.log", "numpy", "stiction.task.env"]
    lazy = ast.parse("import rich\nif TYPE_CHECKING:\n    import torch\ndef f():\n    import mujoco\n")
    assert imports(imports_at_the_top(lazy)) == [("rich", 1)]
    assert loaded(HOUSE / "robots/mjcf.py")["mujoco"] == ["robots/mjcf.py"]
    assert "torch" not in loaded(HOUSE / "cli/train.py")
    assert loaded(HOUSE / "sim/warp.py").keys() >= {"warp", "mujoco_warp", "mujoco"}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from pickle import loads",
        "import torch\ntorch.load('a')",
        "from torch import load",
        "torch.save(x, 'a')",
        "eval('1')",
        "exec('1')",
        "np.load('a', allow_pickle=True)",
        "np.load('a', allow_pickle=flag)",
    ],
)
def test_code_that_executes_files_is_found(source: str) -> None:
    """Reports each call that executes a file, and no harmless call of a similar name."""
    assert len(forbidden_calls(ast.parse(source))) == 1
    assert not forbidden_calls(ast.parse("model.eval()\nnp.load('a', allow_pickle=False)\njson.load(file)"))


def test_every_package_imported_is_a_declared_dependency() -> None:
    """Every imported package is in the dependencies of pyproject.toml."""
    declared: set[str] = set()
    # Packages that need not be installed, and whose distribution has another name.
    distributions = {"bam": ["better-actuator-models"]} | metadata.packages_distributions()
    # The experiments have what the product has, and their own.
    for folder, modules in ((ROOT, PRODUCT), (ROOT / "experiments", MODULES)):
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        requirements = sum(project["optional-dependencies"].values(), project["dependencies"])
        declared |= {re.findall(r"^[a-z0-9-]+", text)[0] for text in requirements}
        packages = {name.split(".")[0] for path in modules for name, _ in all_imports(path)}
        undeclared = [
            name
            for name in packages - sys.stdlib_module_names - OF_ROS - {"stiction", "stiction_experiments"}
            if declared.isdisjoint(dist.lower().replace("_", "-") for dist in distributions.get(name, [name]))
        ]
        assert not undeclared, f"add to {folder.name}/pyproject.toml: {undeclared}"


def test_training_needs_no_package_of_another_device_or_logger() -> None:
    """Imports only what --device and --logger ask for: `stiction[train]` alone can train."""
    theirs = {"sim/warp.py", "sim/worlds.py", "sim/torch_fleet.py"}
    modules = [path for path in MODULES if NAMES[path] not in theirs]
    assert not [NAMES[path] for path in modules if {"warp", "mujoco_warp", "wandb", "trackio"} & set(loaded(path))]


def test_verbs_and_studies_load_their_rooms_only_when_called() -> None:
    """Verbs and studies import torch and simulators only when called.

    Configuration of a verb's flags, which needs no libraries, may be imported at the top.
    """
    light = sys.stdlib_module_names | {"stiction", "stiction_experiments", "rich", "numpy"}
    early = [path for path in MODULES if NAMES[path].startswith("cli/") or path.name in ("study.py", "verb.py")]
    assert len(early) > 20
    heavy = {NAMES[path]: set(loaded(path)) - light for path in early}
    assert not {name: packages for name, packages in heavy.items() if packages}


def test_nothing_executes_what_it_reads() -> None:
    """No module unpickles or executes a file."""
    assert not {NAMES[path]: calls for path in MODULES if (calls := forbidden_calls(tree_of(path)))}


OF_OTHERS = re.compile("dreamwaq|hinf|H∞|disturber|finetune|context-aided", re.IGNORECASE)
"""Words of training methods that are entry points of another distribution."""

NAMED = {
    "files/contract.py": "a field of contracts, a word of bounded length",
    "files/contract_rules.py": "the bounds of that field",
    "files/contract_training.py": "the age of that field, and no such word with a method of the product",
    "files/method.py": "names for which an error says what to install",
    "learning/stored.py": "groups in config.json of runs from before methods were installed",
}
"""Module of the product with such words -> reason."""


def test_the_product_knows_no_method_of_other_papers() -> None:
    """They are found by their names, so that the product neither imports nor explains them."""
    counts = {NAMES[path]: len(OF_OTHERS.findall(path.read_text())) for path in PRODUCT}
    assert {name for name, count in counts.items() if count} == NAMED.keys()
    assert sum(counts.values()) < 15


def test_modules_and_functions_stay_readable() -> None:
    """Modules and functions stay below their maximum lengths."""
    assert not [NAMES[path] for path in MODULES if len(path.read_text().splitlines()) > LONGEST_MODULE]
    functions = [
        (NAMES[path], node)
        for path in MODULES
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    long = [(name, node.name) for name, node in functions if (node.end_lineno or 0) - node.lineno >= LONGEST_FUNCTION]
    assert not long, f"functions of {LONGEST_FUNCTION} lines or more: {long}"


def positional(tree: ast.Module) -> list[str]:
    """Return dataclasses of more than MOST_BY_POSITION fields, all with defaults, that take them by position."""
    return [
        node.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        and any(
            "dataclass(" in ast.unparse(item) and "kw_only=True" not in ast.unparse(item)
            for item in node.decorator_list
        )
        and len(fields := [item for item in node.body if isinstance(item, ast.AnnAssign)]) > MOST_BY_POSITION
        and all(item.value is not None for item in fields)
    ]


def test_long_classes_of_options_take_them_by_name() -> None:
    """A field put between others would give another meaning to numbers by position, without an error."""
    fields = "".join(f"    a{number}: float | None = None\n" for number in range(MOST_BY_POSITION + 1))
    code = "@dataclass(frozen=True)\nclass Many:\n" + fields
    assert positional(ast.parse(code)) == ["Many"]
    assert not positional(ast.parse(code.replace("True", "True, kw_only=True")))
    assert not [name for path in MODULES for name in positional(tree_of(path))]


MOST_REREAD = {
    "src": {"docstrings": 0, "variables": 0},
    "examples": {"docstrings": 0, "variables": 0},
    "tools": {"docstrings": 0, "variables": 0},
    "experiments": {"docstrings": 0, "variables": 2},
    "tests": {"docstrings": 0, "variables": 0},
}
"""Folder -> most docstrings without a noun in front and variables without a meaning; a bound only ever falls. The
two are columns of flags.csv."""


def test_no_two_test_modules_share_a_name() -> None:
    """Test modules are imported by their names alone: of two with one name, one cannot be collected."""
    names = Counter(path.name for path in (ROOT / "tests").rglob("test_*.py"))
    assert not [name for name, count in names.items() if count > 1]


def test_the_rules_of_words_find_what_they_forbid() -> None:
    """Finds a docstring of a module, field and function, and a variable however it is bound; reading one is allowed."""
    words = ("Of", "What", "Whether", "Who", "Whose", "Those", "That", "Which", "If", "There")
    forbidden = [f'"""{word} it is."""' for word in words]
    forbidden += ['class A:\n    b: int = 0\n    """\n    What is it?"""', 'def f():\n    """What, then: it."""']
    assert all(len(reread_docstrings(ast.parse(source))) == 1 for source in forbidden)
    allowed = ['"""Offset of what is given."""', '"""Whatever it is."""', 'HELP = "What it is."']
    assert not any(reread_docstrings(ast.parse(source)) for source in allowed)
    bound = ["found = 1", "found, x = 1, 2", "f(lambda said: 1)", "def f(*, given): pass", "class A:\n    beside: int"]
    bound += [
        "[1 for found in x]",
        "f(said := 1)",
        "try:\n    f()\nexcept E as given:\n    pass",
        "def f(**given): pass",
    ]
    assert all(len(vague_variables(ast.parse(source))) == 1 for source in bound)
    allowed = ["x = found", "f(said=1)", "x = a.given", "beside()", "foundation = 1"]
    assert not any(vague_variables(ast.parse(source)) for source in allowed)


@pytest.mark.parametrize("folder", MOST_REREAD)
def test_words_need_not_be_read_twice(folder: str) -> None:
    """Begins docstrings with a noun or a verb, and names variables by what they hold."""
    lines = violations(ROOT / folder)
    most = MOST_REREAD[folder]
    assert not [line for rule in lines if len(lines[rule]) > most[rule] for line in lines[rule]]
