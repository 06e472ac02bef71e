"""What tells one training from another, worked out by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from stiction.learning.arguments import parse
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.identity import (
    APART,
    defaults,
    difference,
    differing,
    effective,
    key_of_settings,
    settings_of,
    settings_text,
    shown,
    unrecorded_note,
)
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg

DEFAULTS = Path(__file__).parents[1] / "data" / "training_defaults.json"


def test_settings_are_what_differs_from_the_defaults() -> None:
    """If this failed, a bundle would name settings that nobody chose, or lack one that was."""
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


def test_names_are_those_of_the_command_line() -> None:
    """If this failed, nobody could train the same again from what a card says."""
    words = ["--set", "teacher.final_std=0.3", "--task.randomization.contact-time", "0.01", "0.03", "--num-envs", "256"]
    plain, other = (settings_of(parse(["--preset", "two-phase", *more]).config) for more in ([], words))
    expected = {"teacher.final-std": 0.3, "task.randomization.contact-time": [0.01, 0.03], "num-envs": 256}
    assert {name: value for name, value in other.items() if plain.get(name) != value} == expected


def test_what_tells_no_training_from_another_is_left_out(tmp_path: Path) -> None:
    """If this failed, two seeds would count as two trainings, or a bundle would name folders of its maker's machine."""
    same = TrainCfg(
        task=TaskCfg(robot="go1"),
        seed=7,
        checkpoint_every=3,
        video_every=50,
        contacts=99,
        joints="/home/me/joints.json",
    )
    assert settings_of(replace(same, actuator="/home/me/net")) == {}
    assert {*APART} <= defaults().keys()
    assert settings_of(replace(same, device="warp-cpu")) == {"device": "warp-cpu"}


def test_a_setting_that_is_missing_has_its_default() -> None:
    """If this failed, a bundle of before a setting existed would be of another training than the same run today."""
    assert differing({}, {"teacher.quiet": 0}) == [] and difference({}, {"teacher.quiet": 0.0}) is None
    assert differing({"teacher.quiet": 30}, {"num-envs": 1}) == ["num-envs", "teacher.quiet"]
    assert difference({"teacher.quiet": 30}, {}) == ("teacher.quiet 30", "0")
    assert difference({"teacher.quiet": 30, "num-envs": 4}, {}) == ("num-envs 4", "512 (1 more differ)")
    assert difference(None, {"teacher.quiet": 30}) is None and difference({"teacher.quiet": 30}, None) is None
    assert difference({"x": True}, {"x": 1}) == ("x true", "1") and difference({"x": 2}, {"x": 2.0}) is None
    assert effective({"seed": 3, "teacher.quiet": 0, "b": 1, "a": 2}) == {"a": 2, "b": 1}
    assert [*effective({"b": 1, "a": 2})] == ["a", "b"]


def test_keys_are_equal_where_trainings_are() -> None:
    """If this failed, the order in which a file names settings would make two trainings of one."""
    assert key_of_settings({"b": 1, "a": [1, 2.5]}) == key_of_settings({"a": [1.0, 2.5], "b": 1.0, "seed": 3})
    assert key_of_settings({"a": 1}) != key_of_settings({"a": "1"}) != key_of_settings({"a": True})
    assert key_of_settings(None) is None and key_of_settings({}) == "{}"


def test_what_a_file_says_is_shown_without_effect() -> None:
    """A name may have marks of tables, pages, formulas and terminals in it; written out they mean nothing."""
    odd = {"<b>|`$x$`[red]\n\x1b": "a|b", "n": [True, None, 0.5, "é"]}
    text = settings_text(odd)
    assert not {*"<>|`$[]\n\x1b*#\\"} & {*text.replace("\\u", "")}
    assert "a\\u007cb" in text and "n true null 0.5 \\u00e9" in text
    assert shown("task.friction.range 0 1.2") == "task.friction.range 0 1.2"
    many = settings_text({f"n{number:03}": number for number in range(100)})
    assert many.endswith("n059 59, and 40 more")
    assert len(settings_text({"a" * 128: "b" * 512})) < 130
    assert (settings_text(None), settings_text({})) == ("not recorded", "all as by default")


def test_one_note_names_all_that_are_not_recorded() -> None:
    """A line each would hide what else is to be read."""
    assert unrecorded_note([]) == []
    (note,) = unrecorded_note([f"p{number}" for number in range(7)])
    assert note.startswith("Settings not recorded: p0, p1, p2, p3, p4 and 2 more. ")


@pytest.mark.parametrize("name", json.loads(DEFAULTS.read_text(encoding="utf-8")))
def test_no_default_changes(name: str) -> None:
    """A setting that a bundle does not name had this value: with another default it would be of another training.

    A new setting is added to the file, and does nothing by default; another value is for the presets.
    """
    now = defaults()[name]
    assert now == json.loads(DEFAULTS.read_text(encoding="utf-8"))[name]


def test_every_setting_has_its_default_in_the_file() -> None:
    """A setting that is not there could change without a word."""
    assert json.loads(DEFAULTS.read_text(encoding="utf-8")).keys() == defaults().keys()
