"""DreamWaQ's context: its losses against numbers worked out by hand, who trains what, and what a robot walks on."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from tensordict import TensorDict

from rollouts import check_ratio, phase_runner, rollout
from stiction.core.errors import TrainingError
from stiction.learning.config import NetworkCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.phase import PhaseRunner
from stiction.task.config import NoiseCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction_experiments.methods.context import Context, ContextActor, code_loss, divergence
from stiction_experiments.methods.context_ppo import (
    EpisodeReturns,
    bootstrapping_probability,
    context_figures,
    friction_probe,
)
from stiction_experiments.methods.dreamwaq import DreamWaQCfg

CFG = TrainCfg(
    task=TaskCfg(robot="go1", friction=FrictionCfg("dreamwaq", level=0.2, range=(0.0, 1.2), per="joint")),
    network=NetworkCfg(actor=(16,), critic=(16,), history_frame=4, history=(8,)),
    method_settings=DreamWaQCfg(code=4, frame=4, encoder=(8,), decoder=(8,)),
    teacher=TeacherCfg(latent="history", iterations=4, steps=4, epochs=2, mini_batches=2),
    student=StudentCfg(iterations=0),
    num_envs=8,
)


@pytest.fixture
def runner(tmp_path) -> PhaseRunner:
    """Eight small robots, before the first rollout."""
    return phase_runner(CFG, tmp_path)


def batch_of(runner: PhaseRunner) -> TensorDict:
    """A rollout, flattened, as the supervised pass reads it."""
    rollout(runner)
    return runner.alg.storage.observations.flatten(0, 1)


def test_the_divergence_by_hand() -> None:
    """1/2 (mu^2 + sigma^2 - log sigma^2 - 1): 1/2 for mu = 1, and (3 - log 4)/2 for sigma = 2; 0 for the prior."""
    context = Context(torch.zeros(1, 3), torch.tensor([[1.0, 0.0, 0.0]]), torch.tensor([[0.0, math.log(4.0), 0.0]]))
    expected = torch.tensor([[0.5, (3.0 - math.log(4.0)) / 2.0, 0.0]])
    torch.testing.assert_close(divergence(context), expected)


def test_free_bits_by_hand() -> None:
    """Means over the samples that count, 0.03 and 0.3; the first is lifted to 0.05; their mean is 0.175."""
    kl = torch.tensor([[0.02, 0.4], [0.04, 0.2], [9.0, float("nan")]])
    counts = torch.tensor([True, True, False])
    assert code_loss(kl, counts, 0.05).item() == pytest.approx(0.175)
    assert code_loss(kl, counts, 0.0).item() == pytest.approx(0.165)


def test_the_parts_of_the_loss_by_hand(runner: PhaseRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    """Means over entries and samples, beta on the code; a fallen robot trains the velocity alone, whatever is there."""
    obs, actor = batch_of(runner).clone(), runner.alg.actor
    obs["lasts"] = torch.ones_like(obs["lasts"])
    obs["lasts"][3] = 0.0
    obs["next"][3] = float("nan")
    monkeypatch.setattr(torch, "randn_like", torch.ones_like)
    actor.cfg = replace(actor.cfg, beta=0.7, free_bits=0.0)
    losses = actor.supervised_losses(obs)
    velocity, mean, log_variance = actor.context(obs["history"])
    code = mean + torch.sqrt(torch.exp(log_variance))
    error = (actor.context.decoder(torch.cat((velocity, code), -1)) - obs["next"]) ** 2
    kept = torch.arange(len(obs)) != 3
    torch.testing.assert_close(losses["reconstruction"], error[kept].mean())
    kl = 0.5 * (mean**2 + torch.exp(log_variance) - log_variance - 1.0)
    torch.testing.assert_close(losses["code"], 0.7 * kl[kept].mean())
    torch.testing.assert_close(losses["estimator"], ((velocity - obs["explicit"][:, :3]) ** 2).mean())
    assert losses.keys() == {"estimator", "reconstruction", "code"}


def test_the_decoder_does_not_bend_the_velocity(runner: PhaseRunner) -> None:
    """The reconstruction trains the code's outputs of the encoder, and not those of the velocity."""
    obs, actor = batch_of(runner), runner.alg.actor
    actor.supervised_losses(obs)["reconstruction"].backward()
    gradient = actor.context.encoder.mlp[-1].bias.grad
    assert not gradient[:3].any() and gradient[3:].all()


def test_nan_is_an_error(runner: PhaseRunner) -> None:
    """A loss that is no number ends the run in one line, before it is in any network."""
    obs = batch_of(runner).clone()
    obs["next"] = torch.full_like(obs["next"], float("nan"))
    with pytest.raises(TrainingError, match=r"loss 'reconstruction' is nan; train again"):
        runner.alg.actor.supervised_losses(obs)


