"""The records of the shipped robots are those that their sources make."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from stiction.robots.catalog import SHIPPED, find_robot, robot_names


def flat(value: object, path: str = "") -> dict[str, object]:
    """Return the leaves of plain data by their paths."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    leaves = {key: leaf for name, part in items for key, leaf in flat(part, f"{path}/{name}").items()}
    return leaves if isinstance(value, dict | list) else {path: value}


def test_every_record_is_what_its_module_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last digit but two, which processors round differently: a number changed in one place is of no robot."""
    import write

    monkeypatch.setattr(sys, "argv", ["write.py", "--out", str(tmp_path)])
    write.main()
    assert sorted(write.ROBOTS) == list(robot_names()) == sorted(path.stem for path in SHIPPED.glob("*.json"))
    for name in write.ROBOTS:
        made, shipped = (flat(json.loads((folder / f"{name}.json").read_text())) for folder in (tmp_path, SHIPPED))
        assert made.keys() == shipped.keys() and find_robot(name).name == name
        for key, value in shipped.items():
            assert made[key] == (pytest.approx(value, rel=1e-12, abs=1e-15) if isinstance(value, float) else value), key
