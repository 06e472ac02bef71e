"""Curves and live page of a run, from its files alone."""

import json
import os
import re
from pathlib import Path

import pytest

from stiction.files.results import read_metrics
from stiction.report.page import data_uri
from stiction.report.training import PANELS, LivePage, draw_training, training_page


def rows(count: int) -> list[dict]:
    """Figures of `count` iterations of each phase."""
    names = [name for _, group in PANELS for name in group]
    return [
        {"phase": phase, "iteration": i + 1, **dict.fromkeys(names, 0.1 * i)}
        for phase in ("teacher", "student")
        for i in range(count)
    ]


def test_curves_are_a_picture(tmp_path: Path) -> None:
    """Both phases, and a line that was cut off by a kill does not matter."""
    text = "".join(json.dumps(row) + "\n" for row in rows(3))
    (tmp_path / "metrics.jsonl").write_text(text + '{"phase": "stud')
    assert len(read_metrics(tmp_path / "metrics.jsonl")) == 6
    assert draw_training(tmp_path).read_bytes().startswith(b"\x89PNG")


def run_folder(path: Path) -> Path:
    """A run of three iterations of each phase, as far as its page reads it."""
    path.mkdir()
    (path / "config.json").write_text(
        json.dumps({"command": "stiction train", "config": {"seed": 7, "student": {"iterations": 3}}})
    )
    (path / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows(3)))
    return path


def test_the_live_page_shows_the_state_of_a_run(tmp_path: Path) -> None:
    """Holds time left, curves as SVG, newest clip and settings in one file; a browser reloads it after its time."""
    run = run_folder(tmp_path / "first")
    (run / "clips").mkdir()
    for number, name in enumerate(("teacher_000900.webp", "student_000100.webp")):
        (run / "clips" / name).write_bytes(name.encode())
        os.utime(run / "clips" / name, (number, number))
    page = training_page(run, ["Running: 5/6, 4 min left.", "reward 0.04"], refresh=42.4)
    assert '<meta http-equiv="refresh" content="42">' in page
    assert "Training first" in page and "Running: 5/6, 4 min left.<br>reward 0.04" in page
    assert "After iteration 100 of the student." in page and data_uri(b"student_000100.webp", "image/webp") in page
    (svg,) = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert "tracking error [m/s]" in svg and "KL divergence" in svg
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "written anew about every 42 s" in page


def test_the_last_page_of_a_run_stays(tmp_path: Path) -> None:
    """Shows all panels, and asks no browser to load it anew; before the first iteration it has no curves."""
    run = run_folder(tmp_path / "first")
    LivePage(run).end("Finished.")
    page = (run / "report.html").read_text()
    assert "http-equiv" not in page and "Finished." in page and "written anew" not in page
    (run / "metrics.jsonl").unlink()
    assert "<svg" not in training_page(run, ["Stopped."])


def test_the_live_page_takes_its_share_of_the_time(tmp_path: Path, monkeypatch) -> None:
    """Waits for 200 times what the last version took: 2 s are followed by 400 s, 0.01 s by the shortest time, 15 s."""
    now, cost, written = [0.0], [2.0], []

    def make(run: Path, lines: list[str], panels: int, refresh: float) -> str:
        now[0] += cost[0]
        written.append((now[0], panels, refresh))
        return "page"

    monkeypatch.setattr("stiction.report.training.training_page", make)
    page = LivePage(tmp_path, lambda: now[0])
    while len(written) < 2:
        page.update(["Running."])
        now[0] += 1.0
    assert written == [(2.0, 6, 15.0), (404.0, 6, 400.0)]
    cost[0] = 0.01
    for at in (804.0, 819.0, 819.02):
        now[0] = at
        page.update(["Running."])
    assert [round(end, 2) for end, _, _ in written[2:]] == [804.01, 819.03]


def test_a_page_that_cannot_be_written_costs_one_warning(tmp_path: Path) -> None:
    """Goes on training: a damaged config.json, or a full disk, shows where the run itself is written."""
    page = LivePage(tmp_path, iter(range(0, 10_000, 1000)).__next__)
    with pytest.warns(UserWarning) as warned:
        page.update(["Running."])
        page.update(["Running."])
        page.end("Finished.")
    assert len(warned) == 1 and "config.json" in str(warned[0].message)
