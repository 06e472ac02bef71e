"""`stiction train` as a user runs it, with good and with bad input."""

import json
import os
import shlex
import signal
from pathlib import Path

import pytest

from stiction.cli import train as verb
from stiction.cli.main import main
from stiction.cli.progress import Display
from stiction.core import gemm
from stiction.files.contract import read_contract
from stiction.files.joints import Estimate, JointRecord, JointsFile, write_training
from stiction.identification.verdict import propose, write_proposal
from stiction.learning.run import latest_checkpoint, load_checkpoint
from stiction.report.terminal import stop_requests
from stiction.robots.catalog import robot_names
from stiction.task.friction import FrictionCfg
from words import but

pytestmark = pytest.mark.usefixtures("undrawn")

SMALL = [
    *("--preset", "two-phase", "--video-every", "0", "--robot", "go1", "--num-envs", "4", "--json"),
    *("--teacher.iterations", "1", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
    *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
]


def test_a_run_leaves_what_the_design_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Config, metrics, TensorBoard, checkpoints, summary; standard output is JSON and nothing else."""
    out = tmp_path / "run"
    monkeypatch.delenv(gemm.VARIABLE, raising=False)
    monkeypatch.setattr(gemm, "processor_obstacle", lambda: None)
    assert main(["train", *SMALL, "--method", "direct", "--friction-level", "0.1", "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert captured.err.count(f"stiction train: {gemm.VARIABLE}=1 makes updates") == 1
    summary = json.loads(captured.out)
    assert summary["env_steps"] == 4 * 8 and summary["multiply_adds"]["actor"] > 0
    config = json.loads((out / "config.json").read_text())
    friction = config["config"]["task"]["friction"]
    assert friction | {"method": "direct", "level": 0.1, "law": "coulomb", "per": "robot"} == friction
    assert config["seed"] == 0 and config["command"].startswith("stiction train")
    assert len((out / "metrics.jsonl").read_text().splitlines()) == 2
    assert {path.name for path in (out / "tensorboard").iterdir()} == {"teacher", "student"}
    assert (out / "summary.json").exists() and (out / "curves.png").exists()
    assert sorted(p.suffix for p in (out / "checkpoints").iterdir()) == [
        ".json",
        ".json",
        ".safetensors",
        ".safetensors",
    ]
    assert main(["train", *SMALL, "--out", str(out)]) == 1
    assert "--resume" in capsys.readouterr().err


@pytest.mark.parametrize("robot", robot_names())
def test_the_next_step_of_a_checked_robot_begins_a_run(
    robot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """The command that `robot check` names is accepted as it is, also for a robot without a friction of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verb, "_run", lambda options, run, cfg: 0)
    assert main(["robot", "check", robot]) == 0
    step = capsys.readouterr().out.partition("Next:\n")[2].splitlines()[0]
    assert main(shlex.split(step)[1:]) == 0 and (tmp_path / "runs/train/config.json").exists()


