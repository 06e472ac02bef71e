"""Loggers of a training: what each is told, and that none of them can end it."""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from stiction.core.errors import ConfigurationError
from stiction.learning.begin import begin_run
from stiction.learning.boards import Board, as_gif, open_board
from stiction.learning.config import StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import Interrupted

CFG = TrainCfg(teacher=TeacherCfg(iterations=10), student=StudentCfg(iterations=5))


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """An animated WebP of six frames, 40 ms each, as the renderer writes them."""
    path = tmp_path / "clips/teacher_000002.webp"
    path.parent.mkdir()
    frames = [Image.new("RGB", (32, 24), (40 * number, 0, 0)) for number in range(6)]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=40)
    return path


class Recorded:
    """Stands in for the packages wandb and trackio: records the calls."""

    def __init__(self, logged_in: bool = True) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.logged_in = logged_in

    def login(self, prompt: bool) -> bool:
        """Return whether a login is stored; nothing may be asked."""
        assert not prompt
        return self.logged_in

    def Settings(self, **settings: Any) -> dict[str, Any]:
        """Return the settings as they are."""
        return settings

    def Video(self, value: Any, **words: Any) -> tuple[bytes, Any]:
        """Return the clip's content, from a file or bytes, and its caption."""
        return (value.read_bytes() if isinstance(value, Path) else value.read()), words["caption"]

    def init(self, **words: Any) -> SimpleNamespace:
        """Begin a run."""
        self.calls.append(("init", words))
        return SimpleNamespace(log=self.log, finish=self.finish)

    def log(self, values: dict[str, Any], step: int) -> None:
        """Record values."""
        self.calls.append(("log", (step, values)))

    def finish(self, exit_code: int = 0) -> None:
        """End the run, and print, as trackio does."""
        self.calls.append(("finish", exit_code))
        print("* Run finished.")


def test_steps_made_again_after_a_resume_are_shown_once(tmp_path: Path) -> None:
    """Shows each iteration once, with the value that a resumed run gave it."""
    with open_board(tmp_path, CFG) as first:
        for iteration in (1, 2, 3, 4):
            first.add("teacher", iteration, {"reward": float(iteration), "walk/falls": 0.0})
        first.flush()
    # Files of one second are in the order of their names, whose last part counts all writers of the process.
    (file,) = (tmp_path / "tensorboard/teacher").iterdir()
    file.rename(file.with_name("events.out.tfevents.1.before"))
    with open_board(tmp_path, CFG) as again:
        again.flush()
        for iteration in (3, 4, 5):
            again.add("teacher", iteration, {"reward": 10.0 * iteration})
    shown = EventAccumulator(str(tmp_path / "tensorboard/teacher"))
    shown.Reload()
    assert shown.Tags()["scalars"] == ["training/reward", "walk/falls"]
    points = [(event.step, event.value) for event in shown.Scalars("training/reward")]
    assert points == [(1, 1.0), (2, 2.0), (3, 30.0), (4, 40.0), (5, 50.0)]


def test_a_clip_moves_in_tensorboard(tmp_path: Path, clip: Path) -> None:
    """Holds the GIF at the iteration that was filmed; TensorBoard hands the bytes to the browser by their kind."""
    from tensorboard.util import img_mime_type_detector

    with open_board(tmp_path, CFG) as board:
        board.add("teacher", 2, {"reward": 0.0})
        board.add("teacher", 3, {"reward": 0.0})
        board.add_clip("teacher", 2, clip)
    shown = EventAccumulator(str(tmp_path / "tensorboard/teacher"))
    shown.Reload()
    (image,) = shown.Images("clip")
    assert (image.step, image.width, image.height) == (2, 32, 24)
    assert img_mime_type_detector.from_bytes(image.encoded_image_string) == "image/gif"


def test_every_second_frame_of_a_clip_is_shown_for_twice_as_long(clip: Path) -> None:
    """Keeps the pace of the robot: six frames of 40 ms become three of 80 ms."""
    content, size = as_gif(clip)
    with Image.open(io.BytesIO(content)) as moving:
        assert (moving.n_frames, moving.info["duration"], size) == (3, 80, (32, 24))


