"""Docstrings and variables that have to be read twice, by the syntax tree of a module: for the rules of the house."""

from __future__ import annotations

import ast
import re
from pathlib import Path

TREES = ("src", "examples", "tools", "experiments", "tests")
"""Folders of the repository that hold code."""

NO_NOUN = re.compile(r"\s*(Of|What|Whether|Who|Whose|Those|That|Which|If|There)\b")
"""First words of a docstring that hide its noun or verb."""

VAGUE = frozenset({"found", "said", "given", "beside"})
"""Names that say nothing about a value."""


def reread_docstrings(tree: ast.Module) -> list[str]:
    """Return the docstrings that begin with a word of `NO_NOUN`; a string that stands alone is a docstring."""
    return [
        f"line {node.lineno}: {node.value.value.strip()[:60]}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        if isinstance(node.value.value, str) and NO_NOUN.match(node.value.value)
    ]


def vague_variables(tree: ast.Module) -> list[str]:
    """Return the variables and parameters, fields of classes included, that have a name of `VAGUE`."""
    variables = []
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name) | ast.ExceptHandler(name=name):
                variables += [f"line {node.lineno}: {name}"] if name in VAGUE else []
    return variables


RULES = {"docstrings": reread_docstrings, "variables": vague_variables}
"""Name of a rule -> function from a syntax tree to its violations, a line each."""


def violations(folder: Path) -> dict[str, list[str]]:
    """Return the violations of each rule in all modules of a folder, each with the path of its module."""
    trees = {path: ast.parse(path.read_text(), str(path)) for path in sorted(folder.rglob("*.py"))}
    return {
        name: [f"{path.relative_to(folder.parent)}, {one}" for path, tree in trees.items() for one in rule(tree)]
        for name, rule in RULES.items()
    }
