"""Disturbers: a network that learns by a PPO of its own, or random draws that are kept for a while.

Nothing here touches torch's global stream of random numbers: all draws come from a generator that the disturber owns,
so that a training whose disturber may do nothing is the training without one, bit for bit.

h = C - η|d| is what a disturber that learns maximises; the policy of `hinf_ppo` minimises C. A critic with a head for
each of the two serves both, whatever η has become since. It learns the returns of C - 1 and of |d|,
times 1 - γ: means, which are 0 after a fall. A fall then counts as a cost of 1, all of the task lost, in every step
that would have followed; as an end of all costs it would pay the policy to fall, and cost the disturber.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import nn

from stiction_experiments.methods.disturbance import bounded, intensity
from stiction_experiments.methods.hinf import HinfCfg

SEEN = ("proprioception", "explicit", "privileged")
"""Observation groups that disturber and critic see: what the robot measures, and what only simulation knows. One that
knows masses and friction is the stronger one."""

STD = (0.1, 1.0)
"""Bounds of the disturbances' standard deviation, in units of the limit."""

LEAST_SHARE = 1e-3
"""Least of 1 - γ by which returns are multiplied: without a discount nothing would be left."""

CLIP, GRADIENT = 0.2, 1.0
"""Clip range of the ratio, and largest norm of a gradient, as of the policy's PPO."""


def advantages(
    rewards: torch.Tensor,
    values: torch.Tensor,
    last: torch.Tensor,
    ended: torch.Tensor,
    timed_out: torch.Tensor,
    gamma: float,
    lam: float,
) -> torch.Tensor:
    """Return generalised advantage estimates, (steps, N), of rewards and values of that shape.

    `last`: values after the last step, (N,); `ended`: whether the step ended an episode, (steps, N) bool, after which
    there is nothing, or, where it `timed_out`, what there was before the step, as rsl_rl has it.
    """
    # The value before the step stands for the one after it: by then the robot has been reset.
    rewards = rewards + gamma * values * timed_out
    result, advantage = torch.empty_like(rewards), torch.zeros_like(last)
    for step in range(len(rewards) - 1, -1, -1):
        following = last if step == len(rewards) - 1 else values[step + 1]
        goes_on = 1.0 - ended[step].float()
        delta = rewards[step] + goes_on * gamma * following - values[step]
        advantage = delta + goes_on * gamma * lam * advantage
        result[step] = advantage
    return result


def expected(cost: torch.Tensor, size: torch.Tensor, fell: torch.Tensor, eta: float, gamma: float) -> float:
    """Return E[h] of C, |d| and falls in a rollout, all (steps, N).

    Each fall has cost steps more, in which C is 1 and nobody pushes, see `with_falls`.
    """
    return with_falls(float((cost - eta * size).sum()), cost.numel(), float(fell.sum()), gamma)


def with_falls(total: float, samples: int, falls: float, gamma: float) -> float:
    """Return the mean of C, or of h, over `samples` steps, whose sum is `total`, and over those that falls have cost.

    Each fall has cost γ / (1 - γ) steps more, in which C is 1.
    """
    lost = falls * gamma / max(1.0 - gamma, LEAST_SHARE)
    return (total + lost) / (samples + lost)


def log_density(values: torch.Tensor, mean: torch.Tensor, std: torch.Tensor) -> torch.Tensor:
    """Return the log-density of normal distributions side by side, (..., width) -> (...)."""
    return -(((values - mean) / std).square() / 2 + std.log() + math.log(2 * math.pi) / 2).sum(-1)


def clipped_loss(advantage: torch.Tensor, log_ratio: torch.Tensor) -> torch.Tensor:
    """Return PPO's clipped loss of samples, a mean; its descent raises the density where the advantage is positive."""
    ratio = log_ratio.exp()
    return -torch.minimum(advantage * ratio, advantage * ratio.clamp(1.0 - CLIP, 1.0 + CLIP)).mean()


def normalised(advantage: torch.Tensor) -> torch.Tensor:
    """Return advantages with mean 0 and standard deviation 1, as rsl_rl has them."""
    return (advantage - advantage.mean()) / (advantage.std() + 1e-8)


