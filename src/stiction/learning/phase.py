"""One phase of a run, teacher or student: the loop, its figures, its checkpoints, and the reasons to end."""

from __future__ import annotations

import contextlib
import io
import math
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rsl_rl.runners import OnPolicyRunner

from stiction.core.errors import TrainingError
from stiction.core.gemm import VARIABLE, gemm_path
from stiction.learning.boards import Board
from stiction.learning.config import StopCfg
from stiction.learning.figures import EpisodeMeans, RolloutFigures, adaptation_figures, friction_figures
from stiction.learning.health import EarlyStop, Health
from stiction.learning.ppo import AdaptationPPO
from stiction.learning.quick import quicken
from stiction.learning.ranks import ALONE, Ranks
from stiction.learning.run import (
    BROKEN,
    Interrupted,
    RunDirectory,
    keep_newest,
    latest_checkpoint,
    load_checkpoint,
    save_checkpoint,
)
from stiction.learning.symmetry import make_symmetric
from stiction.robots.physics import ROWS_FROM
from stiction.task.env import LocomotionEnv

Progress = Callable[[str, int, int, dict[str, float]], None]
"""Called after every iteration with phase, iteration, iterations, figures."""

Film = Callable[[str, int, Path], None]
"""Called with phase, iteration and a checkpoint that is due to be filmed."""


@contextlib.contextmanager
def one_torch_thread() -> Iterator[None]:
    """Give torch one thread for a while: its idle threads would take the cores from the simulator in rollouts."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def check_moments(optimizer: torch.optim.Optimizer) -> None:
    """Raise `TypeError` where an optimizer's moments, from a file, are not of the shape of their parameter."""
    for parameter, moments in optimizer.state.items():
        for name, value in moments.items():
            if not isinstance(value, torch.Tensor) or value.shape not in (parameter.shape, ()):
                raise TypeError(f"the optimizer's {name} is not of the shape of its parameter")


def film_due(iteration: int, every: int, last: bool) -> bool:
    """Return whether a clip is due: every so many iterations, and at the end unless one was just made."""
    return every > 0 and (iteration % every == 0 or (last and 2 * (iteration % every) >= every))


