"""The figures of an iteration, against numbers worked out by hand."""

from statistics import mean

import pytest
import torch
from rsl_rl.utils.logger import Logger
from tensordict import TensorDict

from stiction.learning.figures import (
    LAST_EPISODES,
    EpisodeMeans,
    RolloutFigures,
    adaptation_figures,
    friction_figures,
)
from stiction.task.config import TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg


class KnownActor:
    """Says what it is told to say."""

    adapts = False

    def __init__(self, z: list, star: list, estimate: list) -> None:
        """Latents (N, latent) and the estimate of o_exp (N, 3 + legs)."""
        self.z, self.star, self.estimate = torch.tensor(z), torch.tensor(star), torch.tensor(estimate)

    def latents(self, _: TensorDict) -> tuple[torch.Tensor, torch.Tensor]:
        """Return z and z*."""
        return self.z, self.star

    def estimator(self, _: torch.Tensor) -> torch.Tensor:
        """o_exp*."""
        return self.estimate


def observation(explicit: list) -> TensorDict:
    """Return observations with the true values of the estimate."""
    truth = torch.tensor(explicit)
    return TensorDict({"history": torch.zeros(len(truth), 1), "explicit": truth}, batch_size=[len(truth)])


def test_explained_share_and_estimator_errors_by_hand() -> None:
    """Var z = 1 + 4 = 5, MSE = 0 + 1 = 1: 0.8 explained. Errors of 5 and 0 m/s; one foot of four misjudged."""
    z, star = [[-1.0, 0.0], [1.0, 4.0]], [[-1.0, 1.0], [1.0, 3.0]]
    guess = [[3.0, 4.0, 0.0, 0.9, 0.1], [0.0, 0.0, 0.0, 0.6, 0.4]]
    truth = [[0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 1.0]]
    figures = adaptation_figures(KnownActor(z, star, guess), observation(truth), 2)
    assert figures["latent/explained"] == pytest.approx(0.8)
    assert figures["estimator/velocity_error"] == pytest.approx(2.5)
    assert figures["estimator/contact_error"] == pytest.approx(0.25)


def test_episodes_are_measured_where_they_end() -> None:
    """Ages of 99 and 49 steps before the step that ends them: 100 and 50 steps of 0.02 s, on average 1.5 s."""
    rollout = RolloutFigures(control_period=0.02)
    rollout.end(torch.tensor([99, 7]), torch.tensor([True, False]))
    rollout.end(torch.tensor([0, 49]), torch.tensor([False, True]))
    assert rollout.means() == {"episode/length": pytest.approx(1.5)}


def test_friction_figures_are_those_of_the_stage() -> None:
    """A schedule that never enters its second stage would look like a robust policy."""
    friction = FrictionCfg("finetune", level=0.2, range=(0.5, 0.5))
    env = LocomotionEnv(TaskCfg(robot="go1", friction=friction), 2, seed=0)
    assert friction_figures(env) == dict.fromkeys([f"friction/{n}" for n in ("stage", "low", "high", "mean")], 0.0)
    env.enter_stage(1)
    names = [f"friction/{n}" for n in ("stage", "low", "high", "mean")]
    assert friction_figures(env) == dict(zip(names, (1.0, 0.5, 0.5, 0.5), strict=True))


def test_episode_means_by_hand() -> None:
    """Two robots: one ends after two steps with a return of 3, then after one with 5; the other goes on, with none.

    (3 + 5)/2 = 4 and (2 + 1)/2 = 1.5; before an episode has ended there is no mean.
    """
    episodes = EpisodeMeans(2, "cpu")
    episodes.add(torch.tensor([1.0, 10.0]), torch.tensor([False, False]))
    assert episodes.means() == {}
    episodes.add(torch.tensor([2.0, 10.0]), torch.tensor([True, False]))
    episodes.add(torch.tensor([5.0, 10.0]), torch.tensor([True, False]))
    assert episodes.means() == {"Train/mean_reward": 4.0, "Train/mean_episode_length": 1.5}


def test_episode_means_are_those_of_rsl_rl() -> None:
    """Agrees with rsl_rl's own bookkeeping, over more than its hundred last episodes and over a checkpoint."""
    theirs = Logger(None, {"algorithm": {}}, {}, 7, False, 1, 0, "cpu")
    theirs.writer = object()  # without one it counts nothing
    ours, generator = EpisodeMeans(7, "cpu"), torch.Generator().manual_seed(0)
    for step in range(200):
        reward, dones = torch.rand(7, generator=generator), torch.rand(7, generator=generator) < 0.2
        theirs.process_env_step(reward, dones, {})
        ours.add(reward, dones)
        if step == 150:
            resumed = EpisodeMeans(7, "cpu")
            resumed.load_state(ours.state())
            ours = resumed
    assert len(theirs.rewbuffer) == LAST_EPISODES
    means = ours.means()
    assert means["Train/mean_reward"] == pytest.approx(mean(theirs.rewbuffer), rel=1e-6)
    assert means["Train/mean_episode_length"] == pytest.approx(mean(theirs.lenbuffer))


def test_sums_of_another_number_of_robots_are_rejected() -> None:
    """A checkpoint is a file, which may hold anything."""
    with pytest.raises(ValueError, match="not one per robot"):
        EpisodeMeans(2, "cpu").load_state(EpisodeMeans(3, "cpu").state())
