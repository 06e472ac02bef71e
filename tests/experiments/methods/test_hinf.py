"""H∞: its numbers worked out by hand, its constraint on two toys, and a policy that is the plain one undisturbed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch

from rollouts import phase_runner, rollout
from stiction.core.errors import StictionError
from stiction.learning.config import NetworkCfg, StopCfg, StudentCfg, TeacherCfg, TrainCfg
from stiction.learning.ppo import AdaptationPPO
from stiction.learning.run import RunDirectory
from stiction.learning.runner import train
from stiction.robots.catalog import find_robot
from stiction.task.config import TaskCfg
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg, best_task_reward
from stiction_experiments.methods.disturber import (
    LearningDisturber,
    RandomDisturber,
    advantages,
    clipped_loss,
    expected,
    log_density,
    normalised,
)
from stiction_experiments.methods.hinf import DisturberName, HinfCfg
from stiction_experiments.methods.hinf_ppo import HinfPPO, ascended, combined, cost, tightened

PLAIN = TrainCfg(
    task=TaskCfg(robot="go1", episode=0.2, friction=FrictionCfg("none")),
    network=NetworkCfg(actor=(16, 8), critic=(16,), history_frame=4, history=(8,), estimator_frame=4, estimator=(8,)),
    teacher=TeacherCfg(latent="history", iterations=4, steps=4, epochs=2, mini_batches=2),
    student=StudentCfg(iterations=0),
    num_envs=8,
)
HINF = replace(
    PLAIN, task=replace(PLAIN.task, friction=FrictionCfg("hinf")), method_settings=HinfCfg(actor=(8,), critic=(8,))
)


def with_hinf(**changes: object) -> TrainCfg:
    """The configuration with other settings of the method."""
    return replace(HINF, method_settings=replace(HINF.method_settings, **changes))


def by_friction(kind: DisturberName = "friction") -> TrainCfg:
    """The friction adversary, on joints that have friction."""
    friction = FrictionCfg("hinf", level=0.2, range=(0.0, 1.2), per="joint")
    hinf = replace(HINF.method_settings, disturber=kind)
    return replace(HINF, task=replace(HINF.task, friction=friction), method_settings=hinf)


def parameters(algorithm: AdaptationPPO) -> dict[str, torch.Tensor]:
    """Every parameter of policy and critic."""
    return {**algorithm.actor.state_dict(), **{f"V.{k}": v for k, v in algorithm.critic.state_dict().items()}}


@dataclass(frozen=True)
class Trained:
    """Result of two iterations."""

    alg: AdaptationPPO
    rows: list[dict]
    stream: torch.Tensor
    """Where torch's random numbers stand afterwards."""


def trained(cfg: TrainCfg, path: Path) -> Trained:
    """Train for two iterations."""
    runner = phase_runner(cfg, path)
    rows = [runner.iterate() for _ in range(2)]
    return Trained(runner.alg, rows, torch.get_rng_state())


def assert_same(one: Trained, other: Trained) -> None:
    """Every parameter, every reward and the stream are the same, bit for bit."""
    mine, yours = parameters(one.alg), parameters(other.alg)
    assert mine.keys() == yours.keys() and all(torch.equal(mine[name], yours[name]) for name in mine)
    assert torch.equal(one.stream, other.stream)
    assert [row["reward"] for row in one.rows] == [row["reward"] for row in other.rows]


def test_combined_advantage_by_hand() -> None:
    """λ = 3: (1 - 3·2)/4 and (-2 - 3·(-1))/4; λ = 0 leaves A as it is, bit for bit."""
    advantage, of_h = torch.tensor([1.0, -2.0]), torch.tensor([2.0, -1.0])
    torch.testing.assert_close(combined(advantage, of_h, 3.0), torch.tensor([-1.25, 0.25]))
    assert torch.equal(combined(advantage, of_h, 0.0), advantage)


def test_cost_by_hand() -> None:
    """0 at the most that the task pays and above it, 1 where nothing is paid; gait and swing are not of the task."""
    costs = cost(torch.tensor([0.08, 0.1, 0.0, -0.04]), 0.08)
    torch.testing.assert_close(costs, torch.tensor([0.0, 0.0, 1.0, 1.5]))
    terms = RewardCfg().terms_for(find_robot("go1"))
    assert best_task_reward(terms) == pytest.approx(2.0 + 0.8)


