"""The networks of rapid motor adaptation, as rsl_rl models."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import nn

from stiction.learning.config import NetworkCfg
from stiction.task.symmetry import Rows

GROUPS = ["proprioception", "history", "privileged", "explicit"]
"""Observation groups on any ground; each model picks those that it may see."""

ELEVATION = "elevation"
"""Additional observation group on terrain."""

VELOCITY = 3
"""Entries of o_exp that are the base's velocity [m/s]; the feet's contacts follow."""


class HistoryEncoder(nn.Module):
    """Reads o_H: every frame through one linear layer, then an MLP over all or a recurrent unit over them in turn."""

    def __init__(
        self, history: int, frame: int, width: int, hidden: tuple[int, ...], output: int, recurrent: bool = False
    ) -> None:
        """`history`: size of the flattened history; `frame`, `width`: size of a frame, before and after its layer."""
        super().__init__()
        self.frame = frame
        self.embed = nn.Sequential(nn.Linear(frame, width), nn.ELU())
        self.memory = nn.GRUCell(width, hidden[0]) if recurrent else None
        self.mlp = MLP(hidden[0] if recurrent else history // frame * width, output, list(hidden), "elu")

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        """Map (N, history) to (N, output)."""
        frames = self.embed(history.unflatten(-1, (-1, self.frame)))
        if self.memory is None:
            return self.mlp(frames.flatten(-2))
        # Not len(frames): the exporter would take it for a number, and the network for one size of batch.
        state = frames.new_zeros(frames.shape[0], self.memory.hidden_size)
        for frame in frames.unbind(1):
            state = self.memory(frame, state)
        return self.mlp(state)


class NoLatent(nn.Module):
    """z and z* of size 0, where the policy has its estimates alone."""

    def forward(self, seen: torch.Tensor) -> torch.Tensor:
        """Map (N, size) to (N, 0)."""
        # Not len(seen): see `HistoryEncoder`.
        return seen.new_zeros(seen.shape[0], 0)


class RMAActor(MLPModel):
    """π(o_exp*, o_prio, z or z*): the actor with its adaptation networks and its estimator.

    `latent_source`: `privileged` (z = f_ada_tea(o_priv)), `history` (z* = f_ada_stu(o_H)), or `groups`: z* where the
    group `walks_blind` marks a robot. The explicit state is always the estimate f_est(o_H). PPO trains neither estimate
    nor z*, unless `adapts` (z*) or `end_to_end` (both, by the cloning loss): they may be computed once and handed in
    (`remembered`). On other than flat ground the teacher encodes the elevation map e_t, the student (`blind`) the same
    from the history.
    """

    adapts = False
    end_to_end = False
    blind = False
    latent_source = "privileged"

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        network: NetworkCfg,
        distribution_cfg: dict[str, Any],
    ) -> None:
        """Build the networks for the sizes of the observation groups; arguments as rsl_rl has them."""
        size = {name: obs[name].shape[-1] for name in obs_groups[obs_set]}
        # rsl_rl's constructor asks for the size of the input, and no module can be set before it has run: sizes before,
        # networks after it.
        self._plan(size, network)
        super().__init__(obs, obs_groups, obs_set, output_dim, network.actor, "elu", False, distribution_cfg)
        self._build(size, network)

    def _plan(self, size: dict[str, int], network: NetworkCfg) -> None:
        """Find the size of the actor's input; `size`: of every observation group."""
        self.sees_terrain, self.terrain_loss = ELEVATION in size, network.terrain_loss
        self.latent_dim = size["proprioception"] + size["explicit"] + network.latent
        self.latent_dim += network.terrain_latent * self.sees_terrain

    def _build(self, size: dict[str, int], network: NetworkCfg) -> None:
        """Make the networks beside the policy's own; arguments as of `_plan`."""
        frames = (size["history"], size["proprioception"])
        encoder = (*frames, network.history_frame, network.history)
        self.privileged_encoder: nn.Module = NoLatent()
        self.adaptation: nn.Module = NoLatent()
        if network.latent:
            self.privileged_encoder = MLP(size["privileged"], network.latent, list(network.privileged), "elu")
            self.adaptation = HistoryEncoder(*encoder, network.latent, network.recurrent)
        self.estimator = HistoryEncoder(*frames, network.estimator_frame, network.estimator, size["explicit"])
        if self.sees_terrain:
            elevation = MLP(size[ELEVATION], network.terrain_latent, list(network.terrain), "elu")
            self.terrain_encoder = nn.Sequential(elevation, nn.Tanh())
            self.terrain_history = nn.Sequential(HistoryEncoder(*encoder, network.terrain_latent), nn.Tanh())

    def _get_latent_dim(self) -> int:
        """Return the size of the actor's input."""
        return self.latent_dim

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> torch.Tensor:
        """Assemble the actor's input, (N, proprioception + explicit + latent + terrain latent)."""
        estimate = self._from_history(self.estimator, obs, "estimate", self.end_to_end)
        parts = [obs["proprioception"], estimate, self._latent(obs)]
        if self.sees_terrain:
            features = self.terrain_history(obs["history"]) if self.blind else self.terrain_encoder(obs[ELEVATION])
            parts.append(features)
        return torch.cat(parts, -1)

    def _from_history(self, network: nn.Module, obs: TensorDict, name: str, trained: bool) -> torch.Tensor:
        """Return what a network makes of the history; if it is not `trained`, the group `name` where that is there."""
        if not trained and name in obs.keys():  # noqa: SIM118 (a TensorDict knows no `in`)
            return obs[name]
        with torch.set_grad_enabled(trained and torch.is_grad_enabled()):
            return network(obs["history"])

    def _latent(self, obs: TensorDict) -> torch.Tensor:
        """Return z or z* of every robot, (N, latent)."""
        if self.latent_source == "privileged":
            return self.privileged_encoder(obs["privileged"])
        guess = self._from_history(self.adaptation, obs, "guess", self.adapts or self.end_to_end)
        if self.latent_source == "history":
            return guess
        return torch.where(obs["walks_blind"] > 0, guess, self.privileged_encoder(obs["privileged"]))

    def remembered(self, obs: TensorDict) -> dict[str, torch.Tensor]:
        """Return the outputs of networks that PPO holds fixed, to store with observations: `estimate`, `guess` (z*)."""
        with torch.no_grad():
            outputs = {"estimate": self.estimator(obs["history"])}
            if self.latent_source != "privileged" and not self.adapts:
                outputs["guess"] = self.adaptation(obs["history"])
        return outputs

    def supervised_parameters(self) -> list[nn.Parameter]:
        """Return the parameters that L_ada, L_est and L_hist train."""
        modules: list[nn.Module] = [self.estimator, *([] if self.adapts else [self.adaptation])]
        modules += [self.terrain_history] if self.sees_terrain else []
        return [parameter for module in modules for parameter in module.parameters()]

    def policy_parameters(self) -> list[nn.Parameter]:
        """Return the parameters that PPO trains: all others."""
        supervised = {id(parameter) for parameter in self.supervised_parameters()}
        return [parameter for parameter in self.parameters() if id(parameter) not in supervised]

    def supervised_losses(
        self, obs: TensorDict, velocity_weight: float = 1.0, both_ways: bool = False
    ) -> dict[str, torch.Tensor]:
        """Return L_ada = MSE(z, z*) where PPO does not train z*, L_est, and on terrain L_hist = MSE(e_t*, f_hist(o_H)).

        L_est = mean of w (o_exp* - o_exp)², w = `velocity_weight` for the velocity, else 1. e_t* and, unless
        `both_ways`, z are held fixed. Without `NetworkCfg.terrain_loss` there is no L_hist.
        """
        losses = {}
        if not self.adapts:
            target, guess = self.latents(obs, both_ways)
            losses["adaptation"] = nn.functional.mse_loss(guess, target)
        error = (self.estimator(obs["history"]) - obs["explicit"]).square()
        more = (velocity_weight - 1.0) * error[:, :VELOCITY].sum(-1).mean() / error.shape[-1]
        losses["estimator"] = error.mean() + more
        if self.sees_terrain and self.terrain_loss:
            with torch.no_grad():
                target = self.terrain_encoder(obs[ELEVATION])
            losses["terrain"] = nn.functional.mse_loss(self.terrain_history(obs["history"]), target)
        return losses

    def latents(self, obs: TensorDict, both_ways: bool = False) -> tuple[torch.Tensor, torch.Tensor]:
        """Return z, held fixed unless `both_ways`, and z*, each (N, latent)."""
        with torch.set_grad_enabled(both_ways and torch.is_grad_enabled()):
            target = self.privileged_encoder(obs["privileged"])
        return target, self.adaptation(obs["history"])

    def student(self) -> StudentPolicy:
        """Return the deployed policy."""
        return StudentPolicy(self)

    def make_inputs_equivariant(self, rows: dict[str, Rows]) -> Rows | None:
        """Make an actor's own networks symmetric; return the mirror of its input, None: those of `symmetry`."""
        return None

    @property
    def std(self) -> torch.Tensor:
        """Standard deviation of the actions within its current bounds, (joints,), without gradient."""
        return self.distribution.std_param.detach().clamp(*self.distribution.std_range)


