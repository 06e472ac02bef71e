"""Settings without effect are refused where somebody changed them, and a preset's own never are."""

from pathlib import Path
from typing import get_args

import pytest

from stiction.core.errors import ConfigurationError
from stiction.files.method import method_names
from stiction.learning.arguments import parse
from stiction.learning.begin import begin_run
from stiction.learning.effects import check_effects
from stiction.learning.presets import PresetName

REFUSED = [
    ("--student.iterations 0 --teacher.latent history --student.steps 12", "--student.steps 12", "second phase"),
    ("--preset quick --set student.learning_rate=0.001", "--set student.learning_rate=0.001", "second phase"),
    ("--preset full --student.noise half", "--student.noise half", "with --student.iterations 0"),
    ("--preset full --student.algorithm ppo", "--student.algorithm ppo", "with --student.iterations 0"),
    ("--student.algorithm ppo --student.mini-batches 2", "--student.mini-batches 2", "is of distillation"),
    (
        "--student.algorithm ppo --set student.adaptation_weight=1",
        "--set student.adaptation_weight=1.0",
        "is of distillation",
    ),
    (
        "--student.algorithm ppo --set student.estimator_weight=1",
        "--set student.estimator_weight=1.0",
        "is of distillation",
    ),
    ("--teacher.latent groups --set teacher.alternate=2", "--set teacher.alternate=2", "only with alternate"),
    ("--preset full --set teacher.alternate=20", "--set teacher.alternate=20", "with --teacher.latent history"),
    ("--set teacher.student_share=0.5", "--set teacher.student_share=0.5", "only with groups"),
    ("--preset full --set network.privileged=[32,16]", "--set network.privileged=[32,16]", "nobody walks on"),
    ("--set network.terrain=[32]", "--set network.terrain=[32]", "on flat ground"),
    ("--set network.terrain_latent=8", "--set network.terrain_latent=8", "on flat ground"),
    ("--set task.terrain.levels=5", "--set task.terrain.levels=5", "on flat ground"),
    ("--set task.terrain.speed=[0.3,0.4]", "--set task.terrain.speed=[0.3,0.4]", "on flat ground"),
    ("--preset full --teacher.quiet 20 --teacher.iterations 3", "--teacher.quiet 20", "at most a quarter"),
    ("--set dreamwaq.code=8", "--set dreamwaq.code=8", "without --method dreamwaq"),
    (
        "--preset full --method dreamwaq --set dreamwaq.beta=0 --set dreamwaq.free_bits=0.1",
        "--set dreamwaq.free_bits=0.1",
        "with --set dreamwaq.beta=0",
    ),
    (
        "--preset full --method dreamwaq --symmetry half --set network.recurrent=true",
        "--set network.recurrent=true",
        "with --method dreamwaq",
    ),
    ("--set hinf.curriculum=0.5", "--set hinf.curriculum=0.5", "without --method hinf"),
    (
        "--preset full --method hinf --set hinf.curriculum=0.001",
        "--set hinf.curriculum=0.001",
        "the limit is there at once",
    ),
    ("--method none --task.friction.per joint", "--task.friction.per joint", "no friction in training"),
    ("--method none --set task.friction.steps=2", "--set task.friction.steps=2", "no friction in training"),
    ("--preset full --method hinf --task.friction.spread 0.5 1.5", "--task.friction.spread 0.5 1.5", "asks for it"),
    ("--preset full --method dreamwaq --task.friction.per joint", "--task.friction.per joint", "asks for it"),
    ("--task.friction.spread 1 1", "--task.friction.spread 1.0 1.0", "a factor of 1"),
    ("--task.friction.load 0 0", "--task.friction.load 0.0 0.0", "a coefficient of 0"),
    ("--task.friction.range 1 1 --task.friction.per joint", "--task.friction.per joint", "the same multiplier"),
    (
        "--friction-level 0 --task.friction.load 0 0.1 --task.friction.range 0 2",
        "--task.friction.range 0.0 2.0",
        "at --friction-level 0",
    ),
    (
        "--method direct --set task.friction.pretraining=0.3",
        "--set task.friction.pretraining=0.3",
        "of other methods' schedules",
    ),
    ("--method finetune --set task.friction.steps=8", "--set task.friction.steps=8", "of other methods' schedules"),
    ("--set task.friction.static_ratio=2", "--set task.friction.static_ratio=2.0", "only with stribeck"),
    ("--set task.friction.stribeck_velocity=0.3", "--set task.friction.stribeck_velocity=0.3", "only with stribeck"),
    (
        "--friction-law stribeck --set task.friction.static_ratio=1 --set task.friction.stribeck_velocity=0.3",
        "--set task.friction.stribeck_velocity=0.3",
        "the same at every speed",
    ),
    ("--set task.physics.impedance=0.9", "--set task.physics.impedance=0.9", "only with rows"),
    ("--physics rows --task.physics.stiffness 500", "--task.physics.stiffness 500.0", "only with plastic"),
    ("--method none --task.physics.stiffness 500", "--task.physics.stiffness 500.0", "the training has none"),
    ("--engine physx --set task.physics.iterations=20", "--set task.physics.iterations=20", "a solver of its own"),
    (
        "--set task.randomization.known_friction=[1,1]",
        "--set task.randomization.known_friction=[1.0,1.0]",
        "without --task.known",
    ),
    (
        "--set task.randomization.push_interval=0 --set task.randomization.push_velocity=2",
        "--set task.randomization.push_velocity=2.0",
        "no robot is pushed",
    ),
    (
        "--set task.randomization.push_interval=0.005",
        "--set task.randomization.push_interval=0.005",
        "less than a control",
    ),
    (
        "--set task.episode=5 --set task.randomization.push_velocity=2",
        "--set task.randomization.push_velocity=2.0",
        "over before the first push",
    ),
    (
        "--set task.randomization.push_velocity=0 --set task.randomization.push_interval=4",
        "--set task.randomization.push_interval=4.0",
        "no robot is pushed",
    ),
    (
        "--actuator net --set task.randomization.stiffness=[0.8,1.2]",
        "--set task.randomization.stiffness=[0.8,1.2]",
        "in the net",
    ),
    (
        "--actuator net --set task.randomization.action_delay=[0,0]",
        "--set task.randomization.action_delay=[0.0,0.0]",
        "in the net",
    ),
    (
        "--set task.commands.standing_share=1 --set task.commands.forward=[0,1]",
        "--set task.commands.forward=[0.0,1.0]",
        "every robot is told to stand",
    ),
    ("--set contacts=64", "--set contacts=64", "only on MuJoCo Warp"),
    ("--set stop.iterations=5", "--set stop.iterations=5", "without --stop-at-tracking-error"),
    ("--set stop.falls=0.1", "--set stop.falls=0.1", "without --stop-at-tracking-error"),
    (
        "--preset full --method finetune --teacher.iterations 30 --stop-at-tracking-error 0.2",
        "--stop-at-tracking-error 0.2",
        "no phase has more than 15",
    ),
]
"""Words for `stiction train`, what they are told has no effect, and why."""