@pytest.mark.parametrize("name", ["wandb", "trackio"])
def test_a_service_shows_both_phases_as_one_run(name: str, tmp_path: Path, clip: Path, monkeypatch, capsys) -> None:
    """Logs the student's iteration 1 as step 11 of 15, clips at the current step, and nothing on standard output."""
    package = Recorded()
    monkeypatch.setitem(sys.modules, name, package)
    monkeypatch.delenv("WANDB_MODE", raising=False)
    cfg = replace(CFG, logger=name)
    with open_board(tmp_path, cfg) as board:
        board.add("teacher", 4, {"reward": 0.5, "Train/mean_reward": 7.0})
        board.add_clip("teacher", 2, clip)
        board.add("student", 1, {"reward": 0.6})
    (_, begun), *logged, (last, status) = package.calls
    assert logged[0] == ("log", (4, {"training/reward": 0.5, "Train/mean_reward": 7.0}))
    (content, caption) = logged[1][1][1]["clip"]
    assert logged[1][1][0] == 4 and caption == "teacher, iteration 2" and content.startswith(b"GIF89a")
    assert logged[2] == ("log", (11, {"training/reward": 0.6}))
    assert (last, status, len(logged)) == ("finish", 0, 3)
    assert begun["project"] == "stiction" and begun["resume"] == "allow"
    assert begun["config"]["teacher"]["iterations"] == 10
    assert capsys.readouterr().out == ""
    assert [path.name for path in clip.parent.iterdir()] == [clip.name]

    identity = json.loads((tmp_path / "logger.json").read_text())["id"]
    assert identity in (begun.get("id"), begun["name"].rpartition("-")[2])
    package.calls.clear()
    with open_board(tmp_path, cfg) as again:
        again.add("student", 2, {"reward": 0.7})
    (_, resumed), *_ = package.calls
    assert resumed == begun


@pytest.mark.parametrize(("error", "status"), [(Interrupted, 0), (ValueError, 1)])
def test_a_training_that_failed_is_a_crashed_run(error: type[Exception], status: int, tmp_path: Path, monkeypatch):
    """Tells a training that was asked to stop from one that diverged."""
    package = Recorded()
    monkeypatch.setitem(sys.modules, "wandb", package)
    with pytest.raises(error), open_board(tmp_path, replace(CFG, logger="wandb")) as board:
        board.add("teacher", 1, {"reward": 0.5})
        raise error("diverged")
    assert package.calls[-1] == ("finish", status)


def test_wandb_without_a_login_logs_offline(tmp_path: Path, monkeypatch) -> None:
    """Asks nothing on the terminal, and says how to upload; output, code and git's remote stay here."""
    package = Recorded(logged_in=False)
    monkeypatch.setitem(sys.modules, "wandb", package)
    monkeypatch.delenv("WANDB_MODE", raising=False)
    with (
        pytest.warns(UserWarning, match="no login is stored; logging offline"),
        open_board(tmp_path, replace(CFG, logger="wandb")) as board,
    ):
        board.add("teacher", 1, {"reward": 0.5})
    _, words = package.calls[0]
    settings = words["settings"]
    assert words["mode"] == "offline" and settings["console"] == "off"
    assert settings["disable_git"] and settings["disable_code"] and 0 < settings["finish_timeout"] <= 60


class Broken:
    """A logger without a network."""

    def __init__(self) -> None:
        self.calls = 0

    def add(self, *_: Any) -> None:
        """Fail."""
        self.calls += 1
        raise ConnectionError("no route\nto host")


def test_a_logger_that_fails_costs_one_warning(tmp_path: Path, clip: Path) -> None:
    """Goes on without it: no second try, and no second warning."""
    broken = Broken()
    with pytest.warns(UserWarning) as warned, Board("wandb", lambda: broken) as board:  # type: ignore[arg-type, return-value]
        for iteration in (1, 2):
            board.add("teacher", iteration, {"reward": 0.5})
            board.add_clip("teacher", iteration, clip)
            board.flush()
    assert [str(each.message) for each in warned] == [
        "wandb failed: no route to host; figures go to metrics.jsonl alone from now on"
    ]
    assert broken.calls == 1