class RMACritic(MLPModel):
    """V(s_t): sees the present frame, all that is privileged, and with `NetworkCfg.critic_history` o_H."""

    def __init__(
        self, obs: TensorDict, obs_groups: dict[str, list[str]], obs_set: str, output_dim: int, network: NetworkCfg
    ) -> None:
        """Build the networks for the sizes of the observation groups; arguments as rsl_rl has them."""
        self.seen = [name for name in obs_groups[obs_set] if name != "history" or network.critic_history]
        self.latent_dim = sum(obs[name].shape[-1] for name in self.seen)
        super().__init__(obs, obs_groups, obs_set, output_dim, network.critic, "elu")

    def _get_latent_dim(self) -> int:
        """Return the size of the value head's input."""
        return self.latent_dim

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> torch.Tensor:
        """Assemble the value head's input."""
        return torch.cat([obs[name] for name in self.seen], -1)


class StudentPolicy(nn.Module):
    """Deployed policy: the flattened history in, the mean action out. No privileged input."""

    def __init__(self, actor: RMAActor) -> None:
        """Take the parts of a trained student that run on the robot."""
        super().__init__()
        self.frame = actor.estimator.frame
        self.adaptation, self.estimator, self.mlp = actor.adaptation, actor.estimator, actor.mlp
        self.terrain = actor.terrain_history if actor.sees_terrain else None

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map observations (N, history) to actions (N, joints); the current frame is the history's last."""
        return self.act(observation, self.adaptation(observation))

    def with_velocity(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the actions, and the estimated forward and sideways velocity of the base [m/s], (N, 2)."""
        estimate = self.estimator(observation)
        return self.act(observation, self.adaptation(observation), estimate), estimate[:, :2]

    def act(
        self, observation: torch.Tensor, latent: torch.Tensor, estimate: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Return the mean actions (N, joints) on a latent, z, z* or another robot's, (N, latent)."""
        current = observation[:, -self.frame :]
        parts = [current, self.estimator(observation) if estimate is None else estimate]
        # Without one nothing of it is left in an exported network.
        parts += [latent] if latent.shape[-1] else []
        if self.terrain is not None:
            parts.append(self.terrain(observation))
        return self.mlp(torch.cat(parts, -1))
