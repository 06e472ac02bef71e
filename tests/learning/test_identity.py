"""Identity of trainings, worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.identity import (
    APART,
    defaults,
    difference,
    differing,
    effective,
    settings_of,
)
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg

DEFAULTS = Path(__file__).parents[1] / "data" / "training_defaults.json"


def test_settings_are_what_differs_from_the_defaults() -> None:
    """Names the settings that were chosen, and no other."""
    assert settings_of(TrainCfg()) == {}
    friction = FrictionCfg(spread=(0.5, 1.5), mixture=((0.2, 0.0, 0.0), (0.8, 1.0, 1.0)))
    cfg = TrainCfg(
        task=TaskCfg(friction=friction, rewards=RewardCfg(trot=0.0, own=(("mine:term", -0.5),)), known_friction=True),
        network=NetworkCfg(actor=(64, 32)),
        teacher=TeacherCfg(latent="history", quiet=30, final_std=0.2),
        student=StudentCfg(iterations=0),
        engine="mujoco",
    )
    assert settings_of(cfg) == {
        "task.friction.spread": [0.5, 1.5],
        "task.friction.mixture": [0.2, 0.0, 0.0, 0.8, 1.0, 1.0],
        "task.rewards.trot": 0.0,
        "task.rewards.own": ["mine:term", -0.5],
        "task.known-friction": True,
        "network.actor": [64, 32],
        "teacher.latent": "history",
        "teacher.final-std": 0.2,
        "teacher.quiet": 30,
        "student.iterations": 0,
    }
    assert json.loads(json.dumps(settings_of(cfg))) == settings_of(cfg)


def test_what_tells_no_training_from_another_is_left_out(tmp_path: Path) -> None:
    """Leaves out seeds, loggers and files: bundles name no folder of their maker's machine."""
    same = TrainCfg(
        task=TaskCfg(robot="go1"),
        seed=7,
        checkpoint_every=3,
        video_every=50,
        logger="wandb",
        contacts=99,
        joints="/home/me/joints.json",
    )
    assert settings_of(replace(same, actuator="/home/me/net")) == {}
    assert {*APART} <= defaults().keys()
    assert settings_of(replace(same, device="warp-cpu")) == {"device": "warp-cpu"}


def test_a_setting_that_is_missing_has_its_default() -> None:
    """Takes an older bundle, without a setting, for the same training as a new one with its default."""
    assert differing({}, {"teacher.quiet": 0}) == [] and difference({}, {"teacher.quiet": 0.0}) is None
    assert differing({"teacher.quiet": 30}, {"num-envs": 1}) == ["num-envs", "teacher.quiet"]
    assert difference({"teacher.quiet": 30}, {}) == ("teacher.quiet 30", "0")
    assert difference({"teacher.quiet": 30, "num-envs": 4}, {}) == ("num-envs 4", "512 (1 more differ)")
    assert difference(None, {"teacher.quiet": 30}) is None and difference({"teacher.quiet": 30}, None) is None
    assert difference({"x": True}, {"x": 1}) == ("x true", "1") and difference({"x": 2}, {"x": 2.0}) is None
    assert effective({"seed": 3, "teacher.quiet": 0, "b": 1, "a": 2}) == {"a": 2, "b": 1}
    assert [*effective({"b": 1, "a": 2})] == ["a", "b"]


def test_every_setting_has_its_default_in_the_file() -> None:
    """A setting that is not there could change without a word."""
    assert json.loads(DEFAULTS.read_text(encoding="utf-8")).keys() == defaults().keys()
