"""Runs the training: a first phase by PPO, and the student after it, resumable at every checkpoint."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rsl_rl.utils import resolve_class

from stiction.core.errors import TrainingError
from stiction.core.provenance import num_threads, stream_seed
from stiction.learning.begin import find_simulator
from stiction.learning.boards import Board, open_board
from stiction.learning.config import STD_RANGE, TrainCfg
from stiction.learning.models import ELEVATION, GROUPS, RMAActor, StudentPolicy
from stiction.learning.phase import Film, PhaseRunner, Progress
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.run import BROKEN, RunDirectory, identified_values, latest_checkpoint, load_checkpoint
from stiction.learning.symmetry import make_dense, make_equivariant
from stiction.robots.catalog import find_robot
from stiction.task.env import LocomotionEnv
from stiction.task.symmetry import task_mirror

QUIET_FROM = 0.75
"""Share of the first phase after which the noise has fallen to `TeacherCfg.final_std`."""


def groups(cfg: TrainCfg) -> list[str]:
    """Return the observation groups of a run."""
    return [*GROUPS, ELEVATION] if cfg.task.terrain.kind != "flat" else GROUPS


def _distribution(cfg: TrainCfg, largest_std: float = STD_RANGE[1]) -> dict[str, Any]:
    """Return rsl_rl's configuration of the actions' distribution."""
    bounds = (STD_RANGE[0], largest_std)
    return {"class_name": "GaussianDistribution", "init_std": cfg.network.initial_std, "std_range": bounds}


def _actor(cfg: TrainCfg, largest_std: float = STD_RANGE[1]) -> dict[str, Any]:
    """Return rsl_rl's configuration of an actor; a new one for each, for rsl_rl takes it apart while it reads it."""
    distribution = _distribution(cfg, largest_std)
    actor = {"class_name": "stiction.learning.models:RMAActor"} if cfg.method.actor is None else cfg.method.actor(cfg)
    return {**actor, "network": cfg.network, "distribution_cfg": distribution}


def ppo_cfg(cfg: TrainCfg, phase: str = "teacher") -> dict[str, Any]:
    """Return rsl_rl's configuration of PPO in the first phase, or (`student`) of a student that walks on its own z*."""
    teacher, first, noise = cfg.teacher, phase == "teacher", None
    if (end := teacher.final_std) is not None:
        falling = (cfg.network.initial_std, end, round(QUIET_FROM * teacher.iterations))
        noise = falling if first else (end, end, 0)
    fewer = 2 if cfg.symmetry == "half" else 1
    method = cfg.method.algorithm
    algorithm = {"class_name": "stiction.learning.ppo:AdaptationPPO"} if method is None else method(cfg)
    return {
        "symmetry": cfg.symmetry,
        "num_steps_per_env": teacher.steps if first else cfg.student.steps,
        "obs_groups": {"actor": groups(cfg), "critic": groups(cfg)},
        "actor": _actor(cfg),
        "critic": {"class_name": "stiction.learning.models:RMACritic", "network": cfg.network},
        "algorithm": {
            **algorithm,
            "settings": teacher if first else replace(teacher, latent="history", both_ways=False, quiet=0),
            "noise": noise,
            "num_learning_epochs": teacher.epochs // fewer,
            "num_mini_batches": teacher.mini_batches * fewer,
            "learning_rate": teacher.learning_rate if first else cfg.student.learning_rate,
            "desired_kl": teacher.desired_kl,
            "entropy_coef": teacher.entropy,
            "gamma": teacher.gamma,
            "lam": teacher.gae_lambda,
        },
    }


def student_cfg(cfg: TrainCfg) -> dict[str, Any]:
    """Return rsl_rl's configuration of the second phase, PPO or distillation."""
    if cfg.student.algorithm == "ppo":
        return ppo_cfg(cfg, "student")
    student, largest_std = cfg.student, cfg.teacher.final_std or STD_RANGE[1]
    return {
        "symmetry": cfg.symmetry,
        "num_steps_per_env": student.steps,
        "obs_groups": {"student": groups(cfg), "teacher": groups(cfg)},
        "student": _actor(cfg, largest_std),
        "teacher": _actor(cfg, largest_std),
        "algorithm": {
            "class_name": "stiction.learning.ppo:StudentDistillation",
            "settings": student,
            "gradient_length": student.steps,
            "max_grad_norm": 1.0,
            "learning_rate": student.learning_rate,
            "velocity_weight": cfg.teacher.velocity_weight,
        },
    }


def train(
    cfg: TrainCfg,
    run: RunDirectory,
    identified: dict[str, np.ndarray] | None = None,
    progress: Progress = lambda *_: None,
    interrupted: Callable[[], bool] = lambda: False,
    film: Film = lambda *_: None,
    ranks: Ranks = ALONE,
    board: Board | None = None,
) -> dict[str, Any]:
    """Train in the run directory, from its newest checkpoint if it has any; return the summary.

    `identified`: see `nominal_joints`; `interrupted`: asked after every iteration; `ranks`: processes, which have met;
    `board`: an open logger, by default that of the configuration.
    Raises `StictionError` where training diverges or cannot be written, `Interrupted` where it was asked to stop.
    """
    cfg.check_memory(find_robot(cfg.task.robot))
    run.check_processes(ranks.size)
    run.check_checkpoints()
    threads = num_threads()
    torch.set_num_threads(threads)
    torch.manual_seed(stream_seed(cfg.seed, ranks.named("training")))
    device, seed = find_simulator(cfg, ranks.local), stream_seed(cfg.seed, ranks.named("environment"))
    num = ranks.share(cfg.num_envs)
    env = LocomotionEnv(cfg.task, num, seed, threads, identified, device, run.actuator())
    ranks.begin()

    def phase(name: str, rl_cfg: dict[str, Any], iterations: int) -> PhaseRunner:
        every = (cfg.checkpoint_every, cfg.video_every)
        hooks = (progress, interrupted, film)
        return PhaseRunner(name, env, run, rl_cfg, iterations, every, cfg.stop, shown, *hooks, ranks, cfg.name_of(name))

    logger = open_board(run.path, cfg) if board is None else nullcontext(board)
    with run.writing() if ranks.leads else nullcontext(), logger as shown:
        teacher = phase("teacher", ppo_cfg(cfg), cfg.teacher.iterations)
        student = _train_phases(run, teacher, lambda: phase("student", student_cfg(cfg), cfg.student.iterations))
        if ranks.leads:
            run.finish(_summary(cfg, run, teacher, student) | {"threads": threads})
    ranks.wait()
    return run.summary()


