"""Settings without effect are refused where somebody changed them, and a preset's own never are."""

from pathlib import Path
from typing import get_args

import pytest

from stiction.core.effects import requirement
from stiction.core.errors import ConfigurationError
from stiction.files.method import method_names
from stiction.learning.arguments import parse
from stiction.learning.begin import begin_run
from stiction.learning.presets import PresetName, check_settings

REFUSED = [
    (
        "--student.iterations 0 --teacher.latent history --student.steps 12",
        "--student.steps",
        "--student.iterations 1 or more",
    ),
    (
        "--preset quick --set student.learning_rate=0.001",
        "--set student.learning_rate",
        "--student.iterations 1 or more",
    ),
    ("--preset full --student.noise half", "--student.noise", "--student.iterations 1 or more"),
    ("--preset full --student.algorithm ppo", "--student.algorithm", "--student.iterations 1 or more"),
    ("--student.algorithm ppo --student.mini-batches 2", "--student.mini-batches", "--student.algorithm distill"),
    (
        "--student.algorithm ppo --set student.adaptation_weight=1",
        "--set student.adaptation_weight",
        "--student.algorithm distill",
    ),
    (
        "--student.algorithm ppo --set student.estimator_weight=1",
        "--set student.estimator_weight",
        "--student.algorithm distill",
    ),
    (
        "--student.algorithm ppo --set student.both_ways=true",
        "--set student.both_ways",
        "--student.algorithm distill",
    ),
    ("--teacher.latent groups --set teacher.alternate=2", "--set teacher.alternate", "--teacher.latent alternate"),
    ("--preset full --set teacher.alternate=20", "--set teacher.alternate", "--teacher.latent alternate"),
    ("--set teacher.student_share=0.5", "--set teacher.student_share", "--teacher.latent groups"),
    (
        "--preset full --set network.privileged=[32,16]",
        "--set network.privileged",
        "--teacher.latent alternate or groups",
    ),
    ("--set network.terrain=[32]", "--set network.terrain", "--terrain slopes, rough, stairs or mixed"),
    ("--set network.terrain_latent=8", "--set network.terrain_latent", "--terrain slopes, rough, stairs or mixed"),
    ("--set network.terrain_loss=false", "--set network.terrain_loss", "--terrain slopes, rough, stairs or mixed"),
    ("--set task.terrain.levels=5", "--set task.terrain.levels", "--terrain slopes, rough, stairs or mixed"),
    ("--set task.terrain.speed=[0.3,0.4]", "--set task.terrain.speed", "--terrain slopes, rough, stairs or mixed"),
    ("--preset full --teacher.quiet 20 --teacher.iterations 3", "--teacher.quiet", "--teacher.iterations 4 or more"),
    ("--set dreamwaq.code=8", "--set dreamwaq.code", "--method dreamwaq"),
    (
        "--preset full --method dreamwaq --set dreamwaq.beta=0 --set dreamwaq.free_bits=0.1",
        "--set dreamwaq.free_bits",
        "--set dreamwaq.beta above 0",
    ),
    (
        "--preset full --method dreamwaq --symmetry half --set network.latent=16 --set network.recurrent=true",
        "--set network.recurrent",
        "another --method than dreamwaq",
    ),
    ("--set hinf.curriculum=0.5", "--set hinf.curriculum", "--method hinf"),
    (
        "--method none --task.friction.per joint",
        "--task.friction.per",
        "friction in training, such as --task.friction.range 0 1.2",
    ),
    (
        "--method none --set task.friction.privileged_unit=0.01",
        "--set task.friction.privileged_unit",
        "friction in training",
    ),
    (
        "--set task.randomization.center_of_mass=[0,0] --set task.randomization.center_of_mass_axes=forward",
        "--set task.randomization.center_of_mass_axes",
        "--set task.randomization.center_of_mass other than 0",
    ),
    (
        "--method none --set task.friction.stages=2",
        "--set task.friction.stages",
        "friction in training, such as --task.friction.range 0 1.2",
    ),
    (
        "--preset full --method hinf --task.friction.spread 0.5 1.5",
        "--task.friction.spread",
        "friction in training, such as --task.friction.range 0 1.2",
    ),
    (
        "--preset full --method dreamwaq --task.friction.per joint",
        "--task.friction.per",
        "friction in training, such as --task.friction.range 0 1.2",
    ),
    ("--task.friction.spread 1 1", "--task.friction.spread", "factors other than 1"),
    ("--task.friction.load 0 0", "--task.friction.load", "a coefficient above 0"),
    ("--task.friction.range 1 1 --task.friction.per joint", "--task.friction.per", "multipliers that differ"),
    (
        "--friction-level 0 --task.friction.load 0 0.1 --task.friction.range 0 2",
        "--task.friction.range",
        "--friction-level above 0",
    ),
    (
        "--method none --set task.friction.begin=0.4",
        "--set task.friction.begin",
        "friction in training, such as --task.friction.range 0 1.2",
    ),
    ("--set task.friction.static_ratio=2", "--set task.friction.static_ratio", "--friction-law stribeck"),
    ("--set task.friction.stribeck_velocity=0.3", "--set task.friction.stribeck_velocity", "--friction-law stribeck"),
    (
        "--friction-law stribeck --set task.friction.static_ratio=1 --set task.friction.stribeck_velocity=0.3",
        "--set task.friction.stribeck_velocity",
        "a static_ratio other than 1",
    ),
    ("--set task.physics.impedance=0.9", "--set task.physics.impedance", "--physics rows"),
    ("--physics rows --task.physics.stiffness 500", "--task.physics.stiffness", "--physics plastic or plastic-first"),
    ("--method none --task.physics.stiffness 500", "--task.physics.stiffness", "friction in training"),
    ("--engine physx --set task.physics.iterations=20", "--set task.physics.iterations", "--engine mujoco"),
    (
        "--set task.randomization.known_friction=[1,1]",
        "--set task.randomization.known_friction",
        "--task.known-friction",
    ),
    (
        "--set task.randomization.push_interval=0 --set task.randomization.push_velocity=2",
        "--set task.randomization.push_velocity",
        "pushes within an episode, by push_interval",
    ),
    (
        "--set task.randomization.push_interval=0.005",
        "--set task.randomization.push_interval",
        "a control period or more, or 0",
    ),
    (
        "--set task.episode=5 --set task.randomization.push_velocity=2",
        "--set task.randomization.push_velocity",
        "pushes within an episode, by push_interval",
    ),
    (
        "--set task.randomization.push_velocity=0 --set task.randomization.push_interval=4",
        "--set task.randomization.push_interval",
        "--set task.randomization.push_velocity above 0",
    ),
    (
        "--set task.commands.standing_share=1 --set task.commands.forward=[0,1]",
        "--set task.commands.forward",
        "a standing_share below 1",
    ),
    ("--set contacts=64", "--set contacts", "--device cuda or warp-cpu"),
    ("--set stop.iterations=5", "--set stop.iterations", "--stop-at-tracking-error"),
    ("--set stop.falls=0.1", "--set stop.falls", "--stop-at-tracking-error"),
    (
        "--preset full --method finetune --teacher.iterations 30 --stop-at-tracking-error 0.2",
        "--stop-at-tracking-error",
        "a longer phase, or fewer stop.iterations",
    ),
]
"""Words for `stiction train`, the option among them that has no effect, and what it requires."""


