"""Runs the training: a teacher by PPO, then its student by distillation, resumable at every checkpoint."""

from __future__ import annotations

import contextlib
import copy
import io
import math
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rsl_rl.runners import OnPolicyRunner
from torch.utils.tensorboard import SummaryWriter

from stiction.formats.errors import StictionError
from stiction.formats.reproducibility import num_threads, stream_seed
from stiction.locomotion.env import LocomotionEnv
from stiction.rma.checkpoint import keep_newest, latest_checkpoint, load_checkpoint, save_checkpoint
from stiction.rma.config import TrainCfg
from stiction.rma.models import ELEVATION, GROUPS, RMAActor, StudentPolicy
from stiction.rma.run import RunDirectory

Progress = Callable[[str, int, int, dict[str, float]], None]
"""Called after every iteration with phase, iteration, iterations, figures."""


def groups(cfg: TrainCfg) -> list[str]:
    """Return the observation groups of a run."""
    return [*GROUPS, ELEVATION] if cfg.task.terrain.kind != "flat" else GROUPS


def _models(cfg: TrainCfg, *names: str) -> dict[str, Any]:
    """Return rsl_rl's configuration of the named actors."""
    net = cfg.network
    actor: dict[str, Any] = {
        "class_name": "stiction.rma.models:RMAActor",
        "hidden_dims": net.actor,
        "latent": net.latent,
        "terrain": net.terrain,
        "terrain_latent": net.terrain_latent,
        "privileged": net.privileged,
        "history_frame": net.history_frame,
        "history": net.history,
        "distribution_cfg": {
            "class_name": "GaussianDistribution",
            "init_std": net.initial_std,
            "std_range": (0.05, 2.0),
        },
    }
    return {name: copy.deepcopy(actor) for name in names}  # rsl_rl takes its configuration apart while it reads it


def teacher_cfg(cfg: TrainCfg) -> dict[str, Any]:
    """Return rsl_rl's configuration of the teacher."""
    teacher, net = cfg.teacher, cfg.network
    return {
        "num_steps_per_env": teacher.steps,
        "obs_groups": {"actor": groups(cfg), "critic": groups(cfg)},
        **_models(cfg, "actor"),
        "critic": {
            "class_name": "stiction.rma.models:RMACritic",
            "hidden_dims": net.critic,
            "history_frame": net.history_frame,
            "history": net.history,
        },
        "algorithm": {
            "class_name": "stiction.rma.teacher:TeacherPPO",
            "num_learning_epochs": teacher.epochs,
            "num_mini_batches": teacher.mini_batches,
            "learning_rate": teacher.learning_rate,
            "desired_kl": teacher.desired_kl,
            "entropy_coef": teacher.entropy,
            "gamma": teacher.gamma,
            "lam": teacher.gae_lambda,
            "alternate": teacher.alternate,
            "adaptation_learning_rate": teacher.adaptation_learning_rate,
            "adaptation_batches": teacher.adaptation_batches,
        },
    }


def student_cfg(cfg: TrainCfg) -> dict[str, Any]:
    """Return rsl_rl's configuration of the student."""
    student = cfg.student
    return {
        "num_steps_per_env": student.steps,
        "obs_groups": {"student": groups(cfg), "teacher": groups(cfg)},
        **_models(cfg, "student", "teacher"),
        "algorithm": {
            "class_name": "stiction.rma.student:StudentDistillation",
            "num_learning_epochs": student.epochs,
            "num_mini_batches": student.mini_batches,
            "gradient_length": student.steps,
            "learning_rate": student.learning_rate,
            "adaptation_weight": student.adaptation_weight,
            "estimator_weight": student.estimator_weight,
        },
    }


