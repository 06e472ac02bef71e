"""The file that `identify` advises by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stiction.files.advice import Source, TrainedWith, read_advice
from stiction.files.following import CommandCount
from stiction_experiments.lab.files import write_source

CELL = CommandCount("none", "mujoco", "coulomb", 0.01, 5, 4, 75, 74, 0.001, 0.05, "wz=1: too slow")
WAYS = {"none": TrainedWith("none", 0.0, 0.0, 0.0)}
SOURCE = Source("stiction train", "abc", "saturn_lite", 6, ("p/student",), WAYS, (CELL,))


def test_a_study_writes_its_own_part_and_leaves_the_others(tmp_path: Path) -> None:
    """Whoever repeats one study must not lose what the other found."""
    path = tmp_path / "advice.json"
    write_source(path, "replication", SOURCE)
    write_source(path, "friction-training", replace(SOURCE, revision="def"))
    write_source(path, "replication", replace(SOURCE, revision="ghi"))
    assert read_advice(path) == {
        "friction-training": replace(SOURCE, revision="def"),
        "replication": replace(SOURCE, revision="ghi"),
    }
