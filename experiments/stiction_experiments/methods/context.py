"""DreamWaQ's context: what one encoder makes of the history, velocity and code, and the actor that walks on it.

Nahrendra, Yu and Myung, "DreamWaQ: Learning Robust Quadrupedal Locomotion With Implicit Terrain Imagination via Deep
Reinforcement Learning", ICRA 2023 (arXiv 2301.10602). The context-aided estimator maps o_H to the base's velocity v̂ and
to a code z ~ N(μ, diag σ²); a decoder predicts the next observation from both:

    L_CE = MSE(v̂, v) + MSE(ô_{t+1}, o_{t+1}) + β · mean_j max(free, KL_j),    KL_j = ½ (μ_j² + σ_j² - log σ_j² - 1)

The paper gives neither β nor whether its errors are sums or means. Here all of them are means, over entries and
samples, KL_j over the samples of the mini-batch before it is held against `free`. The decoder reads v̂ but does not
train it, so that it stays a velocity. Where a robot fell, there is no next observation: the sample then trains the
velocity alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import nn

from stiction.core.errors import TrainingError
from stiction.learning.config import NetworkCfg
from stiction.learning.models import VELOCITY, HistoryEncoder, RMAActor, StudentPolicy
from stiction.learning.symmetry import equivariant_encoder, equivariant_mlp, halves
from stiction.task.symmetry import Rows
from stiction_experiments.methods.dreamwaq import DreamWaQCfg


class Context(NamedTuple):
    """Outputs of the encoder for histories."""

    velocity: torch.Tensor
    """v̂, the base's velocity [m/s], (N, 3)."""
    mean: torch.Tensor
    """μ of the code, (N, code)."""
    log_variance: torch.Tensor
    """log σ² of the code, (N, code)."""

    def code(self, noise: torch.Tensor) -> torch.Tensor:
        """Return μ + σ ε, (N, code), for ε ~ N(0, 1) of the same shape."""
        return self.mean + (0.5 * self.log_variance).exp() * noise


def divergence(context: Context) -> torch.Tensor:
    """Return KL(N(μ, σ²) || N(0, 1)) of every sample and dimension [nat], (N, code)."""
    mean, log_variance = context.mean, context.log_variance
    return 0.5 * (mean.square() + log_variance.exp() - log_variance - 1.0)


