"""Clips: rendered where OpenGL is there, and a clear word where it is not."""

from pathlib import Path

import pytest

from stiction.evaluation.clip import HEIGHT, WIDTH, ClipError
from stiction_experiments.replication.filmed import record_clip

image = pytest.importorskip("PIL.Image", reason="the package pillow, of the extra 'sim', is needed to write clips")
pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


@pytest.mark.parametrize("robot", [None, 1000])
def test_a_clip_shows_a_robot_that_moves(bundle: Path, tmp_path: Path, robot: int | None) -> None:
    """Frames of the right size and number that are neither empty nor all the same."""
    if robot is not None:
        pytest.importorskip("sapien", reason="the package sapien, of the extra 'engines', is needed for PhysX")
    try:
        path = record_clip(bundle, 0.0, "vx=0.5", tmp_path / "clip.webp", seconds=0.4, robot=robot)
    except ClipError as error:
        pytest.skip(f"this machine cannot render: {error}")
    with image.open(path) as clip:
        assert clip.format == "WEBP"
        assert clip.size == (WIDTH, HEIGHT)
        assert clip.n_frames >= 8
        first = clip.convert("RGB").tobytes()
        clip.seek(clip.n_frames - 1)
        assert len(set(first)) > 50
        assert clip.convert("RGB").tobytes() != first


def test_without_opengl_the_error_says_what_to_install(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failing renderer must cost the clip and nothing else."""
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(ClipError, match="libegl1"):
        record_clip(bundle, 0.0, "vx=0.5", tmp_path / "clip.webp", seconds=0.1)
