"""The JSON Schema of contract.json, made from the dataclass and its rules; `contract.schema.json` beside it is a copy.

`python -m stiction.files.contract_schema` prints it. A contract that fits the schema may still be refused: a schema
cannot say that two fields agree.
"""

from __future__ import annotations

import ast
import inspect
import json
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from stiction.files.contract import LATER, MOST_JOINTS, Contract
from stiction.files.contract_rules import NAME, PER_JOINT, RULES, SCHEMA_VERSION, SHARE, SPEED_RATIO, TERM_RULES
from stiction.files.observation import (
    FRAMES,
    LONGEST_HISTORY,
    MOST_ENTRIES,
    MOST_TERMS,
    TERM_NAMES,
    ObservationLayout,
    Term,
)

PATH = Path(__file__).with_name("contract.schema.json")
"""The copy that comes with the package."""

BESIDE = (
    "Beyond this schema: lists over joints have one length; control_period is decimation times physics_timestep; "
    "standing lies between lower and upper; friction_level is the mean of friction over torque_limit (of coefficients, "
    "of friction); friction_law is one that the reader knows, and has its numbers in stribeck; terms have the sizes of "
    "what they observe; anatomy has the contract's name, joints, limits and gains, unit axes, and inertias that a body "
    "can have; the maker's order names every joint once; method, friction, commands and settings agree; a file with a "
    "later field has all earlier ones; integers are written without a point; no key stands twice."
)

OBSERVATION = {
    "history_length": {"type": "integer", "minimum": 1, "maximum": LONGEST_HISTORY},
    "direction": {"enum": ["oldest_first", "newest_first"]},
    "layout": {"enum": ["frame_major", "term_major"]},
    "fill": {"enum": ["first", "zero"]},
    "slow_kept": {"type": ["number", "null"], "exclusiveMinimum": 0, "exclusiveMaximum": 1},
}

TERM = {
    "name": {"enum": list(TERM_NAMES)},
    "size": {"type": "integer", "minimum": 1, "maximum": MOST_ENTRIES},
    "frame": {"enum": sorted(set(FRAMES.values()))},
    "offset": {"enum": ["none", "standing"]},
    "history_length": {"type": ["integer", "null"], "minimum": 1, "maximum": LONGEST_HISTORY},
} | {name: {"anyOf": [rule.schema, {"type": "array", "items": rule.schema}]} for name, rule in TERM_RULES.items()}


def contract_schema() -> dict[str, Any]:
    """Return the JSON Schema, draft 2020-12, of the contracts that this version reads."""
    own = {name: rule.schema for name, rule in RULES.items()}
    own["schema_version"] = {"enum": list(range(1, SCHEMA_VERSION + 1))}
    own |= {name: _each(rule.schema) for name, rule in PER_JOINT.items()}
    own["joint_names"] = _each(NAME.schema) | {"uniqueItems": True}
    own["friction_law"] = NAME.schema
    own["compensation"] = _or_null(own["compensation"])
    own["action_scale"] = {"anyOf": [PER_JOINT["action_scale"].schema, own["action_scale"]]}
    own["stribeck"] = _or_null({"type": "array", "prefixItems": [rule.schema for rule in SPEED_RATIO],
                                "minItems": 2, "maxItems": 2})  # fmt: skip
    own["known_friction"] = _or_null({"type": "object", "additionalProperties": SHARE.schema})
    term = _record(Term, TERM)
    layout = OBSERVATION | {"terms": {"type": "array", "items": term, "minItems": 1, "maxItems": MOST_TERMS}}
    own["observation"] = _record(ObservationLayout, layout)
    whole = _record(Contract, own, optional=set(LATER))
    # A field that came after version 1 may be missing up to the version in `LATER`, and in none that follows.
    missing = {name for name, last in LATER.items() if last < SCHEMA_VERSION}
    newest = {"properties": {"schema_version": {"const": SCHEMA_VERSION}}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:stiction:contract:{SCHEMA_VERSION}",
        "title": "The contract of a policy bundle of stiction, contract.json",
        "$comment": BESIDE,
        **whole,
        "if": newest,
        "then": {"required": sorted(missing)},
    }


def schema_text() -> str:
    """Return the text of contract.schema.json."""
    return json.dumps(contract_schema(), indent=1, ensure_ascii=False) + "\n"


def _each(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a list with one value for each joint."""
    return {"type": "array", "items": schema, "minItems": 1, "maxItems": MOST_JOINTS}


def _or_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a value that may be absent."""
    return {"anyOf": [schema, {"type": "null"}]}


def _record(kind: type, own: Mapping[str, Any] | None = None, optional: set[str] | None = None) -> dict[str, Any]:
    """Return the schema of a dataclass.

    Args:
        kind: its fields, types and docstrings become properties.
        own: schemas of fields of which more is known than their type.
        optional: fields that may be missing; by default those with a default.

    """
    hints, words = get_type_hints(kind), _docstrings(kind)
    properties, required = {}, []
    for field in fields(kind):
        schema = (own or {}).get(field.name) or _of_type(hints[field.name])
        properties[field.name] = ({"description": words[field.name]} if field.name in words else {}) | schema
        absent = field.default is not MISSING or field.default_factory is not MISSING
        if not (absent if optional is None else field.name in optional):
            required.append(field.name)
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _of_type(hint: Any) -> dict[str, Any]:
    """Return the schema of a type hint of our records."""
    inner, origin = get_args(hint), get_origin(hint)
    if isinstance(hint, type) and is_dataclass(hint):
        return _record(hint)
    if origin in (Union, UnionType):
        return {"anyOf": [_of_type(item) for item in inner]}
    if origin is Literal:
        return {"enum": list(inner)}
    if origin is tuple:
        if inner[-1] is Ellipsis:
            return {"type": "array", "items": _of_type(inner[0])}
        return {"type": "array", "prefixItems": [_of_type(item) for item in inner], "minItems": len(inner),
                "maxItems": len(inner)}  # fmt: skip
    return {"type": {float: "number", int: "integer", str: "string", bool: "boolean", type(None): "null"}[hint]}


def _docstrings(kind: type) -> dict[str, str]:
    """Return field -> the docstring under it, in one line."""
    # Python keeps no docstrings of fields: they are read from the source.
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, after in zip(body.body, body.body[1:]):
        said = (
            isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
        )
        if said and isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            found[field.target.id] = " ".join(after.value.value.split())  # type: ignore[attr-defined]
    return found


if __name__ == "__main__":
    print(schema_text(), end="")
