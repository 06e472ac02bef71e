"""The networks of rapid motor adaptation, as rsl_rl models."""

from __future__ import annotations

from typing import Any

import torch
from rsl_rl.models import MLPModel
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import nn

GROUPS = ["proprioception", "history", "privileged", "explicit"]
"""The observation groups on any ground; each model picks what it may see."""

ELEVATION = "elevation"
"""The group that is there too on other than flat ground."""


class HistoryEncoder(nn.Module):
    """Reads o_H: every frame through one linear layer, then an MLP over all frames."""

    def __init__(self, history: int, frame: int, width: int, hidden: tuple[int, ...], output: int) -> None:
        """`history`: size of the flattened history; `frame`: size of one frame; `width`: what a frame is reduced to."""
        super().__init__()
        self.frame = frame
        self.embed = nn.Sequential(nn.Linear(frame, width), nn.ELU())
        self.mlp = MLP(history // frame * width, output, list(hidden), "elu")

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        """Map (N, history) to (N, output)."""
        frames = history.unflatten(-1, (-1, self.frame))
        return self.mlp(self.embed(frames).flatten(-2))


class RMAActor(MLPModel):
    """π(o_exp*, o_prio, z or z*): the actor with its adaptation networks and its estimator.

    `latent_source` says where the latent comes from: `privileged` (z = f_ada_tea(o_priv)) or `history`
    (z* = f_ada_stu(o_H)). The explicit state is always the estimate f_est(o_H), as on the robot. Both are detached
    where they come from the history, so that PPO never trains what the supervised losses train, unless `end_to_end`:
    the student's cloning loss does.

    On other than flat ground there is a second latent: the teacher encodes the elevation map e_t, the student takes the
    same features from the history, by f_hist, and climbs blind.
    """

    end_to_end = False

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        hidden_dims: tuple[int, ...],
        latent: int,
        privileged: tuple[int, ...],
        history_frame: int,
        history: tuple[int, ...],
        distribution_cfg: dict[str, Any],
        terrain: tuple[int, ...] = (),
        terrain_latent: int = 0,
        latent_source: str = "privileged",
    ) -> None:
        """Build from the sizes of the observation groups."""
        size = {name: obs[name].shape[-1] for name in obs_groups[obs_set]}
        self.sees_terrain = ELEVATION in size
        self.latent_dim = size["proprioception"] + size["explicit"] + latent + terrain_latent * self.sees_terrain
        super().__init__(obs, obs_groups, obs_set, output_dim, hidden_dims, "elu", False, distribution_cfg)
        encoder = (size["history"], size["proprioception"], history_frame, history)
        self.latent_source = latent_source
        self.privileged_encoder = MLP(size["privileged"], latent, list(privileged), "elu")
        self.adaptation = HistoryEncoder(*encoder, latent)
        self.estimator = HistoryEncoder(*encoder, size["explicit"])
        self.blind = False
        if self.sees_terrain:
            self.terrain_encoder = nn.Sequential(MLP(size[ELEVATION], terrain_latent, list(terrain), "elu"), nn.Tanh())
            self.terrain_history = nn.Sequential(HistoryEncoder(*encoder, terrain_latent), nn.Tanh())

    def _get_latent_dim(self) -> int:
        """Return the size of the actor's input."""
        return self.latent_dim

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> torch.Tensor:
        """Assemble the actor's input, (N, proprioception + explicit + latent + terrain latent)."""
        with torch.set_grad_enabled(self.end_to_end and torch.is_grad_enabled()):
            explicit = self.estimator(obs["history"])
            latent = self.adaptation(obs["history"]) if self.latent_source == "history" else None
        if latent is None:
            latent = self.privileged_encoder(obs["privileged"])
        parts = (obs["proprioception"], explicit, latent)
        return torch.cat((*parts, self.terrain_features(obs)) if self.sees_terrain else parts, -1)

    def terrain_features(self, obs: TensorDict) -> torch.Tensor:
        """Return e_t*, from the elevation map, or from the history where `blind`."""
        return self.terrain_history(obs["history"]) if self.blind else self.terrain_encoder(obs[ELEVATION])

    def supervised_parameters(self) -> list[nn.Parameter]:
        """Return the parameters that L_ada, L_est and L_hist train."""
        modules = [self.adaptation, self.estimator, *([self.terrain_history] if self.sees_terrain else [])]
        return [parameter for module in modules for parameter in module.parameters()]

    def supervised_losses(self, obs: TensorDict) -> dict[str, torch.Tensor]:
        """Return L_ada, L_est and, where there is terrain, L_hist."""
        losses = {"adaptation": self.adaptation_loss(obs), "estimator": self.estimator_loss(obs)}
        return losses | ({"terrain": self.terrain_loss(obs)} if self.sees_terrain else {})

    def policy_parameters(self) -> list[nn.Parameter]:
        """Return the parameters that PPO trains: all others."""
        supervised = {id(parameter) for parameter in self.supervised_parameters()}
        return [parameter for parameter in self.parameters() if id(parameter) not in supervised]

    def latents(self, obs: TensorDict) -> tuple[torch.Tensor, torch.Tensor]:
        """Return z, held fixed, and z*, each (N, latent)."""
        with torch.no_grad():
            target = self.privileged_encoder(obs["privileged"])
        return target, self.adaptation(obs["history"])

    def adaptation_loss(self, obs: TensorDict) -> torch.Tensor:
        """L_ada = MSE(z, z*), z held fixed."""
        target, guess = self.latents(obs)
        return nn.functional.mse_loss(guess, target)

    def terrain_loss(self, obs: TensorDict) -> torch.Tensor:
        """L_hist = MSE(e_t*, f_hist(o_H)), e_t* held fixed."""
        with torch.no_grad():
            target = self.terrain_encoder(obs[ELEVATION])
        return nn.functional.mse_loss(self.terrain_history(obs["history"]), target)

    def estimator_loss(self, obs: TensorDict) -> torch.Tensor:
        """L_est = MSE(o_exp*, o_exp)."""
        return nn.functional.mse_loss(self.estimator(obs["history"]), obs["explicit"])


