"""`training.json`: the joint friction to train with, as identification proposes it and `stiction train` reads it.

Its object `friction` holds fields of the run's own `config.json` under `task.friction`, so that a proposal
and a run can be compared line by line. The rest is for people: what the level rests on, joint by joint.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from stiction.formats.errors import StictionError

SCHEMA_VERSION = 1
"""Raised when a reader of the older form would misunderstand the newer one."""


def write_training(path: Path, proposal: dict[str, Any]) -> None:
    """Write a proposal: `friction`, null where none can be proposed, `text`, and whatever else explains it."""
    text = json.dumps({"schema_version": SCHEMA_VERSION, **proposal}, indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_training(path: Path) -> dict[str, Any]:
    """Return the whole proposal; raise `StictionError` for a file that is none, or proposes no friction."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StictionError(f"cannot read {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise StictionError(f"{path.name}: not JSON ({str(error)[:120]}); expected a training.json") from error
    if isinstance(data, dict) and {"joints", "warnings"} <= data.keys() and "friction" not in data:
        raise StictionError(
            f"{path.name}: these are identified joints; expected the training.json that lies beside them"
        )
    if not isinstance(data, dict) or "friction" not in data or data.get("schema_version") != SCHEMA_VERSION:
        found = data.get("schema_version") if isinstance(data, dict) else None
        raise StictionError(
            f"{path.name}: schema version {found!r}; expected the training.json of `stiction identify`, with "
            f"'friction' and version {SCHEMA_VERSION}"
        )
    if data["friction"] is None:
        reason = " ".join(str(data.get("text", "it does not say why")).split())[:400]
        raise StictionError(f"{path.name} proposes no joint friction to train with: {reason}")
    if not isinstance(data["friction"], dict) or not {"method", "level"} <= data["friction"].keys():
        raise StictionError(f"{path.name}: 'friction' is {data['friction']!r}; expected at least 'method' and 'level'")
    return data
