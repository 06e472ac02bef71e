"""The walls of the house: who may import whom, how long a module may be, and what nobody may write.

The rules are functions of a syntax tree, so each is shown to find what it forbids before it is turned on the house.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

import stiction

HOUSE = Path(stiction.__file__).parent

FLOORS = {
    "formats": 0,
    "robots": 1,
    "joints": 1,
    "identify": 2,
    "sim": 2,
    "deploy": 2,
    "locomotion": 3,
    "rma": 4,
    "transfer": 5,
    "report": 6,
    "cli": 7,
}
"""Room -> floor. A room imports from itself and from floors below its own."""

TORCH = frozenset({"torch", "rsl_rl", "tensordict"})
"""Packages that bring torch."""

SIMULATOR = frozenset({"mujoco", "mujoco_warp", "warp"})
"""Packages that bring a simulator."""

WITHOUT = {
    "formats": TORCH | SIMULATOR,
    "identify": TORCH | SIMULATOR,
    "deploy": TORCH | SIMULATOR,
    "report": TORCH | SIMULATOR,
    "robots": TORCH,
    "joints": SIMULATOR,
}
"""Room -> packages that none of its modules may reach, by any chain of imports."""

ONLY_HERE = {("robots", "mujoco"): {"robots/build.py"}, ("joints", "torch"): {"joints/actuator_net.py"}}
"""(Room, package) -> the only modules of the room that may import it."""

PICKLES = frozenset({"pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"})
"""Modules that execute what they read."""

LONGEST_MODULE = 350
LONGEST_FUNCTION = 70

MODULES = sorted(HOUSE.rglob("*.py"))
TREES = {path: ast.parse(path.read_text(), str(path)) for path in MODULES}
NAMES = {path: path.relative_to(HOUSE).as_posix() for path in MODULES}
BY_NAME = {
    ".".join(("stiction", *path.relative_to(HOUSE).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in MODULES
}
"""Dotted name -> module."""

Import = tuple[str, int]
"""Dotted name of what is imported, and the line."""


def imports(nodes: Iterator[ast.AST], package: str = "stiction") -> list[Import]:
    """Return every import among `nodes`; `package` is where a relative import starts from.

    `from a import b` counts as `a.b`: b may be a module.
    """
    found = []
    for node in nodes:
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parent = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            base = ".".join(part for part in (parent, node.module) if part)
            found += [(f"{base}.{alias.name}", node.lineno) for alias in node.names]
    return found


def package_of(path: Path) -> str:
    """Return the dotted package that holds a module: `stiction.formats`."""
    return ".".join(("stiction", *path.relative_to(HOUSE).parts[:-1]))


def all_imports(path: Path) -> list[Import]:
    """Return every import of a module, those inside functions included."""
    return imports(ast.walk(TREES[path]), package_of(path))


def imports_at_the_top(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes that run when a module is imported: no function bodies, nothing under TYPE_CHECKING."""
    waiting: list[ast.AST] = list(tree.body)
    while waiting:
        node = waiting.pop()
        yield node
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting += node.orelse
            continue
        waiting += ast.iter_child_nodes(node)


def room_of(name: str) -> str | None:
    """Return the room of a dotted name, None outside the house and for the package's own names."""
    parts = name.split(".")
    return parts[1] if parts[0] == "stiction" and len(parts) > 1 and parts[1] in FLOORS else None


def climbs(room: str, target: str) -> bool:
    """Say whether an import from `room` to room `target` breaks a wall."""
    return target != room and (FLOORS[target] >= FLOORS[room] or (room == "report" and target != "formats"))


def forbidden_calls(tree: ast.Module) -> list[str]:
    """Return what would execute code from a file: pickles, eval and exec, torch's save and load."""
    found = [f"import {name}, line {line}" for name, line in imports(ast.walk(tree)) if name.split(".")[0] in PICKLES]
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            if called in {"eval", "exec", "torch.load", "torch.save"}:
                found.append(f"{called}(), line {node.lineno}")
            found += [
                f"allow_pickle, line {node.lineno}"
                for keyword in node.keywords
                if keyword.arg == "allow_pickle" and ast.unparse(keyword.value) != "False"
            ]
        elif isinstance(node, ast.ImportFrom) and node.module == "torch":
            found += [f"torch.{a.name}, line {node.lineno}" for a in node.names if a.name in {"load", "save"}]
    return found


