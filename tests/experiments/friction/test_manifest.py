"""The manifest: every run can be started, and what is compared differs in what it says."""

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from stiction.core.errors import StictionError
from stiction.learning.arguments import parse
from stiction.learning.config import TrainCfg
from stiction.learning.presets import PRESETS
from stiction.robots.catalog import find_robot
from stiction.robots.physics import EXACT, FAST
from stiction.task.config import NoiseCfg, RandomizationCfg
from stiction.task.friction import FrictionCfg
from stiction_experiments.friction.evaluation import training_mean
from stiction_experiments.friction.manifest import MANIFEST, ONE_PHASE, PARTS, condition_of, runs_of
from stiction_experiments.friction.planned import PlannedRun


@cache
def configured() -> dict[str, TrainCfg]:
    """Return the configuration of each condition: seconds of work, which those that only look for tests need not do."""
    return {c.name: parse([*c.runs[0].arguments]).config for c in MANIFEST}


def test_every_condition_is_a_configuration_and_seeds_change_nothing_else() -> None:
    """Every command line parses, and its seeds differ in nothing else."""
    for condition in MANIFEST:
        find_robot(configured()[condition.name].task.robot)
        words = [run.arguments for run in condition.runs]
        assert [w[-4:-2] for w in words] == [("--seed", str(seed)) for seed in condition.seeds]
        assert {w[:-4] + w[-2:] for w in words} == {words[0][:-4] + words[0][-2:]}
    fourth = MANIFEST[0].runs[3]
    assert parse([*fourth.arguments]).config == replace(configured()[MANIFEST[0].name], seed=3)
    assert parse([*fourth.arguments]).config == fourth.configuration()


def test_names_are_unique_and_read_back() -> None:
    """Names of runs are unique, and tell condition and seed."""
    names = [run.name for run in runs_of(())]
    assert len(set(names)) == len(names)
    assert [condition_of(run.name) for run in runs_of(())] == [(r.condition.name, r.seed) for r in runs_of(())]
    with pytest.raises(StictionError, match="CONDITION-s<SEED>"):
        condition_of("saturn_lite-flat-none-0.2")


def test_no_two_conditions_are_the_same_run() -> None:
    """No two conditions have the same configuration."""
    assert Counter(configured().values()).most_common(1)[0][1] == 1


def test_part_one_is_the_runs_that_were_begun_by_hand() -> None:
    """Commands of part 1 are, word by word, those of the existing runs."""
    words = "--preset two-phase --method direct --friction-level 0.2 --seed 3 --video-every 0"
    assert [" ".join(r.arguments) for r in runs_of(["1"]) if r.name == "coulomb20-direct-s3"] == [words]
    methods = ["none", "direct", "deception"]
    assert [r.name for r in runs_of(["1"])] == [f"coulomb20-{m}-s{seed}" for seed in range(5) for m in methods]


def test_budget_is_the_same_unless_it_is_the_question() -> None:
    """Methods have the same budget, but for conditions about the budget."""
    budget = PRESETS["two-phase"]
    two_phase = {condition.name for condition in MANIFEST if condition.runs[0].preset == "two-phase"}
    for name, cfg in ((name, cfg) for name, cfg in configured().items() if name in two_phase):
        factor = 3 if name.endswith("-long") else 1
        student = 3 if name == "coulomb20-deception-student240" else factor
        assert cfg.teacher.iterations == factor * budget.teacher.iterations, name
        assert cfg.student.iterations == student * budget.student.iterations, name
        assert (cfg.num_envs, cfg.teacher.steps) == (budget.num_envs, budget.teacher.steps), name


def test_designs_and_methods_are_compared_on_one_ground_and_friction() -> None:
    """Designs share ground, simulation and friction, but for conditions about these."""
    quiet = ("quiet", "known-quiet", "rows", "rows-load-spread")
    drawn = ("drawn-contact", "fine-contact", "known-drawn", "rows-loud", *quiet)
    other = {f"coulomb20-{name}" for name in drawn}
    for condition in (one for one in MANIFEST if one.part in ("designs", "methods")):
        ground = configured()[condition.name].task.randomization.contact_time
        assert (ground == (0.02, 0.02)) == (condition.name not in other), condition.name
        physics = configured()[condition.name].task.physics
        assert physics == (EXACT if condition.name.startswith("coulomb20-rows") else FAST), condition.name
        last = configured()[condition.name].teacher.quiet
        assert last == (30 if condition.name.removeprefix("coulomb20-") in quiet else 0), condition.name


def literal_paper() -> TrainCfg:
    """Return the paper to the letter: without noise, friction of 1 % in each joint, both encoders trained."""
    paper = PRESETS["paper"]
    task = replace(paper.task, friction=FrictionCfg(level=0.01, per="joint"), noise=NoiseCfg(0.0, 0.0, 0.0, 0.0))
    return replace(paper, task=task, teacher=replace(paper.teacher, both_ways=True))