def test_multiplier_and_eta_by_hand() -> None:
    """λ moves by κ E[h] and never below 0; η falls by its factor where the constraint holds and stays where not."""
    assert ascended(0.2, 0.4, 0.05) == pytest.approx(0.22)
    assert ascended(0.01, -0.4, 0.05) == 0.0
    assert tightened(2.0, -0.1, 0.9) == pytest.approx(1.8)
    assert tightened(2.0, 0.1, 0.9) == 2.0


def test_advantages_of_h_by_hand() -> None:
    """γ = 0.5, λ = 0.5: one robot goes on, one falls in the first step, one times out there."""
    rewards = torch.tensor([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]])
    values = torch.tensor([[4.0, 4.0, 4.0], [8.0, 8.0, 8.0]])
    ended = torch.tensor([[False, True, True], [False, False, False]])
    timed_out = torch.tensor([[False, False, True], [False, False, False]])
    advantage = advantages(rewards, values, torch.full((3,), 6.0), ended, timed_out, 0.5, 0.5)
    last = 2.0 + 0.5 * 6.0 - 8.0  # -3
    goes_on = 1.0 + 0.5 * 8.0 - 4.0 + 0.25 * last  # 0.25
    expected = [[goes_on, 1.0 - 4.0, 1.0 + 0.5 * 4.0 - 4.0], [last] * 3]
    torch.testing.assert_close(advantage, torch.tensor(expected))


def test_the_disturbers_own_ppo_by_hand() -> None:
    """The density of a normal, the clipped ratio on either side, and the direction of its gradient."""
    density = log_density(torch.tensor([[1.0, 0.0]]), torch.zeros(1, 2), torch.tensor([1.0, 2.0]))
    expected = -0.5 - torch.tensor(2.0).log() - (2 * torch.pi * torch.ones(())).log()
    torch.testing.assert_close(density, expected[None])
    ratio = torch.tensor([1.5, 0.5, 1.5, 0.5]).log()
    loss = clipped_loss(torch.tensor([1.0, 1.0, -1.0, -1.0]), ratio)
    torch.testing.assert_close(loss, torch.tensor(-(1.2 + 0.5 - 1.5 - 0.8) / 4))
    slope = torch.zeros(1, requires_grad=True)
    clipped_loss(torch.tensor([1.0]), slope).backward()
    assert slope.grad is not None and slope.grad.item() == pytest.approx(-1.0)


class Toy:
    """One action a and one constant disturbance of size 1: r = -a², C = (a - 1)². Learned by the method's own rules."""

    def __init__(self, eta: float, multiplier: float) -> None:
        """Begin at a = 0, where reward alone wants to be."""
        self.generator = torch.Generator().manual_seed(1)
        self.mean = torch.zeros(1, requires_grad=True)
        self.eta, self.multiplier, self.seen = eta, multiplier, [multiplier]

    def run(self, iterations: int) -> list[float]:
        """Learn; return λ after every iteration, the first one included."""
        descent, std = torch.optim.SGD([self.mean], lr=0.02), torch.full((1,), 0.1)
        for _ in range(iterations):
            a = self.mean.detach() + std * torch.randn(256, 1, generator=self.generator)
            h = (a[:, 0] - 1.0).square() - self.eta
            climbed = combined(normalised(-a[:, 0].square()), normalised(h), self.multiplier)
            density = log_density(a, self.mean, std)
            descent.zero_grad()
            clipped_loss(climbed, density - density.detach()).backward()
            descent.step()
            self.multiplier = ascended(self.multiplier, float(h.mean()), 0.1)
            self.seen.append(self.multiplier)
        return self.seen


def test_the_constraint_moves_the_policy_and_is_met() -> None:
    """η = 0.25 asks for a ≥ 0.5, against the reward: reached only if the constraint has a gradient. Inert: a = 0."""
    toy = Toy(0.25, 0.0)
    seen = toy.run(400)
    assert toy.mean.item() == pytest.approx(0.5, abs=0.15) and max(seen) > 0.0


