"""H∞ under the one trainer: PPO of the policy beside a disturber that learns, under a bound on what a push may cost.

Long et al. 2024, "Learning H-Infinity Locomotion Control" (arXiv 2404.14405); their code was never released. With what
the task pays in a step, r, its most, r* (`best_task_reward`), and the disturbance d in units of its present limit,

    C = max(0, 1 - r / r*),    h = C - η |d|,    E[h] ≤ 0,
    A' = (A - λ A_C) / (1 + λ),    λ ← max(0, λ + κ E[h]),    η ← τ η where E[h] ≤ 0.

The disturber maximises the return of h (`disturber`). What the paper leaves open is settled here:

* C is of the task's reward, to go as commanded, and not of all that is paid: of that A_C would be -A, and the
  constraint would ask for nothing. It is a share, so that η, λ and κ mean the same for every robot and reward.
* Of A_h = A_C - η A_d the policy is given A_C. How hard it is pushed another draws; paid for that, it would look
  for states in which it is pushed harder, and what its own action does would drown in the draws.
* E is the mean over a rollout and over the steps that falls have cost (`expected`). A and A_C are each normalised
  before they are put together. η is tightened only once the limit has grown to its value.
* A fall costs 1 in every step that would have followed; time-outs are bootstrapped, as PPO does.
* Where nobody disturbs, or by chance, there is no constraint: λ stays 0, and A' is A.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from stiction.core.errors import ConfigurationError
from stiction.learning.ppo import AdaptationPPO
from stiction.task.rewards import TASK, best_task_reward
from stiction_experiments.methods.disturbance import Disturbance, intensity
from stiction_experiments.methods.disturber import Disturber, LearningDisturber, make_disturber, normalised
from stiction_experiments.methods.hinf import HinfCfg


def cost(paid: torch.Tensor, best: float) -> torch.Tensor:
    """Return C, (N,), of what the task has paid, (N,), and the most that it pays."""
    return (1.0 - paid / best).clamp(min=0.0)


def combined(advantage: torch.Tensor, of_cost: torch.Tensor, multiplier: float) -> torch.Tensor:
    """Return A' of A, A_C and λ, any shape."""
    return (advantage - multiplier * of_cost) / (1.0 + multiplier)


def ascended(multiplier: float, constraint: float, rate: float) -> float:
    """Return the next λ of E[h] and κ."""
    return max(0.0, multiplier + rate * constraint)


def tightened(eta: float, constraint: float, factor: float) -> float:
    """Return the next η of E[h] and τ."""
    return factor * eta if constraint <= 0 else eta


