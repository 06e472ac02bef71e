"""A disturber against one frozen policy: it learns in the training's task, then robots walk, disturbed or not.

It maximises the cost of `methods.hinf_ppo` alone (η = 0): no push has a price. All draws depend on the seed, and the
robots that are judged are the same for everyone who disturbs them. Joint friction is by the solver's rows, as in
every evaluation, whatever the policy was trained on; the ground is the simulator's own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
import torch

from stiction.core.errors import ConfigurationError
from stiction.core.provenance import stream_seed
from stiction.core.records import column
from stiction.deploy.policy import Network
from stiction.evaluation.course import SETTLE
from stiction.evaluation.policies import method_of
from stiction.files.bundle import Bundle
from stiction.files.contract import Contract, robot_of
from stiction.files.velocity import parse_command
from stiction.joints.compensation import BY_SPEED
from stiction.learning.phase import one_torch_thread
from stiction.robots.physics import EXACT
from stiction.task.config import CommandCfg, RandomizationCfg, TaskCfg
from stiction.task.env import LocomotionEnv
from stiction.task.friction import FrictionCfg
from stiction.task.rewards import RewardCfg, best_task_reward
from stiction_experiments.methods.disturbance import Disturbance
from stiction_experiments.methods.disturber import Disturber, LearningDisturber, make_disturber, with_falls
from stiction_experiments.methods.hinf import DisturberName, HinfCfg
from stiction_experiments.methods.hinf_ppo import cost

Progress = Callable[[float], None]
Who = Literal["nobody", "random", "learned"]
Stream = Literal["learning", "judging"]

GAMMA, LAMBDA, EPOCHS, BATCHES = 0.99, 0.95, 4, 4
"""Discount and λ of the disturber's advantages, passes over a rollout and steps of each, as of a training."""

RANDOM: dict[str, DisturberName] = {"force": "random", "friction": "random-friction"}
"""Disturber that learns -> the one that draws, within the same limit."""


@dataclass(frozen=True)
class DuelCfg:
    """Settings of a duel; fields as of `DisturberOptions`."""

    disturber: Literal["force", "friction"] = "force"
    limit: float | None = None
    friction_level: float = 0.0
    command: str = "vx=0.5"
    iterations: int = 100
    steps: int = 24
    num_envs: int = 256
    seconds: float = 20.0

    def __post_init__(self) -> None:
        """Refuse what is no duel."""
        if self.disturber not in RANDOM:
            raise ConfigurationError(f"disturber {self.disturber!r} does not learn; expected force or friction")
        if not self.friction_level >= 0:
            raise ConfigurationError(
                f"friction_level is {self.friction_level:g}; expected a fraction of the torque limit, 0 for none"
            )
        if self.disturber == "friction" and not self.friction_level > 0:
            raise ConfigurationError(
                "the disturber 'friction' is bounded by the joints' friction, and there is none; say --friction-level"
            )
        if not parse_command(self.command).is_linear:
            raise ConfigurationError(f"command {self.command!r}: expected a velocity forward or sideways, as vx=0.5")
        whole = min(self.iterations, self.steps, self.num_envs)
        if whole < 1 or self.num_envs * self.steps < BATCHES or not SETTLE < self.seconds <= 3600.0:
            raise ConfigurationError(
                f"{self.iterations} iterations of {self.steps} steps, {self.num_envs} robots, {self.seconds} s: "
                f"expected at least one of each, {BATCHES} samples a rollout, and from {SETTLE:g} to 3600 s"
            )
        if not self.adversary.learns:
            raise ConfigurationError(f"with a limit of {self.limit:g} nobody disturbs; use more, or leave --limit out")

    @property
    def adversary(self) -> HinfCfg:
        """The disturber that learns."""
        return HinfCfg(disturber=self.disturber, limit=self.limit, eta=0.0)


@dataclass(frozen=True)
class DuelRow:
    """How robots walked; a row of duels.csv."""

    policy: str = field(metadata=column("policy"))
    method: str = field(metadata=column("method"))
    seed: int = field(metadata=column("seed"))
    """Seed of the disturber and of the robots."""
    disturbed_by: Who = field(metadata=column("disturbed by"))
    """Nobody, draws, or the disturber that learned."""
    fall_rate: float = field(metadata=column("falls", "1/s", ".4f"))
    """Falls of a robot [1/s]."""
    speed_ratio: float = field(metadata=column("speed ratio", form=".3f"))
    """Speed along the command over the commanded one [-]."""
    tracking_error: float = field(metadata=column("tracking error", "m/s", ".3f"))
    """Mean length of the horizontal velocity's error [m/s]."""
    cost: float = field(metadata=column("cost", form=".3f"))
    """Mean share of the task's reward that is lost [-], as the disturber maximises it: a fall costs all of it for the
    99 control steps that would have followed, though the robot stands up anew."""


