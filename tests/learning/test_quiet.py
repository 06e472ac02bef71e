"""The quiet iterations at the end of one phase: who walks, what learns, and that nothing else of a run changes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from rollouts import phase_runner, rollout
from stiction.core.errors import ConfigurationError
from stiction.learning.arguments import parse
from stiction.learning.config import StopCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.run import RunDirectory
from stiction.learning.runner import train
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg

CFG = TrainCfg(
    task=TaskCfg(friction=FrictionCfg(method="deception", level=0.2)),
    num_envs=8,
    teacher=TeacherCfg(latent="history", iterations=8, steps=4, final_std=0.4, quiet=30),
    student=StudentCfg(iterations=0),
)
"""Eight iterations, of which two may be quiet: the sixth is the last that is not."""


def weights(module: torch.nn.Module) -> list[torch.Tensor]:
    """Copies of the parameters of a network."""
    return [parameter.detach().clone() for parameter in module.parameters()]


@pytest.mark.parametrize(("quiet", "iterations", "first"), [(0, 8, 8), (1, 8, 7), (30, 8, 6), (30, 440, 410)])
def test_they_are_the_last_and_at_most_a_quarter(quiet: int, iterations: int, first: int) -> None:
    """Short trainings would else be quiet from the start, and learn nothing."""
    assert TeacherCfg(quiet=quiet, iterations=iterations).quiet_from == first


def test_who_walks_is_deployed_and_the_estimator_alone_learns(tmp_path: Path) -> None:
    """Actions are the policy's means; actor, encoder, critic and noise stay as they are, and f_est does not."""
    runner = phase_runner(CFG, tmp_path)
    runner.alg.iteration = 6
    runner.alg._prepare_rollout()
    actor, obs = runner.alg.actor, runner.env.get_observations()
    torch.testing.assert_close(runner.alg.act(obs), actor(obs))
    runner.alg.transition.clear()
    still = {name: weights(part) for name, part in (("actor", actor.mlp), ("z*", actor.adaptation))}
    still |= {"critic": weights(runner.alg.critic), "noise": [actor.std.clone()]}
    before = weights(actor.estimator)
    rollout(runner)
    losses = runner.alg.update()
    now = {"actor": weights(actor.mlp), "z*": weights(actor.adaptation), "critic": weights(runner.alg.critic)}
    now["noise"] = [actor.std]
    assert all(torch.equal(a, b) for name in still for a, b in zip(still[name], now[name], strict=True))
    assert any(not torch.equal(a, b) for a, b in zip(before, weights(actor.estimator), strict=True))
    assert set(losses) == {"estimator"}
    assert runner.alg.kl == 0.0
    # The next rollout finds an empty storage.
    rollout(runner)


def test_the_step_falls_and_the_passes_double(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Takes the whole step, 1e-3, in the first of two quiet iterations, half in the second, eight batches each."""
    runner, seen = phase_runner(CFG, tmp_path), []
    take = runner.alg.adaptation_optimizer.step
    monkeypatch.setattr(
        runner.alg.adaptation_optimizer,
        "step",
        lambda: (seen.append(runner.alg.adaptation_optimizer.param_groups[0]["lr"]), take())[1],
    )
    for _ in range(8):
        rollout(runner)
        runner.alg.update()
    assert seen == pytest.approx([1e-3] * (6 * 4 + 8) + [5e-4] * 8)


def test_a_target_met_early_ends_with_them(tmp_path: Path) -> None:
    """A phase that ends for its tracking error has quiet iterations first, as many as it would have had."""
    cfg = replace(
        CFG,
        teacher=replace(CFG.teacher, iterations=12, final_std=None),
        stop=StopCfg(tracking_error=10.0, iterations=2, falls=1e3),
    )
    run = RunDirectory.create(tmp_path / "run", cfg, "test", None)
    summary = train(cfg, run)
    rows = [row for row in run.rows() if row["phase"] == "teacher"]
    assert ["loss/value" in row for row in rows] == [True] * 2 + [False] * 3
    assert summary["stopped"]["teacher"]["iteration"] == 5


@pytest.mark.parametrize(
    "words",
    [
        "--teacher.quiet 30 --teacher.latent alternate --student.iterations 80 --set network.latent=16",
        "--teacher.quiet 30 --student.algorithm ppo --student.iterations 5",
        "--method dreamwaq --teacher.quiet 30",
        "--method hinf --teacher.quiet 30",
    ],
)
def test_where_they_mean_nothing_they_are_refused(words: str) -> None:
    """A teacher's estimator goes on to learn in the second phase; a context's code would drift under the policy."""
    with pytest.raises(ConfigurationError, match=r"--teacher\.quiet 30 .* add --teacher\.quiet 0"):
        parse(["--preset", "quick", "--friction-level", "0.2", *words.split()])
