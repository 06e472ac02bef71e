"""Evaluation of runs: what is asked of each, what is kept, and what is read again."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import pytest

from stiction.core import cache
from stiction.core.errors import StictionError
from stiction.evaluation.policies import method_of, method_texts
from stiction.files.bundle import read_bundle, write_bundle
from stiction.learning.arguments import parse
from stiction.learning.identity import settings_of
from stiction_experiments.friction.evaluation import BASE, LEVELS, Task, evaluate_tasks, settings_for, tasks_for
from stiction_experiments.friction.manifest import Condition, Run
from stiction_experiments.friction.planned import PlannedRun, unrecorded
from stiction_experiments.lab import trained as run_evaluation
from stiction_experiments.methods.friction import BY_ERROR
from synthetic import place, row, write_run


@pytest.fixture
def walked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Evaluations that were really walked; walking itself is made up."""
    names: list[str] = []

    def walk(run: Path, who: str, cfg) -> SimpleNamespace:
        names.append(f"{run.name}/{who}")
        if run.name == "bad-s0":
            raise StictionError("the robot is unknown")
        return SimpleNamespace(rows=[row(names[-1], level, "vx=0.5", 1 / 3) for level in cfg.friction_levels])

    monkeypatch.setattr(run_evaluation, "walk_run", walk)
    return names


def tasks(tmp_path: Path, name: str = "toy") -> list[Task]:
    """The student of a finished run."""
    at = place(tmp_path, name, 0, "--friction-level", "0.2")
    write_run(at)
    return [task for task in tasks_for([at], BASE) if task.who == "student"]


