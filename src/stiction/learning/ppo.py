"""rsl_rl's PPO with rapid motor adaptation: where the latent comes from, its losses, and the action noise."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from types import MappingProxyType
from typing import Any

import torch
from rsl_rl.algorithms import PPO, Distillation
from rsl_rl.env import VecEnv
from tensordict import TensorDict
from torch import nn

from stiction.learning.config import STD_RANGE, StudentCfg, TeacherCfg
from stiction.learning.models import RMAActor
from stiction.learning.quick import take_rows
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.symmetry import MirroredBatches

REMEMBERED = ("estimate", "guess", "walks_blind")
"""Groups that are stored beside those of the task, see `RMAActor.remembered`."""


def evenly_spread(num: int, share: float) -> torch.Tensor:
    """Return a mask of a share of `num` robots, spread evenly over them, (num,) bool."""
    counted = torch.floor(torch.arange(num + 1, dtype=torch.float64) * share)
    return counted[1:] > counted[:-1]


class AdaptationPPO(PPO):
    """PPO of an actor that walks on z, on z*, on both in turn, or on z* with a share of the robots.

    What comes from networks that PPO does not train is computed once, as the robot walks: the first ratio is 1.
    """

    actor: RMAActor
    symmetry: MirroredBatches | None

    ranks: Ranks = ALONE

    targets: Mapping[str, str | None] = MappingProxyType({})
    """Stored groups that the supervised losses need beside the task's -> the group by whose rule each is mirrored, or
    None where it is the same for the image."""

    def __init__(
        self, *args: Any, settings: TeacherCfg, noise: tuple[float, float, int] | None = None, **kwargs: Any
    ) -> None:
        """Add the supervised losses to `PPO`, whose arguments are `args` and `kwargs`.

        `noise`: bound of the actions' standard deviation at the start and at the end, and the iterations in between.
        """
        super().__init__(*args, **kwargs)
        self.settings, self.noise = settings, noise
        stored = self.storage.observations[0]
        # What an iteration does not remember (z* while robots walk on z) is stored as zeros: the storage's groups are
        # fixed.
        self.fixed = {name: stored[name].clone() for name in REMEMBERED if name in stored.keys()}  # noqa: SIM118
        if settings.latent == "groups":
            blind = evenly_spread(self.storage.num_envs, settings.student_share)
            self.fixed["walks_blind"] = blind.float()[:, None].to(self.device)
        self.iteration = 0
        self.quiet_from = settings.quiet_from
        self.quiet_for = settings.iterations - settings.quiet_from
        self.kl = 0.0
        self.figures: dict[str, float] = {}
        self.actor.adapts = settings.latent == "history"
        policy = chain(self.actor.policy_parameters(), self.critic.parameters())
        # In place of rsl_rl's, which trains the whole actor: estimator and adaptation have an optimizer of their own.
        self.optimizer = torch.optim.Adam(policy, lr=self.learning_rate)
        supervised = self._supervised_parameters()
        self.adaptation_optimizer = torch.optim.Adam(supervised, lr=settings.adaptation_learning_rate)
        self._prepare_rollout()

    @staticmethod
    def construct_algorithm(obs: TensorDict, env: VecEnv, cfg: dict, device: str) -> PPO:
        """Construct the algorithm, with room in its storage for what the actor remembers of a rollout."""
        latent, source = cfg["actor"]["network"].latent, cfg["algorithm"]["settings"].latent
        columns = {"estimate": obs["explicit"].shape[-1]}
        if source != "history":
            columns |= {"guess": latent}
        if source == "groups":
            columns |= {"walks_blind": 1}
        empty = {name: torch.zeros(env.num_envs, width, device=device) for name, width in columns.items()}
        return PPO.construct_algorithm(obs.clone(recurse=False).update(empty), env, cfg, device)

    def warm_start(self, actor: dict[str, torch.Tensor], critic: dict[str, torch.Tensor]) -> None:
        """Begin with the networks of an earlier phase."""
        self.actor.load_state_dict(actor)
        self.critic.load_state_dict(critic)
        self._bound_noise()

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Sample actions; store, with the observations, what PPO holds fixed."""
        actions = super().act(obs.clone(recurse=False).update(self.fixed | self.actor.remembered(obs)))
        if self.is_quiet:
            # The mean; it comes first.
            actions = self.transition.actions = self.transition.distribution_params[0]
        return actions

    def compute_returns(self, obs: TensorDict) -> None:
        """Compute returns and advantages, the latter in units of their spread over the robots of all processes."""
        super().compute_returns(obs)
        if not self.ranks.alone:
            # rsl_rl has standardised them over the robots of this process alone.
            self.storage.advantages = self.ranks.standardized(self.storage.returns - self.storage.values)

    def update(self) -> dict[str, float]:
        """Update the policy, then adaptation and estimator; prepare the next rollout."""
        if self.is_quiet:
            losses, self.kl = {}, 0.0
            # As `PPO.update` leaves it.
            self.storage.clear()
        else:
            losses = super().update()
            self.kl = self._divergence()
        losses |= self._supervise()
        self.iteration += 1
        self._prepare_rollout()
        return losses

    @property
    def settled_from(self) -> int:
        """First iteration with the least noise of the phase."""
        return 0 if self.noise is None else self.noise[2]

    @property
    def is_quiet(self) -> bool:
        """True if the present iteration is a quiet one."""
        return self.quiet_for > 0 and self.iteration >= self.quiet_from

    def end_early(self) -> None:
        """Go over to the quiet iterations, unless they have begun."""
        self.quiet_from = min(self.quiet_from, self.iteration)
        self._prepare_rollout()

    def _prepare_rollout(self) -> None:
        """Set where the next rollout's latent comes from, how much noise it may have, and the supervised step."""
        source: str = self.settings.latent
        every = self.settings.alternate
        if source == "alternate":
            source = "history" if every > 0 and self.iteration % every == every - 1 else "privileged"
        self.actor.latent_source = source
        self._bound_noise()
        if self.is_quiet:
            left = 1.0 - (self.iteration - self.quiet_from) / self.quiet_for
            for group in self.adaptation_optimizer.param_groups:
                group["lr"] = left * self.settings.adaptation_learning_rate

    def _bound_noise(self) -> None:
        """Set the bound of the actions' standard deviation, and bring within it what is outside."""
        distribution = self.actor.distribution
        if self.noise is not None:
            start, end, iterations = self.noise
            done = min(1.0, self.iteration / max(1, iterations - 1))
            distribution.std_range = [STD_RANGE[0], start + (end - start) * done]
        # rsl_rl clamps what it samples with and leaves the parameter outside, where no gradient reaches it: noise that
        # the falling bound has once overtaken would be the bound's for good, and not what PPO makes of it.
        with torch.no_grad():
            distribution.std_param.clamp_(*distribution.std_range)

    def _divergence(self) -> float:
        """Return KL(policy that walked || policy now), mean over the last step of the rollout still in the storage."""
        with torch.no_grad():
            mean = self.actor(self.storage.observations[-1])
            before = tuple(parameter[-1] for parameter in self.storage.distribution_params)
            after = (mean, self.actor.std.expand_as(mean))
            return float(self.actor.distribution.kl_divergence(before, after).mean())

    def _supervised_parameters(self) -> list[nn.Parameter]:
        """Return the parameters of the supervised pass."""
        privileged = self.actor.privileged_encoder.parameters() if self.settings.both_ways else ()
        return [*self.actor.supervised_parameters(), *privileged]

    def _supervise(self) -> dict[str, float]:
        """Descend the supervised losses over the rollout still in the storage; return their means."""
        observations = self.storage.observations.flatten(0, 1)
        total: dict[str, float] = {}
        passes, batches = self.settings.adaptation_passes, self.settings.adaptation_batches
        passes *= 2 if self.is_quiet else 1
        steps = passes * batches
        for _ in range(passes):
            for ids in torch.randperm(observations.batch_size[0], device=self.device).chunk(batches):
                batch = take_rows(observations, ids)
                if self.symmetry is not None:
                    batch, _ = self.symmetry.supervised(batch)
                losses = self.actor.supervised_losses(batch, self.settings.velocity_weight, self.settings.both_ways)
                self.adaptation_optimizer.zero_grad()
                torch.stack(list(losses.values())).sum().backward()
                self.ranks.average(self._supervised_parameters())
                if self.max_grad_norm is not None:
                    nn.utils.clip_grad_norm_(self._supervised_parameters(), self.max_grad_norm)
                self.adaptation_optimizer.step()
                for name, value in losses.items():
                    total[name] = total.get(name, 0.0) + value.item() / steps
        # PPO clips the gradient norm of the whole actor and clears only what it trains: leave nothing behind for it.
        self.adaptation_optimizer.zero_grad()
        return total

    def save(self) -> dict:
        """Return every network, optimizer and counter, for a checkpoint."""
        return super().save() | {
            "adaptation_optimizer_state_dict": self.adaptation_optimizer.state_dict(),
            "algorithm_iteration": self.iteration,
            "quiet_from": self.quiet_from,
        }

    def load(self, loaded_dict: dict, load_cfg: dict | None = None, strict: bool = True) -> bool:
        """Restore the state of `save`, the latent source and the noise included."""
        result = super().load(loaded_dict, load_cfg, strict)
        self.adaptation_optimizer.load_state_dict(loaded_dict["adaptation_optimizer_state_dict"])
        self.iteration = loaded_dict["algorithm_iteration"]
        # Runs of before there were quiet iterations have none.
        self.quiet_from = loaded_dict.get("quiet_from", self.quiet_from)
        self._prepare_rollout()
        return result