@pytest.mark.parametrize(("words", "named", "why"), REFUSED, ids=[words for words, _, _ in REFUSED])
def test_what_has_no_effect_is_refused(words: str, named: str, why: str) -> None:
    """Two runs that differ in it would be compared, and are the same run."""
    preset_words = [] if "--preset" in words else ["--preset", "two-phase"]
    with pytest.raises(ConfigurationError) as caught:
        parse([*preset_words, *words.split()])
    said = str(caught.value)
    assert said.startswith(f"{named} has no effect") and why in said and said.endswith("; leave it out"), said
    assert "\n" not in said


ACCEPTED = [
    "--student.steps 12 --student.noise half --student.mini-batches 2 --set student.adaptation_weight=1",
    "--student.algorithm ppo --set student.learning_rate=0.001 --student.steps 12",
    "--set teacher.alternate=20 --set network.privileged=[32] --set teacher.adaptation_passes=2",
    "--teacher.latent groups --set network.privileged=[32] --set teacher.student_share=0.5",
    "--terrain stairs --set task.terrain.levels=5 --set network.terrain=[32] --set network.terrain_latent=8",
    "--preset full --set teacher.adaptation_learning_rate=0.002 --set teacher.adaptation_batches=2 "
    "--set network.recurrent=true --symmetry half",
    "--preset full --method dreamwaq --set dreamwaq.free_bits=0.1 --set teacher.adaptation_passes=2",
    "--preset full --method hinf --set hinf.curriculum=0.5 --set hinf.multiplier_rate=0 --set hinf.eta=1",
    "--preset full --method hinf --task.friction.load 0 0.1 --set hinf.disturber=friction",
    "--preset full --method hinf --task.friction.range 0 1.2 --task.friction.spread 0.5 1.5 --task.friction.per robot",
    "--method none --friction-level 0.2 --friction-law stribeck --set task.friction.static_ratio=2",
    "--method none --friction-law load",
    "--friction-level 0 --task.friction.load 0 0.1",
    "--task.friction.range 0 0 --task.friction.load 0 0.1",
    "--task.friction.mixture 0.2 0 0 0.8 1 1 --task.friction.per joint",
    "--method iterative --set task.friction.steps=8 --set task.friction.pretraining=0.3",
    "--physics rows --set task.physics.impedance=0.9",
    "--task.physics.stiffness 500 --set task.physics.iterations=20",
    "--task.known-friction --set task.randomization.known_friction=[1,1]",
    "--task.known-friction --friction-law stribeck --friction-level 0.2",
    "--set task.randomization.push_interval=0",
    "--set task.randomization.push_velocity=0",
    "--set task.commands.standing_share=1",
    "--actuator net --set task.randomization.damping=[0.5,1.5]",
    "--device warp-cpu --set contacts=64",
    "--stop-at-tracking-error 0.2 --set stop.iterations=5 --set stop.falls=0.1",
]
"""Words for `stiction train` that all have an effect."""


