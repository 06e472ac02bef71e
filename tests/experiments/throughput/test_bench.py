"""`stiction bench`: the summary's shape, and a measurement that leaves the task as it was."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from actuators import pd_net
from stiction.cli.main import main
from stiction.task.config import TaskCfg

PARTS = ("physics", "task", "inference", "ppo", "supervised", "other")

torch = pytest.importorskip("torch", reason="the package torch, of the extra 'train', is needed to measure training")
pytest.importorskip("rsl_rl", reason="the package rsl_rl, of the extra 'train', is needed to measure training")


def flat(tree: Any, name: str = "") -> dict[str, np.ndarray]:
    """Return the leaves of a nested state by their path, copied."""
    if isinstance(tree, dict):
        return {path: leaf for key, value in tree.items() for path, leaf in flat(value, f"{name}.{key}").items()}
    return {name: np.array(tree.numpy() if isinstance(tree, torch.Tensor) else tree)}


def test_the_summary_says_what_the_ratios_were_computed_from(capsys: pytest.CaptureFixture) -> None:
    """With one block, each ratio is the quotient of the rates beside it."""
    assert main(["bench", "--robot", "go1", "--num-envs", "4", "--blocks", "1", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    rates = {name: spread["median"] for name, spread in summary["env_steps_per_second"].items()}
    assert set(rates) == {"bare", "rollout", "iteration"}
    assert min(rates.values()) > 0
    assert summary["rollout_ratio"] == pytest.approx(rates["rollout"] / rates["bare"])
    assert summary["iteration_ratio"] == pytest.approx(rates["iteration"] / rates["bare"])
    assert summary["rollout_ratio"] > summary["iteration_ratio"]
    spread = summary["spread"]["rollout_ratio"]
    assert spread["min"] == spread["median"] == spread["max"] == summary["rollout_ratio"]
    measured = summary["measured"]
    assert (measured["robot"], measured["num_envs"], measured["blocks"]) == ("go1", 4, 1)
    assert measured["preset"] == "quick"
    assert set(summary["multiply_adds_per_env_step"]) == {"actor", "critic"}
    assert summary["identification_seconds"] > 0
    assert list(summary["parts"]) == ["rows", "rows, impedance 0.9", "plastic, Newton", "plastic"]
    for parts in summary["parts"].values():
        assert sum(parts[name] for name in PARTS) == pytest.approx(parts["iteration"])
        assert min(parts[name] for name in PARTS if name != "other") > 0
    assert summary["parts"]["rows"]["speedup"] == 1.0
    assert summary["command"] == "stiction bench --robot go1 --num-envs 4 --blocks 1 --json"


def test_what_cannot_be_is_said_before_a_measurement_is_announced(capsys: pytest.CaptureFixture) -> None:
    """A refusal would stand under a line that says what is going on."""
    assert main(["bench", "--friction-level", "nan"]) == 1
    assert capsys.readouterr().err.startswith("stiction bench: friction level nan: expected a fraction")


def test_a_device_without_a_bare_counterpart_has_rates_and_no_ratios() -> None:
    """A ratio of two devices would say nothing about what the task costs."""
    from stiction_experiments.throughput.measure import Timing

    summary = Timing(bare=(), rollout=(10.0, 30.0, 20.0), iteration=(8.0, 6.0, 7.0)).summary()
    assert summary["rollout_ratio"] is None and summary["iteration_ratio"] is None and summary["spread"] == {}
    assert summary["env_steps_per_second"] == {
        "rollout": {"min": 10.0, "median": 20.0, "max": 30.0},
        "iteration": {"min": 6.0, "median": 7.0, "max": 8.0},
    }


@pytest.mark.parametrize("with_net", [False, True])
def test_the_replay_leaves_the_task_as_it_was(with_net: bool) -> None:
    """A robot that was never replayed and one that was take the same next steps, resets included; also with a net."""
    from stiction.task.env import LocomotionEnv
    from stiction_experiments.throughput.measure import _timed_replay, _timed_rollout

    cfg, net = TaskCfg(robot="go1", episode=0.3), pd_net("go1") if with_net else None
    replayed, untouched = (LocomotionEnv(cfg, num_envs=4, seed=1, actuator=net) for _ in range(2))
    actions = torch.randn(30, 4, replayed.num_actions, generator=torch.Generator().manual_seed(0))
    _, states = _timed_rollout(replayed, actions[:20], True)
    _timed_rollout(untouched, actions[:20], False)
    before = flat(replayed.state())
    assert _timed_replay(replayed, states) > 0
    after = flat(replayed.state())
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value, err_msg=name)
    for action in actions[20:]:
        (one, *rest), (other, *others) = replayed.step(action), untouched.step(action)
        assert torch.equal(rest[0], others[0])
        for group in ("proprioception", "history", "privileged", "explicit"):
            assert torch.equal(one[group], other[group]), group
