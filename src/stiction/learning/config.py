"""Configuration of training. No torch, no mujoco: the command line reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Annotated, Any, Literal, get_args

from stiction.core.effects import all_of, excludes, needs
from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.flags import FIXED, FLAG, SETTING, flag
from stiction.core.memory import check_memory
from stiction.core.records import check_numbers
from stiction.files.method import Method, find_method
from stiction.joints.friction import has_coefficient
from stiction.robots.model import Robot
from stiction.task.config import UNEVEN, RandomizationCfg, TaskCfg

MOST_COUNTS = {
    "num_envs": 131_072,
    "iterations": 1_000_000,
    "quiet": 1_000_000,
    "checkpoint_every": 1_000_000,
    "steps": 1000,
    "epochs": 100,
    "contacts": 1000,
    "alternate": 1_000_000,
}
"""Largest counts, by name; 10,000 for all others, such as widths of layers."""

MAY_BE_NONE = ("student.iterations", "teacher.quiet", "network.latent")

LAYERS = ("actor", "critic", "privileged", "history", "estimator", "terrain")
NETWORK_SIZES = ("history_frame", "estimator_frame", "terrain_latent", "latent")
MOST_LAYERS = 10

TORCH, SIMULATED, COPIES, BESIDE = 350e6, 50e3, 4, 500
"""Memory of a training: of Python with torch [B], of a simulated robot [B]; of a sample of the rollout, copies of its
history, and numbers beside it, single precision. From measured peaks, 376 MB (16 robots) to 1011 MB (51 frames)."""

STD_RANGE = (0.05, 2.0)
"""Bounds of the actions' standard deviation."""

DeviceName = Literal["cpu", "cuda", "warp-cpu"]
"""Compute device: MuJoCo on the processor; MuJoCo Warp and torch on a GPU; MuJoCo Warp on the processor."""

EngineName = Literal["mujoco", "physx", "ode", "ode-webots"]
"""Engines in which a policy can be trained: the shipped ones, for a run's configuration names no code."""

SymmetryName = Literal["none", "batches", "half", "network"]
LoggerName = Literal["tensorboard", "wandb", "trackio"]

LATENT = needs("--set network.latent above 0", lambda cfg: cfg.latent > 0)
"""Requirement of settings of f_ada."""


@dataclass(frozen=True)
class NetworkCfg:
    """Sizes of the networks. Small: on a CPU the update costs as much as the physics."""

    actor: tuple[int, ...] = (256, 128, 64)
    """Hidden layers of the actor."""
    critic: tuple[int, ...] = (256, 128)
    """Hidden layers of the critic."""
    critic_history: bool = False
    """True if the critic sees o_H too, as in the paper; its present frame is the last of o_H."""
    privileged: tuple[int, ...] = field(default=(64,), metadata=needs("--teacher.latent alternate or groups"))
    """Hidden layers of f_ada of the teacher, privileged observation -> z."""
    history_frame: int = field(default=24, metadata=LATENT)
    """Width to which every frame of the history is reduced first, by the same weights for all frames."""
    history: tuple[int, ...] = field(default=(64,), metadata=LATENT)
    """Hidden layers of f_ada of the student, after the frames."""
    recurrent: bool = field(default=False, metadata=LATENT)
    """True if a gated recurrent unit as wide as the first of network.history reads the frames for z* in turn, in place
    of an MLP over all of them."""
    estimator_frame: int = 24
    """Same as network.history_frame, for f_est."""
    estimator: tuple[int, ...] = (64,)
    """Hidden layers of f_est, after the frames."""
    terrain: tuple[int, ...] = field(default=(64, 32), metadata=needs(UNEVEN))
    """Hidden layers of the encoder of the elevation map."""
    terrain_latent: int = field(default=16, metadata=needs(UNEVEN))
    """Size of e_t*."""
    terrain_loss: bool = field(default=True, metadata=needs(UNEVEN))
    """True if L_hist = MSE(e_t*, f_hist(o_H)) trains f_hist in both phases; False: L_clone alone, as in the paper."""
    latent: int = 16
    """Size of z and z*; 0: the policy of one phase sees the present frame and its estimates alone."""
    initial_std: float = 0.8
    """Standard deviation of the first actions."""


