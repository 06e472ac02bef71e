"""DreamWaQ under the one trainer: PPO on a drawn code, and the context-aided estimator's pass after it.

What the robot walks on, a draw of the code and the estimated or true velocity, is stored with the observations, so that
the ratio is 1 before the first gradient step. Adaptive bootstrapping feeds the estimate with probability

    p = 1 - tanh(CV(R)),    CV(R) = std(R) / mean(R),    R: returns of the robots' last episodes

and the true velocity otherwise: where returns differ much, little is learned yet. Each robot draws at its reset, for a
whole episode. Episodes that began at a random age, at the start of a run, do not count; until two robots have finished
one, and where the mean return is not positive, p is 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from stiction.learning.models import VELOCITY
from stiction.learning.ppo import AdaptationPPO
from stiction_experiments.methods.context import ContextActor, divergence

ACTIVE = 0.1
"""KL from which a dimension of the code counts as active [nat]: twice the default's free bits, below which nothing pays
for what it tells."""

RIDGE = 1e-3
"""Penalty of the probe, per sample: features have unit variance."""


def bootstrapping_probability(returns: torch.Tensor) -> float:
    """Return p of episode returns, (robots,)."""
    if len(returns) < 2 or not (mean := float(returns.mean())) > 0:
        return 0.0
    return 1.0 - math.tanh(float(returns.std(correction=0)) / mean)


class EpisodeReturns:
    """Adds up the reward of every robot's episode; what the last whole one gave is its return."""

    def __init__(self, num: int, device: str) -> None:
        """Begin amid episodes, which will not count."""
        self.running = torch.zeros(num, device=device)
        """Reward of the present episode so far."""
        self.whole = torch.zeros(num, dtype=torch.bool, device=device)
        """True where that episode was seen from its beginning."""
        self.last = torch.zeros(num, device=device)
        """Return of the last whole episode."""
        self.known = torch.zeros(num, dtype=torch.bool, device=device)
        """True where a whole episode has ended."""

    def push(self, reward: torch.Tensor, dones: torch.Tensor) -> None:
        """Take in one step: rewards and ends of episodes, (N,)."""
        self.running = self.running + reward
        ended = dones > 0
        counts = ended & self.whole
        self.last = torch.where(counts, self.running, self.last)
        self.known, self.whole = self.known | counts, self.whole | ended
        self.running = torch.where(ended, 0.0, self.running)

    @property
    def values(self) -> torch.Tensor:
        """The returns that are known, (robots,)."""
        return self.last[self.known]


def friction_probe(code: torch.Tensor, friction: torch.Tensor) -> torch.Tensor:
    """Return R² of friction, (joints,), as a linear map of the code tells it of robots that the map has not seen.

    code: (steps, robots, code); friction: (steps, robots, joints). Ridge regression on every second robot's steps,
    judged on the others' against their own mean; NaN for a joint whose friction does not vary in either half.
    """
    # In double precision: the Gram matrix squares the condition of the features.
    (x, x_new), (y, y_new) = (
        [part.flatten(0, 1).double() for part in (values[:, ::2], values[:, 1::2])] for values in (code, friction)
    )
    center, scale = x.mean(0), x.std(0, correction=0).clamp(min=1e-9)
    x, x_new = (x - center) / scale, (x_new - center) / scale
    gram = x.T @ x + RIDGE * len(x) * torch.eye(x.shape[-1], dtype=x.dtype, device=x.device)
    weights = torch.linalg.solve(gram, x.T @ (y - y.mean(0)))
    error = (y_new - y.mean(0) - x_new @ weights).square().sum(0)
    spread = (y_new - y_new.mean(0)).square().sum(0)
    varies = (spread > 1e-9) & ((y - y.mean(0)).square().sum(0) > 1e-9)
    return torch.where(varies, 1.0 - error / spread.clamp(min=1e-9), torch.nan)


def context_figures(actor: ContextActor, rollout: TensorDict, joints: Sequence[str]) -> dict[str, float]:
    """Return how much the code tells, over a rollout, (steps, robots), with the groups that `ContextPPO` stores.

    `code/kl` [nat], summed over the code; `code/active`: dimensions above `ACTIVE`; `code/reconstruction`: mean squared
    error of the next observation predicted from the code's mean, and `code/repeat` that of the present one in its
    place; `code/friction/JOINT`: see `friction_probe`, where the joint's friction varies.
    """
    steps, errors = [], []
    with torch.no_grad():
        for obs in rollout.unbind(0):
            context = actor.context(obs["history"])
            steps.append(context)
            guess, lasts = actor.context.predict(context.velocity, context.mean), obs["lasts"][:, 0] > 0
            both = torch.stack((guess, obs["proprioception"]))
            errors.append((both - obs["next"]).square()[:, lasts].mean(-1))
        mean = torch.stack([context.mean for context in steps])
        kl = torch.stack([divergence(context) for context in steps]).mean((0, 1))
        error = torch.cat(errors, 1).mean(1)
        friction = rollout["privileged"][..., -len(joints) :]
        determination = friction_probe(mean, friction)
    figures = {"code/kl": float(kl.sum()), "code/active": float((kl > ACTIVE).sum())}
    if error.isfinite().all():
        figures |= {"code/reconstruction": float(error[0]), "code/repeat": float(error[1])}
    return figures | {
        f"code/friction/{joint}": float(value)
        for joint, value in zip(joints, determination, strict=True)
        if not math.isnan(value)
    }