def test_ppo_never_reaches_the_estimator(runner: PhaseRunner, monkeypatch: pytest.MonkeyPatch) -> None:
    """The actor's input is detached; the estimator has an optimizer of its own, which reaches nothing else."""
    alg = runner.alg
    inside = {id(parameter) for parameter in alg.actor.context.parameters()}
    assert {id(p) for group in alg.adaptation_optimizer.param_groups for p in group["params"]} == inside
    assert not inside & {id(p) for group in alg.optimizer.param_groups for p in group["params"]}
    obs = batch_of(runner)
    for seen in (obs, obs.select(*runner.env.get_observations().keys())):
        alg.actor(seen).sum().backward()
        assert all(parameter.grad is None for parameter in alg.actor.context.parameters())
    before = [p.detach().clone() for p in alg.actor.context.parameters()]
    policy = [p.detach().clone() for p in alg.actor.mlp.parameters()]
    monkeypatch.setattr(type(alg), "_supervise", lambda self: {})
    alg.update()
    assert all(torch.equal(a, b) for a, b in zip(before, alg.actor.context.parameters()))
    assert not all(torch.equal(a, b) for a, b in zip(policy, alg.actor.mlp.parameters()))


def test_the_ratio_is_one_before_the_first_step(runner: PhaseRunner) -> None:
    """Stores the log probabilities of the drawn actions, to 1e-6: after updates, and with robots on the estimate."""
    alg, storage = runner.alg, runner.alg.storage
    for _ in range(3):
        alg.probability, alg.bootstrapped = 0.5, (torch.arange(8) % 2.0)[:, None]
        rollout(runner)
        with torch.no_grad():
            for step in range(4):
                alg.actor(storage.observations[step], stochastic_output=True)
                again = alg.actor.get_output_log_prob(storage.actions[step])
                ratio = (again - storage.actions_log_prob[step, :, 0]).exp()
                torch.testing.assert_close(ratio, torch.ones(8), atol=1e-6, rtol=0)
        check_ratio(runner)
        alg.update()


def test_the_stored_code_is_the_mean_and_its_noise(runner: PhaseRunner) -> None:
    """The code is mu + sigma eps, v is v^ where the robot is bootstrapped and the truth elsewhere; one draw a step."""
    runner.alg.bootstrapped = (torch.arange(8) % 2.0)[:, None]
    before = {name: value.clone() for name, value in runner.alg.actor.context.state_dict().items()}
    obs = batch_of(runner)
    assert all(torch.equal(before[name], value) for name, value in runner.alg.actor.context.state_dict().items())
    velocity, mean, log_variance = runner.alg.actor.context(obs["history"])
    torch.testing.assert_close(obs["guess"], mean + torch.exp(log_variance / 2) * obs["noise"])
    on = obs["bootstrapped"] > 0
    torch.testing.assert_close(obs["estimate"], torch.where(on, velocity, obs["explicit"][:, :3]))
    assert on.sum() == 16 and 0.5 < obs["noise"].std() < 1.5
    assert not torch.equal(obs["noise"][:8], obs["noise"][8:16])


def test_what_is_deployed_walks_on_means(runner: PhaseRunner) -> None:
    """Without draws: v^ and mu, through one pass of the encoder as through two, the same actions as the actor's."""
    obs, actor = runner.env.get_observations(), runner.alg.actor
    assert isinstance(actor, ContextActor)
    velocity, mean, _ = actor.context(obs["history"])
    expected = actor.mlp(torch.cat((obs["proprioception"], velocity, mean), -1))
    student = actor.student()
    for actions in (actor(obs), student(obs["history"]), student.act(obs["history"], mean)):
        torch.testing.assert_close(actions, expected, atol=1e-6, rtol=0)


def test_the_bootstrapping_probability_by_hand() -> None:
    """1 - tanh(std/mean): returns 1 and 3 have 1/2; equal ones 1; none, one, or a loss on the average 0."""
    assert bootstrapping_probability(torch.tensor([1.0, 3.0])) == pytest.approx(0.5378828427)
    assert bootstrapping_probability(torch.tensor([2.0, 2.0, 2.0])) == 1.0
    for returns in ([], [2.0], [-1.0, -3.0], [1.0, -1.0]):
        assert bootstrapping_probability(torch.tensor(returns)) == 0.0


