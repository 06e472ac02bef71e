"""Overviews of runs, from folders that hold what a training writes, and from damaged ones."""

from __future__ import annotations

import os
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from run_folders import CFG, make_run
from stiction.core.errors import FileError
from stiction.core.lock import LOCK, output_folder
from stiction.files.results import ResultRow, write_results
from stiction.learning.overview import DEPTH, different, read_overview, run_folders, short_names

ROW = ResultRow(
    policy="bundle", method="none", seed=3, engine="mujoco", friction_law="coulomb", friction_level=0.2, terrain="flat",
    command="vx=0.5", speed_ratio=1.0, tracking_error=0.1, fall_rate=0.0, distance=4.0, steps_climbed=None,
    cost_of_transport=0.5, joint_jitter=100.0, tripod_share=0.5, flight_share=0.0, episodes=8,
    mean_vx=0.5, mean_vy=0.0, mean_wz=0.0,
)  # fmt: skip
"""A command that is followed."""


def test_the_state_of_a_run_by_its_files(tmp_path: Path) -> None:
    """Tells stopped from running by the lock and from finished by the summary; a killed run leaves its lock file."""
    run = make_run(tmp_path / "a", rows=30, cfg=replace(CFG, seed=3))
    (run / LOCK).write_text("{}")
    overview = read_overview(run)
    assert (overview.robot, overview.method, overview.seed) == ("saturn_lite", CFG.task.friction.method, 3)
    assert (overview.done, overview.iterations, overview.state) == (30, 150, "stopped")
    # Iterations 11 to 30.
    assert overview.ends == {"reward": 20.5, "walk/falls": 0.5}
    with output_folder(run):
        assert read_overview(run).state == "running"
    (run / "summary.json").write_text("{}")
    assert read_overview(run).state == "finished"


def test_ends_are_those_of_the_last_phase(tmp_path: Path) -> None:
    """Leaves the teacher's figures out where the student has begun, and a line that a kill cut off."""
    run = make_run(tmp_path / "a", rows=100)
    with (run / "metrics.jsonl").open("a") as file:
        file.write('{"phase": "student", "iteration": 1, "reward": 7.0}\n{"phase": "stu')
    assert (read_overview(run).done, read_overview(run).ends) == (101, {"reward": 7.0})


def test_a_run_without_iterations_counts_none(tmp_path: Path) -> None:
    """Shows a run that has just begun."""
    run = make_run(tmp_path / "a")
    (run / "metrics.jsonl").unlink()
    assert (read_overview(run).done, read_overview(run).ends) == (0, {})


def test_followed_commands_are_those_of_the_newest_evaluation(tmp_path: Path) -> None:
    """Counts the rows that are followed: one of two; the older evaluation, and a damaged one, do not count."""
    run = make_run(tmp_path / "a")
    assert read_overview(run).followed is None
    for number, (name, rows) in enumerate({"old": [ROW], "new": [ROW, replace(ROW, mean_vx=0.1)]}.items()):
        (run / name).mkdir()
        write_results(run / name / "results.csv", rows)
        os.utime(run / name / "results.csv", (number, number))
    assert read_overview(run).followed == (1, 2)
    (run / "results.csv").write_text("no table")
    assert read_overview(run).followed is None


@pytest.mark.parametrize(
    ("file", "content", "cause"),
    [
        ("config.json", "{", "not JSON"),
        ("config.json", "[]", "holds a list"),
        ("config.json", '{"model_type": "llama"}', "no robot, method, seed and iterations"),
        ("config.json", '{"seed": 1, "config": {"task": 3}}', "no robot, method, seed and iterations"),
        ("metrics.jsonl", "reward\n", "not JSON"),
        ("metrics.jsonl", "3\n", "no figures of iterations"),
        ("metrics.jsonl", "[" * 100_000 + "\n", "not JSON"),
    ],
)
def test_damage_is_named(file: str, content: str, cause: str, tmp_path: Path) -> None:
    """Raises the one kind of error that the list turns into a line."""
    run = make_run(tmp_path / "a", rows=1)
    (run / file).write_text(content)
    with pytest.raises(FileError, match=f"{file}.*{cause}"):
        read_overview(run)


def test_runs_are_those_with_a_configuration(tmp_path: Path) -> None:
    """Finds runs at any depth up to the limit; does not enter runs, hidden folders or links, one of them a circle."""
    for name in ("a", "cohort/b", "a/bundle/inner", ".hidden/c", "/".join("d" * DEPTH), "/".join("e" * (DEPTH + 1))):
        make_run(tmp_path / name)
    (tmp_path / "cohort/circle").symlink_to(tmp_path)
    names = sorted(str(path.relative_to(tmp_path)) for path in run_folders(tmp_path))
    assert names == ["a", "cohort/b", "/".join("d" * DEPTH)]
    assert run_folders(tmp_path / "a") == [tmp_path / "a"]
    with pytest.raises(FileError, match="got no folder"):
        run_folders(tmp_path / "none")


def test_a_search_has_a_bound(tmp_path: Path, monkeypatch) -> None:
    """Rejects a whole disk."""
    monkeypatch.setattr("stiction.learning.overview.MOST_FOLDERS", 2)
    for name in "abc":
        (tmp_path / name).mkdir()
    with pytest.raises(FileError, match="over 2 folders"):
        run_folders(tmp_path)


def test_settings_that_differ(tmp_path: Path) -> None:
    """Names each by its path; a setting that an older run does not have is None there."""
    new = read_overview(make_run(tmp_path / "a", cfg=replace(CFG, seed=1, teacher=replace(CFG.teacher, gamma=0.98))))
    config = asdict(CFG)
    del config["logger"]
    old = read_overview(make_run(tmp_path / "deep/b", config=config))
    assert different([new, old]) == {
        "teacher.gamma": [0.98, 0.99],
        "seed": [1, 0],
        "logger": ["tensorboard", None],
    }
    assert different([new, new]) == {}
    assert short_names([new.path, old.path]) == ["a", "deep/b"]