class RandomDisturber:
    """Draws within the limit, evenly, and keeps what it has drawn for some time."""

    def __init__(self, num: int, width: int, by_torque: bool, renewal: float, seed: int) -> None:
        """`renewal`: probability that a robot's disturbance is drawn anew in a step."""
        self.by_torque, self.renewal = by_torque, renewal
        self.generator = torch.Generator().manual_seed(seed)
        self.values = self._draw(num, width)

    def _draw(self, num: int, width: int) -> torch.Tensor:
        """Return disturbances, evenly spread over cube or ball, (num, width)."""
        if self.by_torque:
            return 2 * torch.rand(num, width, generator=self.generator) - 1
        direction = torch.randn(num, width, generator=self.generator)
        # The volume within a radius grows with radius^width; without the root the draws would crowd at the centre.
        radius = torch.rand(num, 1, generator=self.generator) ** (1 / width)
        return radius * direction / direction.norm(dim=-1, keepdim=True).clamp(min=1e-9)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Return every robot's disturbance in units of the limit, (N, width)."""
        num, width = self.values.shape
        renewed = torch.rand(num, 1, generator=self.generator) < self.renewal
        self.values = torch.where(renewed, self._draw(num, width), self.values)
        return self.values

    def state(self) -> dict[str, Any]:
        """Return what the next draw depends on, for a checkpoint."""
        return {"values": self.values, "generator": self.generator.get_state()}

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.values = torch.empty_like(self.values).copy_(state["values"])
        self.generator.set_state(state["generator"])