def test_returns_are_those_of_whole_episodes() -> None:
    """The first episode, of unknown beginning, does not count; then 2 + 3, and the next one takes its place."""
    returns = EpisodeReturns(2, "cpu")
    for reward, done in ((1.0, 1), (2.0, 0), (3.0, 1), (7.0, 0)):
        returns.push(torch.tensor([reward, reward]), torch.tensor([done, 0]))
    assert returns.values.tolist() == [5.0] and returns.running.tolist() == [7.0, 13.0]
    returns.push(torch.ones(2), torch.ones(2))
    assert returns.values.tolist() == [8.0]


def test_robots_draw_their_source_at_their_reset(runner: PhaseRunner) -> None:
    """Nobody changes amid an episode: a robot that is done draws, with p = 1 the estimate, the others keep theirs."""
    alg, obs = runner.alg, runner.env.get_observations()
    dones = torch.tensor([1, 0, 0, 1, 0, 0, 0, 0])
    extras = {"time_outs": torch.tensor([1.0, 0, 0, 0, 0, 0, 0, 0]), "terminal": obs["proprioception"] + 1.0}
    alg.act(obs)
    alg.probability = 1.0
    alg.process_env_step(obs, torch.zeros(8), dones, extras)
    assert alg.bootstrapped[:, 0].tolist() == [1, 0, 0, 1, 0, 0, 0, 0]
    stored = alg.storage.observations[0]
    assert stored["lasts"][:, 0].tolist() == [1, 1, 1, 0, 1, 1, 1, 1]
    torch.testing.assert_close(stored["next"][0], obs["proprioception"][0] + 1.0)
    torch.testing.assert_close(stored["next"][1], obs["proprioception"][1])
    assert not stored["next"][3].any()


def test_a_time_out_tells_the_frame_before_the_reset() -> None:
    """It has the last action and the pose in which the episode ended; the observation after it has neither."""
    silent = NoiseCfg(0.0, 0.0, 0.0, 0.0)
    task = replace(CFG.task, episode=0.06, noise=silent, slow_means=1.0)
    env, twin = (LocomotionEnv(task, 4, 0) for _ in range(2))
    env.return_terminal_obs = True
    twin.max_episode_length = 100
    twin.push_interval = env.push_interval = 0
    for step in range(3):
        actions = torch.full((4, 12), 0.1 * (step + 1))
        (obs, _, dones, extras), (later, _, fell, _) = env.step(actions), twin.step(actions)
        assert ("terminal" in extras) == (step == 2)
    assert dones.all() and not fell.any()
    torch.testing.assert_close(extras["terminal"], later["proprioception"], atol=1e-5, rtol=0)
    assert not torch.allclose(extras["terminal"], obs["proprioception"], atol=1e-2)


def test_the_probe_finds_what_is_there() -> None:
    """R^2 is 1 of a linear map, near 0 or below of noise, and NaN of friction that is the same for all robots."""
    torch.manual_seed(0)
    code = torch.randn(6, 200, 4)
    friction = torch.stack((code[..., 0] - 2.0 * code[..., 3], torch.randn(6, 200), torch.ones(6, 200)), -1)
    told = friction_probe(code, friction)
    assert told[0] > 0.999 and told[1].abs() < 0.05 and told[2].isnan()


def test_what_is_said_of_a_code_by_hand() -> None:
    """One of two dimensions is used; it is off by 0.1 where repeating is off by 0.3, and tells one joint's friction.

    Figures that were of other columns, or of each other, would be finite all the same. A fallen robot's next frame does
    not count.
    """
    torch.manual_seed(0)
    used, noise = torch.randn(3, 64, 1), torch.randn(3, 64, 2)

    class Estimator:
        """Means are the history's first two entries, and the frame that is predicted is the first mean."""

        def __call__(self, history: torch.Tensor) -> Context:
            return Context(torch.zeros(len(history), 3), history, torch.zeros_like(history))

        def predict(self, velocity: torch.Tensor, code: torch.Tensor) -> torch.Tensor:
            return code[:, :1]

    lasts = torch.ones(3, 64, 1)
    lasts[1, 5] = 0.0
    groups = {
        "history": torch.cat((used, torch.full_like(used, 0.1)), -1),
        "proprioception": used + 0.1 - 0.3,
        "next": torch.where(lasts > 0, used + 0.1, 99.0),
        "lasts": lasts,
        "privileged": torch.cat((noise, 1.0 + 2.0 * used, torch.ones(3, 64, 1)), -1),
    }
    told = context_figures(SimpleNamespace(context=Estimator()), TensorDict(groups, [3, 64]), ("shank", "hip"))
    assert told.pop("code/friction/shank") > 0.999
    kl = float(used.square().mean()) / 2 + 0.1**2 / 2
    expected = {"code/kl": kl, "code/active": 1.0, "code/reconstruction": 0.01, "code/repeat": 0.09}
    assert told == pytest.approx(expected, rel=1e-4)