@pytest.mark.parametrize(("words", "option", "needed"), REFUSED, ids=[words for words, _, _ in REFUSED])
def test_what_has_no_effect_is_refused(words: str, option: str, needed: str) -> None:
    """Two runs that differ in it would be compared, and are the same run."""
    preset_words = [] if "--preset" in words else ["--preset", "two-phase"]
    with pytest.raises(ConfigurationError) as caught:
        parse([*preset_words, *words.split()])
    assert str(caught.value) == requirement(option, needed)


@pytest.mark.parametrize("option", ["stiffness=[0.8,1.2]", "action_delay=[0,0]"])
def test_what_is_in_a_net_is_refused_beside_it(option: str) -> None:
    """Gains and delay are the net's."""
    with pytest.raises(
        ConfigurationError, match=r"^--actuator and --set task\.randomization\.[a-z_]* exclude each other"
    ):
        parse(["--actuator", "net", "--set", f"task.randomization.{option}"])


ACCEPTED = [
    "--student.steps 12 --student.noise half --student.mini-batches 2 --set student.adaptation_weight=1",
    "--student.algorithm ppo --set student.learning_rate=0.001 --student.steps 12",
    "--set teacher.alternate=20 --set network.privileged=[32] --set teacher.adaptation_passes=2",
    "--teacher.latent groups --set network.privileged=[32] --set teacher.student_share=0.5",
    "--terrain stairs --set task.terrain.levels=5 --set network.terrain=[32] --set network.terrain_latent=8",
    "--terrain stairs --set network.terrain_loss=false --set student.both_ways=true --set network.critic_history=true",
    "--set task.friction.privileged_unit=0.01 --set task.randomization.center_of_mass_axes=forward",
    "--preset full --set teacher.adaptation_learning_rate=0.002 --set teacher.adaptation_batches=2 "
    "--set network.latent=16 --set network.recurrent=true --symmetry half",
    "--preset full --method dreamwaq --set dreamwaq.free_bits=0.1 --set teacher.adaptation_passes=2",
    "--preset full --method hinf --set hinf.curriculum=0.5 --set hinf.multiplier_rate=0 --set hinf.eta=1",
    "--preset full --method hinf --task.friction.load 0 0.1 --set hinf.disturber=friction",
    "--preset full --method hinf --task.friction.range 0 1.2 --task.friction.spread 0.5 1.5 --task.friction.per robot",
    "--method none --friction-level 0.2 --friction-law stribeck --set task.friction.static_ratio=2",
    "--method none --friction-law load",
    "--friction-level 0 --task.friction.load 0 0.1",
    "--task.friction.range 0 0 --task.friction.load 0 0.1",
    "--task.friction.mixture 0.2 0 0 0.8 1 1 --task.friction.per joint",
    "--method iterative --set task.friction.stages=8 --set task.friction.begin=0.3",
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
    """Accepts a preset's own values; a method that a preset cannot train says so itself."""
    words = ["--preset", name, "--method", method, *where.split()]
    one_phase = method in ("dreamwaq", "hinf")
    if one_phase and (name not in ("full", "quick") or (method == "hinf" and "physx" in where)):
        with pytest.raises(ConfigurationError, match=r"learns in one phase|cannot train with"):
            parse(words)
        return
    cfg = parse(words).config
    check_settings(cfg)
    assert cfg.task.friction.method == method


@pytest.mark.parametrize("law", ["load", "effort"])
def test_a_coefficient_is_not_told(law: str) -> None:
    """Rejects a share of the torque limit that no bench could find."""
    words = f"--task.known-friction --friction-law {law} --friction-level 0.1"
    with pytest.raises(
        ConfigurationError, match=r"^--task.known-friction requires --friction-law coulomb or stribeck;"
    ):
        parse(words.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--task.friction.range 0 0", "--method deception with a range, mixture or spread that ends at 0"),
        ("--task.friction.mixture 1 0 0", "trains without friction"),
        ("--task.friction.spread 0 0", "trains without friction"),
        ("--method hinf --task.friction.range 0 0", "--method hinf with a range"),
        ("--method dreamwaq --friction-level 0 --task.friction.range 0 1", "at --friction-level 0 trains without"),
        ("--robot go2", "and that of go2 is not known"),
        (
            "--robot go2 --method hinf --task.friction.range 0 1.2",
            "--method hinf draws multiples of the joints' nominal friction",
        ),
    ],
)
def test_friction_that_cannot_be_there_is_refused(words: str, message: str, tmp_path: Path) -> None:
    """A run that is named after friction would have none, and its policy be believed to cope with it."""
    with pytest.raises(ConfigurationError, match=message):
        begin_run(tmp_path / "run", parse(words.split()).config, "stiction train")
    assert not (tmp_path / "run").exists()