def test_an_identification_becomes_the_nominal_joint(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Recorded in config.json; the level overrides its friction."""
    number = {"value": 0.02, "std": 0.0, "interval95": [0.02, 0.02]}
    record = {"inertia": number, "viscous_friction": number, "coulomb_friction": number}
    conditions = {"calf": "bare_motor", "thigh": "loaded"}
    joints = {
        kind: JointRecord.from_dict(record | {"test_condition": condition}, kind)
        for kind, condition in conditions.items()
    }
    JointsFile(joints).write(tmp_path / "joints.json")
    options = ["--joints", str(tmp_path / "joints.json"), "--method", "direct"]
    assert main(["train", *SMALL, *options, "--out", str(tmp_path / "own")]) == 0
    header = json.loads((tmp_path / "own" / "config.json").read_text())
    assert header["identified"]["file"] == "joints.json"
    values = {name: joint[:3] for name, joint in header["identified"]["values"].items()}
    assert values.pop("armature") == [None, None, 0.02]
    assert values == {"damping": [None, 0.02, 0.02], "frictionloss": [None, 0.02, 0.02]}
    printed = capsys.readouterr().err
    assert "warning: the inertia of 'thigh' was measured loaded" in printed
    assert (
        "thigh: damping, frictionloss from joints.json; calf: armature, damping, frictionloss from joints.json; hip: "
        "nothing from joints.json; all else as in the robot go1\n"
    ) in printed
    assert main(["train", *SMALL, *options, "--friction-level", "0.1", "--out", str(tmp_path / "level")]) == 0
    for run, expected in (("own", 0.02), ("level", 0.1 * 35.55)):
        path = latest_checkpoint(tmp_path / run / "checkpoints", "student")
        draws = load_checkpoint(path)["environment"]["draws"]["friction"][:, 2]
        assert ((draws >= 0.8) & (draws <= 1.2)).all()
        assert main(["export", str(tmp_path / run), "--out", str(tmp_path / f"{run}-bundle")]) == 0
        contract = json.loads((tmp_path / f"{run}-bundle" / "contract.json").read_text())
        assert contract["friction"][2] == pytest.approx(expected) and contract["armature"][2] == 0.02


def test_a_law_is_trained_and_resumed(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """From the flags to the joints, with the friction that was there among the figures; a resumed run keeps the law."""
    run = tmp_path / "run"
    options = ["--method", "direct", "--friction-law", "load", "--friction-level", "0.05", "--checkpoint-every", "1"]
    assert main(["train", *SMALL, *options, "--out", str(run)]) == 0
    for file in (run / "checkpoints").glob("student_*"):
        file.unlink()
    (run / "summary.json").unlink()
    assert main(["train", "--resume", str(run), "--json"]) == 0
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert [row["phase"] for row in rows] == ["teacher", "student"] and all(row["friction/share"] > 0 for row in rows)
    path = latest_checkpoint(run / "checkpoints", "teacher")
    assert set(load_checkpoint(path)["environment"]["friction"]) == {"friction", "bound", "measured", "fresh"}


def test_a_proposal_of_identify_is_what_is_trained(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """The worst joint, 9.8 % in the air, doubled and rounded up, is 20 %: what follows there is what is trained."""
    ratios = {"thigh": 0.01, "shank": 0.098}
    records = {
        name: JointRecord(friction_ratio=Estimate(high, 0.001, (0.5 * high, high)), test_condition="in_air")
        for name, high in ratios.items()
    }
    proposal = propose(JointsFile(records))
    write_training(tmp_path / "training.json", proposal)
    source = ["--friction-from", str(tmp_path / "training.json")]
    assert main(["train", *SMALL, *source, "--out", str(tmp_path / "run")]) == 0
    config = json.loads((tmp_path / "run" / "config.json").read_text())["config"]["task"]["friction"]
    assert proposal["friction"] == {"method": "deception", "level": 0.2, "law": "coulomb", "per": "robot"}
    assert config == config | proposal["friction"]
    friction = FrictionCfg(**proposal["friction"])
    assert [end * friction.level for end in friction.last.range] == proposal["range"]
    capsys.readouterr()
    for other in ("--method=direct", "--friction-level", "--task.friction.per"):
        value = [] if "=" in other else ["0.1" if "level" in other else "joint"]
        assert main(["train", *SMALL, *source, other, *value, "--out", str(tmp_path / "two")]) == 1
        assert other.partition("=")[0] in capsys.readouterr().err
    (tmp_path / "a.yaml").write_text("task: {friction: {per: joint}}")
    for more, name in (
        (["--set", "task.friction.per=joint"], "--set task.friction.per"),
        (["--config", str(tmp_path / "a.yaml")], "a.yaml: task.friction.per"),
    ):
        assert main(["train", *SMALL, *source, *more, "--out", str(tmp_path / "two")]) == 1
        printed = capsys.readouterr().err
        assert "--friction-from and" in printed and f"{name} exclude each other" in printed


def test_what_holds_a_joint_at_rest_is_drawn_too(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """15 % at rest, 10 % in motion: both are trained with, on rows, and go with the policy."""
    ratios = (Estimate(share, 0.001, (0.98 * share, 1.02 * share)) for share in (0.15, 0.1))
    friction = {
        "static_friction": Estimate(1.5, 0.015, (1.47, 1.53)),
        "coulomb_friction": Estimate(1, 0.01, (0.98, 1.02)),
    }
    names = dict(zip(("friction_ratio", "dynamic_ratio"), ratios, strict=True))
    write_proposal(tmp_path, JointsFile({"shank": JointRecord(**names, **friction, test_condition="loaded")}))
    source = ["--friction-from", str(tmp_path / "training.json"), "--physics", "plastic-first"]
    assert main(["train", *SMALL, *source, "--out", str(tmp_path / "run")]) == 0
    assert "--physics rows, not plastic-first: sliders let a joint go" in capsys.readouterr().err
    task = json.loads((tmp_path / "run" / "config.json").read_text())["config"]["task"]
    assert task["physics"]["friction"] == "rows" and task["friction"]["law"] == "stribeck"
    assert task["friction"]["static_ratio"] == [1.44, 1.56] and task["friction"]["level"] == 0.133
    assert main(["export", str(tmp_path / "run"), "--out", str(tmp_path / "bundle")]) == 0
    contract = read_contract((tmp_path / "bundle" / "contract.json").read_bytes())
    assert contract.law.static_ratio == pytest.approx(1.5) and contract.rise == (1.44, 1.56)


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        (None, "proposes no joint friction"),
        ({"method": "deception"}, "at least 'method' and 'level'"),
        ({"method": "magic", "level": 0.1, "law": "coulomb", "per": "robot"}, "'magic'"),
        (
            {"method": "direct", "level": "0.1", "law": "coulomb", "per": "robot"},
            "expected a finite number",
        ),
        ({"method": "direct", "level": 0.9, "law": "coulomb", "per": "robot"}, "0.9"),
    ],
)
def test_a_bad_proposal_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture, friction: dict | None, message: str
) -> None:
    """The file may have been edited by hand."""
    write_training(tmp_path / "training.json", {"friction": friction, "text": "no ratio"})
    options = ["--friction-from", str(tmp_path / "training.json"), "--out", str(tmp_path / "run")]
    assert main(["train", *but(SMALL, *options)]) == 1
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1 and not (tmp_path / "run").exists()


def test_a_signal_ends_the_run_where_it_can_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C and SIGTERM: a checkpoint, the way on, the status of a signal; afterwards the signals are as before."""
    out = tmp_path / "run"
    arguments = [*SMALL, "--method", "none", "--out", str(out)]
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    show = Display.__call__
    for number in (signal.SIGTERM, signal.SIGINT):

        def send(self: Display, *figures, number=number) -> None:
            show(self, *figures)
            os.kill(os.getpid(), number)

        if number == signal.SIGINT:
            arguments = but(SMALL, "--student.iterations", "2", "--method", "none", "--out", str(tmp_path / "other"))
        with monkeypatch.context() as patch:
            patch.setattr(Display, "__call__", send)
            assert main(["train", *arguments]) == 128 + number
        captured = capsys.readouterr()
        assert captured.out == ""
        assert "stopping after this iteration" in captured.err
        assert "stopped after iteration 1 of 1 of the teacher" in captured.err and "--resume" in captured.err
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
    assert main(["train", "--resume", str(out)]) == 0
    assert "next: stiction export" in capsys.readouterr().err


def test_a_second_signal_does_not_wait() -> None:
    """A rollout of thousands of robots can take a minute: who presses Ctrl-C twice means it."""
    printed: list[str] = []
    with stop_requests(printed.append, "this iteration") as asked:
        os.kill(os.getpid(), signal.SIGINT)
        assert asked() and asked.status == 130 and len(printed) == 1
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_a_finished_run_says_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A script that resumes whatever it finds must neither fail nor train again on a run that is done."""
    out = tmp_path / "run"
    assert main(["train", *SMALL, "--method", "none", "--out", str(out)]) == 0
    first = json.loads(capsys.readouterr().out)
    written = {path: path.read_bytes() for path in out.rglob("*.json*")}
    (out / "curves.png").unlink()
    assert main(["train", "--resume", str(out), "--json"]) == 0
    captured = capsys.readouterr()
    again = json.loads(captured.out)
    assert again == again | first and "finished already" in captured.err
    assert {path: path.read_bytes() for path in out.rglob("*.json*")} == written and (out / "curves.png").exists()


def test_resume_with_other_options_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """They would be ignored without a word; --json is no setting of the run."""
    for other in (
        ["--seed", "3"],
        ["--preset=quick"],
        ["--out", str(tmp_path)],
        ["--teacher.iterations", "9"],
        ["--set", "teacher.gamma=0.9"],
    ):
        assert main(["train", "--resume", str(tmp_path), *other]) == 1
        assert other[0].partition("=")[0] in capsys.readouterr().err
    assert main(["train", f"--resume={tmp_path}", "--json"]) == 1
    assert "expected a folder that `stiction train` made" in capsys.readouterr().err


def test_bad_input_is_one_line_and_status_one(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Names the value and the expected one; no traceback, and no folder left behind."""
    cases = [
        (["--robot", "nobody"], "nobody"),
        (["--joints", str(tmp_path / "none.json")], "none.json"),
        (["--friction-level", "1.5"], "1.5"),
        (["--method", "direct", "--friction-level", "0"], "--method none"),
        (["--friction-law", "load"], "coefficient"),
        (["--friction-law", "effort", "--friction-level", "0.1", "--method", "compensation"], "compensation"),
        (["--num-envs", "0"], "num_envs"),
        (["--checkpoint-every", "0"], "checkpoint_every"),
        (["--video-every", "-1"], "video_every"),
        (["--stop-at-tracking-error", "0"], "stop.tracking_error"),
        (["--student.iterations", "-1"], "student.iterations"),
        (["--set", "task.commands.interval=0"], "new commands every 0.0 s"),
        (["--terrain", "stairs", "--set", "task.terrain.speed=[0.3,11]"], "speed on terrain"),
        (["--stop-at-tracking-error", "0.2", "--set", "stop.terrain_level=3"], "stop.terrain_level"),
        (["--robot", "go1@kp=0.5,kp=2", "--method", "none"], "each at most once"),
        (["--friction-level", "0.1", "--task.friction.mixture", "inf", "0", "1", "1", "0", "1"], "finite weight"),
        (["--set", "task.randomization.payload=[3,-2]"], "payload"),
        (["--set", "task.randomization.payload=[-9,0]"], "payload"),
    ]
    for arguments, word in cases:
        assert main(["train", *but(SMALL, "--out", str(tmp_path / "bad"), *arguments)]) == 1, arguments
        error = capsys.readouterr().err
        assert word in error and error.count("\n") == 1, error
    assert not (tmp_path / "bad").exists()
    assert main(["train", "--resume", str(tmp_path / "nothing")]) == 1
    assert "expected a folder that `stiction train` made" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file", tmp_path / "file" / "run"):
        assert main(["train", *SMALL, "--out", str(out)]) == 1
        error = capsys.readouterr().err
        assert "--out" in error and error.count("\n") == 1, error


@pytest.mark.parametrize("name", ["contract.json", "metrics.jsonl", "summary.json", "checkpoints/teacher_000001.json"])
def test_no_run_begins_among_files_of_another(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A bundle would no longer be what its digests say, and figures of two runs would be one curve."""
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("{}")
    assert main(["train", *SMALL, "--out", str(tmp_path)]) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and f"holds {name}, of a bundle or of a run without its config.json" in printed
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [file]


def test_a_finished_run_that_lost_a_file_says_which(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """`export` would send its user to --resume, and --resume, of a run that is finished, back to `export`."""
    run = tmp_path / "run"
    assert main(["train", *SMALL, "--out", str(run)]) == 0
    for file in (run / "checkpoints").glob("student_*"):
        file.unlink()
    capsys.readouterr()
    assert main(["export", str(run)]) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and "is finished, and has no whole checkpoint of its student any more" in printed
    (run / "config.json").write_text("[]")
    assert main(["train", "--resume", str(run)]) == 1
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1 and "config.json: holds a list" in printed