def _train_phases(run: RunDirectory, teacher: PhaseRunner, build_student: Callable[[], PhaseRunner]) -> PhaseRunner:
    """Take teacher and then student, which draws its random numbers after it, to their ends; return the student."""
    teacher_checkpoint = latest_checkpoint(run.checkpoints, "teacher")
    student_checkpoint = latest_checkpoint(run.checkpoints, "student")
    if teacher_checkpoint is not None:
        teacher.restore(teacher_checkpoint)
    _forget_after(run, teacher, student_checkpoint is None)
    teacher.learn(init_at_random_ep_len=True)

    student = build_student()
    trained = teacher.alg.get_policy().state_dict(), teacher.alg.critic.state_dict()
    student.alg.warm_start(*trained)
    if student_checkpoint is not None:
        student.restore(student_checkpoint)
        _forget_after(run, student)
    student.learn()
    if student_checkpoint is None and not student.iterations:
        # Without iterations of its own the student is the policy of the first phase, and still has a checkpoint to be
        # loaded.
        student.save()
    return student


def _forget_after(run: RunDirectory, phase: PhaseRunner, due: bool = True) -> None:
    """Drop the figures of iterations that a phase will make again, when every process has read them."""
    phase.ranks.wait()
    if due and phase.ranks.leads:
        run.forget_after(phase.phase, phase.current_learning_iteration)


def _summary(cfg: TrainCfg, run: RunDirectory, teacher: PhaseRunner, student: PhaseRunner) -> dict[str, Any]:
    """Return the summary of a finished run; `stopped` names the phases that reached their target early."""
    rows = run.rows()
    phases = {"teacher": (teacher, cfg.teacher.steps), "student": (student, cfg.student.steps)}
    return {
        "env_steps": sum(runner.current_learning_iteration * steps for runner, steps in phases.values()) * cfg.num_envs,
        "seconds": round(sum(row["seconds"] for row in rows), 1),
        "multiply_adds": multiply_adds(teacher),
        "last": {
            name: [row for row in rows if row["phase"] == name][-1]
            for name, (runner, _) in phases.items()
            if runner.iterations
        },
        "stopped": {
            name: {"iteration": runner.current_learning_iteration, **runner.stopped}
            for name, (runner, _) in phases.items()
            if runner.stopped is not None
        },
    }


def multiply_adds(teacher: PhaseRunner) -> dict[str, int]:
    """Return the multiply-adds of a forward pass of actor and critic; decoders serve the loss and are not counted."""
    frames = teacher.env.layout.history_length

    def count(module: torch.nn.Module) -> int:
        total = 0
        for name, layer in module.named_modules():
            if isinstance(layer, torch.nn.Linear) and ".decoder." not in name:
                total += layer.in_features * layer.out_features * (frames if ".embed." in name else 1)
        return total

    return {"actor": count(teacher.alg.actor), "critic": count(teacher.alg.critic)}


def load_actor(run: RunDirectory, phase: str, checkpoint: Path | None = None) -> RMAActor:
    """Return the actor of a phase, from `checkpoint` or the newest. Raises `StictionError` where the run has none."""
    path = checkpoint or latest_checkpoint(run.checkpoints, phase)
    if path is None:
        raise TrainingError(f"{run.path} has no {phase} yet; finish it with `stiction train --resume {run.path}`")
    cfg = run.config()
    state = load_checkpoint(path)["algorithm"]
    state = state["actor_state_dict" if "actor_state_dict" in state else "student_state_dict"]
    env = LocomotionEnv(cfg.task, 1, 0, identified=identified_values(run.header()))
    observations, seen = env.get_observations(), {phase: groups(cfg)}
    kind, settings = resolve_class(_actor(cfg))
    actor: RMAActor = kind(observations, seen, phase, env.num_actions, **settings)
    if cfg.symmetry == "network":
        # Before the parameters are loaded, which are those of before the average.
        make_equivariant(actor, task_mirror(env))
    try:
        actor.load_state_dict(state)
    except (*BROKEN, RuntimeError) as error:
        cause = str(error).strip().splitlines()[-1].strip()
        raise TrainingError(f"{path}: its networks are not those of the run ({cause}); train again") from error
    make_dense(actor)
    actor.blind = phase == "student" or cfg.teacher.latent == "history"
    actor.latent_source = "history" if actor.blind else "privileged"
    return actor.eval()


def load_student(run: RunDirectory) -> StudentPolicy:
    """Return the trained student of a run. Raises `StictionError` where it has none yet."""
    return load_actor(run, "student").student().eval()
