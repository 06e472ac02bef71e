"""Any log that can be read: the canonical CSV and NPZ, and MATLAB version 5 by a column mapping."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stiction.formats.log import SIGNALS, Log, LogError, assemble, read_log
from stiction.identify.matlab import read_mat


def open_log(path: Path, columns: dict[str, str] | None = None, joint: str | None = None) -> Log:
    """Read a log by its suffix; `columns` and `joint` as in `read_log`. Raises `LogError`."""
    if path.is_dir():
        raise LogError(f"{path} is a directory; expected a log, a .csv, .npz or .mat file")
    if not path.is_file():
        raise LogError(f"no log at {path}; expected a .csv, .npz or .mat file")
    if path.suffix.lower() == ".mat":
        if not columns:
            raise LogError(
                f"{path.name}: a MATLAB log needs a column mapping: --columns time=NAME position=NAME torque=NAME"
            )
        return assemble(path, read_mat(path), columns, joint)
    return read_log(path, columns, joint)


def parse_columns(words: Sequence[str]) -> dict[str, str]:
    """Turn `position=qm` words into role -> column; raise `LogError` for anything else."""
    mapping: dict[str, str] = {}
    for word in words:
        role, equals, name = word.partition("=")
        if not equals or not name or role not in ("time", *SIGNALS) or role in mapping:
            raise LogError(
                f"column mapping {word!r}: expected ROLE=NAME, once each, ROLE one of time, {', '.join(SIGNALS)}"
            )
        mapping[role] = name
    return mapping
