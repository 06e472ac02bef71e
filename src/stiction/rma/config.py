"""Configuration of training. No torch, no mujoco: the command line reads it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, get_args

from tyro.conf import arg

from stiction.formats.errors import StictionError
from stiction.locomotion.config import RandomizationCfg, TaskCfg
from stiction.sim.protocol import DeviceName

STD_RANGE = (0.05, 2.0)
"""Bounds of the actions' standard deviation."""

SymmetryName = Literal["none", "batches", "half", "network"]


@dataclass(frozen=True)
class NetworkCfg:
    """Sizes of the networks. Small on purpose: on a CPU the update costs as much as the physics."""

    actor: tuple[int, ...] = (256, 128, 64)
    """Hidden layers of the actor."""
    critic: tuple[int, ...] = (256, 128)
    """Hidden layers of the critic."""
    privileged: tuple[int, ...] = (64,)
    """Hidden layers of f_ada of the teacher, privileged observation -> z."""
    history_frame: int = 24
    """Width to which every frame of the history is reduced first, by the same weights for all frames."""
    history: tuple[int, ...] = (64,)
    """Hidden layers of f_ada of the student, of f_est and of the critic's view of the history, after the frames."""
    terrain: tuple[int, ...] = (64, 32)
    """Hidden layers of the encoder of the elevation map; there is none on flat ground."""
    terrain_latent: int = 16
    """Size of e_t*."""
    latent: int = 16
    """Size of z and z*."""
    initial_std: float = 0.8
    """Standard deviation of the first actions."""


@dataclass(frozen=True)
class TeacherCfg:
    """PPO, and the supervised losses of adaptation and estimator."""

    iterations: int = 700
    """Rollouts, each followed by an update."""
    steps: int = 24
    """Control steps of one rollout."""
    epochs: int = 4
    """Passes over a rollout."""
    mini_batches: int = 4
    """Parts of one pass."""
    learning_rate: float = 1e-3
    """First learning rate; adapted to the KL divergence."""
    desired_kl: float = 0.01
    """KL divergence to which the learning rate is adapted."""
    entropy: float = 0.002
    """Weight of the entropy bonus."""
    gamma: float = 0.99
    """Discount."""
    gae_lambda: float = 0.95
    """λ of the advantage estimate."""
    alternate: int = 4
    """z comes from the history (z*) in one iteration out of this many, else from the privileged encoder. The paper
    says that they alternate, not how often; the public code it builds on uses 20, with which z* is hardly ever walked
    on."""
    adaptation_learning_rate: float = 1e-3
    """For L_ada, L_est and, where there is terrain, L_hist."""
    adaptation_batches: int = 4
    """Gradient steps of these losses after each PPO update, one pass over the rollout."""


@dataclass(frozen=True)
class StudentCfg:
    """Distillation: behaviour cloning, with L_ada and L_est, from a warm start."""

    iterations: int = 240
    """Rollouts of the student, each labelled by the teacher and followed by an update."""
    steps: int = 24
    """Control steps of one rollout."""
    epochs: int = 2
    """Passes over a rollout."""
    mini_batches: int = 4
    """Parts of one pass."""
    learning_rate: float = 5e-4
    """Fixed."""
    adaptation_weight: float = 0.1
    """Weight beside L_clone of L_ada, and of L_hist where there is terrain."""
    estimator_weight: float = 0.5
    """Weight of L_est beside L_clone."""


@dataclass(frozen=True)
class StopCfg:
    """When a phase has learned enough and ends before its last iteration. Off unless a tracking error is named.

    All figures are those of training: noisy, pushed, randomised. Its tracking error is some 0.1 m/s above that of an
    evaluation. Teacher and student each end by this rule, the teacher not before the last stage of friction has begun.
    """

    tracking_error: Annotated[float | None, arg(aliases=("--stop-at-tracking-error",))] = None
    """Mean tracking error under which a phase ends [m/s]; None: never, as in every comparison of methods."""
    iterations: int = 20
    """Iterations over which all figures are averaged."""
    falls: float = 0.01
    """Most falls that count as none [1/s]: one in 100 s of walking with pushes."""
    terrain_level: float | None = None
    """Mean terrain level that must be reached as well; None: any. Without it, a run on terrain may end on its easiest
    part."""

    def __post_init__(self) -> None:
        """Refuse targets that mean nothing."""
        if self.tracking_error is not None and not self.tracking_error > 0:
            raise StictionError(f"stop.tracking_error is {self.tracking_error}; expected more than 0 m/s")
        if self.iterations < 1 or self.falls < 0:
            raise StictionError(
                f"stop after {self.iterations} iterations with {self.falls} falls a second: expected at least 1 and 0"
            )
        if self.terrain_level is not None and self.tracking_error is None:
            raise StictionError("stop.terrain_level has no effect by itself; say --stop-at-tracking-error too")