class RMACritic(MLPModel):
    """V(s_t): sees everything, the history through an encoder of its own."""

    def __init__(
        self,
        obs: TensorDict,
        obs_groups: dict[str, list[str]],
        obs_set: str,
        output_dim: int,
        hidden_dims: tuple[int, ...],
        history_frame: int,
        history: tuple[int, ...],
    ) -> None:
        """Build from the sizes of the observation groups."""
        size = {name: obs[name].shape[-1] for name in obs_groups[obs_set]}
        self.seen = [name for name in size if name != "history"]
        encoded = history[-1] // 2
        self.latent_dim = sum(size.values()) - size["history"] + encoded
        super().__init__(obs, obs_groups, obs_set, output_dim, hidden_dims, "elu")
        self.history_encoder = HistoryEncoder(size["history"], size["proprioception"], history_frame, history, encoded)

    def _get_latent_dim(self) -> int:
        """Return the size of the value head's input."""
        return self.latent_dim

    def get_latent(self, obs: TensorDict, masks: Any = None, hidden_state: Any = None) -> torch.Tensor:
        """Assemble the value head's input."""
        seen = [obs[name] for name in self.seen]
        return torch.cat((*seen, self.history_encoder(obs["history"])), -1)


class StudentPolicy(nn.Module):
    """What is deployed: the flattened history in, the mean action out. No privileged input."""

    def __init__(self, actor: RMAActor) -> None:
        """Take the parts of a trained student that run on the robot."""
        super().__init__()
        self.frame = actor.adaptation.frame
        self.adaptation, self.estimator, self.mlp = actor.adaptation, actor.estimator, actor.mlp
        self.terrain = actor.terrain_history if actor.sees_terrain else None

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map observations (N, history) to actions (N, joints); the current frame is the history's last."""
        return self.act(observation, self.adaptation(observation))

    def act(self, observation: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """Return the mean actions (N, joints) on a latent, z, z* or another robot's, (N, latent)."""
        current = observation[:, -self.frame :]
        parts = [current, self.estimator(observation), latent]
        if self.terrain is not None:
            parts.append(self.terrain(observation))
        return self.mlp(torch.cat(parts, -1))