@dataclass
class PhaseRunner(OnPolicyRunner):
    """One phase of a run: rsl_rl's runner with another loop, figures and checkpoints."""

    phase: str
    env: LocomotionEnv
    run: RunDirectory
    rl_cfg: dict[str, Any]
    iterations: int
    every: tuple[int, int]
    """Iterations between checkpoints, and between clips (0: none)."""
    stop: StopCfg
    board: Board
    progress: Progress = lambda *_: None
    interrupted: Callable[[], bool] = lambda: False
    film: Film = lambda *_: None
    ranks: Ranks = ALONE
    called: str = "teacher"
    """Name of the phase in messages."""
    stopped: dict[str, float] | None = None
    """Means with which the phase reached its target and ended early."""

    def __post_init__(self) -> None:
        """Build the algorithm; rsl_rl prints its networks to standard output, which belongs to --json."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(self.env, self.rl_cfg, log_dir=None, device=self.env.device)
        self.alg.ranks = self.ranks
        quicken(self.alg)
        make_symmetric(self.alg, self.rl_cfg["symmetry"], self.env)
        if self.alg.symmetry is not None and isinstance(self.alg, AdaptationPPO):
            self.alg.symmetry.remembered = self.alg.actor.remembered
            self.alg.symmetry.targets = self.alg.targets
        # Counts add up over the processes.
        self.health = Health(self.env.num_envs * self.ranks.size, self.rl_cfg["algorithm"].get("desired_kl", 0.01))
        steady = self.alg.settled_from if isinstance(self.alg, AdaptationPPO) else 0
        self.episodes = EpisodeMeans(self.env.num_envs, self.env.device)
        self.early_stop = EarlyStop(self.stop, len(self.env.cfg.friction.schedule) - 1, steady)

    def _configure_multi_gpu(self) -> None:
        """Tell rsl_rl of the processes; by itself it would read the environment, and wants GPUs."""
        ranks = self.ranks
        self.gpu_world_size, self.gpu_global_rank, self.gpu_local_rank = ranks.size, ranks.number, ranks.local
        self.is_distributed = not ranks.alone
        known = {"global_rank": ranks.number, "local_rank": ranks.local, "world_size": ranks.size}
        self.cfg["multi_gpu"] = known if self.is_distributed else None

    @property
    def finished(self) -> bool:
        """True if the phase has made all its iterations, or reached its target and made the quiet ones."""
        alg, made = self.alg, self.current_learning_iteration
        quiet = isinstance(alg, AdaptationPPO) and made < alg.quiet_from + alg.quiet_for
        return made >= self.iterations or (self.stopped is not None and not quiet)

    def learn(self, num_learning_iterations: int | None = None, init_at_random_ep_len: bool = False) -> None:
        """Train to the end. Raises `StictionError` where it diverges, `Interrupted` where it was asked to stop."""
        self.alg.train_mode()
        if init_at_random_ep_len and self.current_learning_iteration == 0:
            env = self.env
            # Robots that all began at once would all be reset in the same step, from then on.
            env.episode_length_buf = torch.randint(
                0, env.max_episode_length, (env.num_envs,), generator=env.generator, device=env.task_device
            )
        with self.ranks.together():
            if not self.ranks.alone:
                # Each rank drew its networks from its own stream of random numbers; those of rank 0 count.
                self.alg.broadcast_parameters()
            while not self.finished:
                start = time.perf_counter()
                self._enter_stage()
                figures = self.ranks.figures(self.iterate())
                seconds = time.perf_counter() - start
                steps = self.cfg["num_steps_per_env"] * self.env.num_envs * self.ranks.size
                self.current_learning_iteration += 1
                self._report(figures | {"seconds": seconds, "env_steps_per_second": steps / seconds})
                self._preserve()

    def _enter_stage(self) -> None:
        """Go over to the friction, and the physics of it, that the schedule has for this iteration."""
        friction, teacher = self.env.cfg.friction, self.phase == "teacher"
        done = self.current_learning_iteration / self.iterations if teacher else 1.0
        if self.env.cfg.physics.friction == "plastic-first" and done >= ROWS_FROM:
            self.env.fleet.use_rows()
        last = len(friction.schedule) - 1
        stage = friction.stage(self.current_learning_iteration, self.iterations) if teacher else last
        if stage != self.env.stage:
            self.env.enter_stage(stage)

    def iterate(self) -> dict[str, float]:
        """Collect one rollout and update; return the means of all figures."""
        start = time.perf_counter()
        rollout = RolloutFigures(self.env.cfg.control_period)
        with torch.no_grad(), one_torch_thread():
            obs = self.env.get_observations()
            for _ in range(self.cfg["num_steps_per_env"]):
                # The step puts a new tensor in its place, so that this one still holds the ages before it.
                age = self.env.episode_length_buf
                actions = self.alg.act(obs)
                obs, reward, dones, extras = self.env.step(actions)
                self.alg.process_env_step(obs, reward, dones, extras)
                rollout.add({"reward": reward.mean(), "action": actions.abs().mean(), **extras["log"]})
                rollout.end(age, dones.to(age.device))
                self.episodes.add(reward, dones)
            self.alg.compute_returns(obs)
        seconds = time.perf_counter() - start
        losses = self.alg.update()
        figures = rollout.means() | {f"loss/{name}": value for name, value in losses.items()}
        figures |= {"rollout_seconds": seconds, "learning_rate": float(self.alg.learning_rate)}
        return figures | self.episodes.means() | self._policy_figures() | friction_figures(self.env)

    def _policy_figures(self) -> dict[str, float]:
        """Return the figures of the updated policy."""
        policy = self.alg.get_policy()
        figures = {"action_std": float(policy.std.mean())}
        if isinstance(self.alg, AdaptationPPO):
            figures |= {"kl": self.alg.kl, **self.alg.figures}
        if not all(bool(parameter.isfinite().all()) for parameter in policy.parameters()):
            figures["parameters"] = math.nan
        return figures | adaptation_figures(policy, self.env.get_observations(), len(self.env.spec.feet))

    def _report(self, figures: dict[str, float]) -> None:
        """Write one iteration's figures everywhere; stop a run that has diverged."""
        it = self.current_learning_iteration
        # Rounded before it is judged: a resumed run judges by the rows of metrics.jsonl, and must judge alike.
        row = {name: round(value, 6) for name, value in figures.items()}
        diagnosis = self.health.check(it, row)
        if diagnosis is not None:
            good = latest_checkpoint(self.run.checkpoints, self.phase)
            name = good.name if good else "none, there was no time for one"
            raise TrainingError(
                f"training diverged in iteration {it} of the {self.called}, since iteration {diagnosis.since}: "
                f"{diagnosis.what}; the last good checkpoint is {name}; train again in another folder with "
                f"{diagnosis.advice}"
            )
        if self.stopped is None and (met := self.early_stop.check(row, it)) is not None:
            self.stopped = met
            if isinstance(self.alg, AdaptationPPO):
                self.alg.end_early()
        if not self.ranks.leads:
            return
        self.run.log({"phase": self.phase, "iteration": it, **row})
        self.board.add(self.phase, it, figures)
        self.progress(self.phase, it, self.iterations, figures)

    def _preserve(self) -> None:
        """Write a checkpoint where one is due and the run healthy. Raises `Interrupted` where it was asked to stop."""
        it, last, healthy = self.current_learning_iteration, self.finished, not self.health.suspicious
        # `any` comes first, since all ranks must take part in it. Asked to stop after its very last iteration, the run
        # ends as finished.
        stop = self.ranks.any(self.interrupted()) and not (last and self.phase == "student")
        checkpoint_every, video_every = self.every
        due = film_due(it, video_every, last)
        if last or stop or (healthy and (due or it % checkpoint_every == 0)):
            self.save()
        if due and healthy and self.ranks.leads:
            self.film(self.phase, it, self._file())
        if stop:
            raise Interrupted(
                f"stopped after iteration {it} of {self.iterations} of the {self.called}, nothing is lost; "
                f"go on with `{self.ranks.program} train --resume {self.run.path}`"
            )

    def _file(self) -> Path:
        """Return the checkpoint's path of the iteration that was made last."""
        return self.run.robots_of(self.ranks.number) / f"{self.phase}_{self.current_learning_iteration:06d}.safetensors"

    def save(self, path: str = "", infos: dict | None = None) -> None:
        """Write a checkpoint that a resumed run continues from bit by bit; rank 0 when all others have theirs."""
        tree = {
            "algorithm": self.alg.save(),
            "environment": self.env.state(),
            "episodes": self.episodes.state(),
            "random": torch.get_rng_state(),
            "threads": torch.get_num_threads(),
            "gemm": gemm_path(),
            "iteration": self.current_learning_iteration,
            "stopped": self.stopped,
        }
        if self.env.device == "cuda":
            tree["random_cuda"] = torch.cuda.get_rng_state()
        if not self.ranks.leads:
            save_checkpoint(self._file(), tree)
            keep_newest(self._file().parent, self.phase)
        # The networks are in rank 0's file: while that is missing, a resume takes the checkpoint before it for all.
        self.ranks.wait()
        if not self.ranks.leads:
            return
        # Figures before the checkpoint that speaks of them: it holds their digest, and a power cut may come between.
        self.run.flush()
        self.board.flush()
        tree["run"] = self.run.origin()
        save_checkpoint(self._file(), tree)
        keep_newest(self.run.checkpoints, self.phase)

    def restore(self, path: Path) -> None:
        """Continue from a checkpoint, of rank 0 or its own beside it. Raises `StictionError` for another version's."""
        path = self.run.robots_of(self.ranks.number) / path.name
        tree = load_checkpoint(path)
        try:
            self._restore(path, tree)
        # A part that is missing, of another shape, of another net.
        except (*BROKEN, IndexError, RuntimeError) as error:
            cause = (str(error).strip() or "nothing more").splitlines()[0]
            first = self.run.header()["revision"].partition("+")[0]
            raise TrainingError(
                f"checkpoint {path} cannot be restored by this version ({type(error).__name__}: {cause}); "
                f"finish the run with revision {first}, which began it, or train again"
            ) from error

    def _restore(self, path: Path, tree: dict[str, Any]) -> None:
        """Bring algorithm, task, random numbers and watchers to where a checkpoint has them."""
        if tree["threads"] != torch.get_num_threads():
            warnings.warn(
                f"{path.name} was written on {tree['threads']} threads and continues on {torch.get_num_threads()}: "
                "the result will not be that of an uninterrupted run bit by bit",
                stacklevel=2,
            )
        # Before there was a fast path, checkpoints did not say which one they were written on.
        written = tree.get("gemm", "default (none was recorded)")
        if (written == "fast") != (gemm_path() == "fast"):
            warnings.warn(
                f"{path.name} was written on the path {written!r} of matrix products and continues on {gemm_path()!r}: "
                "the numbers will differ from those of an uninterrupted run; to keep to the first path, set "
                f"{VARIABLE}={int(written == 'fast')}",
                stacklevel=2,
            )
        self.alg.load(tree["algorithm"], None, True)
        for optimizer in (value for value in vars(self.alg).values() if isinstance(value, torch.optim.Optimizer)):
            check_moments(optimizer)
        self.env.load_state(tree["environment"])
        if "episodes" in tree:  # checkpoints of before have none, and their means begin anew
            self.episodes.load_state(tree["episodes"])
        torch.set_rng_state(tree["random"])
        if self.env.device == "cuda":
            torch.cuda.set_rng_state(tree["random_cuda"])
        self.current_learning_iteration = tree["iteration"]
        self.stopped = tree.get("stopped")
        for row in self.run.rows():
            if row["phase"] == self.phase and row["iteration"] <= tree["iteration"]:
                figures = {name: value for name, value in row.items() if name not in ("phase", "iteration")}
                self.health.check(row["iteration"], figures)
                self.early_stop.check(figures, row["iteration"])