@contextlib.contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Give torch `count` threads for a while.

    Rollouts use one: their tensors are small, and torch's own threads, which wait actively after each operation,
    would take the cores from the simulator's (measured on two cores: a third of its speed).
    """
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@dataclass
class PhaseRunner(OnPolicyRunner):
    """One phase of a run. rsl_rl builds algorithm and storage; the loop, the figures and the checkpoints are ours."""

    phase: str
    env: LocomotionEnv
    run: RunDirectory
    rl_cfg: dict[str, Any]
    iterations: int
    checkpoint_every: int
    writer: SummaryWriter
    progress: Progress

    def __post_init__(self) -> None:
        """Build the algorithm; rsl_rl prints its networks to standard output, which belongs to --json."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(self.env, self.rl_cfg, log_dir=None, device="cpu")

    def learn(self, num_learning_iterations: int | None = None, init_at_random_ep_len: bool = False) -> None:
        """Train until `iterations`, from wherever the phase stands."""
        self.alg.train_mode()
        if init_at_random_ep_len and self.current_learning_iteration == 0:
            self.env.episode_length_buf = torch.randint(
                0, self.env.max_episode_length, (self.env.num_envs,), generator=self.env.generator
            )
        while self.current_learning_iteration < (num_learning_iterations or self.iterations):
            start = time.perf_counter()
            self._enter_stage()
            figures = self.iterate()
            figures["seconds"] = time.perf_counter() - start
            self.current_learning_iteration += 1
            self._report(figures)
            it = self.current_learning_iteration
            if it % self.checkpoint_every == 0 or it == self.iterations:
                self.save()

    def _enter_stage(self) -> None:
        """Go over to the friction that the schedule has for this iteration."""
        friction = self.env.cfg.friction
        stage = len(friction.schedule) - 1
        if self.phase == "teacher":
            stage = friction.stage(self.current_learning_iteration, self.iterations)
        if stage != self.env.stage:
            self.env.enter_stage(stage)

    def iterate(self) -> dict[str, float]:
        """Collect one rollout and update; return the means of all figures."""
        sums: dict[str, torch.Tensor] = {}
        steps = self.cfg["num_steps_per_env"]
        start = time.perf_counter()
        with torch.no_grad(), torch_threads(1):
            obs = self.env.get_observations()
            for _ in range(steps):
                actions = self.alg.act(obs)
                obs, reward, dones, extras = self.env.step(actions)
                self.alg.process_env_step(obs, reward, dones, extras)
                for name, value in {"reward": reward.mean(), "action": actions.abs().mean(), **extras["log"]}.items():
                    sums[name] = sums.get(name, torch.zeros(())) + value
            self.alg.compute_returns(obs)
        rollout = time.perf_counter() - start
        losses = self.alg.update()
        figures = {name: float(value) / steps for name, value in sums.items()}
        figures["walk/blown_up"] *= steps
        figures |= {f"loss/{name}": value for name, value in losses.items()}
        figures |= {"rollout_seconds": rollout, "learning_rate": float(self.alg.learning_rate)}
        policy = self.alg.get_policy()
        figures["action_std"] = float(policy.distribution.std_param.detach().mean())
        return figures

    def _report(self, figures: dict[str, float]) -> None:
        """Write one iteration's figures everywhere; stop a run that has diverged."""
        it = self.current_learning_iteration
        bad = [name for name, value in figures.items() if not math.isfinite(value)]
        if bad:
            raise StictionError(
                f"training diverged in iteration {it} of the {self.phase}: {', '.join(bad)} not finite; "
                "train again in another folder with a smaller --teacher.learning-rate or --student.learning-rate"
            )
        self.run.log({"phase": self.phase, "iteration": it, **{k: round(v, 6) for k, v in figures.items()}})
        for name, value in figures.items():
            self.writer.add_scalar(f"{self.phase}/{name}", value, it)
        self.progress(self.phase, it, self.iterations, figures)

    def save(self, path: str = "", infos: dict | None = None) -> None:
        """Write a checkpoint that a resumed run continues from bit by bit."""
        file = self.run.checkpoints / f"{self.phase}_{self.current_learning_iteration:06d}.safetensors"
        tree = {
            "algorithm": self.alg.save(),
            "environment": self.env.state(),
            "random": torch.get_rng_state(),
            "threads": torch.get_num_threads(),
            "iteration": self.current_learning_iteration,
        }
        save_checkpoint(file, tree)
        keep_newest(self.run.checkpoints, self.phase)

    def restore(self, path: Path) -> None:
        """Continue from a checkpoint of this phase."""
        tree = load_checkpoint(path)
        if tree["threads"] != torch.get_num_threads():
            warnings.warn(
                f"{path.name} was written on {tree['threads']} threads and continues on {torch.get_num_threads()}: "
                "the result will not be that of an uninterrupted run bit by bit",
                stacklevel=2,
            )
        self.alg.load(tree["algorithm"], None, True)
        self.env.load_state(tree["environment"])
        torch.set_rng_state(tree["random"])
        self.current_learning_iteration = tree["iteration"]


