"""Clips: rendered with OpenGL, and a clear error without it."""

from pathlib import Path

import pytest

from stiction.evaluation.clip import ClipError, record_side_by_side

image = pytest.importorskip("PIL.Image", reason="the package pillow, of the extra 'sim', is needed to write clips")
pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")


@pytest.mark.slow
def test_a_clip_shows_robots_that_move(bundle: Path, tmp_path: Path) -> None:
    """Frames of one size that are neither empty nor all the same."""
    try:
        path = record_side_by_side([bundle], ["toy"], ["#2060a0"], 0.0, "vx=0.5", tmp_path / "clip.webp")
    except ClipError as error:
        pytest.skip(f"this machine cannot render: {error}")
    with image.open(path) as clip:
        assert clip.format == "WEBP" and clip.n_frames >= 8
        first = clip.convert("RGB").tobytes()
        clip.seek(clip.n_frames - 1)
        assert len(set(first)) > 50
        assert clip.convert("RGB").tobytes() != first


def test_without_opengl_the_error_says_what_to_install(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A failing renderer ends the clip with a clear error."""
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(ClipError, match="libegl1"):
        record_side_by_side([bundle], ["toy"], ["#2060a0"], 0.0, "vx=0.5", tmp_path / "clip.webp")