class ContextPPO(AdaptationPPO):
    """PPO of an actor on DreamWaQ's context.

    Beside the task's groups it stores `estimate` and `guess`, what was fed, `noise` and `bootstrapped`, by what draws,
    and `next` and `lasts`, what came of it: the next frame, at a time-out that before the reset, and whether there was
    one.
    """

    actor: ContextActor
    targets: Mapping[str, str | None] = MappingProxyType({"next": "proprioception", "lasts": None})
    joints: tuple[str, ...] = ()
    """Names of the robot's joints, for the probe."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        """Begin with the true velocity for all; arguments as of `AdaptationPPO`."""
        super().__init__(*args, **kwargs)
        num = self.storage.num_envs
        self.returns = EpisodeReturns(num, self.device)
        self.probability = 0.0
        self.bootstrapped = torch.zeros(num, 1, device=self.device)

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Construct the algorithm, with room in its storage; ask the task for the frames before time-outs' resets."""
        code, frame = cfg["actor"]["context"].code, obs["proprioception"].shape[-1]
        columns = {"estimate": VELOCITY, "guess": code, "noise": code, "bootstrapped": 1, "next": frame, "lasts": 1}
        empty = {name: torch.zeros(env.num_envs, width, device=device) for name, width in columns.items()}
        algorithm = PPO.construct_algorithm(obs.clone(recurse=False).update(empty), env, cfg, device)
        assert isinstance(algorithm, ContextPPO)
        env.return_terminal_obs = True
        algorithm.joints = env.spec.joint_names
        return algorithm

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Draw the code and sample actions on it; store both."""
        noise = torch.randn(self.storage.num_envs, self.actor.cfg.code, device=self.device)
        # Both are known only after the step; until then zeros keep their places in the storage.
        unknown = {"next": torch.zeros_like(obs["proprioception"]), "lasts": torch.zeros_like(self.bootstrapped)}
        drawn = {"noise": noise, "bootstrapped": self.bootstrapped}
        return super().act(obs.clone(recurse=False).update(drawn | unknown))

    def process_env_step(
        self, obs: TensorDict, rewards: torch.Tensor, dones: torch.Tensor, extras: dict[str, torch.Tensor]
    ) -> None:
        """Store what came of the step, count its reward, and let robots that begin anew draw what they are fed."""
        ended, timed_out = dones > 0, extras["time_outs"] > 0
        # After a time-out `obs` is of the next episode already; the frame before the reset is in `extras`.
        frame, lasts = obs["proprioception"], ~ended | timed_out
        if timed_out.any():
            frame = torch.where(timed_out[:, None], extras["terminal"], frame)
        came = {"next": torch.where(lasts[:, None], frame, 0.0), "lasts": lasts[:, None].float()}
        assert self.transition.observations is not None
        self.transition.observations = self.transition.observations.clone(recurse=False).update(came)
        super().process_env_step(obs, rewards, dones, extras)
        self.returns.push(rewards, dones)
        if ended.any():
            drawn = (torch.rand(len(dones), 1, device=self.device) < self.probability).float()
            self.bootstrapped = torch.where(ended[:, None], drawn, self.bootstrapped)

    def update(self) -> dict[str, float]:
        """Update the policy, then the estimator; adapt the bootstrapping, and see what the code tells."""
        losses = super().update()
        self.probability = bootstrapping_probability(self.returns.values)
        self.figures = context_figures(self.actor, self.storage.observations, self.joints)
        self.figures |= {
            "bootstrap/probability": self.probability,
            "bootstrap/share": float(self.bootstrapped.mean()),
        }
        return losses

    def save(self) -> dict:
        """Return what a checkpoint holds, with the bootstrapping: what robots get, and the returns that decide it."""
        drawn = {"bootstrapped": self.bootstrapped, "probability": self.probability}
        return super().save() | {"bootstrapping": drawn | vars(self.returns)}

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore what `save` returned."""
        result = super().load(loaded_dict, load_cfg, strict)
        saved = dict(loaded_dict["bootstrapping"])
        self.probability = float(saved.pop("probability"))
        self.bootstrapped = saved.pop("bootstrapped").to(self.device)
        for name in vars(self.returns):
            setattr(self.returns, name, saved[name].to(self.device))
        return result
