"""A run folder that somebody sent runs none of his code: what its config.json names as a module is not looked up."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.film import _render
from stiction.learning.run import ROBOT, RunDirectory, load_checkpoint, save_checkpoint
from stiction_experiments.lab.trained import walk_run

pytestmark = pytest.mark.usefixtures("undrawn")

WORDS = [
    *("--preset", "quick", "--robot", "go1", "--num-envs", "4", "--teacher.iterations", "2", "--teacher.steps", "4"),
    *("--teacher.mini-batches", "2", "--checkpoint-every", "1", "--video-every", "0", "--method", "none"),
]

TRAP = """
from pathlib import Path
Path({mark!r}).touch()
from stiction.robots.catalog import find_robot
ROBOT = find_robot("go1")
def pays(snapshot):
    return 1.0 - snapshot.fallen.float()
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two iterations."""
    folder = tmp_path_factory.mktemp("run") / "run"
    assert main(["train", *WORDS, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module that can be found, and leaves a mark; returns the mark."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "trap.py").write_text(TRAP.format(mark=str(tmp_path / "mark")))
    monkeypatch.syspath_prepend(tmp_path / "lib")
    monkeypatch.delitem(sys.modules, "trap", raising=False)
    return tmp_path / "mark"


def sent(finished: Path, folder: Path, unfinished: bool = False, **task: object) -> Path:
    """Copy the run, with other settings of its task in config.json, as somebody may send it."""
    (folder / "checkpoints").mkdir(parents=True)
    for path in finished.rglob("*"):
        if path.is_file() and not (unfinished and path.name == "summary.json"):
            (folder / path.relative_to(finished)).parent.mkdir(parents=True, exist_ok=True)
            (folder / path.relative_to(finished)).write_bytes(path.read_bytes())
    data = json.loads((folder / "config.json").read_text())
    for name, value in task.items():
        part = data["config"]["task"]
        if name == "own":
            part = part["rewards"]
        part[name] = value
    (folder / "config.json").write_text(json.dumps(data))
    # Digests find accidents: whoever sends it has made them anew.
    for path in (folder / "checkpoints").glob("*.safetensors"):
        save_checkpoint(path, load_checkpoint(path) | {"run": RunDirectory(folder).origin()})
    return folder


@pytest.mark.parametrize("robot", ["trap:ROBOT", "trap.ROBOT", "trap", "no.such:ROBOT"])
def test_a_robot_that_a_file_names_is_no_module(
    robot: str, finished: Path, trap: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Resumed, exported, walked or filmed: one line that says what to say, and nothing was imported."""
    run = sent(finished, tmp_path / "run", True, robot=robot)
    assert main(["train", "--resume", str(run)]) == 1
    shown = capsys.readouterr().err.splitlines()
    assert len(shown) == 1 and "a file runs no module" in shown[0] and "--robot" in shown[0]
    run = sent(finished, tmp_path / "again", robot=robot)
    assert main(["export", str(run)]) == 1
    assert "a file runs no module" in capsys.readouterr().err
    with pytest.raises(StictionError, match="runs no module"):
        walk_run(run, "student", EvaluationCfg(commands=("vx=0.5",), episodes=1, seconds=3.0))
    with pytest.raises(StictionError, match="runs no module"):
        _render(run, next((run / "checkpoints").glob("*.safetensors")), tmp_path / "clip.webp")
    assert not trap.exists()


def test_a_robot_that_the_user_names_again_is_copied_into_the_run(
    finished: Path, trap: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """From then on the run has it as data; another robot than the run's own is refused before it is looked up."""
    run = sent(finished, tmp_path / "run", robot="trap:ROBOT")
    assert main(["export", str(run), "--robot", "trap:OTHER"]) == 1
    assert "leave --robot out" in capsys.readouterr().err and not trap.exists()
    assert main(["export", str(run), "--robot", "trap:ROBOT", "--out", str(tmp_path / "bundle")]) == 0
    assert trap.exists() and (run / ROBOT).is_file()
    trap.unlink()
    del sys.modules["trap"]
    assert RunDirectory(run).config().task.robot == str(run / ROBOT)
    assert main(["train", "--resume", str(run)]) == 0
    assert not trap.exists()


def test_a_reward_term_that_a_file_names_is_no_module(
    finished: Path, trap: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Training on needs it said again, the same; exporting and walking need no reward at all."""
    run = sent(finished, tmp_path / "run", True, own=[["trap:pays", 0.5]])
    newest = sorted((run / "checkpoints").glob("*.safetensors"))[-1]
    again = ["train", "--resume", str(run)]
    for words in ([], ["--task.rewards.own", "trap:pays", "0.6"]):
        assert main([*again, *words]) == 1
        assert "--task.rewards.own trap:pays 0.5" in capsys.readouterr().err
    assert not trap.exists() and newest.is_file()
    walked = sent(finished, tmp_path / "walked", own=[["trap:pays", 0.5]])
    assert main(["export", str(walked), "--out", str(tmp_path / "bundle")]) == 0
    assert not trap.exists()
    assert main([*again, "--task.rewards.own", "trap:pays", "0.5"]) == 0
    assert trap.exists()