@pytest.mark.parametrize("changes", [{"disturber": "none"}, {"limit": 0.0}, {"disturber": "random", "limit": 0.0}])
@pytest.mark.parametrize("symmetry", ["none", "network"])
def test_without_a_disturbance_it_is_plain_ppo_bit_for_bit(changes: dict, symmetry: str, tmp_path: Path) -> None:
    """Nothing that the method has draws from torch's stream, or changes an advantage, unless someone disturbs."""
    plain, own = (
        trained(replace(cfg, symmetry=symmetry), tmp_path / str(number))
        for number, cfg in enumerate((PLAIN, with_hinf(**changes)))
    )
    assert isinstance(own.alg, HinfPPO) and not isinstance(plain.alg, HinfPPO)
    assert_same(plain, own)


@pytest.mark.parametrize("kind", ["force", "friction"])
def test_a_disturber_that_learns_and_pushes_with_nothing_leaves_plain_ppo_bit_for_bit(
    kind: DisturberName, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of the method runs, its rollouts, its own PPO and its critic; with λ at 0 none of it reaches the policy."""
    monkeypatch.setattr("stiction_experiments.methods.disturber.bounded", lambda raw, by_torque: torch.zeros_like(raw))
    base = by_friction(kind) if kind == "friction" else HINF
    plain = replace(base, method_settings=replace(base.method_settings, disturber="none"))
    learns = replace(base, method_settings=replace(base.method_settings, multiplier_rate=0.0))
    alone, disturbed = (trained(cfg, tmp_path / str(number)) for number, cfg in enumerate((plain, learns)))
    assert alone.alg.learning is None and disturbed.alg.learning is not None
    assert_same(alone, disturbed)
    assert "hinf/lambda" in disturbed.rows[-1] and disturbed.rows[-1]["hinf/intensity"] == 0.0


def walked(tmp_path: Path, multiplier: float, **changes: object) -> HinfPPO:
    """A rollout of the same robots under a λ, with critics that say 0: what differs is no error of theirs."""
    runner = phase_runner(with_hinf(**changes), tmp_path / f"{multiplier}{changes}")
    alg = runner.alg
    alg.multiplier = multiplier
    with torch.no_grad():
        for parameter in (*alg.critic.parameters(), *alg.learning.network.critic.parameters()):
            parameter.zero_()
    rollout(runner)
    return alg


def gradient(alg: HinfPPO) -> torch.Tensor:
    """The gradient of the policy's loss on a rollout."""
    storage = alg.storage
    alg.actor.zero_grad()
    alg.actor(storage.observations.flatten(0, 1), stochastic_output=True)
    density = alg.actor.get_output_log_prob(storage.actions.flatten(0, 1))
    clipped_loss(storage.advantages.flatten(), density - storage.actions_log_prob.flatten()).backward()
    return torch.cat([p.grad.flatten() for p in alg.actor.policy_parameters() if p.grad is not None])


def cosine(a: torch.Tensor, b: torch.Tensor) -> float:
    """The cosine of the angle between two vectors."""
    return float((a @ b) / (a.norm() * b.norm()))


def test_the_price_of_a_push_is_the_disturbers_alone(tmp_path: Path) -> None:
    """η moves what the disturber climbs, and nothing of what the policy climbs: the draws of another are no merit."""
    algs = [walked(tmp_path, 2.0, eta=eta) for eta in (0.0, 3.0)]
    assert torch.equal(*(alg.storage.advantages for alg in algs))
    assert not torch.equal(*(alg.learning._rollout["advantage"] for alg in algs))


def test_ppo_climbs_the_combined_advantage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The update sees (A - λ A_C)/(1 + λ) of two normalised advantages: with λ = 0 that of plain PPO."""
    runner, seen = phase_runner(HINF, tmp_path), []
    finish = runner.alg.learning.finish
    monkeypatch.setattr(runner.alg.learning, "finish", lambda *args: (seen.append(finish(*args)), seen[-1])[1])
    for multiplier in (0.0, 2.0):
        runner.alg.multiplier = multiplier
        rollout(runner)
        storage, of_cost = runner.alg.storage, normalised(seen[-1])[..., None]
        plain = normalised(storage.returns - storage.values)
        torch.testing.assert_close(storage.advantages, (plain - multiplier * of_cost) / (1 + multiplier))
        storage.clear()


def test_expected_h_by_hand() -> None:
    """γ = 0.5: a fall costs one step more, at C = 1. Four steps at 0.4 - 2·0.5, one fall: (-2.4 + 1)/5."""
    steps, fell = torch.full((2, 2), 0.4), torch.tensor([[False, True], [False, False]])
    assert expected(steps, torch.full((2, 2), 0.5), fell, 2.0, 0.5) == pytest.approx(-0.28)
    assert expected(steps, torch.full((2, 2), 0.5), fell & False, 2.0, 0.5) == pytest.approx(-0.6)


def test_the_disturbers_advantage_is_of_cost_and_price(tmp_path: Path) -> None:
    """One step, critics at 0, γ = 0.5: A_C = 0.5 (C - 1), A_d = 0.5 |d|; the disturber climbs A_C - η A_d."""
    obs = phase_runner(HINF, tmp_path).env.get_observations()
    learner = LearningDisturber(obs, 3, False, HinfCfg(actor=(8,), critic=(8,)), 5, "cpu")
    with torch.no_grad():
        for parameter in learner.network.critic.parameters():
            parameter.zero_()
    size = learner.act(obs).norm(dim=-1)
    costs, never = torch.linspace(0, 1, 8), torch.zeros(8)
    learner.record(costs, never, never)
    advantage = learner.finish(obs, 3.0, 0.5, 0.9)
    torch.testing.assert_close(advantage, 0.5 * (costs - 1.0)[None])
    climbed = normalised(0.5 * (costs - 1.0) - 3.0 * 0.5 * size)
    torch.testing.assert_close(learner._rollout["advantage"], climbed[None])


@pytest.mark.parametrize(("eta", "rises"), [(0.0, True), (1000.0, False)])
def test_lambda_and_eta_in_a_training(eta: float, rises: bool, tmp_path: Path) -> None:
    """η = 0: every cost violates it and λ rises. A huge η: it holds, λ falls to 0 and η is tightened."""
    runner = phase_runner(with_hinf(eta=eta), tmp_path)
    runner.alg.multiplier = 0.5
    rows = [runner.iterate() for _ in range(2)]
    seen = [0.5, *(row["hinf/lambda"] for row in rows)]
    if rises:
        assert seen[0] < seen[1] < seen[2] and rows[-1]["hinf/eta"] == 0.0
    else:
        assert seen[2] == 0.0 and rows[-1]["hinf/eta"] == pytest.approx(1000.0 * 0.99**2)
    for row in rows:
        h = row["hinf/cost"] - eta * 0.99 ** rows.index(row) * row["hinf/intensity"]
        assert row["hinf/constraint"] == pytest.approx(h, rel=1e-4)


def test_the_disturber_learns_what_costs(tmp_path: Path) -> None:
    """A cost of +x forces and a reward for -x ones: after some updates it pushes forward, whatever it sees."""
    runner = phase_runner(HINF, tmp_path)
    obs = runner.env.get_observations()
    cfg = HinfCfg(actor=(8,), critic=(8,), learning_rate=0.02, entropy=0.0)
    learner = LearningDisturber(obs, 3, False, cfg, 5, "cpu")
    never = torch.zeros(8)
    before = float(learner.mean(obs)[:, 0].mean())
    for _ in range(15):
        for _ in range(12):
            learner.record(1.0 + learner.act(obs)[:, 0], never, never)
        learner.finish(obs, 0.0, 0.9, 0.9)
        learner.update(4, 2)
    assert float(learner.mean(obs)[:, 0].mean()) > before + 0.3


def test_a_fall_is_all_later_reward_lost(tmp_path: Path) -> None:
    """Not the end of all costs: the step of a fall has a higher advantage of C than the same step without."""
    obs = phase_runner(HINF, tmp_path).env.get_observations()
    learnt = []
    for fell in (0.0, 1.0):
        learner = LearningDisturber(obs, 3, False, HinfCfg(actor=(8,), critic=(8,)), 5, "cpu")
        with torch.no_grad():
            learner.network.critic[-1].weight.zero_()
            learner.network.critic[-1].bias.fill_(-0.3)  # C - 1 is -0.3 in every step, for ever
        learner.act(obs)
        learner.record(torch.full((8,), 0.7), torch.full((8,), fell), torch.zeros(8))
        learnt.append(learner.finish(obs, 0.0, 0.99, 0.95))
    torch.testing.assert_close(learnt[0], torch.zeros(1, 8), atol=1e-4, rtol=0)
    torch.testing.assert_close(learnt[1], torch.full((1, 8), 0.99 * 0.3), atol=1e-4, rtol=0)


@pytest.mark.parametrize("by_torque", [False, True])
def test_random_disturbances_fill_the_limit_and_are_kept(by_torque: bool) -> None:
    """Within it, to its edge, with mean zero; drawn anew with the probability that was asked for."""
    random = RandomDisturber(4000, 3, by_torque, 0.1, 0)
    first = random.act(None).clone()
    second = random.act(None)
    size = first.abs().max() if by_torque else first.norm(dim=-1).max()
    assert 0.97 < float(size) <= 1.0 and float(first.mean(0).abs().max()) < 0.05
    changed = (first != second).any(-1).float().mean()
    assert float(changed) == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("kind", ["force", "friction", "random", "random-friction"])
def test_every_disturber_pushes_within_its_limit(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In every step of a rollout: a force of half the weight at most, a torque of the joint's own friction at most."""
    by_torque = "friction" in kind
    runner = phase_runner(by_friction(kind) if by_torque else with_hinf(disturber=kind), tmp_path)
    fleet, pushes = runner.env.fleet, []

    def spy(force: object = None, torque: object = None) -> None:
        assert (torque is None) != by_torque and (force is None) == by_torque
        limit = fleet.friction if by_torque else 0.5 * fleet.spec.weight
        used = abs(torque) if by_torque else (force**2).sum(-1) ** 0.5
        assert (used <= limit * (1 + 1e-6)).all()
        pushes.append(used.max())

    monkeypatch.setattr(fleet, "disturb", spy)
    rollout(runner)
    assert len(pushes) == 4 and min(pushes) > 0.0


def test_the_curriculum_raises_the_limit_on_a_straight_line(tmp_path: Path) -> None:
    """Over half of four iterations: half of it, then all; without one, all at once. η waits for the whole of it."""
    runner = phase_runner(with_hinf(curriculum=0.5, eta=1000.0), tmp_path)
    rows = [runner.iterate() for _ in range(3)]
    assert [row["hinf/limit"] for row in rows] == pytest.approx([0.25, 0.5, 0.5])
    assert [row["hinf/eta"] for row in rows] == pytest.approx([1000.0, 990.0, 980.1])
    assert phase_runner(HINF, tmp_path / "b").alg.scale == 1.0


def test_a_phase_does_not_end_before_the_curriculum_has(tmp_path: Path) -> None:
    """The limit of all four iterations' curriculum is there in the third: a target met under half of it is not met."""
    cfg = replace(with_hinf(curriculum=0.75), stop=StopCfg(tracking_error=10.0, iterations=1, falls=1e6))
    summary = train(cfg, RunDirectory.create(tmp_path / "run", cfg, "test", None))
    assert summary["stopped"]["teacher"]["iteration"] == 3
    at_once = phase_runner(replace(cfg, method_settings=HINF.method_settings), tmp_path / "b")
    assert at_once.early_stop.not_before == 0
    nobody = replace(cfg, method_settings=replace(cfg.method_settings, disturber="none"))
    assert phase_runner(nobody, tmp_path / "c").early_stop.not_before == 0


def test_without_a_reward_there_is_no_cost(tmp_path: Path) -> None:
    """Rejects rewards of gait alone, of which a push can cost nothing."""
    rewards = RewardCfg(track_linear=0.0, track_angular=0.0)
    with pytest.raises(StictionError, match="nothing is paid for going as commanded"):
        phase_runner(replace(HINF, task=replace(HINF.task, rewards=rewards)), tmp_path)
