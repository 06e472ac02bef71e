"""The file that `identify` advises by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.files.advice import Source, TrainedWith, read_advice
from stiction.files.straight import Following
from stiction_experiments.lab.files import write_source

CELL = Following("none", "mujoco", "coulomb", 0.01, 5, 4, 0, 1, 0, 0.1, "1.00/1.00 1.25/1.00")
WAYS = {"none": TrainedWith("none", 0.0, 0.0, 0.0)}
SOURCE = Source("stiction study friction", "abc", "saturn_lite", 6, ("p/student",), WAYS, (CELL,))


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


@pytest.mark.parametrize("text", ["{", "[]", '{"schema_version": 1, "sources": {}}', '{"schema_version": 2}'])
def test_another_file_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    """It would be advised by nonsense, or overwritten."""
    path = tmp_path / "advice.json"
    path.write_text(text)
    with pytest.raises(StictionError, match=r"advice\.json: "):
        read_advice(path)
    with pytest.raises(StictionError):
        write_source(path, "replication", SOURCE)
    assert path.read_text() == text


@pytest.mark.parametrize(
    ("robot", "feet", "text"),
    [
        ("saturn_lite", 6, "the hexapod Saturn Lite"),
        ("go2", 4, "the quadruped Go2"),
        ("my/dog.xml", 5, "the robot my/dog.xml"),
    ],
)
def test_a_robot_has_a_name_that_people_read(robot: str, feet: int, text: str) -> None:
    """Whoever reads the verdict must know what walked, and may have no file of that name."""
    assert replace(SOURCE, robot=robot, feet=feet).robot_text == text
