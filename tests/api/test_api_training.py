"""A policy from Python: what `train` and `export` make is what the verbs make, and walks in `evaluate`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stiction
from stiction.api.training import Trained
from stiction.core.errors import ConfigurationError, TrainingError
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg
from stiction.learning.presets import preset

TINY = replace(
    preset("quick"),
    network=NetworkCfg(actor=(8,), critic=(8,), history_frame=4, history=(8,), latent=4),
    teacher=TeacherCfg(iterations=2, steps=4, epochs=2, mini_batches=2, latent="history"),
    student=StudentCfg(iterations=0),
    num_envs=4,
    video_every=0,
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trained, list[tuple[str, int, int]]]:
    """A training of two iterations, and what it said after each."""
    seen: list[tuple[str, int, int]] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICTION_THREADS", "1")
        folder = tmp_path_factory.mktemp("api") / "run"
        trained = stiction.train(
            folder,
            robot="go1",
            method="deception",
            friction_level=0.1,
            seed=7,
            config=TINY,
            progress=lambda phase, iteration, iterations, figures: seen.append((phase, iteration, iterations)),
        )
    return trained, seen


def test_a_training_is_a_run_that_the_verbs_read(run: tuple[Trained, list[tuple[str, int, int]]]) -> None:
    """Its folder says what was asked for, and each iteration was seen."""
    trained, seen = run
    header = json.loads((trained.path / "config.json").read_text())
    task = header["config"]["task"]
    assert (header["seed"], task["robot"]) == (7, "go1")
    assert (task["friction"]["method"], task["friction"]["level"]) == ("deception", 0.1)
    assert seen == [("teacher", 1, 2), ("teacher", 2, 2)]
    assert [row["iteration"] for row in trained.metrics()] == [1, 2]
    assert trained.to_dict() == json.loads((trained.path / "summary.json").read_text())
    assert "min" in repr(trained) and "walk/tracking_error" in trained.table()
    with pytest.raises(ConfigurationError, match="is in "):
        trained.write(trained.path)


def test_a_second_training_into_its_folder_is_refused(run: tuple[Trained, list[tuple[str, int, int]]]) -> None:
    """Nothing is lost."""
    before = (run[0].path / "metrics.jsonl").read_bytes()
    with pytest.raises(TrainingError, match="holds a run already"):
        stiction.train(run[0].path, config=TINY)
    assert (run[0].path / "metrics.jsonl").read_bytes() == before


def test_its_bundle_is_checked_and_walks(run: tuple[Trained, list[tuple[str, int, int]]]) -> None:
    """`export` returns the policy that `load_policy` reads from the folder, with the student's actions."""
    lines: list[str] = []
    policy = stiction.export(run[0], say=lines.append)
    again = stiction.load_policy(run[0].path / "bundle")
    assert policy.digest == again.digest and policy.contract.robot == "go1"
    frames = np.random.default_rng(0).normal(size=(3, policy.contract.observation.size)).astype(np.float32)
    assert np.array_equal(policy.network(frames), again.network(frames))
    walked = stiction.evaluate(policy, friction_levels=(0.0, 0.1), commands=("vx=0.5",), episodes=2, seconds=3.0)
    assert [(row.engine, row.friction_level, row.episodes) for row in walked] == [
        ("mujoco", 0.0, 2),
        ("mujoco", 0.1, 2),
    ]


def test_a_run_that_is_not_finished_is_not_exported(
    run: tuple[Trained, list[tuple[str, int, int]]], tmp_path: Path
) -> None:
    """And no folder is left where the bundle was to be."""
    half = tmp_path / "half"
    half.mkdir()
    (half / "config.json").write_bytes((run[0].path / "config.json").read_bytes())
    with pytest.raises(TrainingError, match="finish it with"):
        stiction.export(half)
    assert not (half / "bundle").exists()