class HinfPPO(AdaptationPPO):
    """PPO of an actor that is disturbed."""

    disturber: Disturber | None = None
    disturbance: Disturbance
    best: float = 0.0
    """Most that the task pays in a step."""

    def __init__(self, *args: Any, hinf: HinfCfg, seed: int, iterations: int, **kwargs: Any) -> None:
        """Begin with λ = 0. `seed`: of the disturber; `iterations`: of the phase; others as of `AdaptationPPO`."""
        super().__init__(*args, **kwargs)
        self.hinf, self.seed, self.iterations = hinf, seed, iterations
        self.multiplier, self.eta = 0.0, hinf.eta
        self.disturber_optimizer: torch.optim.Optimizer | None = None
        """Optimizer of a disturber that learns."""
        self._intensity = torch.zeros(())
        self._logged: list[tuple[float, float]] = []

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Construct the algorithm, and the task's disturber.

        Raises `StictionError` where no reward could be lost.
        """
        algorithm = AdaptationPPO.construct_algorithm(obs, env, cfg, device)
        assert isinstance(algorithm, HinfPPO)
        # The task pays every term times the control period.
        algorithm.best = best_task_reward(env.terms) * env.cfg.control_period
        if algorithm.hinf.learns and not algorithm.best > 0:
            raise ConfigurationError(
                "the method 'hinf' counts the cost of a disturbance from what the task pays, and nothing is paid for "
                f"going as commanded; give {' or '.join(TASK)} a positive weight"
            )
        algorithm.disturbance = Disturbance(env.fleet, algorithm.hinf.by_torque, algorithm.hinf.share)
        width, period = algorithm.disturbance.width, env.cfg.control_period
        algorithm.disturber = make_disturber(algorithm.hinf, obs, width, period, algorithm.seed, device)
        if algorithm.learning is not None:
            algorithm.disturber_optimizer = algorithm.learning.optimizer
        return algorithm

    @property
    def learning(self) -> LearningDisturber | None:
        """The disturber where it learns."""
        return self.disturber if isinstance(self.disturber, LearningDisturber) else None

    @property
    def scale(self) -> float:
        """Share of the limit that the curriculum has reached."""
        over = self.hinf.curriculum * self.iterations
        return min(1.0, (self.iteration + 1) / over) if over > 0 else 1.0

    @property
    def settled_from(self) -> int:
        """Iteration from which robots walk as they will in the end: disturbed up to the limit too."""
        grown = math.ceil(self.hinf.curriculum * self.iterations) if self.hinf.disturbs else 0
        return max(super().settled_from, grown)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Sample actions, and disturb the step that follows."""
        actions = super().act(obs)
        if self.disturber is not None:
            values = self.disturber.act(obs)
            self.disturbance.apply(self.scale * values)
            self._intensity = intensity(values, self.hinf.by_torque)
        return actions

    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Store what came of the step, for the policy and for the disturber."""
        if self.disturber is not None and self.best > 0:
            costs = cost(extras["task"], self.best)
            self._logged.append((float(costs.mean()), float(self._intensity.mean())))
            if self.learning is not None:
                self.learning.record(costs, dones, extras["time_outs"])
        super().process_env_step(obs, rewards, dones, extras)

    def compute_returns(self, obs: TensorDict) -> None:
        """Compute the returns of the reward, and the advantages that the policy climbs."""
        super().compute_returns(obs)
        if self.learning is not None:
            of_cost = self.learning.finish(obs, self.eta, self.gamma, self.lam)
            # rsl_rl has normalised its advantages already, and has them as (steps, N, 1).
            self.storage.advantages = combined(self.storage.advantages, normalised(of_cost)[..., None], self.multiplier)

    def update(self) -> dict[str, float]:
        """Update policy and estimator, then disturber and its critic, then λ and η."""
        # Before `update` counts on: the limit that this rollout walked under.
        scale = self.scale
        losses = super().update()
        self.figures = {}
        if self.disturber is not None and self._logged:
            means = [sum(values) / len(values) for values in zip(*self._logged, strict=True)]
            self.figures = {"hinf/cost": means[0], "hinf/intensity": means[1], "hinf/limit": scale * self.hinf.share}
        self._logged = []
        if (learning := self.learning) is not None:
            losses |= learning.update(self.settings.epochs, self.settings.mini_batches)
            constraint = learning.expected_h(self.eta, self.gamma)
            self.multiplier = ascended(self.multiplier, constraint, self.hinf.multiplier_rate)
            if scale == 1.0:
                self.eta = tightened(self.eta, constraint, self.hinf.tightening)
            self.figures |= {
                "hinf/constraint": constraint,
                "hinf/lambda": self.multiplier,
                "hinf/eta": self.eta,
                "hinf/std": float(learning.network.log_std.detach().exp().mean()),
            }
        return losses

    def save(self) -> dict:
        """Return what a checkpoint holds: disturber, λ and η too."""
        own: dict[str, Any] = {"lambda": self.multiplier, "eta": self.eta}
        if self.disturber is not None:
            own |= self.disturber.state()
        return super().save() | {"hinf": own}

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore what `save` returned."""
        result = super().load(loaded_dict, load_cfg, strict)
        own = loaded_dict["hinf"]
        self.multiplier, self.eta = float(own["lambda"]), float(own["eta"])
        if self.disturber is not None:
            self.disturber.load_state(own)
        return result