def masked_mean(values: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Return the mean over the rows that count, (...,), of values, (N, ...); 0 where none does. `counts`: (N,) bool."""
    return torch.where(counts[:, None], values, 0.0).sum(0) / counts.sum().clamp(min=1)


def code_loss(divergences: torch.Tensor, counts: torch.Tensor, free_bits: float) -> torch.Tensor:
    """Return mean_j max(free, KL_j), a scalar, of KLs, (N, code); KL_j is the mean over the rows that count.

    Free bits (Kingma et al. 2016): a dimension that tells less than `free_bits` [nat] is pulled no closer to the prior.
    """
    return masked_mean(divergences, counts).clamp(min=free_bits).mean()


class ContextEstimator(nn.Module):
    """The encoder, one trunk with three heads, and the decoder, which is there for the loss alone."""

    def __init__(self, history: int, frame: int, cfg: DreamWaQCfg) -> None:
        """`history`: size of the flattened history; `frame`: of one frame."""
        super().__init__()
        self.code = cfg.code
        self.encoder = HistoryEncoder(history, frame, cfg.frame, cfg.encoder, VELOCITY + 2 * cfg.code)
        self.decoder = MLP(VELOCITY + cfg.code, frame, list(cfg.decoder), "elu")

    def forward(self, history: torch.Tensor) -> Context:
        """Encode histories, (N, history)."""
        return Context(*self.encoder(history).split((VELOCITY, self.code, self.code), -1))

    def predict(self, velocity: torch.Tensor, code: torch.Tensor) -> torch.Tensor:
        """Return ô_{t+1}, the next frame, (N, frame)."""
        return self.decoder(torch.cat((velocity, code), -1))


class Head(nn.Module):
    """One of the encoder's outputs as a network of its own: velocity, or the code's mean."""

    def __init__(self, context: ContextEstimator, name: str) -> None:
        """`name`: of a field of `Context`."""
        super().__init__()
        self.context, self.name, self.frame = context, name, context.encoder.frame

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        """Map (N, history) to (N, size)."""
        output: torch.Tensor = getattr(self.context(history), self.name)
        return output


class ContextActor(RMAActor):
    """π(o_prio, v, z): RMA's actor with DreamWaQ's context in place of estimate and latent.

    Where the observations hold them, v (`estimate`) and z (`guess`) are what the robot walked on: v̂ or, in training,
    the true velocity; z one draw. Else they are v̂ and the code's mean, as deployed. PPO's gradient never reaches the
    estimator. The actor sees no ground, on any terrain; the critic does.
    """

    blind = True
    latent_source = "history"

    def __init__(self, *args: Any, context: DreamWaQCfg, **kwargs: Any) -> None:
        """Build the networks; `context`: sizes of the estimator, β and free bits; the rest as of `RMAActor`."""
        self.cfg = context
        super().__init__(*args, **kwargs)

    def _plan(self, size: dict[str, int], network: NetworkCfg) -> None:
        """Find the size of the actor's input: frame, velocity, code."""
        self.sees_terrain = False
        self.latent_dim = size["proprioception"] + VELOCITY + self.cfg.code

    def _build(self, size: dict[str, int], network: NetworkCfg) -> None:
        self.context = ContextEstimator(size["history"], size["proprioception"], self.cfg)

    @property
    def estimator(self) -> Head:  # type: ignore[override]
        """Histories -> v̂."""
        return Head(self.context, "velocity")

    @property
    def adaptation(self) -> Head:  # type: ignore[override]
        """Histories -> the code's mean."""
        return Head(self.context, "mean")

    def _latent(self, obs: TensorDict) -> torch.Tensor:
        """Return z of every robot, (N, code)."""
        return self._from_history(self.adaptation, obs, "guess", False)

    def remembered(self, obs: TensorDict) -> dict[str, torch.Tensor]:
        """Return what the robots walk on: `estimate` (v), and `guess` (z), by the draws in `obs`.

        `noise`, (N, code): of the code; `bootstrapped`, (N, 1): 1 where v is v̂, 0 where it is the true velocity.
        """
        with torch.no_grad():
            context = self.context(obs["history"])
            truth = obs["explicit"][:, :VELOCITY]
            velocity = torch.where(obs["bootstrapped"] > 0, context.velocity, truth)
            return {"estimate": velocity, "guess": context.code(obs["noise"])}

    def supervised_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of encoder and decoder."""
        return list(self.context.parameters())

    def supervised_losses(
        self, obs: TensorDict, velocity_weight: float = 1.0, both_ways: bool = False
    ) -> dict[str, torch.Tensor]:
        """Return the parts of L_CE: `estimator`, `reconstruction`, and `code` (β included). The code is drawn anew.

        `obs`: with `next` (o_{t+1}, (N, frame)) and `lasts` ((N, 1), 1 where there is one). The other arguments are
        RMA's and mean nothing here. Raises `TrainingError` where a part is no number.
        """
        context, counts = self.context(obs["history"]), obs["lasts"][:, 0] > 0
        guess = self.context.predict(context.velocity.detach(), context.code(torch.randn_like(context.mean)))
        code = code_loss(divergence(context), counts, self.cfg.free_bits)
        losses = {
            "estimator": nn.functional.mse_loss(context.velocity, obs["explicit"][:, :VELOCITY]),
            "reconstruction": masked_mean((guess - obs["next"]).square(), counts).mean(),
            "code": self.cfg.beta * code,
        }
        for name, loss in losses.items():
            if not loss.isfinite():
                raise TrainingError(
                    f"the context-aided estimator's loss {name!r} is {loss.item()}; train again in another folder with "
                    "a smaller --set teacher.adaptation_learning_rate"
                )
        return losses

    def latents(self, obs: TensorDict, both_ways: bool = False) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the code's mean twice, (N, code): there is no teacher whose latent it could be held against."""
        mean = self.adaptation(obs["history"])
        return mean, mean

    def make_inputs_equivariant(self, rows: dict[str, Rows]) -> Rows:
        """Make the estimator left-right symmetric; return the mirror of the actor's input."""
        explicit = rows["explicit"]
        velocity = Rows(explicit.index[:VELOCITY], explicit.factor[:VELOCITY])
        code = halves(self.context.code)
        equivariant_encoder(self.context.encoder, rows, Rows.joined([velocity, code, code]))
        equivariant_mlp(self.context.decoder, Rows.joined([velocity, code]), rows["proprioception"])
        return Rows.joined([rows["proprioception"], velocity, code])

    def student(self) -> StudentPolicy:
        """Return what is deployed."""
        return ContextPolicy(self)


class ContextPolicy(StudentPolicy):
    """Deployed policy of DreamWaQ: the flattened history in, the mean action on v̂ and the code's mean out."""

    def __init__(self, actor: ContextActor) -> None:
        """Take the parts that run on the robot."""
        super().__init__(actor)
        self.context = actor.context

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map observations (N, history) to actions (N, joints), with one pass of the encoder."""
        return self.with_velocity(observation)[0]

    def with_velocity(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the actions, and v̂ forward and sideways, (N, 2)."""
        context = self.context(observation)
        action = self.mlp(torch.cat((observation[:, -self.frame :], context.velocity, context.mean), -1))
        return action, context.velocity[:, :2]
