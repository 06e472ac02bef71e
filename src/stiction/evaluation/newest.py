"""Newest checkpoint of a training run, finished or not, or a chosen one, as a policy of one robot. Needs torch.

The teacher of two phases observes the friction of its robot: here the nominal friction of its training.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import nn

from stiction.core.errors import ConfigurationError, StictionError, TrainingError, unknown_name
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import PolicyStep
from stiction.evaluation.export import TrainedPolicy, contract_of
from stiction.evaluation.reward_meter import RewardMeter
from stiction.files.contract import Contract, robot_of
from stiction.learning.models import RMAActor, StudentPolicy
from stiction.learning.run import RunDirectory, latest_checkpoint
from stiction.learning.runner import load_actor
from stiction.robots.model import Robot
from stiction.task.friction import FrictionCfg, friction_share
from stiction.task.randomization import nominal_privileged

LOOK_EVERY = 2.0
"""Time between two looks for a newer checkpoint [s]."""


NEWEST = "newest"
"""Choice of checkpoint that follows the training."""


class LatentPolicy(nn.Module):
    """The mean action of an actor: observations (N, size), flattened histories, to actions (N, joints)."""

    def __init__(
        self,
        actor: RMAActor,
        privileged: torch.Tensor | None = None,
        sources: torch.Tensor | None = None,
        frozen: torch.Tensor | None = None,
        watch: Callable[[torch.Tensor], None] = lambda latent: None,
    ) -> None:
        """Choose the source of the latent.

        privileged: o_priv of each robot, (N, size), for z, by default z* from the history; sources: for each robot, the
        robot whose latent it uses, (N,), by default itself; frozen: one latent for all, (latent,); watch: called with z
        or z* at every step.
        """
        super().__init__()
        self.policy, self.sources, self.frozen, self.watch = StudentPolicy(actor), sources, frozen, watch
        self.constant = None if privileged is None else actor.privileged_encoder(privileged).detach()

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the mean actions, (N, joints)."""
        return self.with_velocity(observation)[0]

    def with_velocity(self, observation: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the mean actions, (N, joints), and the velocity of the base, as of `StudentPolicy.with_velocity`."""
        latent = self.policy.adaptation(observation) if self.constant is None else self.constant
        if len(latent) != len(observation):
            raise ConfigurationError(
                f"o_priv of {len(latent)} robots for {len(observation)} observations; expected as many"
            )
        self.watch(latent)
        if self.frozen is not None:
            latent = self.frozen.expand_as(latent)
        elif self.sources is not None:
            latent = latent[self.sources]
        estimate = self.policy.estimator(observation)
        return self.policy.act(observation, latent, estimate), estimate[:, :2]


def privileged_of(
    run: RunDirectory, teacher: RMAActor, contract: Contract, robot: Robot, present: np.ndarray | None = None
) -> torch.Tensor:
    """Return o_priv of the robots that a teacher drives, (N, size): nominal except for their friction.

    present: that friction over the torque limit, (N, joints), by default of one robot and nominal. Raises
    `ConfigurationError` for a teacher that sees the ground.
    """
    if teacher.sees_terrain:
        raise ConfigurationError(
            f"{run.path}: its teacher sees the ground, which is not available here; use its student"
        )
    nominal = friction_share(contract.friction_law, contract.array("friction"), robot)
    present = nominal[None] if present is None else present
    friction = run.config().task.friction
    return nominal_privileged(observed_friction(friction, nominal, present), friction.privileged_unit)


def observed_friction(friction: FrictionCfg, nominal: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the friction in o_priv of a teacher, fractions of the torque limit, shape (N, joints).

    The friction is the true one, `present`, unless training never varied it: weights of an entry that never moved are
    those of initialisation, so it stays at its value in training, a multiple of `nominal`, (joints,).
    """
    ends = [end for stage in friction.schedule for end in stage.range]
    if min(ends) == max(ends):
        return np.tile(ends[0] * nominal, (len(present), 1))
    return present


class Standing:
    """Policy before the first checkpoint: it commands the standing pose."""

    def __init__(self, contract: Contract) -> None:
        """contract: of the policy to come."""
        self.contract = contract

    def reset(self) -> None:
        """Do nothing: the policy has no history."""

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Return the standing pose as target, and zero observation and action."""
        zero = np.zeros(self.contract.num_joints, np.float32)
        return PolicyStep(np.zeros(self.contract.observation.size, np.float32), zero, self.contract.array("standing"))


class OneTrained:
    """Policy as training computes it, for one robot without a batch, as a `Pilot` drives it."""

    def __init__(self, module: torch.nn.Module, contract: Contract) -> None:
        """module: observations (1, size) -> actions (1, J)."""
        self.contract, self._driver = contract, TrainedPolicy(module, contract)

    def reset(self) -> None:
        """Forget the history and the last action."""
        self._driver.reset()

    def step(self, sensors: Sensors, command: np.ndarray) -> PolicyStep:
        """Advance by one control period; see `Policy.step`."""
        step = self._driver.step(sensors.each(lambda value: value[None]), np.asarray(command, float)[None])
        velocity = None if step.velocity is None else step.velocity[0]
        return PolicyStep(step.observation[0], step.action[0], step.target[0], velocity)


class NewestPolicy:
    """Newest policy of a run that may still be training."""

    def __init__(self, run: Path, wait: bool = False, robot: str | None = None) -> None:
        """Read a run; wait: let the robot stand until there is a checkpoint; robot: see `RunDirectory.adopt`.

        Raises `StictionError` where `run` is no run, has no checkpoint and `wait` is False, or has a teacher that sees
        the ground.
        """
        torch.set_num_threads(1)
        self._directory = RunDirectory(run)
        if robot is not None:
            self._directory.adopt(robot)
        self.contract = contract_of(self._directory.config(), self._directory.header())
        self.robot = robot_of(self.contract)
        self._file: Path | None = None
        self._module: torch.nn.Module | None = None
        self.chosen, self._lock = NEWEST, threading.RLock()
        if not self.refresh() and not wait:
            raise TrainingError(f"{run} has no checkpoint yet; wait for it with --follow")

    @property
    def name(self) -> str:
        """Name of the run, and its progress."""
        run = self._directory.path.resolve().name
        return f"{run}: {'no checkpoint yet, standing' if self._file is None else self._file.stem.replace('_', ' ')}"

    def load(self) -> OneTrained | Standing:
        """Return the newest policy that was read, with an empty history."""
        return Standing(self.contract) if self._module is None else OneTrained(self._module, self.contract)

    @property
    def checkpoints(self) -> tuple[str, ...]:
        """Names of the choices: `newest`, then the complete checkpoints, students before teachers, newest first."""
        files = self._directory.checkpoints.glob("*_*.safetensors")
        names = [file.stem for file in files if file.with_suffix(".json").exists()]
        return (NEWEST, *sorted(names, key=lambda name: (name.startswith("student"), name), reverse=True))

    def choose(self, name: str) -> None:
        """Read a checkpoint by its name, or the newest. Raises `StictionError` if it is missing or not readable."""
        if name not in self.checkpoints:
            raise TrainingError(unknown_name("checkpoint", name, self.checkpoints))
        with self._lock:
            if name == NEWEST:
                self.chosen = name
                self.refresh()
                return
            file = self._directory.checkpoints / f"{name}.safetensors"
            self._module, self._file = self._read(name.partition("_")[0], file), file
            self.chosen = name

    def meter(self) -> RewardMeter:
        """Return a meter of the training's reward terms on one robot."""
        return RewardMeter(self._directory.config().task, self.robot)

    def refresh(self) -> bool:
        """Read the newest checkpoint; return whether it is newer than before.

        False while an older one is chosen. Raises `StictionError`.
        """
        with self._lock:
            return self.chosen == NEWEST and self._read_newest()

    def _read_newest(self) -> bool:
        """Read the newest checkpoint; return whether it is newer than before."""
        directory = self._directory
        for phase in ("student", "teacher"):
            file = latest_checkpoint(directory.checkpoints, phase)
            if file is not None:
                break
        else:
            return False
        if file == self._file:
            return False
        self._module, self._file = self._read(phase, file), file
        return True

    def watch(self, use: Callable[[], None]) -> Callable[[], None]:
        """Call `use` from a separate thread after each newer checkpoint was read; return the function that stops it."""
        ended = threading.Event()

        def look() -> None:
            while not ended.wait(LOOK_EVERY):
                try:
                    newer = self.refresh()
                except (StictionError, OSError):
                    # The training deletes old checkpoints: the next look finds the newer one.
                    continue
                if newer:
                    use()

        thread = threading.Thread(target=look, name="newest checkpoint", daemon=True)
        thread.start()

        def stop() -> None:
            ended.set()
            thread.join(LOOK_EVERY)

        return stop

    def _read(self, phase: str, file: Path) -> torch.nn.Module:
        """Return the network of a checkpoint, observations (1, size) -> actions (1, J)."""
        actor = load_actor(self._directory, phase, file)
        if actor.blind:
            return LatentPolicy(actor)
        return LatentPolicy(actor, privileged_of(self._directory, actor, self.contract, self.robot))