def test_the_literal_rows_are_the_paper_at_the_budget_of_all() -> None:
    """The literal rows are the paper's configuration at the common budget."""
    literal, budget = literal_paper(), PRESETS["two-phase"]
    phases = {
        "teacher": replace(literal.teacher, iterations=budget.teacher.iterations),
        "student": replace(literal.student, iterations=budget.student.iterations),
    }
    expected = replace(literal, **phases, video_every=0)
    assert configured()["literal01-mujoco"] == expected
    assert configured()["literal01-physx"] == replace(expected, engine="physx")


def test_what_is_varied_is_what_the_purpose_says() -> None:
    """Mean frictions and first torques of the conditions are those worked out by hand."""
    means = {name: training_mean(cfg.task.friction) for name, cfg in configured().items()}
    assert means["coulomb20-none"] == 0.0
    assert means["coulomb20-deception"] == means["coulomb20-narrow"] == pytest.approx(0.12)
    assert means["coulomb20-mean-kept"] == means["coulomb20-direct"] == pytest.approx(0.2)
    assert means["coulomb20-mixture"] == pytest.approx(0.16)
    assert _shank_friction("coulomb20-direct") == pytest.approx(9.0)
    assert _first_action("coulomb20-direct-strong") == pytest.approx(40.0)
    assert _first_action("coulomb20-direct") == pytest.approx(20.0)
    assert _first_action("coulomb20-none-mid") == pytest.approx(7.5) and 0.2 * 25.0 < 7.5 < 0.2 * 45.0
    assert _first_action("coulomb20-direct-weak") == pytest.approx(3.75) and 3.75 < 0.2 * 25.0


def _shank_friction(name: str) -> float:
    """Nominal friction of the shank [N m]."""
    task = configured()[name].task
    return task.friction.level * find_robot(task.robot).kind("shank").torque_limit


def _first_action(name: str) -> float:
    """Torque of one standard deviation of the first actions [N m]."""
    cfg = configured()[name]
    robot = find_robot(cfg.task.robot)
    return robot.kind("shank").kp * robot.action_scale * cfg.network.initial_std


def test_parts_come_in_order_and_unknown_ones_are_named() -> None:
    """Parts come in order; rejects an unknown part."""
    parts = [run.condition.part for run in runs_of(["2", "1"])]
    assert parts == sorted(parts) and set(parts) == {"1", "2"}
    assert {run.condition.part for run in runs_of(())} <= set(PARTS)
    with pytest.raises(StictionError, match="unknown part '7'"):
        runs_of(["7"])


def test_every_part_has_the_presets_that_its_options_were_written_for() -> None:
    """A part that names phases would with one phase be trained as something that nobody meant, and the other way."""
    runs = runs_of((), "quick")
    assert {run.condition.part for run in runs} == {"designs", "methods", "cohort"}
    assert all(run.arguments[:2] == ("--preset", "quick") for run in runs)
    with pytest.raises(StictionError, match="part 2 is not trained with the preset 'quick'"):
        runs_of(["cohort", "2"], "quick")
    with pytest.raises(StictionError, match="part designs is not trained with the preset 'two-phase'"):
        runs_of(["designs"])
    own = {run.name for run in runs_of(())} | {run.name for run in runs}
    assert own == {run.name for condition in MANIFEST for run in condition.runs}


def test_designs_have_one_budget() -> None:
    """Designs have one budget: 440 iterations, however they are divided; 333 where an update of 0.48 s in 1.49 s has
    twice the samples, 440 · 1.49 / 1.97; 290 where a recurrent encoder makes an iteration one and a half times as dear;
    393 of four supervised passes, 440 · 2.20 / (2.20 + 3 · 0.087).
    """
    for condition in MANIFEST:
        if condition.part in ("designs", "methods"):
            cfg = configured()[condition.name]
            iterations = 290 if cfg.network.recurrent else 333 if cfg.symmetry == "batches" else 440
            iterations = 393 if cfg.teacher.adaptation_passes == 4 else iterations
            assert cfg.teacher.iterations + cfg.student.iterations == iterations, condition.name
            assert (cfg.num_envs, cfg.teacher.steps) == (512, 24), condition.name


def test_the_cost_of_a_run_is_that_of_its_control_steps() -> None:
    """Every robot and step of a training costs 0.179 ms on sliders, 0.242 on rows and 1.2 in PhysX."""
    planned = PlannedRun.of(runs_of(["cohort"], ONE_PHASE)[0], Path("runs"))
    cfg = planned.cfg
    steps = 512 * 24 * (cfg.teacher.iterations + cfg.student.iterations) / 60.0
    for engine, physics, cost in (("mujoco", FAST, 0.179e-3), ("mujoco", EXACT, 0.242e-3), ("physx", EXACT, 1.2e-3)):
        ground = replace(cfg.task.randomization, contact_time=RandomizationCfg().contact_time)
        other = replace(cfg, engine=engine, task=replace(cfg.task, physics=physics, randomization=ground))
        assert replace(planned, cfg=other).minutes() == pytest.approx(cost * steps)