@dataclass(frozen=True)
class TrainCfg:
    """One training run: a teacher, then its student."""

    task: TaskCfg = field(default_factory=TaskCfg)
    network: NetworkCfg = field(default_factory=NetworkCfg)
    teacher: TeacherCfg = field(default_factory=TeacherCfg)
    student: StudentCfg = field(default_factory=StudentCfg)
    num_envs: int = 512
    """Robots simulated side by side."""
    seed: int = 0
    """Seed of everything random in the run."""
    symmetry: SymmetryName = "none"
    """Left-right symmetry. `batches`: every sample of an update also as its mirror image, at twice the update's cost.
    `half`: mirrored samples at no cost, PPO makes half as many passes. `network`: actor and critic are symmetric by
    construction. See `stiction.rma.symmetry` and `stiction.rma.equivariant`."""
    joints: str | None = None
    """A `joints.json` whose inertia, damping and friction become the robot's nominal ones."""
    actuator: str | None = None
    """A folder of `stiction train-actuator`: its net gives the joints' torque in place of the PD law."""
    checkpoint_every: int = 50
    """Iterations between checkpoints."""
    device: DeviceName = "cpu"
    """`cpu`: MuJoCo on all cores. `cuda`: MuJoCo Warp and the networks on a GPU; wants thousands of robots. `warp-cpu`:
    MuJoCo Warp on the processor, many times slower than `cpu`, to try it where there is no GPU."""
    contacts: int = 32
    """Contacts for which MuJoCo Warp has room, a robot. More than that stop the run."""
    video_every: int = 0
    """Iterations between short clips of the policy, in `clips/`; 0: none. They are rendered by a process of their own
    from a checkpoint and change nothing in the training; each takes some seven seconds of one core. The presets have
    clips, for people like to see what they train; this default has none, for nobody looks at those of an experiment."""
    stop: StopCfg = field(default_factory=StopCfg)

    def __post_init__(self) -> None:
        """Refuse what cannot be run, before any folder is made."""
        if self.device not in get_args(DeviceName):
            raise StictionError(f"device {self.device!r}: expected one of {', '.join(get_args(DeviceName))}")
        self._check_symmetry()
        counts = {name: getattr(self, name) for name in ("num_envs", "checkpoint_every", "contacts")}
        for phase, cfg in (("teacher", self.teacher), ("student", self.student)):
            names = ("iterations", "steps", "epochs", "mini_batches")
            counts |= {f"{phase}.{name}": getattr(cfg, name) for name in names}
        counts["teacher.adaptation_batches"] = self.teacher.adaptation_batches
        for name, count in counts.items():
            if count < 1:
                raise StictionError(f"{name} is {count}; expected at least 1")
        if self.stop.terrain_level is not None and self.task.terrain.kind == "flat":
            raise StictionError("stop.terrain_level is set, but flat ground has no terrain levels; leave it out")
        if self.video_every < 0:
            raise StictionError(f"video_every is {self.video_every}; expected a number of iterations, or 0 for none")
        for phase, cfg in (("teacher", self.teacher), ("student", self.student)):
            samples = self.num_envs * cfg.steps
            if samples < cfg.mini_batches:
                raise StictionError(
                    f"{phase}: {samples} samples a rollout for {cfg.mini_batches} mini-batches; use more robots"
                )
        rates = (self.teacher.learning_rate, self.teacher.adaptation_learning_rate, self.student.learning_rate)
        if min(rates) <= 0 or self.seed < 0:
            raise StictionError(
                f"learning rates {rates}, seed {self.seed}: expected positive rates and a seed of at least 0"
            )

    def _check_symmetry(self) -> None:
        """Refuse a symmetry that is none, and one that would need half a pass."""
        if self.symmetry not in get_args(SymmetryName):
            raise StictionError(f"symmetry {self.symmetry!r}: expected one of {', '.join(get_args(SymmetryName))}")
        if self.symmetry == "half" and self.teacher.epochs % 2:
            raise StictionError(
                f"symmetry 'half' makes half of {self.teacher.epochs} passes; use an even number of --teacher.epochs"
            )

    @property
    def env_steps(self) -> int:
        """Control steps of all robots in the whole run."""
        rollouts = self.teacher.iterations * self.teacher.steps + self.student.iterations * self.student.steps
        return rollouts * self.num_envs


_SHOWN = TrainCfg(video_every=100)

PRESETS = {
    "full": _SHOWN,
    "quick": replace(
        _SHOWN, teacher=replace(TeacherCfg(), iterations=350), student=replace(StudentCfg(), iterations=80)
    ),
    "paper": replace(_SHOWN, task=TaskCfg(randomization=RandomizationCfg.literal())),
}
"""`full` is what the results are made with; `quick` has nearly half its budget; `paper` randomises the paper's table
and no more: no action delay, no encoder offset. All three show clips."""
