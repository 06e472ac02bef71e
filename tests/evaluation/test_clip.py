"""Clips: rendered with OpenGL, and a clear error without it."""

import re
from pathlib import Path

import numpy as np
import pytest

from stiction.evaluation.clip import CAPTION, FRAMES, SETTLE, SIZE, TOGETHER, ClipError, mean_speed, record_side_by_side

image = pytest.importorskip("PIL.Image", reason="the package pillow, of the extra 'sim', is needed to write clips")
pytest.importorskip("mujoco", reason="the package mujoco, of the extra 'sim', is needed to run robots")

CHECKOUT = Path(__file__).parents[2]


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


def test_the_speed_of_a_walk_leaves_out_its_begin() -> None:
    """1 s at rest and 2 s at 0.5 m/s are 0.5 m/s after the first second."""
    x = np.concatenate([np.zeros(10), 0.05 * np.arange(21)])
    assert SETTLE == 1.0 and mean_speed(x[:, None], 0.1) == pytest.approx(0.5)


def test_the_film_of_the_front_page_is_eight_seconds_and_readable_on_a_telephone() -> None:
    """Holds the committed film to its length; a telephone shows it 366 px wide, where its text has 12 px."""
    with image.open(CHECKOUT / "docs" / "hero.webp") as film:
        assert film.n_frames == TOGETHER * FRAMES and film.width == SIZE[0]
        film.load()
        assert TOGETHER == 8.0 and film.info["duration"] * film.n_frames == 8000
    assert CAPTION * 366 / SIZE[0] > 12


@pytest.mark.slow
def test_the_film_of_the_front_page_says_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walks again as the film does: README.md and the site have these speeds; one follows the command, one does not."""
    monkeypatch.syspath_prepend(str(CHECKOUT / "tools"))
    import hero

    caption = hero.caption()
    for page in ("README.md", "docs/index.md"):
        assert f"*{caption}*" in (CHECKOUT / page).read_text()
    slow, fast = (float(number) for number in re.findall(r"([\d.]+) m/s", caption)[1:])
    assert slow < 0.8 * 0.5 <= fast <= 1.2 * 0.5
