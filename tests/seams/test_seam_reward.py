"""Reward terms from outside the package, named in the configuration: they pay, are logged, and survive a resume."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to train")

from stiction.cli.main import main
from stiction.core.errors import StictionError
from stiction.robots.catalog import find_robot
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.rewards import RewardCfg, Snapshot, fall

pytestmark = pytest.mark.usefixtures("undrawn")

SILENT = {name: 0.0 for name in RewardCfg().terms_for(find_robot("saturn_lite"))}


def alive(snapshot: Snapshot):
    """One a second to every robot that stands."""
    return 1.0 - snapshot.fallen.float()


HERE = f"{__name__}:alive"


def test_a_term_of_ones_own_pays_its_weight() -> None:
    """3 a second, at 50 Hz 0.06 a step, and nothing else where every other weight is zero; it is logged by its name."""
    task = TaskCfg(robot="go1", rewards=RewardCfg(**SILENT, own=((HERE, 3.0),)))
    env = LocomotionEnv(task, 2, seed=0)
    _, reward, _, extras = env.step(env.last_action)
    assert reward.tolist() == pytest.approx([0.06, 0.06])
    assert [name for name in extras["log"] if name.startswith("reward/")] == ["reward/alive"]


def test_it_is_a_flag_and_goes_on_after_a_resume(tmp_path: Path) -> None:
    """config.json is the complete configuration; a run that is finished pays nobody, and needs no module to say so."""
    out = tmp_path / "run"
    words = (
        "--preset quick --robot go1 --num-envs 4 --teacher.iterations 2 --teacher.steps 4 --teacher.mini-batches 2 "
        "--checkpoint-every 1 --video-every 0 --method none"
    )
    assert main(["train", *words.split(), "--task.rewards.own", HERE, "0.5", "--out", str(out)]) == 0
    config = json.loads((out / "config.json").read_text())["config"]
    assert config["task"]["rewards"]["own"] == [[HERE, 0.5]]
    lines = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    assert len(lines) == 2 and all(line["reward/alive"] > 0.0 for line in lines)
    assert main(["train", "--resume", str(out)]) == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("alive", "expected package.module:NAME"),
        ("no_such_module_at_all:alive", "cannot be imported"),
        (f"{__name__}:dead", "has no 'dead'"),
        (f"{__name__}:HERE", "a function with another name"),
        (f"{__name__}:fall", "a function with another name"),
    ],
)
def test_what_is_no_new_term_is_refused(name: str, message: str) -> None:
    """A misspelt term that is silently left out would cost a night of training."""
    assert fall.__name__ == "fall"
    with pytest.raises(StictionError, match=message):
        RewardCfg(own=((name, 1.0),)).terms_for(find_robot("saturn_lite"))


def crooked(snapshot: Snapshot):
    """One number in all, where one a robot is expected."""
    return snapshot.command.sum()


def broken(snapshot: Snapshot):
    """Ask for what no snapshot has."""
    return snapshot.no_such_thing


def number(snapshot: Snapshot) -> float:
    """Pay no tensor."""
    return 1.0


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ("crooked", r"returns a tensor of shape \(\); expected \(2,\), one value per robot"),
        (
            "broken",
            "fails with AttributeError: 'Snapshot' object has no attribute 'no_such_thing'; expected a function",
        ),
        ("number", "fails with AttributeError: 'float' object has no attribute 'shape'; expected a function"),
    ],
)
def test_a_term_that_fails_is_named(term: str, message: str) -> None:
    """It is the user's own mistake, and no fault of the program; a sum over all robots would be paid to each."""
    env = LocomotionEnv(TaskCfg(robot="go1", rewards=RewardCfg(own=((f"{__name__}:{term}", 1.0),))), 2, seed=0)
    with pytest.raises(StictionError, match=f"reward term '{__name__}:{term}' {message}"):
        env.step(env.last_action)