def test_an_evaluation_is_done_once_and_again_when_what_it_depends_on_changes(
    tmp_path: Path, walked: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Evaluates once, and again after a change of settings, weights or code."""
    task = tasks(tmp_path)[0]
    rows, failed = evaluate_tasks([task], 1)
    assert not failed and [r.speed_ratio for r in rows] == [0.333333] * len(LEVELS)
    assert evaluate_tasks([task], 1) == (rows, {}) and len(walked) == 1
    evaluate_tasks([replace(task, settings=replace(task.settings, episodes=17))], 1)
    assert len(walked) == 2
    (task.run.path / "checkpoints/student_000001.safetensors").write_text("other weights")
    evaluate_tasks([task], 1)
    assert len(walked) == 3
    monkeypatch.setattr(cache, "fingerprint", lambda *code: {"code": "other"})
    evaluate_tasks([task], 1)
    assert len(walked) == 4


def edited(task: Task, **changes: object) -> str:
    """The key of a task after config.json of its run was edited, which is put back."""
    file = task.run.path / "config.json"
    text = file.read_text()
    header = json.loads(text)
    for name, value in changes.items():
        *outer, last = name.split("__")
        inner = header
        for part in outer:
            inner = inner[part]
        assert inner[last] != value
        inner[last] = value
    file.write_text(json.dumps(header))
    key = task.key
    file.write_text(text)
    return key


def test_runs_with_the_same_weights_that_walk_differently_have_different_keys(tmp_path: Path) -> None:
    """A run's network meets the joints, gains, clip and histories of its configuration: others are another walk."""
    (task,) = tasks(tmp_path)
    identified = {"file": "joints.json", "sha256": "0" * 64, "values": {"damping": [0.1] * 18}}
    keys = [
        task.key,
        edited(task, identified=identified),
        edited(task, identified=identified | {"values": {"damping": [0.2] * 18}}),
        edited(task, config__task__action_clip=4.0),
        edited(task, config__task__history=5),
        edited(task, config__task__timestep=0.0025),
        replace(task, settings=replace(task.settings, known_friction="true")).key,
        replace(task, settings=replace(task.settings, friction_law="stribeck")).key,
    ]
    assert len({*keys}) == len(keys) and task.key == keys[0]


def test_a_finished_run_walks_by_the_policy_that_was_exported_of_it(tmp_path: Path) -> None:
    """The student walks as its exported bundle; the teacher is in no bundle, and walks from the folder."""
    at = place(tmp_path, "toy", 0, "--friction-level", "0.2")
    write_run(at)
    for file in list((tmp_path / "toy-s0/checkpoints").iterdir()):
        (file.parent / f"teacher_000001{file.suffix}").write_bytes(file.read_bytes())
    for policy in (None, SHIPPED):
        exported = {task.who: task.exported for task in tasks_for([replace(at, policy=policy)], BASE)}
        assert exported == {"teacher": False, "student": policy is not None}


def test_a_policy_that_cannot_be_evaluated_stops_nobody(tmp_path: Path, walked: list) -> None:
    """Names a policy that fails, and evaluates the others."""
    rows, failed = evaluate_tasks([*tasks(tmp_path, "bad"), *tasks(tmp_path)], 1)
    assert {r.policy for r in rows} == {"toy-s0/student"}
    assert failed == {"bad-s0/student": "the robot is unknown"}


def test_a_run_whose_checkpoint_is_gone_stops_nobody(tmp_path: Path, walked: list) -> None:
    """Names a run without its checkpoint, which the cache key needs, and evaluates the others."""
    gone = tasks(tmp_path, "gone")
    for file in (tmp_path / "gone-s0" / "checkpoints").glob("student*"):
        file.unlink()
    rows, failed = evaluate_tasks([*gone, *tasks(tmp_path)], 1)
    assert {r.policy for r in rows} == {"toy-s0/student"} and "has no student" in failed["gone-s0/student"]


def test_the_cache_can_lie_elsewhere(tmp_path: Path, walked: list) -> None:
    """Writes rows to another cache folder, and nothing into the runs."""
    at = place(tmp_path / "runs", "toy", 0, "--friction-level", "0.2")
    write_run(at)
    before = sorted((tmp_path / "runs").rglob("*"))
    (tmp_path / "runs/toy-s0/checkpoints/teacher_000001.safetensors").write_text("teacher")
    (tmp_path / "runs/toy-s0/checkpoints/teacher_000001.json").write_text("{}")
    tasks = tasks_for([at], BASE, tmp_path / "cache")
    assert [task.name for task in tasks] == ["toy-s0/teacher", "toy-s0/student"]
    evaluate_tasks(tasks, 1)
    assert len(list((tmp_path / "cache/toy-s0").glob("*.json"))) == 2
    assert len(sorted((tmp_path / "runs").rglob("*"))) == len(before) + 2


SHIPPED = Path(str(files("stiction"))) / "policies/saturn_lite-flat-none-0.2"
"""A policy that is always here."""


def exported(tmp_path: Path, seed: int) -> PlannedRun:
    """The run of the shipped policy as the manifest has it, its folder elsewhere."""
    words = ("--method", "none", "--friction-level", "0.2")
    run = Run(Condition("coulomb20-none", "1", "a test", words, (seed,)), seed, "quick")
    return PlannedRun(run, parse([*run.arguments]).config, tmp_path / run.name, SHIPPED)


def test_a_run_that_is_elsewhere_is_evaluated_by_its_policy(tmp_path: Path) -> None:
    """Evaluates an exported policy without its training, under the name of the run."""
    seed = read_bundle(SHIPPED).contract.seed
    at = exported(tmp_path, seed)
    (task,) = tasks_for([at], replace(BASE, friction_levels=(0.2,), episodes=1, seconds=3.0), tmp_path / "cache")
    task = replace(task, settings=replace(task.settings, commands=("vx=0.5",), friction_levels=(0.2,)))
    rows, failed = evaluate_tasks([task], 1)
    assert not failed and [r.policy for r in rows] == [f"coulomb20-none-s{seed}/student"]
    with pytest.raises(StictionError, match="is another policy than the manifest's"):
        evaluate_tasks([replace(task, run=exported(tmp_path, seed + 1))], 1)


def recorded(tmp_path: Path, *words: str, **changes: object) -> PlannedRun:
    """A run of the manifest whose exported policy has the settings of a training by `words`, or other ones."""
    shipped = read_bundle(SHIPPED)
    condition = Condition("coulomb20-none", "1", "a test", ("--method", "none", "--friction-level", "0.2", *words))
    settings = settings_of(Run(condition, 0, "quick").configuration())
    contract = replace(shipped.contract, **({"settings": settings} | changes))  # type: ignore[arg-type]
    golden = replace(shipped.golden)
    bundle = write_bundle(tmp_path / "policies" / f"s{len(words)}", contract, shipped.policy, golden, shipped.card)
    return replace(exported(tmp_path, contract.seed), policy=bundle)


def test_a_policy_of_other_settings_is_not_the_manifests(tmp_path: Path) -> None:
    """Renamed, a policy of another training would be a seed of this one."""
    assert recorded(tmp_path).bundle()
    other = recorded(tmp_path, "--teacher.quiet", "20", "--symmetry", "half")
    words = (
        r"s4 is another policy than the manifest's: it was trained with symmetry half, expected network \(1 more diff"
    )
    with pytest.raises(StictionError, match=words):
        other.bundle()
    with pytest.raises(StictionError, match="another policy"):
        unrecorded([exported(tmp_path, 0), other])


def test_a_policy_of_compensation_by_the_error_is_not_the_manifests(tmp_path: Path) -> None:
    """Rejects policies of the earlier compensation, by the error, as seeds of the one by the speed of the joints."""
    shipped, words = read_bundle(SHIPPED), ("--method", "compensation", "--friction-level", "0.2")
    run = Run(Condition("coulomb20-compensation", "2", "a test", words, (0,)), 0, "quick")
    own = {"seed": 0, "method": "compensation", "compensation": (0.05,) * 18, "settings": None}
    own |= {"friction_range": (0.16, 0.24)}
    for name, speeds in (("new", (0.2, 0.3)), ("old", None)):
        contract = replace(shipped.contract, **own, compensation_speeds=speeds)
        bundle = write_bundle(tmp_path / name, contract, shipped.policy, replace(shipped.golden), shipped.card)
        planned = PlannedRun(run, parse([*run.arguments]).config, tmp_path / run.name, bundle)
        if speeds:
            assert planned.bundle().contract == contract and method_of(contract) == "compensation"
    assert method_of(contract) == BY_ERROR in method_texts()
    with pytest.raises(StictionError, match="old is another policy than the manifest's: its friction was added by"):
        planned.bundle()


def test_a_policy_of_hinf_without_settings_is_of_the_constraint_that_asked_for_nothing(tmp_path: Path) -> None:
    """Rejects policies of the earlier constraint as seeds of the present one."""
    shipped, words = read_bundle(SHIPPED), ("--method", "hinf", "--friction-level", "0.2")
    run = Run(Condition("coulomb20-hinf-force", "methods", "a test", words, (0,)), 0, "quick")
    cfg = parse([*run.arguments]).config
    for name, settings in (("new", settings_of(cfg)), ("old", None)):
        contract = replace(shipped.contract, seed=0, method="hinf", settings=settings)
        bundle = write_bundle(tmp_path / name, contract, shipped.policy, replace(shipped.golden), shipped.card)
        planned = PlannedRun(run, cfg, tmp_path / run.name, bundle)
        if settings:
            assert planned.bundle().contract == contract
    with pytest.raises(StictionError, match="old is another policy than the manifest's: its constraint asked for noth"):
        planned.bundle()


def test_policies_without_settings_are_taken_at_their_names(tmp_path: Path) -> None:
    """Accepts policies without recorded settings, and names them once."""
    shipped, newer = read_bundle(SHIPPED), recorded(tmp_path)
    contract = replace(shipped.contract, settings=None)
    bundle = write_bundle(tmp_path / "older", contract, shipped.policy, replace(shipped.golden), shipped.card)
    older = replace(exported(tmp_path, contract.seed), policy=bundle)
    assert older.bundle().contract.settings is None
    assert unrecorded([older, newer]) == [older.run.name]


def test_levels_follow_the_torque_and_hold_the_mean_of_training() -> None:
    """Twice the limit at half the level is the same friction in N m; a mixture's mean, 0.16, is evaluated too."""
    quick = ["--preset", "two-phase", "--friction-level"]
    doubled = settings_for(parse([*quick, "0.1", "--robot", "saturn_lite@torque=2"]).config)
    assert doubled.friction_levels == pytest.approx([level / 2 for level in LEVELS])
    mixture = ["--task.friction.mixture", "0.2", "0", "0", "0.8", "1", "1"]
    assert settings_for(parse([*quick, "0.2", *mixture]).config).friction_levels == tuple(sorted({*LEVELS, 0.16}))


def test_a_policy_is_evaluated_under_its_own_law() -> None:
    """Trained with 0.1 (|F| + |T|), U(0, 1.2): its coefficients, and the mean 0.06; nothing in torque limits."""
    cfg = settings_for(parse(["--preset", "two-phase", "--friction-law", "load", "--friction-level", "0.1"]).config)
    assert cfg.friction_law == "load" and cfg.friction_levels == (0.0, 0.02, 0.05, 0.06, 0.1, 0.2, 0.3, 0.442)


def test_a_run_with_the_robots_own_friction_is_refused() -> None:
    """Rejects a run whose friction differs from joint to joint."""
    with pytest.raises(StictionError, match="--friction-level"):
        settings_for(parse(["--preset", "two-phase", "--method", "direct"]).config)