class StudentDistillation(Distillation):
    """Distillation with the paper's further losses, on terrain with L_hist; the cloning loss reaches the encoders too.

    The student begins as a copy of the teacher that takes its latents from the history.
    """

    student: RMAActor
    teacher: RMAActor
    symmetry: MirroredBatches | None = None
    ranks: Ranks = ALONE

    def __init__(self, *args: Any, settings: StudentCfg, velocity_weight: float = 1.0, **kwargs: Any) -> None:
        """Add the supervised losses to `Distillation`, whose arguments are `args` and `kwargs`."""
        super().__init__(*args, **kwargs)
        self.settings, self.velocity_weight = settings, velocity_weight
        self.noise_share = self._draw_noise(self.storage.num_envs)
        self.student.latent_source, self.teacher.latent_source = "history", "privileged"
        self.student.end_to_end = self.student.blind = True

    def _draw_noise(self, num: int) -> torch.Tensor:
        """Return the share of the exploration noise with which each robot walks, (num, 1)."""
        shares = {"all": torch.ones(num), "none": torch.zeros(num), "half": torch.arange(num) % 2.0}
        share = torch.rand(num) if self.settings.noise == "drawn" else shares[self.settings.noise]
        return share[:, None].to(self.device)

    def act(self, obs: TensorDict) -> torch.Tensor:
        """Let the student walk with each robot's share of the noise; store the teacher's actions."""
        noisy = super().act(obs)
        # Scaled after the draw: the stream of random numbers is the same for any share.
        mean = self.student.output_mean.detach()
        self.transition.actions = mean + self.noise_share * (noisy - mean)
        return self.transition.actions

    def warm_start(self, actor: dict[str, torch.Tensor], critic: dict[str, torch.Tensor]) -> None:
        """Load the trained teacher's actor into teacher and student; there is no critic here."""
        self.teacher.load_state_dict(actor)
        self.student.load_state_dict(actor)
        self.teacher_loaded = True

    def update(self) -> dict[str, float]:
        """Descend L_clone and the weighted supervised losses over the rollout; return their means."""
        observations, settings = self.storage.observations.flatten(0, 1), self.settings
        labels = self.storage.privileged_actions.flatten(0, 1)
        total: dict[str, float] = {}
        updates = settings.epochs * settings.mini_batches
        for _ in range(settings.epochs):
            for ids in torch.randperm(len(labels), device=self.device).chunk(settings.mini_batches):
                batch, wanted = take_rows(observations, ids), labels[ids]
                if self.symmetry is not None:
                    batch, wanted = self.symmetry.supervised(batch, wanted)
                losses = {"clone": self.loss_fn(self.student(batch), wanted)}
                losses |= self.student.supervised_losses(batch, self.velocity_weight, settings.both_ways)
                loss = losses["clone"] + settings.adaptation_weight * losses["adaptation"]
                loss = loss + settings.estimator_weight * losses["estimator"]
                if "terrain" in losses:
                    loss = loss + settings.adaptation_weight * losses["terrain"]
                self.optimizer.zero_grad()
                loss.backward()
                self.ranks.average(self.student.parameters())
                if self.max_grad_norm is not None:
                    nn.utils.clip_grad_norm_(self.student.parameters(), self.max_grad_norm)
                self.optimizer.step()
                for name, value in losses.items():
                    total[name] = total.get(name, 0.0) + value.item() / updates
        self.num_updates += 1
        self.storage.clear()
        return total