def test_a_resumed_run_whose_logger_is_not_installed_goes_on(tmp_path: Path, monkeypatch) -> None:
    """Names the command that installs it, and trains without."""
    monkeypatch.setitem(sys.modules, "wandb", None)
    with (
        pytest.warns(UserWarning, match=r"wandb failed: .* needs the extra 'wandb'; install it with: .*\[wandb\]"),
        open_board(tmp_path, replace(CFG, logger="wandb")) as board,
    ):
        board.add("teacher", 1, {"reward": 0.5})


def test_a_new_run_is_refused_where_its_logger_is_not_installed(tmp_path: Path, monkeypatch) -> None:
    """Says so in one line before the folder is made."""
    monkeypatch.setattr("stiction.core.extras.is_installed", lambda package: package != "trackio")
    with pytest.raises(ConfigurationError, match=r"extra 'trackio', of which trackio is not installed; .*\[trackio\]"):
        begin_run(tmp_path / "run", replace(CFG, logger="trackio"), "stiction train")
    assert not (tmp_path / "run").exists()


def test_a_damaged_id_costs_the_logger_and_not_the_training(tmp_path: Path, monkeypatch) -> None:
    """Rejects ids that are no eight hexadecimal digits: trackio makes folders of them."""
    package = Recorded()
    monkeypatch.setitem(sys.modules, "trackio", package)
    (tmp_path / "logger.json").write_text('{"id": "../../etc"}')
    with pytest.warns(UserWarning, match="got the id"), open_board(tmp_path, replace(CFG, logger="trackio")) as board:
        board.add("teacher", 1, {"reward": 0.5})
    assert not package.calls


def test_wandb_itself_takes_figures_and_clips_offline(tmp_path: Path, clip: Path, monkeypatch, capfd) -> None:
    """Writes a log and the clip into the run's folder; standard output stays empty, and no key is asked for."""
    pytest.importorskip("wandb", reason="the package wandb, of the extra 'wandb', is needed to log to it")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_API_KEY", "0123456789abcdef" * 3)
    with open_board(tmp_path, replace(CFG, logger="wandb")) as board:
        board.add("teacher", 1, {"reward": 0.5, "Train/mean_reward": 7.0})
        board.add_clip("teacher", 1, clip)
        board.add("teacher", 2, {"reward": 0.6})
        assert not board._failed
    written = [path for path in (tmp_path / "wandb").rglob("*") if path.is_file() and not path.is_symlink()]
    assert any(path.suffix == ".wandb" and b"Train/mean_reward" in path.read_bytes() for path in written)
    assert any(path.suffix == ".gif" for path in written)
    assert not any(b"0123456789abcdef" in path.read_bytes() for path in written)
    assert capfd.readouterr().out == ""


def test_trackio_itself_takes_figures_and_clips(tmp_path: Path, clip: Path) -> None:
    """Keeps figures and clip under the project's name; in a process of its own, for it reads TRACKIO_DIR once."""
    pytest.importorskip("trackio", reason="the package trackio, of the extra 'trackio', is needed to log to it")
    import os
    import sqlite3
    import subprocess

    script = (
        "import sys; from pathlib import Path; from stiction.learning.boards import open_board\n"
        "from stiction.learning.config import TrainCfg\n"
        "with open_board(Path(sys.argv[1]), TrainCfg(logger='trackio')) as board:\n"
        "    board.add('teacher', 1, {'Train/mean_reward': 7.0})\n"
        "    board.add_clip('teacher', 1, Path(sys.argv[2]))\n"
        "    assert not board._failed\n"
    )
    environment = {**os.environ, "TRACKIO_DIR": str(tmp_path / "kept")}
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path), str(clip)], env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    (file,) = (tmp_path / "kept").glob("*.db")
    with sqlite3.connect(file) as database:
        assert any("Train/mean_reward" in str(row) for row in database.execute("select * from metrics"))
    assert list((tmp_path / "kept").rglob("*.gif"))
