"""Modules of both distributions, their names, syntax trees and imports: for the rules of the house."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import stiction
import stiction_experiments

HOUSE = Path(stiction.__file__).parent
EXPERIMENTS = Path(stiction_experiments.__file__).parent

PRODUCT = sorted(HOUSE.rglob("*.py"))
MODULES = [*PRODUCT, *sorted(EXPERIMENTS.rglob("*.py"))]
NAMES = {path: path.relative_to(HOUSE).as_posix() for path in PRODUCT}
NAMES |= {path: f"stiction_experiments:{path.relative_to(EXPERIMENTS).as_posix()}" for path in MODULES[len(PRODUCT) :]}
"""Module -> its path below its package, as in `source_digest`."""


def parts_of(path: Path) -> tuple[str, ...]:
    """Return the parts of the dotted name of a module."""
    root = HOUSE if HOUSE in path.parents else EXPERIMENTS
    return (root.name, *path.relative_to(root).with_suffix("").parts)


BY_NAME = {".".join(parts_of(path)).removesuffix(".__init__"): path for path in MODULES}
"""Dotted name -> module."""

Import = tuple[str, int]
"""Dotted name of what is imported, and the line."""


@cache
def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a module; not made where tests are only collected."""
    return ast.parse(path.read_text(), str(path))


def imports(nodes: Iterator[ast.AST], package: str = "stiction") -> list[Import]:
    """Return every import among `nodes`; `package` is where a relative import starts from.

    `from a import b` counts as `a.b`: b may be a module.
    """
    names = []
    for node in nodes:
        if isinstance(node, ast.Import):
            names += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            parent = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            base = ".".join(part for part in (parent, node.module) if part)
            names += [(f"{base}.{alias.name}", node.lineno) for alias in node.names]
    return names


def package_of(path: Path) -> str:
    """Return the dotted package that holds a module: `stiction.files`."""
    return ".".join(parts_of(path)[:-1])


def all_imports(path: Path) -> list[Import]:
    """Return every import of a module, those inside functions included."""
    return imports(ast.walk(tree_of(path)), package_of(path))


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