def task_for(contract: Contract, cfg: DuelCfg, robot: str | None = None) -> TaskCfg:
    """Return the task in which a policy is disturbed: the training's, without pushes, at one command and one friction.

    Masses, motors, delays and the joints' viscous friction and inertia are drawn about the nominal ones as in training.
    The network gets the command as it is, as in training: the control step's correction of it is left out.

    `robot`: as of `robot_of`. Raises `StictionError` where the policy observes what this task does not give, or feeds
    friction forward by another rule than that of today's training.
    """
    spec, velocity = robot_of(contract, robot), parse_command(cfg.command).velocity
    forward, sideways, turn = ((speed, speed) for speed in velocity)
    friction = FrictionCfg("none")
    if cfg.friction_level > 0:
        friction = FrictionCfg("direct", level=cfg.friction_level, range=(1.0, 1.0))
    task = TaskCfg(
        robot=robot or contract.robot,
        timestep=contract.physics_timestep,
        decimation=contract.decimation,
        friction=friction,
        physics=EXACT,
        randomization=RandomizationCfg(push_interval=0.0),
        commands=CommandCfg(forward, sideways, turn, standing_share=0.0),
        rewards=RewardCfg().for_robot(spec),
        action_clip=contract.action_clip,
        history=contract.observation.history_length,
        first_side=contract.observation.has("first_side"),
    )
    if task.layout(spec) != contract.observation:
        raise ConfigurationError(
            f"the policy for {contract.robot!r} by {contract.method!r} observes other than the task's usual terms; "
            "expected one of this trainer without --task.known-friction and slow means"
        )
    if contract.compensation is not None and contract.push != BY_SPEED.push:
        raise ConfigurationError(
            f"the policy for {contract.robot!r} by {contract.method!r} feeds friction forward by another rule than "
            "today's training does, as by the position error alone; train it again"
        )
    return task


class SteadyEnv(LocomotionEnv):
    """The task, in which a robot that begins anew changes nothing that is drawn for the others: noise above all."""

    _anew: torch.Generator | None = None
    """Generator for robots that begin anew, once all have begun."""

    def _reset(self, which: torch.Tensor) -> None:
        with self._own_draws():
            super()._reset(which)

    def _push_and_command(self, fresh: torch.Tensor) -> None:
        """Draw commands where their time has come, which is another after a fall."""
        with self._own_draws():
            super()._push_and_command(fresh)

    @contextmanager
    def _own_draws(self) -> Iterator[None]:
        if self._anew is None:
            self._anew = torch.Generator(self.task_device).manual_seed(self.generator.initial_seed() ^ 1)
        everyone, self.generator = self.generator, self._anew
        try:
            yield
        finally:
            self.generator = everyone


