"""Effects of other latents: paired by episode, pooled over seeds; and a study that refuses what it cannot do."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.evaluation.evaluate import EvaluationCfg
from stiction.evaluation.export import export_run
from stiction.learning.arguments import parse
from stiction.learning.config import StudentCfg, TrainCfg
from stiction.learning.run import RunDirectory, save_checkpoint
from stiction.task.friction import FrictionCfg
from stiction_experiments.adaptation.monitor import over_seeds, per_episode
from stiction_experiments.adaptation.probes import WalkCfg, probe_task
from stiction_experiments.adaptation.run import AdaptationCfg, same_but_for_seed, study, study_run


@dataclass(frozen=True)
class Walked:
    """Evaluation as `per_episode` reads it."""

    episodes: list


@dataclass(frozen=True)
class Figure:
    """Episode as `per_episode` reads it."""

    speed_ratio: float


def test_episodes_are_averaged_over_commands_and_kept_apart() -> None:
    """Two levels, two commands, two episodes: of the second level (1, 2) forward and (3, 5) backward make (2, 3.5)."""
    rows = [[0.0, 0.0], [0.0, 0.0], [1.0, 2.0], [3.0, 5.0]]
    walk = Walked([[Figure(value) for value in row] for row in rows])
    cfg = EvaluationCfg(friction_levels=(0.0, 0.2), episodes=2)
    assert per_episode(walk, cfg, 1, "speed_ratio").tolist() == [2.0, 3.5]  # type: ignore[arg-type]


def test_a_part_counts_by_the_run_that_it_is_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With other joints, the same student walks and feels otherwise: its old part would stand for it."""
    run, keys = tmp_path / "toy-s0", []
    words = ["--preset", "two-phase", "--teacher.iterations", "1", "--student.iterations", "1"]
    header = {"command": "stiction train", "revision": "abc", "seed": 0, "identified": None}
    config = asdict(parse([*words, "--friction-level", "0.2", "--seed", "0"]).config)
    files = {
        "config.json": json.dumps(header | {"config": config}),
        "checkpoints/student_000001.safetensors": "weights",
        "checkpoints/student_000001.json": "{}",
        "summary.json": "{}",
    }
    for name, text in files.items():
        (run / name).parent.mkdir(parents=True, exist_ok=True)
        (run / name).write_text(text)
    monkeypatch.setattr("stiction_experiments.adaptation.run.read_entry", lambda file, key: keys.append(key) or {})
    file = run / "config.json"
    text = files["config.json"]
    for identified in (None, {"file": "j", "sha256": "0" * 64}, None):
        file.write_text(json.dumps(json.loads(text) | {"identified": identified}))
        study_run(run, tmp_path, AdaptationCfg(), 1, lambda name, share: None)
    assert keys[0] == keys[2] != keys[1]


def test_seeds_are_pooled_with_a_t_interval() -> None:
    """Differences 1, 2, 3 over three seeds: 2 plus or minus 2.484; a single seed has no interval."""
    runs = [
        {"effects": [{"latent": "mean", "level": 0.1, "figure": "f", "own": 1.0, "value": 1 + d, "difference": d}]}
        for d in (1.0, 2.0, 3.0)
    ]
    pooled = over_seeds(runs)[0]
    assert pooled["interval95"] == pytest.approx([2 - 2.48414, 2 + 2.48414], abs=1e-4)
    assert (pooled["value"], pooled["seeds"], pooled["each"]) == (3.0, 3, [1.0, 2.0, 3.0])
    assert over_seeds(runs[:1])[0]["interval95"] is None


def test_only_runs_that_differ_in_nothing_but_the_seed_are_seeds_of_one_training() -> None:
    """A narrow range and a long budget go by the same method: pooled, their t-interval would be of nothing."""
    first = TrainCfg()
    long = replace(first, teacher=replace(first.teacher, iterations=9))
    runs = [("direct", first), ("none", first), ("direct", replace(first, seed=1)), ("direct", long)]
    runs[1] = ("none", replace(first, task=replace(first.task, friction=FrictionCfg(method="none"))))
    assert same_but_for_seed(runs) == {"direct 1": [0, 2], "none": [1], "direct 2": [3]}


@pytest.mark.parametrize("method", ["none", "deception", "compensation"])
def test_a_probed_walk_has_the_friction_that_was_asked_for(method: str) -> None:
    """Whatever the run was trained with, at its own level: 0 to 24 % of the torque limit, each joint by itself."""
    task = TrainCfg().task
    task = replace(task, friction=replace(task.friction, method=method, level=0.1))
    friction = probe_task(task, "joint", WalkCfg()).friction
    low, high = friction.last.range
    assert (low, high * 0.1, friction.per) == (0.0, pytest.approx(0.24), "joint")
    assert (friction.method == "compensation") == (method == "compensation")


def test_what_cannot_be_studied_is_refused(tmp_path: Path) -> None:
    """One level leaves nothing to swap, ten robots nothing to test on, an unfinished student nothing to say."""
    with pytest.raises(StictionError, match="at least two"):
        AdaptationCfg(EvaluationCfg(friction_levels=(0.1,)))
    with pytest.raises(StictionError, match="10 robots"):
        AdaptationCfg(walk=WalkCfg(robots=10))
    with pytest.raises(StictionError, match="5 s"):
        AdaptationCfg(walk=WalkCfg(seconds=5.0))
    run = RunDirectory.create(tmp_path / "run", TrainCfg(), "stiction train", None)
    with pytest.raises(StictionError, match="not finished"):
        study([run.path], tmp_path, AdaptationCfg(), 1)
    with pytest.raises(StictionError, match="two runs are called 'run'"):
        study([run.path, run.path], tmp_path, AdaptationCfg(), 1)


def test_a_monitor_of_another_student_does_not_get_into_a_bundle(tmp_path: Path) -> None:
    """Seeds look alike by name; the map of one says nothing about the walk of another."""
    cfg = TrainCfg(student=StudentCfg(iterations=1))
    run = RunDirectory.create(tmp_path / "run", cfg, "stiction train", None)
    save_checkpoint(run.checkpoints / "student_000001.safetensors", {"iteration": 1})
    (run.path / "summary.json").write_text(
        '{"last": {"teacher": {"walk/tracking_error": 0.1, "walk/tripod_share": 0.5}}, "seconds": 1.0}'
    )
    assert len(run.student_digest()) == 64
    from stiction.files.wear import WearModel

    model = WearModel(
        joint_names=("a",),
        window=1,
        center=(0.0,),
        scale=(1.0,),
        limit=3.0,
        weights=((1.0, 1.0),),
        intercept=(0.0, 0.0),
        reach=(0.1, 0.1),
        estimated=(True, True),
        determination=(0.9, 0.9),
        coverage=(0.95, 0.95),
        threshold=0.5,
        highest=0.24,
        unusual=1.0,
        student="0" * 64,
    )
    (tmp_path / "wear.json").write_text(model.to_json())
    with pytest.raises(StictionError, match="another student"):
        export_run(run.path, tmp_path / "bundle", tmp_path / "wear.json")
    with pytest.raises(StictionError, match="cannot read"):
        export_run(run.path, tmp_path / "bundle", tmp_path / "nothing.json")
