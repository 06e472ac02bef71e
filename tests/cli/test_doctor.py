"""`stiction doctor` as a user runs it: a table or JSON, and a status that a script can use."""

import json

import pytest

from stiction.cli.main import main
from stiction.sim.fleet import Fleet


def test_sound_randomisation_is_status_zero(capsys: pytest.CaptureFixture) -> None:
    """JSON and nothing else on standard output; every row says what was measured."""
    assert main(["doctor", "--randomization", "--robot", "go1", "--json"]) == 0
    audit = json.loads(capsys.readouterr().out)
    assert audit["ok"] and audit["robot"] == "go1"
    assert all(row["ok"] and row["quantity"] for row in audit["rows"]) and len(audit["rows"]) > 15


def test_randomisation_that_does_nothing_is_status_one(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The parameter is named on standard error."""
    monkeypatch.setattr(Fleet, "set_gains", lambda *_: None)
    assert main(["doctor", "--randomization", "--robot", "go1"]) == 1
    captured = capsys.readouterr()
    assert "motor_strength, stiffness" in captured.err and "DOES NOTHING" in captured.out.replace("\n", " ")
    lines = captured.out.splitlines()
    assert lines[1].startswith("As declared: NO, ") and lines[-1].startswith("good: ") and "friction" in lines[-1]
    assert all("DOES NOTHING" in line for line in lines if line.startswith(("stiffness", "motor_strength")))


@pytest.mark.parametrize("options", [["--set", "task.randomization.payload=[0,0]"], ["--set", "task.timestep=0.002"]])
def test_other_tasks_are_audited_or_refused_without_a_traceback(options: list[str]) -> None:
    """A row switched off is skipped; a delay that the model cannot hold is refused."""
    try:
        assert main(["doctor", "--randomization", "--robot", "go1", "--json", *options]) in (0, 1)
    except SystemExit as stop:
        assert stop.code == 2


@pytest.mark.parametrize("more", [[], ["--json"], ["--randomization"]])
def test_an_empty_name_of_a_task_is_refused(more: list[str], capsys: pytest.CaptureFixture) -> None:
    """A variable of the shell that is not set would pass as an audit."""
    with pytest.raises(SystemExit) as stop:
        main(["doctor", "--mjlab", "", *more])
    captured = capsys.readouterr()
    assert stop.value.code == 2 and not captured.out and "--mjlab: got an empty name, expected that of" in captured.err