class Duel:
    """One frozen policy and its disturber, in one simulation."""

    def __init__(
        self, bundle: Bundle, cfg: DuelCfg, seed: int, stream: Stream, threads: int, robot: str | None
    ) -> None:
        """`stream`: what the robots are drawn for; others as of `fight`. Raises `StictionError` as `task_for`.

        Joints have inertia and viscous friction of the contract, as in an evaluation: training may have had those that
        a bench identified. Robots that are judged have one episode; those that are learned from are of all ages, as in
        a training, or all would be reset in the same step.
        """
        contract, task = bundle.contract, task_for(bundle.contract, cfg, robot)
        joints = {name: contract.array(name) for name in ("armature", "damping")}
        judged = stream == "judging"
        if judged:
            task = replace(task, episode=cfg.seconds)
        self.cfg, self.adversary = cfg, cfg.adversary
        make, seed = SteadyEnv if judged else LocomotionEnv, stream_seed(seed, stream)
        self.env = make(task, cfg.num_envs, seed, threads, joints, spec=robot_of(contract, robot))
        if contract.compensation is not None:
            # As much as the policy was trained with, however much friction there is here: so it walks on a robot.
            self.env.compensation = torch.tensor(contract.compensation)
        if not judged:
            ages = (0, self.env.max_episode_length, (cfg.num_envs,))
            self.env.episode_length_buf = torch.randint(*ages, generator=self.env.generator)
        self.network = Network(
            bundle.policy, contract.observation.size, contract.num_joints, contract.estimates_velocity
        )
        self.disturbance = Disturbance(self.env.fleet, self.adversary.by_torque, self.adversary.share)
        self.best = best_task_reward(self.env.terms) * self.env.cfg.control_period

    def disturber(self, kind: HinfCfg, seed: int) -> Disturber:
        """Return a new disturber of a kind."""
        obs, width = self.env.get_observations(), self.disturbance.width
        disturber = make_disturber(kind, obs, width, self.env.cfg.control_period, seed, "cpu")
        assert disturber is not None
        return disturber

    def step(self, values: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Take one control step; return cost, ends of episodes and time-outs, each (N,)."""
        if values is not None:
            self.disturbance.apply(values)
        history = self.env.get_observations()["history"].numpy()
        _, _, dones, extras = self.env.step(torch.from_numpy(self.network(history)))
        return cost(extras["task"], self.best), dones, extras["time_outs"]

    def learn(self, learner: LearningDisturber, progress: Progress) -> None:
        """Let the disturber learn. `progress`: called with the share of it that is done."""
        for iteration in range(self.cfg.iterations):
            for _ in range(self.cfg.steps):
                costs, dones, time_outs = self.step(learner.act(self.env.get_observations()))
                learner.record(costs, dones, time_outs)
            learner.finish(self.env.get_observations(), 0.0, GAMMA, LAMBDA)
            learner.update(EPOCHS, BATCHES)
            progress((iteration + 1) / self.cfg.iterations)

    @property
    def judged(self) -> int:
        """Control steps for which robots are judged."""
        return round(self.cfg.seconds / self.env.cfg.control_period)

    def judge(self, act: Callable[[Any], torch.Tensor] | None) -> dict[str, float]:
        """Return how the robots walk while `act` disturbs them, given observations; None: nobody does."""
        env, period = self.env, self.env.cfg.control_period
        target = torch.tensor(parse_command(self.cfg.command).velocity[:2])
        settle = round(SETTLE / period)
        sums = np.zeros(4)
        for step in range(self.judged):
            costs, dones, time_outs = self.step(None if act is None else act(env.get_observations()))
            if step < settle:
                continue
            velocity = env.linear_velocity[:, :2]
            # Episodes also end by time-outs, which are no falls.
            fell = (dones.float() - time_outs).sum()
            ratio = (velocity @ target).sum() / target.square().sum()
            sums += [float(x) for x in (fell, ratio, (velocity - target).norm(dim=-1).sum(), costs.sum())]
        samples = (self.judged - settle) * self.cfg.num_envs
        falls, ratios, errors, lost = sums.tolist()
        return {
            "fall_rate": falls / samples / period,
            "speed_ratio": ratios / samples,
            "tracking_error": errors / samples,
            "cost": with_falls(lost, samples, falls, GAMMA),
        }


def fight(
    bundle: Bundle,
    cfg: DuelCfg,
    seed: int,
    threads: int = 1,
    progress: Progress = lambda share: None,
    robot: str | None = None,
) -> list[dict[str, Any]]:
    """Train a disturber against a policy; return the outcomes with nobody, draws and the disturber, as plain data.

    `seed`: of everything random; `progress`: called with the share of all control steps that are done, until all are.
    Raises `StictionError` where the policy does not fit the task.
    """
    with one_torch_thread():
        arena = Duel(bundle, cfg, seed, "learning", threads, robot)
        learner = arena.disturber(arena.adversary, stream_seed(seed, "disturber"))
        assert isinstance(learner, LearningDisturber)
        steps = cfg.iterations * cfg.steps
        learning = steps / (steps + len(get_args(Who)) * arena.judged)
        arena.learn(learner, lambda share: progress(learning * share))
        draws = arena.disturber(HinfCfg(disturber=RANDOM[cfg.disturber], limit=cfg.limit), stream_seed(seed, "draws"))
        sides: dict[Who, Callable[[Any], torch.Tensor] | None]
        sides = {"nobody": None, "random": draws.act, "learned": learner.mean}
        rows = []
        for number, (who, act) in enumerate(sides.items()):
            progress(learning + (1 - learning) * number / len(sides))
            # A new arena each time: the same robots, commands and noise for everyone who disturbs them.
            figures = Duel(bundle, cfg, seed, "judging", threads, robot).judge(act)
            rows.append(asdict(DuelRow(bundle.name, method_of(bundle.contract), seed, who, **figures)))
    return rows