@dataclass(frozen=True)
class TeacherCfg:
    """The first phase: PPO, and the supervised losses of adaptation and estimator."""

    latent: Annotated[Literal["alternate", "groups", "history"], FLAG] = "alternate"
    """`alternate`: z of the privileged encoder, and z* in every `alternate`-th iteration, as in the paper. `groups`: a
    share of the robots walks on z*, the rest on z (concurrent teacher and student, Wang et al. 2024). `history`: every
    robot walks on z*, and PPO's gradient trains its encoder: one phase without a teacher."""
    student_share: float = field(default=0.25, metadata=needs("--teacher.latent groups"))
    """Share of the robots on z*."""
    both_ways: Annotated[bool, FLAG] = False
    """True if L_ada trains the privileged encoder too, as in the paper: z becomes what a history can tell."""
    final_std: float | None = None
    """Bound of the actions' standard deviation in the last quarter of the phase, to which it falls on a straight line;
    by default free. Noise shakes joints loose: a policy trained with more of it may stand still without."""
    quiet: Annotated[int, FLAG] = field(
        default=0, metadata=needs("--teacher.iterations 4 or more", lambda cfg: cfg.iterations >= 4 or not cfg.quiet)
    )
    """Last iterations of one phase, of all at most a quarter, in which robots walk without noise, as deployed, and the
    estimator alone learns, with twice the passes and a step that falls to zero: while the policy changes, the estimate
    of velocity lags behind it."""
    iterations: Annotated[int, FLAG] = 700
    """Rollouts, each followed by an update."""
    steps: Annotated[int, FLAG] = 24
    """Control steps of one rollout."""
    epochs: int = 4
    """Passes over a rollout."""
    mini_batches: Annotated[int, FLAG] = 4
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
    alternate: int = field(default=4, metadata=needs("--teacher.latent alternate"))
    """z comes from the history (z*) in one iteration out of this many, else from the privileged
    encoder. The paper does not say how often; the public code it builds on uses 20."""
    adaptation_learning_rate: float = 1e-3
    """Learning rate of L_ada, L_est and, on terrain, L_hist."""
    adaptation_batches: int = 4
    """Gradient steps of these losses in a pass over the rollout, after each PPO update."""
    adaptation_passes: int = 1
    """Passes over the rollout."""
    velocity_weight: float = 1.0
    """Weight in L_est of the base's velocity, whose variance is a tenth of a contact's."""

    @property
    def quiet_from(self) -> int:
        """Iterations before the quiet ones."""
        return self.iterations - min(self.quiet, self.iterations // 4)


DISTILLED = needs("--student.algorithm distill")
"""Requirement of settings of distillation; PPO has those of the first phase."""


@dataclass(frozen=True)
class StudentCfg:
    """The second phase, from a warm start."""

    algorithm: Annotated[Literal["distill", "ppo"], FLAG] = "distill"
    """`distill`: behaviour cloning, with L_ada and L_est. `ppo`: the student's own z* and estimate are walked on and
    PPO's gradient trains its encoder, with the settings of the first phase."""
    iterations: Annotated[int, FLAG] = 240
    """Rollouts of the student, each followed by an update. 0: the policy of the first phase, on its z*, is the
    student."""
    noise: Annotated[Literal["all", "half", "drawn", "none"], FLAG] = field(default="all", metadata=DISTILLED)
    """Robots that walk with exploration noise: all, every second one, each with a drawn share of it, or none. The
    deployed policy walks without."""
    steps: Annotated[int, FLAG] = 24
    """Control steps of one rollout."""
    epochs: int = field(default=2, metadata=DISTILLED)
    """Passes over a rollout."""
    mini_batches: Annotated[int, FLAG] = field(default=4, metadata=DISTILLED)
    """Parts of one pass."""
    learning_rate: float = 5e-4
    """Learning rate, fixed in distillation, the first one in PPO."""
    adaptation_weight: float = field(default=0.1, metadata=DISTILLED)
    """Weight beside L_clone of L_ada, and of L_hist where there is terrain."""
    both_ways: bool = field(default=False, metadata=DISTILLED)
    """True if L_ada trains the student's copy of the privileged encoder too. The teacher that is cloned stays."""
    estimator_weight: float = field(default=0.5, metadata=DISTILLED)
    """Weight of L_est beside L_clone."""


@dataclass(frozen=True)
class StopCfg:
    """Target at which a phase ends before its last iteration. Off unless a tracking error is named.

    Figures are those of training: noisy, pushed, randomised, the tracking error some 0.1 m/s above that of an
    evaluation. The teacher does not end before the last stage of friction has begun and the noise is the least.
    """

    tracking_error: Annotated[float | None, flag("--stop-at-tracking-error")] = None
    """Mean tracking error under which a phase ends [m/s]; by default never, as in every comparison of methods."""
    iterations: int = 20
    """Iterations over which all figures are averaged."""
    falls: float = 0.01
    """Largest rate of falls that counts as none [1/s]: one in 100 s of walking with pushes."""
    terrain_level: float | None = None
    """Mean terrain level that must be reached as well; by default any."""

    def __post_init__(self) -> None:
        """Reject targets out of range, and one without effect."""
        if self.tracking_error is not None and not self.tracking_error > 0:
            raise ConfigurationError(f"stop.tracking_error is {self.tracking_error}; expected more than 0 m/s")
        if self.iterations < 1 or self.falls < 0:
            raise ConfigurationError(
                f"stop after {self.iterations} iterations with {self.falls} falls a second: expected at least 1 and 0"
            )
        if self.terrain_level is not None and self.tracking_error is None:
            raise ConfigurationError("stop.terrain_level has no effect by itself; say --stop-at-tracking-error too")


def check_counts(counts: Mapping[str, int], layers: Mapping[str, tuple[int, ...]]) -> None:
    """Raise `ConfigurationError` where a count, or number or size of layers, is out of range; both by their places."""
    counts = dict(counts)
    for name, sizes in layers.items():
        if not 1 <= len(sizes) <= MOST_LAYERS:
            raise ConfigurationError(f"{name} has {len(sizes)} layers; expected 1 to {MOST_LAYERS}")
        counts |= {f"{name}[{number}]": size for number, size in enumerate(sizes)}
    for name, count in counts.items():
        least, most = int(name not in MAY_BE_NONE), MOST_COUNTS.get(name.rpartition(".")[2], 10_000)
        if not least <= count <= most:
            raise ConfigurationError(f"{name} is {count}; expected at least {least}, and at most {most}")


@dataclass(frozen=True)
class TrainCfg:
    """One training run: a first phase by PPO, and where it has iterations a second one that makes the student."""

    task: TaskCfg = field(
        default_factory=TaskCfg, metadata=needs("--engine mujoco", parts=("physics",), but=("physics.friction",))
    )
    network: NetworkCfg = field(default_factory=NetworkCfg)
    teacher: TeacherCfg = field(default_factory=TeacherCfg)
    student: StudentCfg = field(
        default_factory=StudentCfg,
        metadata=needs("--student.iterations 1 or more", lambda cfg: cfg.student.iterations > 0, but=("iterations",)),
    )
    method_settings: Annotated[Any, FIXED] = None
    """Settings of the method, of `Method.settings`; by default, for a method that has some, their defaults."""
    num_envs: int = 512
    """Robots simulated side by side."""
    seed: int = 0
    """Seed of everything random in the run."""
    symmetry: SymmetryName = "none"
    """Left-right symmetry. `batches`: samples and mirror images, at twice the update's cost. `half`:
    at no cost, in half as many passes. `network`: networks symmetric by construction."""
    joints: str | None = None
    """A `joints.json` whose inertia, damping and friction become the robot's nominal ones."""
    actuator: str | None = field(
        default=None, metadata=excludes("--task.randomization.stiffness", "--task.randomization.action-delay")
    )
    """Folder of an Actuator Net, in place of the joints' PD law, gains and delay."""
    checkpoint_every: int = 50
    """Iterations between checkpoints."""
    device: DeviceName = "cpu"
    """Compute device. `cpu`: MuJoCo on all cores. `cuda`: MuJoCo Warp and the networks on a GPU; wants thousands of
    robots. `warp-cpu`: MuJoCo Warp on the processor, many times slower, to try it without a GPU."""
    engine: EngineName = "mujoco"
    """Physics engine. All but `mujoco` take a robot at a time, ten times slower and more, on flat
    ground: `--num-envs 256`. A run that goes on there begins with its robots at rest where they were."""
    contacts: Annotated[int, SETTING] = field(default=32, metadata=needs("--device cuda or warp-cpu"))
    """Largest number of contacts of a robot in MuJoCo Warp; more stop the run."""
    video_every: int = 0
    """Iterations between short clips of the policy, in `clips/`; 0: none. A process of its own renders each from a
    checkpoint in some seven seconds."""
    logger: LoggerName = "tensorboard"
    """Target of curves and clips. `wandb` and `trackio` are extras of their names; one that fails does not
    end the training, and metrics.jsonl is always written."""
    stop: StopCfg = field(
        default_factory=StopCfg,
        metadata=all_of(
            needs("--stop-at-tracking-error", lambda cfg: cfg.stop.tracking_error is not None, but=("tracking_error",)),
            needs("a longer phase, or fewer stop.iterations", lambda cfg: cfg.may_stop, parts=("tracking_error",)),
        ),
    )

    def __post_init__(self) -> None:
        """Validate all settings, before any folder is made."""
        self._complete()
        self._check_simulator()
        if self.symmetry == "network" and self.network.recurrent:
            raise ConfigurationError(
                "a recurrent encoder has no rule for --symmetry network, which the presets of one phase have; add "
                "--symmetry half"
            )
        if self.symmetry == "half" and self.teacher.epochs % 2:
            raise ConfigurationError(
                f"symmetry 'half' makes half of {self.teacher.epochs} passes; use an even number, --set teacher.epochs"
            )
        check_numbers(self)
        friction = self.task.friction
        if friction.level is None and self.joints is None and friction.has_friction and has_coefficient(friction.law):
            raise ConfigurationError(
                f"the friction law {friction.law!r} needs its coefficient; say --friction-level, or --joints with an "
                "identification that has a load_coefficient"
            )
        self._check_counts()
        self._check_rates()
        self._check_phases()
        if self.stop.terrain_level is not None and self.task.terrain.kind == "flat":
            raise ConfigurationError("stop.terrain_level is set, but flat ground has no terrain levels; leave it out")

    def _check_simulator(self) -> None:
        """Reject unknown names, and settings that the device or engine cannot simulate."""
        choices = {"device": DeviceName, "engine": EngineName, "symmetry": SymmetryName, "logger": LoggerName}
        for name, known in choices.items():
            if getattr(self, name) not in get_args(known):
                raise ConfigurationError(unknown_name(name, getattr(self, name), get_args(known)))
        if self.device != "cpu" and self.task.physics.plastic:
            raise ConfigurationError(
                f"MuJoCo Warp has no joints that yield, and --physics {self.task.physics.friction} needs them; use "
                f"--device cpu in place of {self.device}, or --physics rows"
            )
        if self.engine == "mujoco":
            return
        contact_time = self.task.randomization.contact_time
        lacking = {
            f"--device {self.device}": self.device != "cpu",
            f"--physics {self.task.physics.friction}": self.task.physics.plastic,
            f"--terrain {self.task.terrain.kind}": self.task.terrain.kind != "flat",
            "friction that grows with load": self.task.friction.loaded,
            f"--method {self.method.name}": self.method.acts_on_fleet,
            "--task.randomization.contact-time": contact_time != RandomizationCfg().contact_time,
        }
        for name in (name for name, asked in lacking.items() if asked):
            raise ConfigurationError(
                f"--engine {self.engine} cannot train with {name}; use --engine mujoco, or leave it out"
            )

    def name_of(self, phase: str) -> str:
        """Return the name of a phase for messages; the only phase of a training is its `policy`."""
        return phase if self.student.iterations else "policy"

    @property
    def may_stop(self) -> bool:
        """True if a phase, with the friction of the last stage, is longer than the mean of `stop`."""
        last = round(self.task.friction.last.begin * self.teacher.iterations)
        return self.stop.iterations < max(self.teacher.iterations - last, self.student.iterations)

    @property
    def method(self) -> Method:
        """Training method."""
        return find_method(self.task.friction.method)

    def _complete(self) -> None:
        """Give a method that has settings its defaults where none are given; reject those of another method."""
        kind, settings = self.method.settings, self.method_settings
        if settings is None and kind is not None:
            object.__setattr__(self, "method_settings", kind())
        elif settings is not None and type(settings) is not kind:
            wanted = "None: it has no settings" if kind is None else kind.__name__
            raise ConfigurationError(
                f"settings of the method {self.method.name!r}: got {type(settings).__name__}, expected {wanted}"
            )

    def _check_counts(self) -> None:
        """Reject counts out of range, and rollouts too short to be split."""
        phases: dict[str, TeacherCfg | StudentCfg] = {"teacher": self.teacher, "student": self.student}
        names = ("iterations", "steps", "epochs", "mini_batches")
        counts = {name: getattr(self, name) for name in ("num_envs", "checkpoint_every", "contacts")}
        counts |= {f"{phase}.{name}": getattr(cfg, name) for phase, cfg in phases.items() for name in names}
        more = ("adaptation_batches", "adaptation_passes", "alternate", "quiet")
        counts |= {f"teacher.{name}": getattr(self.teacher, name) for name in more}
        counts |= {f"network.{name}": getattr(self.network, name) for name in NETWORK_SIZES}
        check_counts(counts, {f"network.{name}": getattr(self.network, name) for name in LAYERS})
        self._check_halves()
        if self.video_every < 0:
            raise ConfigurationError(f"video_every: got {self.video_every}, expected iterations, or 0 for none")
        for phase, cfg in phases.items():
            samples = self.num_envs * cfg.steps
            # With `half` PPO has twice as many mini-batches, each of half as many originals.
            if samples < max(cfg.mini_batches, 2 * self.teacher.mini_batches * (self.symmetry == "half")):
                raise ConfigurationError(
                    f"{phase}: {samples} samples a rollout for {cfg.mini_batches} mini-batches; use more robots"
                )

    def _check_halves(self) -> None:
        """Reject layers that symmetric networks cannot split into left and right."""
        if self.symmetry != "network":
            return
        sizes: dict[str, int] = {}
        used = ["network.actor", "network.critic"]
        if self.method.even is not None:
            sizes |= self.method.even(self)
        else:
            names = ("history", "history_frame", "privileged", "latent", "estimator", "estimator_frame")
            used += [f"network.{name}" for name in names]
            used += [] if self.task.terrain.kind == "flat" else ["network.terrain", "network.terrain_latent"]
        for place in used:
            value = attrgetter(place)(self)
            each = enumerate(value) if isinstance(value, tuple) else ()
            sizes |= {f"{place}[{number}]": size for number, size in each} or {place: value}
        for name, size in sizes.items():
            if size % 2:
                raise ConfigurationError(
                    f"{name} is {size}, and a layer of {size} units has no left and right half; --symmetry network "
                    "needs even sizes"
                )

    def _check_rates(self) -> None:
        """Reject rates, weights and shares out of range."""
        teacher, student = self.teacher, self.student
        rates = (teacher.learning_rate, teacher.adaptation_learning_rate, student.learning_rate)
        if not (min(rates) > 0 and max(rates) <= 1 and self.seed >= 0):
            raise ConfigurationError(
                f"learning rates {rates}, seed {self.seed}: expected positive rates of at most 1 and a seed of at "
                "least 0"
            )
        for name in ("desired_kl", "gamma", "gae_lambda"):
            if not 0 < (share := getattr(teacher, name)) <= 1:
                raise ConfigurationError(f"teacher.{name} is {share}; expected more than 0 and at most 1")
        for name in ("teacher.entropy", "student.adaptation_weight", "student.estimator_weight"):
            if (weight := attrgetter(name)(self)) < 0:
                raise ConfigurationError(f"{name} is {weight}; expected at least 0")

    def _check_phases(self) -> None:
        """Reject settings of the phases that contradict each other."""
        teacher, student, one_phase = self.teacher, self.student, self.method.one_phase
        if one_phase and (teacher.latent != "history" or student.iterations):
            raise ConfigurationError(
                f"the method {self.task.friction.method!r} learns in one phase, not with --teacher.latent "
                f"{teacher.latent} and {student.iterations} iterations of a student; use --preset full or quick"
            )
        self.method.check(self)
        if student.iterations == 0 and teacher.latent != "history" and self.task.terrain.kind != "flat":
            raise ConfigurationError(
                "--student.iterations 0 is not allowed on terrain, which the teacher observes; use 1"
            )
        blind = teacher.latent == "history" or student.algorithm == "ppo"
        if self.task.terrain.kind != "flat" and blind and not one_phase:
            raise ConfigurationError(
                f"on terrain {self.task.terrain.kind!r} one phase, and PPO on the student, have no encoder of the "
                "ground to learn from; use --preset two-phase"
            )
        if teacher.latent == "history" and student.iterations and student.algorithm == "distill":
            raise ConfigurationError(
                f"with --teacher.latent history there is no teacher to distil for {student.iterations} iterations; "
                "use --student.iterations 0, or --student.algorithm ppo"
            )
        if teacher.latent == "history" and teacher.both_ways:
            raise ConfigurationError(
                "with --teacher.latent history there is no z for L_ada to train; leave both_ways out"
            )
        if not self.network.latent and teacher.latent != "history":
            raise ConfigurationError(
                f"network.latent is 0, and --teacher.latent {teacher.latent} is about a latent; add --set "
                "network.latent=16"
            )
        ended = teacher.latent == "history" and not student.iterations and not one_phase
        if teacher.quiet and not ended:
            raise ConfigurationError(
                f"--teacher.quiet {teacher.quiet} requires a training of one phase by RMA, at whose end the estimator "
                "learns alone; add --teacher.quiet 0"
            )
        if not 0.0 < teacher.student_share < 1.0:
            raise ConfigurationError(
                f"teacher.student_share is {teacher.student_share}; expected a share between 0 and 1"
            )
        low, high = STD_RANGE
        for name, std in (("teacher.final_std", teacher.final_std), ("network.initial_std", self.network.initial_std)):
            if std is not None and not low <= std <= high:
                raise ConfigurationError(f"{name} is {std}; expected a standard deviation from {low} to {high}")
        if teacher.final_std is not None and teacher.final_std > self.network.initial_std:
            raise ConfigurationError(
                f"teacher.final_std {teacher.final_std} is above network.initial_std {self.network.initial_std}: noise "
                "falls, it does not grow"
            )
        if not teacher.velocity_weight > 0:
            raise ConfigurationError(f"teacher.velocity_weight is {teacher.velocity_weight}; expected more than 0")

    def check_memory(self, robot: Robot) -> None:
        """Raise `StictionError` where the training needs more memory than the machine has; a GPU checks its own."""
        if self.device == "cuda":
            return
        samples = self.num_envs * max(self.teacher.steps, self.student.steps)
        frames = self.task.history * self.task.layout(robot).frame_size
        needed = TORCH + self.num_envs * SIMULATED + samples * 4 * (COPIES * frames + BESIDE)
        check_memory(
            needed,
            f"a rollout of {self.num_envs} robots over {samples // self.num_envs} steps",
            "use fewer --num-envs, fewer steps, or a shorter history",
        )
