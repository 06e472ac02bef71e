"""Clips of a training run: rendered in another process, and lost without harm."""

import sys
from pathlib import Path

import pytest

from stiction.evaluation.film import ClipRecorder, filmed_task
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.task.config import TaskCfg

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to film a training run")
image = pytest.importorskip("PIL.Image", reason="the package pillow, of the extra 'sim', is needed to write clips")


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """Something that looks like a checkpoint."""
    path = tmp_path / "teacher_000100.safetensors"
    path.write_bytes(b"tensors")
    path.with_suffix(".json").write_text("{}")
    return path


def renderer(tmp_path: Path, script: str) -> str:
    """An interpreter that does something else."""
    path = tmp_path / "python"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def test_a_lost_clip_costs_one_line_and_no_more_tries(tmp_path: Path, checkpoint: Path, monkeypatch) -> None:
    """A failed renderer prints one line and is not started again; the training continues."""
    monkeypatch.setattr(sys, "executable", renderer(tmp_path, f"echo x >> {tmp_path}/tries; echo no GL >&2; exit 1"))
    lines: list[str] = []
    crew = ClipRecorder(tmp_path / "run", lines.append)
    (tmp_path / "run").mkdir()
    crew("teacher", 100, checkpoint)
    crew.finish()
    crew("teacher", 200, checkpoint)
    crew.finish()
    assert len(lines) == 1 and "no GL" in lines[0] and "--video-every 0" in lines[0]
    assert (tmp_path / "tries").read_text() == "x\n"


def test_the_newest_checkpoint_waits_for_a_slow_clip(tmp_path: Path, checkpoint: Path, monkeypatch) -> None:
    """Training neither waits nor piles up processes; of those that wait, the newest is what people want to see.

    The stand-in for the renderer gets `-P -m module run checkpoint out`, and waits until it may go on.
    """
    go = tmp_path / "go"
    monkeypatch.setattr(sys, "executable", renderer(tmp_path, f'until [ -e {go} ]; do sleep 0.02; done; cp "$5" "$6"'))
    lines: list[str] = []
    run = tmp_path / "run"
    run.mkdir()
    crew = ClipRecorder(run, lines.append)
    for iteration in (100, 200, 300):
        crew("teacher", iteration, checkpoint)
    checkpoint.unlink()  # as the training does with old ones
    go.touch()
    crew.finish()
    assert sorted(path.name for path in (run / "clips").iterdir()) == ["teacher_000100.webp", "teacher_000300.webp"]
    assert not lines


def test_a_run_that_ends_takes_its_renderer_along(tmp_path: Path, checkpoint: Path, monkeypatch) -> None:
    """The end of the training ends the renderer and removes its temporary files."""
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(sys, "executable", renderer(tmp_path, "exec sleep 60"))
    (tmp_path / "run").mkdir()
    crew = ClipRecorder(tmp_path / "run", lambda _: None)
    crew("teacher", 100, checkpoint)
    crew("teacher", 200, checkpoint)
    assert crew._filming is not None
    process = crew._filming[1]
    crew.abandon()
    assert process.poll() is not None and not list((tmp_path / "temporary").iterdir())


def test_the_robot_of_a_clip_stands_on_the_level_that_was_reached() -> None:
    """Four robots of sixteen are on flat ground and have no level; the others are on 6: stairs, and the step is 12 cm.

    Levels are moved by the way walked, which for a robot that has just begun would be down.
    """
    import torch

    from stiction.evaluation.film import _to_level
    from stiction.task.env import LocomotionEnv
    from stiction.task.terrain import TerrainCfg

    env = LocomotionEnv(filmed_task(TaskCfg(robot="go1", terrain=TerrainCfg(kind="stairs"))), 1, seed=0)
    _to_level(env, {"level": torch.tensor([0] * 4 + [6] * 12)})
    for _ in range(2):
        env.step(torch.zeros(1, env.num_actions))
    assert env.course is not None
    assert env.course.level.tolist() == [6] and int(env.episode_length_buf[0]) == 1
    assert 0.6 <= env.course.terrain.difficulty[0] < 0.7


@pytest.mark.slow
def test_a_training_run_leaves_clips_that_move(tmp_path: Path) -> None:
    """The whole way: a checkpoint, another process, OpenGL, a file."""
    from stiction.learning.run import RunDirectory
    from stiction.learning.runner import train

    cfg = TrainCfg(
        task=TaskCfg(robot="go1"),
        network=NetworkCfg(actor=(8,), critic=(8,), privileged=(8,), history_frame=4, history=(8,), latent=3),
        teacher=TeacherCfg(iterations=1, steps=4, epochs=1, mini_batches=2),
        student=StudentCfg(iterations=0, steps=4, epochs=1, mini_batches=2),
        num_envs=2,
        video_every=1,
    )
    run = RunDirectory.create(tmp_path / "run", cfg, "stiction train", None)
    lines: list[str] = []
    crew = ClipRecorder(run.path, lines.append)
    train(cfg, run, film=crew)
    crew.finish()
    if lines:
        pytest.skip(f"this machine cannot render: {lines[0]}")
    with image.open(run.path / "clips" / "teacher_000001.webp") as clip:
        assert clip.format == "WEBP" and clip.n_frames > 50
        first = clip.convert("RGB").tobytes()
        clip.seek(clip.n_frames - 1)
        assert clip.convert("RGB").tobytes() != first