@pytest.mark.parametrize("words", ACCEPTED)
def test_what_has_an_effect_is_not(words: str) -> None:
    """A rule that goes too far would take a training away."""
    preset_words = [] if "--preset" in words else ["--preset", "two-phase"]
    parse([*preset_words, *words.split()])


@pytest.mark.parametrize("name", get_args(PresetName))
@pytest.mark.parametrize("method", method_names())
@pytest.mark.parametrize("where", ["", "--device warp-cpu", "--engine physx"])
def test_a_preset_with_a_method_is_never_refused(name: str, method: str, where: str) -> None:
    """What a preset brings along nobody has typed; a method that a preset cannot train says so itself."""
    words = ["--preset", name, "--method", method, *where.split()]
    one_phase = method in ("dreamwaq", "hinf")
    if one_phase and (name not in ("full", "quick") or (method == "hinf" and "physx" in where)):
        with pytest.raises(ConfigurationError, match=r"learns in one phase|cannot train with"):
            parse(words)
        return
    cfg = parse(words).config
    check_effects(cfg)
    assert cfg.task.friction.method == method


@pytest.mark.parametrize("law", ["load", "effort"])
def test_a_coefficient_is_not_told(law: str) -> None:
    """There is no share of the torque limit that a bench could find."""
    words = f"--task.known-friction --friction-law {law} --friction-level 0.1"
    with pytest.raises(ConfigurationError, match=f"under --friction-law {law} there is none"):
        parse(words.split())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--task.friction.range 0 0", "--method deception with a range, mixture or spread that ends at 0"),
        ("--task.friction.mixture 1 0 0", "trains without friction"),
        ("--task.friction.spread 0 0", "trains without friction"),
        ("--method hinf --task.friction.range 0 0", "--method hinf with a range"),
        ("--method dreamwaq --friction-level 0 --task.friction.range 0 1", "at --friction-level 0 trains without"),
        ("--robot go2", "that the joints of go2 have, which nobody has measured"),
        ("--robot go2 --method hinf --task.friction.range 0 1.2", "--method hinf draws multiples of the friction"),
    ],
)
def test_friction_that_cannot_be_there_is_refused(words: str, said: str, tmp_path: Path) -> None:
    """A run that is named after friction would have none, and its policy be believed to cope with it."""
    with pytest.raises(ConfigurationError, match=said):
        begin_run(tmp_path / "run", parse(words.split()).config, "stiction train")
    assert not (tmp_path / "run").exists()