class DisturberNetwork(nn.Module):
    """A normal distribution of disturbances, and the critic's value, from what is seen."""

    def __init__(self, seen: int, width: int, cfg: HinfCfg) -> None:
        """`seen`: size of the disturber's observation; `width`: of a disturbance."""
        super().__init__()
        self.policy = MLP(seen, width, list(cfg.actor), "elu")
        self.critic = MLP(seen, 2, list(cfg.critic), "elu")
        self.log_std = nn.Parameter(torch.full((width,), math.log(cfg.initial_std)))

    def value(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the values of C - 1 and of |d|, (..., seen) -> (..., 2)."""
        return self.critic(seen)


class LearningDisturber:
    """Maximises the return of h by a PPO of its own: own network, rollout, optimizer and random numbers."""

    def __init__(self, obs: TensorDict, width: int, by_torque: bool, cfg: HinfCfg, seed: int, device: str) -> None:
        """`obs`: observations of the task, for their sizes; `width`: of a disturbance."""
        self.cfg, self.by_torque, self.device = cfg, by_torque, device
        size = sum(obs[name].shape[-1] for name in SEEN)
        with torch.random.fork_rng(devices=[]):
            # Not `torch.manual_seed`: that seeds GPUs too, and what is forked, and restored, is the host's stream
            # alone.
            torch.default_generator.manual_seed(seed)
            self.network = DisturberNetwork(size, width, cfg).to(device)
        self.generator = torch.Generator().manual_seed(seed)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=cfg.learning_rate)
        self._steps: list[dict[str, torch.Tensor]] = []
        self._rollout: dict[str, torch.Tensor] = {}

    @staticmethod
    def _seen(obs: TensorDict) -> torch.Tensor:
        """Return the disturber's observation, (N, seen)."""
        return torch.cat([obs[name] for name in SEEN], -1)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Draw and remember every robot's disturbance; return it in units of the limit, (N, width)."""
        with torch.no_grad():
            seen = self._seen(obs)
            mean, std = self.network.policy(seen), self.network.log_std.exp()
            raw = mean + std * torch.randn(mean.shape, generator=self.generator).to(self.device)
            values = bounded(raw, self.by_torque)
            self._steps.append(
                {
                    "seen": seen,
                    "raw": raw,
                    "log_density": log_density(raw, mean, std),
                    "value": self.network.value(seen),
                    "intensity": intensity(values, self.by_torque),
                }
            )
        return values

    def mean(self, obs: TensorDict) -> torch.Tensor:
        """Return the disturbances without a draw, in units of the limit, (N, width), and remember nothing."""
        with torch.no_grad():
            return bounded(self.network.policy(self._seen(obs)), self.by_torque)

    def record(self, cost: torch.Tensor, dones: torch.Tensor, time_outs: torch.Tensor) -> None:
        """Take in what came of the step: cost, and whether the episode ended or timed out, each (N,)."""
        step = self._steps[-1]
        step["cost"], step["ended"], step["timed_out"] = cost, dones > 0, time_outs > 0

    def finish(self, obs: TensorDict, eta: float, gamma: float, lam: float) -> torch.Tensor:
        """End the rollout; return A_C times 1 - γ, (steps, N). `obs`: after the last step."""
        rollout = {name: torch.stack([step[name] for step in self._steps]) for name in self._steps[0]}
        self._steps = []
        with torch.no_grad():
            last = self.network.value(self._seen(obs))
        # Returns of some tens would be far from what a fresh network says, and the critic long in getting there.
        paid = max(1.0 - gamma, LEAST_SHARE) * torch.stack((rollout["cost"] - 1.0, rollout["intensity"]), -1)
        ends = rollout["ended"], rollout["timed_out"]
        heads = zip(paid.unbind(-1), rollout["value"].unbind(-1), last.unbind(-1), strict=True)
        of_cost, of_size = (advantages(reward, value, after, *ends, gamma, lam) for reward, value, after in heads)
        returns = torch.stack((of_cost, of_size), -1) + rollout["value"]
        self._rollout = rollout | {"returns": returns, "advantage": normalised(of_cost - eta * of_size)}
        return of_cost

    def expected_h(self, eta: float, gamma: float) -> float:
        """Return E[h] over the rollout that has ended."""
        rollout = self._rollout
        fell = rollout["ended"] & ~rollout["timed_out"]
        return expected(rollout["cost"], rollout["intensity"], fell, eta, gamma)

    def update(self, epochs: int, batches: int) -> dict[str, float]:
        """Learn from the rollout that has ended, in `epochs` passes of `batches` steps; return the mean losses."""
        flat = {name: value.flatten(0, 1) for name, value in self._rollout.items()}
        network, total = self.network, {"disturber": 0.0, "disturber_value": 0.0}
        for _ in range(epochs):
            order = torch.randperm(len(flat["cost"]), generator=self.generator).to(self.device)
            for ids in order.chunk(batches):
                batch = {name: value[ids] for name, value in flat.items()}
                std = network.log_std.exp()
                density = log_density(batch["raw"], network.policy(batch["seen"]), std)
                loss = clipped_loss(batch["advantage"], density - batch["log_density"])
                value_loss = (network.value(batch["seen"]) - batch["returns"]).square().mean()
                self.optimizer.zero_grad()
                (loss + value_loss - self.cfg.entropy * std.log().sum()).backward()
                # Each by its own norm: a large error of the critic would else shorten the step of the policy.
                nn.utils.clip_grad_norm_([*network.policy.parameters(), network.log_std], GRADIENT)
                nn.utils.clip_grad_norm_(network.critic.parameters(), GRADIENT)
                self.optimizer.step()
                with torch.no_grad():
                    network.log_std.clamp_(math.log(STD[0]), math.log(STD[1]))
                total["disturber"] += loss.item() / (epochs * batches)
                total["disturber_value"] += value_loss.item() / (epochs * batches)
        return total

    def state(self) -> dict[str, Any]:
        """Return network, optimizer and random numbers between two rollouts, for a checkpoint."""
        return {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "generator": self.generator.get_state(),
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned."""
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.generator.set_state(state["generator"])


Disturber = RandomDisturber | LearningDisturber


def make_disturber(
    cfg: HinfCfg, obs: TensorDict, width: int, control_period: float, seed: int, device: str
) -> Disturber | None:
    """Return the disturber, None without one. `width`: of a disturbance; `control_period`: between two [s]."""
    if not cfg.disturbs:
        return None
    if cfg.learns:
        return LearningDisturber(obs, width, cfg.by_torque, cfg, seed, device)
    return RandomDisturber(len(obs), width, cfg.by_torque, min(1.0, control_period / cfg.hold), seed)