def public_definitions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]:
    """Yield the public classes and functions of a module, and the public methods of its public classes."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node
            if isinstance(node, ast.ClassDef):
                yield from public_definitions(ast.Module(node.body, []))


def reachable(start: Path, when_imported: bool = False) -> dict[str, list[str]]:
    """Return the packages outside the house that a module reaches -> the chain of modules that leads there.

    `when_imported`: only what its import loads; else also what its functions import when they are called.
    """
    outside: dict[str, list[str]] = {}
    seen, waiting = {start}, [(start, [NAMES[start]])]
    while waiting:
        path, chain = waiting.pop()
        nodes = imports_at_the_top(TREES[path]) if when_imported else ast.walk(TREES[path])
        for name, _ in imports(nodes, package_of(path)):
            if not name.startswith("stiction"):
                outside.setdefault(name.split(".")[0], chain)
                continue
            parts = name.split(".")
            for target in {BY_NAME.get(".".join(parts[:count])) for count in range(1, len(parts) + 1)} - {None, *seen}:
                seen.add(target)
                waiting.append((target, [*chain, NAMES[target]]))
    return outside


def in_rooms(*rooms: str) -> list[Path]:
    """Return the modules of some rooms, of all when none is named."""
    return [path for path in MODULES if path.parent != HOUSE and (not rooms or NAMES[path].split("/")[0] in rooms)]


def each(paths: list[Path]) -> pytest.MarkDecorator:
    """Run a test once a module."""
    return pytest.mark.parametrize("path", paths, ids=[NAMES[path] for path in paths])


def test_every_folder_is_a_room_of_the_design() -> None:
    """If this failed, a room without a floor would escape every wall below."""
    rooms = {path.parent.relative_to(HOUSE).parts[0] for path in in_rooms()}
    assert rooms <= set(FLOORS), f"rooms without a floor: {sorted(rooms - set(FLOORS))}"
    assert {path.name for path in MODULES if path.parent == HOUSE} <= {"__init__.py", "__main__.py"}


def test_the_rules_find_what_they_forbid() -> None:
    """If this failed, the walls would stand on paper only."""
    assert climbs("identify", "sim")
    assert climbs("robots", "joints")
    assert climbs("formats", "cli")
    assert climbs("report", "robots")
    assert not climbs("report", "formats")
    assert not climbs("rma", "locomotion")
    source = (
        "from ..sim import native\nfrom . import log\nimport numpy\ndef f():\n    from stiction.rma import runner\n"
    )
    found = [name for name, _ in imports(ast.walk(ast.parse(source)), "stiction.identify")]
    assert found == ["stiction.sim.native", "stiction.identify.log", "numpy", "stiction.rma.runner"]
    lazy = ast.parse("import rich\nif TYPE_CHECKING:\n    import torch\ndef f():\n    import mujoco\n")
    assert imports(imports_at_the_top(lazy)) == [("rich", 1)]
    chain = reachable(HOUSE / "robots/build.py")["mujoco"]
    assert chain == ["robots/build.py"]
    assert "mujoco" in reachable(HOUSE / "robots/build.py", when_imported=True)
    assert "torch" in reachable(HOUSE / "cli/train.py")
    assert "torch" not in reachable(HOUSE / "cli/train.py", when_imported=True)
    assert reachable(HOUSE / "sim/warp.py", when_imported=True).keys() >= {"warp", "mujoco_warp", "mujoco"}


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
    """If this failed, a file from a stranger could run code."""
    assert len(forbidden_calls(ast.parse(source))) == 1
    assert not forbidden_calls(ast.parse("model.eval()\nnp.load('a', allow_pickle=False)\njson.load(file)"))


@each(in_rooms())
def test_a_room_imports_only_from_floors_below(path: Path) -> None:
    """If this failed, a change upstairs could break the ground floor."""
    room = NAMES[path].split("/")[0]
    wrong = [f"{name}, line {line}" for name, line in all_imports(path) if (t := room_of(name)) and climbs(room, t)]
    assert not wrong, f"{NAMES[path]} (floor {FLOORS[room]}) imports {wrong}"


@each(in_rooms(*WITHOUT))
def test_rooms_stay_free_of_torch_and_the_simulator(path: Path) -> None:
    """If this failed, the base install could not identify, verify or deploy on an on-board computer."""
    room = NAMES[path].split("/")[0]
    if room in {room for room, _ in ONLY_HERE}:
        reached = {name: [NAMES[path]] for name in {name.split(".")[0] for name, _ in all_imports(path)}}
    else:
        reached = reachable(path)
    wrong = {package: reached[package] for package in WITHOUT[room] & set(reached)}
    for (owner, package), allowed in ONLY_HERE.items():
        if owner == room and package in reached and NAMES[path] not in allowed:
            wrong[package] = reached[package]
    assert not wrong, "; ".join(f"{package} by {' -> '.join(chain)}" for package, chain in wrong.items())


@each(in_rooms("formats"))
def test_formats_need_numpy_and_the_standard_library_alone(path: Path) -> None:
    """If this failed, reading a file that passes between stages would drag a library in; Parquet has one of its own."""
    packages = {name.split(".")[0] for name, _ in all_imports(path)}
    when_imported = {name.split(".")[0] for name, _ in imports(imports_at_the_top(TREES[path]))}
    only_called = {"pyarrow"} if NAMES[path] == "formats/parquet.py" else set()
    assert packages - only_called <= sys.stdlib_module_names | {"numpy", "stiction"}
    assert not only_called & when_imported


@each(MODULES)
def test_every_package_imported_is_a_declared_dependency(path: Path) -> None:
    """If this failed, the program would work here by the accident of what else is installed."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    requirements = sum(project["optional-dependencies"].values(), project["dependencies"])
    declared = {re.findall(r"^[a-z0-9-]+", text)[0] for text in requirements}
    packages = {name.split(".")[0] for name, _ in all_imports(path)} - sys.stdlib_module_names - {"stiction"}
    distributions = metadata.packages_distributions()
    undeclared = [
        name
        for name in packages
        if declared.isdisjoint(dist.lower().replace("_", "-") for dist in distributions.get(name, [name]))
    ]
    assert not undeclared, f"add to pyproject.toml: {undeclared}"


