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


@pytest.mark.parametrize("options", [["--set", "task.randomization.payload=[0,0]"], ["--set", "task.timestep=0.002"]])
def test_other_tasks_are_audited_or_refused_without_a_traceback(options: list[str]) -> None:
    """A row switched off is skipped; a delay that the model cannot hold is refused."""
    try:
        assert main(["doctor", "--randomization", "--robot", "go1", "--json", *options]) in (0, 1)
    except SystemExit as stop:
        assert stop.code == 2


def test_what_the_audit_would_not_see_is_refused(capsys: pytest.CaptureFixture) -> None:
    """If this failed, a range would be called sound that no robot is drawn from."""
    words = ["doctor", "--randomization", "--robot", "go1", "--set", "task.randomization.known_friction=[0.5,1.5]"]
    assert main(words) == 1
    printed = capsys.readouterr().err
    assert "has no effect without --task.known-friction; leave it out" in printed and printed.count("\n") == 1


def test_machine_is_described(capsys: pytest.CaptureFixture) -> None:
    """Without an audit: what a bug report needs."""
    assert main(["doctor", "--json"]) == 0
    assert {"cpu", "cores", "threads", "packages"} <= json.loads(capsys.readouterr().out).keys()


def test_a_robot_without_an_audit_is_wrong_usage(capsys: pytest.CaptureFixture) -> None:
    """If this failed, a robot that there is not would end with the machine's facts and status 0."""
    with pytest.raises(SystemExit) as stop:
        main(["doctor", "--robot", "no_such_robot"])
    assert stop.value.code == 2
    printed = capsys.readouterr()
    assert not printed.out and "--randomization" in printed.err and printed.err.count("\n") == 1
