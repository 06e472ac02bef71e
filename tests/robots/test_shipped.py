"""The records of the shipped robots are those that their sources make."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from stiction.robots.catalog import SHIPPED, find_robot, robot_names


def test_every_record_is_what_its_module_makes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit: a number changed in one place alone would be of no known robot."""
    import write

    monkeypatch.setattr(sys, "argv", ["write.py", "--out", str(tmp_path)])
    write.main()
    assert sorted(write.ROBOTS) == list(robot_names()) == sorted(path.stem for path in SHIPPED.glob("*.json"))
    for name, robot in write.ROBOTS.items():
        assert find_robot(name) == robot
        assert (tmp_path / f"{name}.json").read_bytes() == (SHIPPED / f"{name}.json").read_bytes()