def test_training_on_the_processor_needs_no_gpu_package() -> None:
    """If this failed, `stiction[train]` alone could not train: only what --device asks for is imported."""
    modules = [path for path in in_rooms() if NAMES[path] not in ("sim/warp.py", "sim/mirror.py", "sim/warp_parts.py")]
    eager = [NAMES[path] for path in modules if {"warp", "mujoco_warp"} & set(reachable(path, when_imported=True))]
    assert not eager


@each(in_rooms("cli"))
def test_a_verb_loads_its_room_only_when_called(path: Path) -> None:
    """If this failed, `stiction VERB --help` would need torch or a simulator, and take seconds.

    What a verb's flags are made of, configuration without libraries, may be imported at the top.
    """
    light = sys.stdlib_module_names | {"stiction", "rich", "tyro", "numpy"}
    heavy = {package: chain for package, chain in reachable(path, when_imported=True).items() if package not in light}
    assert not heavy, "; ".join(f"{package} by {' -> '.join(chain)}" for package, chain in heavy.items())


@each(MODULES)
def test_nothing_executes_what_it_reads(path: Path) -> None:
    """If this failed, opening a log, a checkpoint or a bundle could run somebody's code."""
    assert not forbidden_calls(TREES[path])


@each(MODULES)
def test_modules_and_functions_stay_readable(path: Path) -> None:
    """If this failed, a module would have more than one reason to exist, or a function would not fit a screen."""
    assert len(path.read_text().splitlines()) <= LONGEST_MODULE
    functions = [node for node in ast.walk(TREES[path]) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    long = [node.name for node in functions if (node.end_lineno or 0) - node.lineno >= LONGEST_FUNCTION]
    assert not long, f"functions of {LONGEST_FUNCTION} lines or more: {long}"


@each(MODULES)
def test_everything_public_says_what_it_is(path: Path) -> None:
    """If this failed, a reader would have to guess shapes and units from the code."""
    assert ast.get_docstring(TREES[path]), "the module has no docstring"
    bare = [node.name for node in public_definitions(TREES[path]) if not ast.get_docstring(node)]
    assert not bare, f"no docstring: {bare}"
