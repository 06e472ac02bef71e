"""Names in texts for trainers that are not installed here: classes, arguments and attributes of the trainers' sources,
as `trainer_names.json` lists them with the version that they were read in.
"""

from __future__ import annotations

import ast
import builtins
import json
from pathlib import Path
from typing import Any, get_args

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to write an Actuator Net")

from actuators import pd_net
from code_blocks import blocks_of
from motors import motor, number
from stiction.exchange.randomization import recipe_of
from stiction.exchange.targets import RANGES, TARGETS, ConvertOptions, Target, convert
from stiction.files.joints import JointsFile
from stiction.learning.actuator_script import actuator_files

NAMES: dict[str, dict[str, dict[str, Any]]] = json.loads(Path(__file__).with_name("trainer_names.json").read_text())
VERSIONS = [(trainer, version) for trainer, versions in NAMES.items() for version in versions]
PAGE = Path(__file__).parents[3] / "docs/trainers.md"
LIBRARIES = {"torch", "numpy", "re", "math", "pathlib"}
PLAIN = {"get", "values", "items", "unbind"}
"""Attributes of Python's containers and of tensors."""

TRAINING = {"friction": {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}, "range": [0.0, 0.24]}


def texts(trainer: str) -> list[str]:
    """Return all that is written for a trainer: values, ranges, coefficients of a load, a net; and its page's code."""
    to = next(target for target in get_args(Target) if target == trainer)
    options = [ConvertOptions(to=to)]
    if to in ("isaaclab", "legged_gym"):
        options.append(ConvertOptions(to=to, assumed_load=50.0))
    record = motor(static_friction=number(0.6), torque_limit=20.0)
    write = TARGETS[to].ranges
    assert write is not None
    written = [convert(JointsFile({"hip": record}), one).text for one in options]
    written += [write(recipe_of(TRAINING, {"hip": 20.0}), one).text for one in options]
    if to == "isaaclab":
        written.append(actuator_files(pd_net("go1", torque_source="output_side"), "isaaclab")["actuators.py"].decode())
        written += [block.text for block in blocks_of(PAGE) if block.reason == "needs Isaac Lab"]
    return written


def root(node: ast.AST) -> str:
    """Return the name that a chain of attributes, calls and items begins with."""
    while not isinstance(node, ast.Name):
        node = node.func if isinstance(node, ast.Call) else getattr(node, "value", ast.Name(""))
    return node.id


def problems(text: str, names: dict[str, Any]) -> list[str]:
    """Return the names of a text that a trainer does not have."""
    nodes, faults = list(ast.walk(ast.parse(text))), []
    imports = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    libraries = set()
    for node in imports:
        module = node.module or "" if isinstance(node, ast.ImportFrom) else node.names[0].name
        if module.partition(".")[0] in LIBRARIES:
            libraries |= {alias.asname or alias.name for alias in node.names}
        elif module.partition(".")[0] == "isaaclab":
            known = names["imports"].get(module, [])
            faults += [f"from {module} import {alias.name}" for alias in node.names if alias.name not in known]
    defined = {node.name: node for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    held = {node.attr for node in nodes if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)}
    arguments, writers = names["arguments"], [one for one in names["arguments"] if one.startswith("write_")]
    attributes: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Subscript) and root(node) == "props" and isinstance(node.slice, ast.Constant):
            attributes.add(f"props.{node.slice.value}")
        read = isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and root(node) not in libraries
        if read and (root(node.value) == "super" or node.attr not in {*defined, *held, *PLAIN}):
            attributes.add(node.attr)
        if not isinstance(node, ast.Call) or root(node) in libraries:
            continue
        name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr  # type: ignore[attr-defined]
        inherited = isinstance(node.func, ast.Attribute) and root(node.func.value) == "super"
        if name == "getattr":
            attributes.add(node.args[1].value)  # type: ignore[attr-defined]
        if not inherited and (name in defined or name in PLAIN or hasattr(builtins, name)):
            continue
        # A function of theirs that is kept, `self.write`.
        takes = arguments.get(writers[0] if name in held and writers else name)
        if takes is None or len(node.args) > len(takes):
            faults.append(f"{name}: {len(node.args)} arguments")
        faults += [f"{name}({word.arg}=)" for word in node.keywords if word.arg not in (takes or ())]
        if inherited and name in defined and isinstance(defined[name], ast.FunctionDef) and name != "__init__":
            parameters = [one.arg for one in defined[name].args.args[1:]]
            faults += [] if parameters == takes else [f"def {name}({', '.join(parameters)})"]
    # Of the writers of two versions a text takes the one that is there.
    written = {name for name in attributes if name.startswith("write_")}
    if written and not written & {*writers}:
        faults.append(f"{' or '.join(sorted(written))}")
    return faults + sorted(attributes - written - {*arguments, *names["attributes"]})


@pytest.mark.parametrize(("trainer", "version"), VERSIONS)
def test_every_name_is_one_of_the_trainers(trainer: str, version: str) -> None:
    """Each written name occurs in the trainer's sources."""
    for text in texts(trainer):
        assert problems(text, NAMES[trainer][version]) == [], text


@pytest.mark.parametrize(("trainer", "version"), VERSIONS)
def test_every_listed_name_is_needed_or_an_argument(trainer: str, version: str) -> None:
    """Without a name of the list a text that uses it is found out, so that the test above can fail."""
    names = NAMES[trainer][version]
    for attribute in names["attributes"]:
        less = names | {"attributes": [one for one in names["attributes"] if one != attribute]}
        assert any(problems(text, less) for text in texts(trainer)), attribute
    for function, words in names["arguments"].items():
        fewer = names | {"arguments": {key: value for key, value in names["arguments"].items() if key != function}}
        assert any(problems(text, fewer) for text in texts(trainer)), function
        none = names | {"arguments": names["arguments"] | {function: []}}
        assert not words or any(problems(text, none) for text in texts(trainer)), function


def test_every_trainer_that_does_not_run_here_is_listed() -> None:
    """MuJoCo and Playground run, in MuJoCo and MJX; a new target is run or listed."""
    assert {*RANGES} - {"mujoco", "playground"} == {*NAMES}
