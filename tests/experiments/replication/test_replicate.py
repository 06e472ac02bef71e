"""`stiction replicate` from the command line, with good and with bad input."""

import csv
import json
import re
from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.results import read_results
from stiction_experiments.replication.study import ReplicateOptions, train_all
from words import but

pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


LOAD = ("--parts", "load")
"""A part that needs no other engine than the one of the training."""


def test_a_part_is_walked_judged_and_gone_on_with(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, undrawn: None
) -> None:
    """One file a table, a verdict a sentence; the same command again walks nothing."""
    monkeypatch.setattr("stiction_experiments.replication.plan.SECONDS", 3.0)
    arguments = ["replicate", "--policies", str(bundle), "--parts", "load", "--jobs", "1"]
    assert main([*arguments, "--out", str(tmp_path), "--json"]) == 0
    verdicts = json.loads(capsys.readouterr().out)
    assert verdicts["X1"] == "not tested"  # one seed
    rows = read_results(tmp_path / "results.csv")
    assert {(row.friction_law, row.engine, row.method) for row in rows} == {("load", "mujoco", "none")}
    with (tmp_path / "verdicts.csv").open() as file:
        told = {row["id"]: row["evidence"] for row in csv.DictReader(file)}
    assert "(one seed)" in told["X1"]
    with (tmp_path / "evidence.csv").open() as file:
        behind = [row for row in csv.DictReader(file) if (row["claim"], row["column"]) == ("X1", "speed_ratio")]
    by_command = {row.command: row.speed_ratio for row in rows if row.friction_level == 0.442}
    assert {row["command"]: float(row["each"]) for row in behind} == pytest.approx(by_command, rel=1e-5)
    monkeypatch.setattr("stiction.evaluation.run.walk_unit", lambda *rest: pytest.fail("walked again"))
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("One training seed a method: numbers, no verdicts.")
    assert "report.html" in printed
    assert "One training seed a method: numbers, no verdicts." in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--parts", "moon"], "known: training, engines, robot"),
        ([*LOAD, "--policies", "nothing"], "unknown policy"),
        ([*LOAD, "--policies", "{bundle}", "{bundle}"], "two bundles"),
        (["--jobs", "0"], "at least 1"),
        (["--num-robots", "0"], "--num-robots 0: expected at least 1"),
        ([*LOAD, "--out", "{bundle}/card.md"], "--out"),
        ([*LOAD, "--policies", "{begun}"], "expected a folder that `stiction train` made"),
        (["--plan"], "--plan requires --preset full"),
        (["--plan", "--preset", "full"], "--plan and --out exclude"),
    ],
)
def test_bad_input_is_one_line(
    bundle: Path, tmp_path: Path, capsys: pytest.CaptureFixture, arguments: list[str], message: str
) -> None:
    """Status 1, what came, what was expected."""
    begun = tmp_path / "begun"
    (begun / "checkpoints").mkdir(parents=True)
    filled = [argument.replace("{bundle}", str(bundle)).replace("{begun}", str(begun)) for argument in arguments]
    assert main(["replicate", *but(("--out", str(tmp_path / "out")), *filled)]) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_a_plan_names_every_training_and_begins_none(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A training that the plan leaves out, of a net that is not fitted yet, costs hours that nobody reckoned with."""
    assert main(["replicate", "--preset", "full", "--plan", "--runs", str(tmp_path)]) == 0
    *planned, total = capsys.readouterr().out.splitlines()
    assert not list(tmp_path.iterdir())
    assert re.match(rf"{len(planned)} runs, .* {len(planned)} are missing, some [\d.]+ hours of one core", total)
    monkeypatch.setattr("stiction_experiments.replication.study.known_joints", lambda *rest: tmp_path / "joints.json")
    monkeypatch.setattr("stiction_experiments.replication.study.known_net", lambda *rest: tmp_path / "net")
    monkeypatch.setattr("stiction_experiments.friction.training.train_missing", lambda *rest, **more: {})
    folders, _ = train_all(ReplicateOptions(preset="full", runs=tmp_path), 1, lambda *share: None, lambda text: None)
    assert [line.rpartition(" --out ")[2] for line in planned] == [str(folder) for folder in folders]


def test_a_training_that_fails_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One diverged run would cost the days of all others; a net of a policy that is not there cannot be made."""
    messages: list[str] = []
    broken = {"stairs-none-s1": "training diverged", "coulomb20-none-s2": "training diverged"}
    monkeypatch.setattr("stiction_experiments.replication.study.known_joints", lambda *rest: tmp_path / "joints.json")
    monkeypatch.setattr(
        "stiction_experiments.replication.study.known_net", lambda runs, first, *rest: runs / f"net of {first.name}"
    )
    monkeypatch.setattr(
        "stiction_experiments.friction.training.train_missing",
        lambda places, *rest, **more: {at.run.name: broken[at.run.name] for at in places if at.run.name in broken},
    )
    trained = train_all(ReplicateOptions(preset="full", runs=tmp_path), 1, lambda *share: None, messages.append)
    assert not isinstance(trained, int)
    folders, failed = trained
    assert set(failed) == {*broken, "coulomb20-actuator-s2", "coulomb20-actuator-output-s2"}
    assert failed["coulomb20-actuator-s2"].startswith("coulomb20-none-s2 failed")
    names = {folder.name for folder in folders}
    assert {"stairs-none-s0", "coulomb20-actuator-s1", "coulomb20-direct-s2"} <= names
    assert not names & set(failed)
    assert all(f"{name} is left out: {reason}" in messages for name, reason in failed.items())
    monkeypatch.setattr(
        "stiction_experiments.friction.training.train_missing",
        lambda places, *rest, **more: {at.run.name: "no room" for at in places},
    )
    with pytest.raises(StictionError, match="could be trained"):
        train_all(ReplicateOptions(preset="full", runs=tmp_path), 1, lambda *share: None, messages.append)