def train(
    cfg: TrainCfg,
    run: RunDirectory,
    identified: dict[str, np.ndarray] | None = None,
    progress: Progress = lambda *_: None,
) -> dict[str, Any]:
    """Train teacher and student in the run directory, from its newest checkpoint if it has any; return the summary."""
    threads = num_threads()
    torch.set_num_threads(threads)
    torch.manual_seed(stream_seed(cfg.seed, "training"))
    env = LocomotionEnv(cfg.task, cfg.num_envs, stream_seed(cfg.seed, "environment"), threads, identified)
    teacher_checkpoint = latest_checkpoint(run.checkpoints, "teacher")
    student_checkpoint = latest_checkpoint(run.checkpoints, "student")
    writer = SummaryWriter(str(run.path / "tensorboard"))

    def phase(name: str, rl_cfg: dict[str, Any], iterations: int) -> PhaseRunner:
        return PhaseRunner(name, env, run, rl_cfg, iterations, cfg.checkpoint_every, writer, progress)

    teacher = phase("teacher", teacher_cfg(cfg), cfg.teacher.iterations)
    if teacher_checkpoint is not None:
        teacher.restore(teacher_checkpoint)
    if student_checkpoint is None:
        run.forget_after("teacher", teacher.current_learning_iteration)
    teacher.learn(init_at_random_ep_len=True)

    student = phase("student", student_cfg(cfg), cfg.student.iterations)
    student.alg.warm_start(teacher.alg.get_policy().state_dict())
    if student_checkpoint is not None:
        student.restore(student_checkpoint)
        run.forget_after("student", student.current_learning_iteration)
    student.learn()
    writer.close()

    rows = run.rows()
    figures = {
        "env_steps": cfg.env_steps,
        "seconds": round(sum(row["seconds"] for row in rows), 1),
        "threads": threads,
        "multiply_adds": multiply_adds(teacher),
        "last": {name: [r for r in rows if r["phase"] == name][-1] for name in ("teacher", "student")},
    }
    run.finish(figures)
    return figures


def multiply_adds(teacher: PhaseRunner) -> dict[str, int]:
    """Return the multiply-adds of one forward pass: actor with adaptation and estimator, and critic."""
    frames = teacher.env.layout.history_length

    def count(module: torch.nn.Module) -> int:
        total = 0
        for name, layer in module.named_modules():
            if isinstance(layer, torch.nn.Linear):
                total += layer.in_features * layer.out_features * (frames if ".embed." in name else 1)
        return total

    return {"actor": count(teacher.alg.actor), "critic": count(teacher.alg.critic)}


def load_student(run: RunDirectory) -> StudentPolicy:
    """Return the trained student of a run. Raises `StictionError` where it has none yet."""
    path = latest_checkpoint(run.checkpoints, "student")
    if path is None:
        raise StictionError(f"{run.path} has no student yet; finish it with `stiction train --resume {run.path}`")
    cfg = run.config()
    state = load_checkpoint(path)["algorithm"]["student_state_dict"]
    env = LocomotionEnv(cfg.task, 1, 0)
    model = {key: value for key, value in _models(cfg, "student")["student"].items() if key != "class_name"}
    actor = RMAActor(env.get_observations(), {"student": groups(cfg)}, "student", env.num_actions, **model)
    actor.load_state_dict(state)
    return StudentPolicy(actor).eval()
