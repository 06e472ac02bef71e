"""The trainings `literal` and `literal-none`: what sets them apart from the preset, and a tiny run of one."""

from pathlib import Path

import pytest

from stiction.cli.main import main
from stiction.files.contract import read_contract
from stiction.learning.arguments import parse
from stiction.learning.config import TrainCfg
from stiction.learning.identity import differing, settings_of
from stiction.learning.run import RunDirectory
from stiction_experiments.paper.plan import SHARP, TRAININGS, WEAK
from stiction_experiments.paper.work import reward_words

SETTINGS = {
    "task.friction.per": "joint",
    "task.friction.privileged-unit": 0.01,
    "task.noise.angular-velocity": 0.0,
    "task.noise.joint-position": 0.0,
    "task.noise.joint-velocity": 0.0,
    "task.noise.roll-pitch": 0.0,
    "task.physics.friction": "rows",
    "task.randomization.action-delay": [0.0, 0.0],
    "task.randomization.center-of-mass-axes": "forward",
    "task.randomization.encoder-offset": [0.0, 0.0],
    "task.randomization.standing-start": 1.0,
    "task.rewards.own": [
        *("stiction_experiments.paper.rewards:printed_trot", 1.0),
        *("stiction_experiments.paper.rewards:printed_unsync", -0.6),
    ],
    "task.rewards.trot": 0.0,
    "task.rewards.unsync": 0.0,
    "task.terrain.elevation-noise": 0.0,
    "task.terrain.kind": "mixed",
    "network.critic-history": True,
    "network.terrain-loss": False,
    "teacher.both-ways": True,
    "student.both-ways": True,
}
"""Settings of `literal` that differ from the preset `two-phase`."""

FRICTION = {"task.friction.method", "task.friction.per", "task.friction.privileged-unit"}
"""Settings in which `literal-none` differs from `literal`."""


def words_of(name: str) -> list[str]:
    """Return the words of a training, with its preset."""
    (training,) = (one for one in TRAININGS if one.name == name)
    return ["--preset", training.preset, *training.words]


def config_of(*words: str) -> TrainCfg:
    """Return the configuration of some words of `stiction train`."""
    return parse([*words]).config


def test_literal_differs_from_the_preset_in_exactly_these_settings() -> None:
    """Both trainings take the preset's budget, robots and everything else that is not listed."""
    preset, literal, none = (
        settings_of(cfg)
        for cfg in (
            config_of("--preset", "two-phase", "--method", "deception"),
            *(config_of(*words_of(name)) for name in ("literal", "literal-none")),
        )
    )
    changed = differing(preset, literal)
    assert changed == sorted(SETTINGS)
    # Rows are the default, which settings do not repeat.
    values = {name: literal.get(name, "rows") for name in changed}
    assert values == SETTINGS
    assert {*differing(literal, none)} == FRICTION


def test_reward_terms_are_said_again() -> None:
    """Two terms with their weights, whatever comes behind them; none where there are none."""
    assert reward_words([*SHARP, "--seed", "10"]) == list(SHARP[4:])
    assert reward_words(WEAK) == []


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_tiny_literal_begins_goes_on_and_exports(tmp_path: Path) -> None:
    """Four robots, one iteration a phase: it trains on terrain, is resumed with its reward terms, and has a policy."""
    run, bundle = tmp_path / "run", tmp_path / "bundle"
    small = [
        *("--video-every", "0", "--num-envs", "4", "--json"),
        *("--teacher.iterations", "1", "--teacher.steps", "4", "--teacher.mini-batches", "2"),
        *("--student.iterations", "1", "--student.steps", "4", "--student.mini-batches", "2"),
    ]
    assert main(["train", *words_of("literal"), *small, "--out", str(run)]) == 0
    for file in ((run / "summary.json"), *(run / "checkpoints").glob("student_*")):
        file.unlink()
    assert main(["train", "--resume", str(run), "--json", *reward_words(words_of("literal"))]) == 0
    rows = RunDirectory(run).rows()
    assert [row["phase"] for row in rows] == ["teacher", "student"]
    assert {"reward/printed_trot", "reward/printed_unsync", "terrain/step_height"} <= {*rows[0]}
    assert not {"reward/trot", "reward/unsync", "loss/terrain"} & {*rows[0], *rows[1]}
    assert main(["export", str(run), "--out", str(bundle)]) == 0
    settings = read_contract((bundle / "contract.json").read_text()).settings
    assert settings is not None and settings["network.terrain-loss"] is False
