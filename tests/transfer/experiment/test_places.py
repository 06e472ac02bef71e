"""Where a run stands, and whose folder it is."""

import json
from pathlib import Path

import pytest

from stiction.formats.errors import StictionError
from synthetic import place, write_run


def test_states(tmp_path: Path) -> None:
    """If this failed, finished runs would be trained again, or half-trained ones evaluated."""
    at = place(tmp_path)
    assert (at.state(), at.done()) == ("missing", 0)
    write_run(at, "summary.json")
    assert (at.state(), at.done(), at.iterations) == ("interrupted", 2, 2)
    write_run(at)
    assert at.state() == "finished"
    (at.path / "checkpoints/student_000001.json").unlink()
    assert at.state() == "interrupted"


def test_a_configuration_from_before_a_field_existed_is_the_same(tmp_path: Path) -> None:
    """If this failed, runs of an earlier revision would be refused though they did what the default does now."""
    at = place(tmp_path)
    write_run(at)
    header = json.loads((at.path / "config.json").read_text())
    del header["config"]["task"]["friction"]["mixture"], header["config"]["task"]["friction"]["steps"]
    (at.path / "config.json").write_text(json.dumps(header))
    assert at.state() == "finished"


def test_a_folder_of_another_run_is_refused_by_name(tmp_path: Path) -> None:
    """If this failed, a result would be reported under a condition that it was not trained with."""
    write_run(place(tmp_path, "toy", 0, "--friction-level", "0.2"))
    with pytest.raises(StictionError, match=r"toy-s0 holds another run .*task\.friction\.level is 0\.2, expected 0\.1"):
        place(tmp_path, "toy", 0, "--friction-level", "0.1").state()
