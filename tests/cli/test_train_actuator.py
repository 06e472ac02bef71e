"""An Actuator Net from the command line, from the logs of a walk to a policy that was trained with it."""

import json
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")

import numpy as np

from actuators import pd_net
from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.files.actuator import FILE, write_actuator
from stiction.learning.run import RunDirectory, latest_checkpoint, load_checkpoint
from stiction.learning.runner import PhaseRunner
from words import but

SMALL = [
    *("--robot", "go1", "--num-envs", "4", "--json", "--checkpoint-every", "1", "--method", "none"),
    *("--preset", "two-phase", "--video-every", "0"),
    *("--teacher.iterations", "2", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
]


def test_from_a_walk_to_a_net(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The verb evaluate logs the side that was asked for, train-actuator fits and prints JSON and nothing else."""
    logs, out = tmp_path / "logs", tmp_path / "net"
    walk = ["evaluate", "saturn_lite-flat-none-0.2", "--friction-levels", "0.2", "--commands", "vx=-0.5"]
    walk += ["--episodes", "1", "--seconds", "3", "--log", str(logs), "--log-robots", "2", "--log-seconds", "1"]
    assert main([*walk, "--log-torque", "output_side", "--out", str(tmp_path / "evaluation"), "--json"]) == 0
    capsys.readouterr()
    options = ["--epochs", "1", "--hidden", "4", "--out", str(out), "--json"]
    assert main(["train-actuator", str(logs), *options]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["torque_source"] == "output_side" and list(summary["commands"]) == ["vx=-0.5"]
    assert {path.name for path in out.iterdir()} == {FILE, "fit.npz", "summary.json", "settings.json", "report.html"}
    with pytest.raises(SystemExit) as stop:
        main(["train-actuator", "--out", str(out)])
    assert stop.value.code == 2 and "no log given" in capsys.readouterr().err


def test_help_says_what_else_takes_the_net(capsys: pytest.CaptureFixture) -> None:
    """Whoever trains in mjlab or Isaac Lab finds the verb that writes the net for them."""
    with pytest.raises(SystemExit):
        main(["train-actuator", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "`stiction convert ACTUATOR --to mjlab` or `--to isaaclab` writes the net for those trainers." in told


def weights(run: Path) -> dict:
    """Return the student's parameters at the end of a run."""
    path = latest_checkpoint(run / "checkpoints", "student")
    assert path is not None
    return load_checkpoint(path)["algorithm"]["student_state_dict"]


def test_training_with_a_net_resumes_bit_for_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undrawn: None
) -> None:
    """The net's window and the held targets are part of the state: stopped after an iteration, and gone on without the
    folder that the net came from, a run ends in the same parameters; its bundle names the net.
    """
    write_actuator(tmp_path / "net" / FILE, pd_net("go1"))
    options = [*SMALL, "--actuator", str(tmp_path / "net")]
    assert main(["train", *options, "--out", str(tmp_path / "whole")]) == 0
    plain = PhaseRunner.save

    def stop(self: PhaseRunner, path: str = "", infos: dict | None = None) -> None:
        plain(self, path, infos)
        raise KeyboardInterrupt

    monkeypatch.setattr(PhaseRunner, "save", stop)
    assert main(["train", *options, "--out", str(tmp_path / "halved")]) == 130
    monkeypatch.setattr(PhaseRunner, "save", plain)
    (tmp_path / "net").rename(tmp_path / "elsewhere")
    assert main(["train", "--resume", str(tmp_path / "halved"), "--json"]) == 0
    for (name, ours), theirs in zip(weights(tmp_path / "halved").items(), weights(tmp_path / "whole").values()):
        np.testing.assert_array_equal(ours, theirs, err_msg=name)
    assert main(["export", str(tmp_path / "halved"), "--out", str(tmp_path / "bundle")]) == 0
    contract = json.loads((tmp_path / "bundle" / "contract.json").read_text())
    assert contract["actuator"]["name"] == "net" and len(contract["actuator"]["sha256"]) == 64
    assert "Actuator Net of motor-side torque net" in (tmp_path / "bundle" / "card.md").read_text()
    (tmp_path / "halved" / FILE).write_bytes((tmp_path / "elsewhere" / FILE).read_bytes() + b"\0")
    with pytest.raises(StictionError, match="not the net that the run was started with"):
        RunDirectory(tmp_path / "halved").actuator()


@pytest.mark.parametrize(
    ("side", "options", "message"),
    [
        ("output_side", ["--method", "direct"], "would add it again"),
        ("motor_side", ["--set", "task.timestep=0.01", "--set", "task.decimation=2"], "period of 0.005 s"),
        ("motor_side", ["--robot", "saturn_lite"], "for the joints of 'go1'"),
    ],
)
def test_a_net_that_does_not_fit_is_refused_before_anything_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture, side: str, options: list[str], message: str
) -> None:
    """One line, and no folder of a run that never was."""
    write_actuator(tmp_path / "net" / FILE, pd_net("go1", torque_source=side))
    arguments = [*but(SMALL, *options), "--actuator", str(tmp_path / "net"), "--out", str(tmp_path / "run")]
    assert main(["train", *arguments]) == 1
    assert message in capsys.readouterr().err and not (tmp_path / "run").exists()
