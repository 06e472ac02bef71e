"""Observations, events and terminations as terms: one function and one line each."""

from __future__ import annotations

import pytest
import torch

from stiction.task import env as task
from stiction.task import events
from stiction.task.config import RandomizationCfg, TaskCfg
from stiction.task.rewards import Snapshot

CALM = TaskCfg(randomization=RandomizationCfg(push_interval=0.0))
"""Nobody is pushed."""


def make(robots: int = 3) -> task.LocomotionEnv:
    """Return a small task."""
    return task.LocomotionEnv(CALM, robots, seed=0)


def stand(env: task.LocomotionEnv) -> tuple:
    """Let every robot stand for a control period."""
    return env.step(torch.zeros(env.num_envs, env.num_actions))


def test_an_event_comes_after_each_interval_and_not_in_the_step_of_a_reset(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every 0.06 s is every third control period; one that never comes is not asked."""
    seen: list[list[int]] = []
    mine = (lambda env, which: seen.append(which.tolist()), lambda cfg: 0.06)
    never = (lambda env, which: pytest.fail("an event without an interval came"), lambda cfg: 0.0)
    monkeypatch.setattr(task, "INTERVALS", (mine, never))
    env = make()
    for _ in range(6):
        stand(env)
    assert seen == [[], [], [0, 1, 2], [], [], [0, 1, 2]]


@pytest.mark.parametrize("fails", [True, False])
def test_a_termination_ends_episodes_as_a_failure_or_out_of_time(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a failure nothing is worth having; where time ran out, the value of the next state counts."""

    def second(env: task.LocomotionEnv, snapshot: Snapshot) -> torch.Tensor:
        return torch.arange(env.num_envs) == 1

    mine = events.Termination(second, fails)
    monkeypatch.setattr(events, "TERMINATIONS", (*events.TERMINATIONS, mine))
    _, _, dones, extras = stand(make())
    assert dones.tolist() == [False, True, False]
    assert extras["time_outs"].tolist() == [0.0, 0.0 if fails else 1.0, 0.0]


def test_a_term_of_a_frame_is_what_its_function_returns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scaled as the layout says, in its place; the command has no sensor, and no noise."""
    monkeypatch.setitem(task.FRAME_TERMS, "command", lambda env: torch.full((env.num_envs, 3), 0.25))
    env = make()
    names = [term.name for term in env.layout.terms]
    start = sum(term.size for term in env.layout.terms[: names.index("command")])
    entries = slice(start, start + 3)
    assert torch.equal(
        env.get_observations()["proprioception"][:, entries], (0.25 * env.frames.scale[entries]).expand(3, 3)
    )
