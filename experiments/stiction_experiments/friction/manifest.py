"""Every run of the experiment, with the reason for it.

All conditions have one preset, without its clips: the same budget, no early stop. Three ask what three times as much
would do. They differ from `stiction train --preset PRESET --video-every 0` in the options that stand here and nothing
else. `designs`, `methods` and `cohort` are trained with presets of one phase, all others with `TWO_PHASE`, whose phases
they name.

The paper explains frozen training by friction that filters early actions. The first actions of saturn_lite ask for
kp · action scale · σ = 100 N m/rad · 0.25 rad · 0.8 = 20 N m, one standard deviation, against 5 N m (hip, thigh) and
9 N m (shank) of friction at level 0.2: by default they break away. Both sides of that are tried: `strong` with σ = 1.6
(40 N m), and with and without friction `weak` with σ = 0.15 (3.75 N m, less than the friction of every joint) and `mid`
with σ = 0.3 (7.5 N m, between that of hip and shank).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.joints.compensation import BY_SPEED
from stiction.learning.arguments import parse
from stiction.learning.config import TrainCfg

LEVEL = 0.2
"""Nominal dry friction of the experiment, a fraction of each joint's torque limit [-]."""

LOAD_COEFFICIENTS = (0.05, 0.2, 0.442)
"""Coefficients of the law `load` [-]: where walking begins to suffer and where it ends, for policies that never met the
law, and the number of the paper's Table III read as one."""

TWO_PHASE = "two-phase"
"""Preset of `stiction train` with which most parts are trained."""

ONE_PHASE = "quick"
"""Preset of the others; with `full` they have more of the same."""

PARTS = {
    "1": "The training methods, five seeds",
    "2": "The paper's other ways, more budget, more and less exploration",
    "3": "What makes the wide range work",
    "5": "Friction that grows with load",
    "6": "A quadruped, which can fall",
    "gait": "The gait rewards, without friction",
    "history": "Longer histories for the student",
    "literal": "The paper to the letter, trained in two engines",
    "designs": "How a student learns, at equal processor time",
    "methods": "Other papers' methods, friction with load, joints that differ",
    "cohort": "The training methods as the presets are since, every command, held-out seeds",
}
"""Part -> what it is about, in the order in which the parts are worth their time."""


ONE_PHASE_PARTS = ("designs", "methods", "cohort")
"""Parts that presets of one phase train, and `TWO_PHASE` does not."""


def parts_of(preset: str) -> list[str]:
    """Return the parts that are trained with a preset, in their order."""
    return [part for part in PARTS if (part in ONE_PHASE_PARTS) == (preset != TWO_PHASE)]


@dataclass(frozen=True)
class Condition:
    """One training method, and the seeds that it is trained with."""

    name: str
    """Name of its runs without `-s<seed>`."""
    part: str
    """One of `PARTS`."""
    purpose: str
    options: tuple[str, ...]
    """Words for `stiction train`, without preset, seed and folder."""
    seeds: tuple[int, ...] = (0,)

    @property
    def runs(self) -> tuple[Run, ...]:
        """One run a seed, with the first preset that trains it."""
        preset = ONE_PHASE if self.part in ONE_PHASE_PARTS else TWO_PHASE
        return tuple(Run(self, seed, preset) for seed in self.seeds)


@dataclass(frozen=True)
class Run:
    """One training run."""

    condition: Condition
    seed: int
    preset: str = TWO_PHASE

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.condition.name}-s{self.seed}"

    @property
    def arguments(self) -> tuple[str, ...]:
        """Words for `stiction train`, without the folder. Nobody looks at the clips of an experiment."""
        return "--preset", self.preset, *self.condition.options, "--seed", str(self.seed), "--video-every", "0"

    def configuration(self) -> TrainCfg:
        """Return what `stiction train` reads in the arguments: those of a condition once, for its seeds are fields."""
        return replace(_read(replace(self, seed=0).arguments), seed=self.seed)


@cache
def _read(arguments: tuple[str, ...]) -> TrainCfg:
    """Return the configuration of a command line; reading one takes longer than all else about a run."""
    return parse([*arguments]).config


def condition_of(run: str) -> tuple[str, int]:
    """Return condition and seed of a run's name: `coulomb20-none-s3` -> (`coulomb20-none`, 3).

    Raises `StictionError` for a name without a seed.
    """
    name, mark, seed = run.rpartition("-s")
    if not mark or not seed.isdecimal():
        raise ConfigurationError(f"{run!r} is no run of the experiment; expected CONDITION-s<SEED>")
    return name, int(seed)


def _coulomb(
    name: str, part: str, purpose: str, method: str, *options: str, seeds: int = 1, level: float = LEVEL
) -> Condition:
    words = ("--method", method, "--friction-level", f"{level:g}", *options)
    return Condition(f"coulomb20-{name}", part, purpose, words, tuple(range(seeds)))


def _load(coefficient: float, method: str) -> Condition:
    """Return a condition under the law `load`."""
    options = ("--method", method, "--friction-law", "load", "--friction-level", f"{coefficient:g}")
    return Condition(f"load{round(1000 * coefficient)}-{method}", "5", "the number as a coefficient of load", options)


LONG_STUDENT = ("--student.iterations", "240")
LONG = ("--teacher.iterations", "1050", *LONG_STUDENT)
"""Options of three times the budget."""

DESIGN_SEEDS, METHOD_SEEDS = (0, 1, 2, 3, 4), (0, 1)

COHORT_SEEDS = (10, 11, 12, 13, 14)
"""Seeds that nothing was chosen on."""

GROUND = "--task.randomization.contact-time"
SOFT = (GROUND, "0.02", "0.02")
"""Options of the ground on which designs and methods are compared: the simulator's own, as soft for every robot."""

DRAWN = (GROUND, "0.01", "0.03")
"""Options of ground of drawn softness, which is what came out best of the designs."""

QUIET = ("--teacher.quiet", "30")
"""Options of a training that ends with quiet iterations."""


COMPARED = (
    *("--set", "task.first_side=false", "--set", "task.randomization.standing_start=0"),
    *("--set", "task.commands.forward=[-0.8, 0.8]", "--set", "task.commands.sideways=[-0.3, 0.3]"),
    *("--set", "task.commands.turn=[-0.6, 0.6]", "--set", "network.latent=16"),
    *(*SOFT, "--physics", "plastic", "--teacher.quiet", "0"),
)
"""Options with which designs and methods are compared, whatever the presets have since."""


def _over(before: tuple[str, ...], options: tuple[str, ...]) -> tuple[str, ...]:
    """Return words of options, of two that set the same the one in `options`."""
    named: dict[str, list[str]] = {}
    for word in (*before, *options):
        if word.startswith("--"):
            words = [word]
            if word != "--set":
                named[word] = words
        else:
            if words == ["--set"]:
                named[word.partition("=")[0]] = words
            words.append(word)
    return tuple(chain.from_iterable(named.values()))


def _design(name: str, purpose: str, *options: str) -> Condition:
    """Return a way for a student to learn, with `deception`; its iterations are as many as those of one phase."""
    return replace(_coulomb(name, "designs", purpose, "deception", *_over(COMPARED, options)), seeds=DESIGN_SEEDS)


def _method(name: str, purpose: str, method: str, *options: str) -> Condition:
    """Return another method of one phase, or another friction."""
    return replace(_coulomb(name, "methods", purpose, method, *_over(COMPARED, options)), seeds=METHOD_SEEDS)


DEARER = ("--teacher.iterations", "333")
"""Options of a design whose update costs twice, at the processor time of 440 iterations: an update is 0.48 of the 1.49
seconds of an iteration (results/speed)."""

RECURRENT = ("--teacher.iterations", "290")
"""Options of a recurrent encoder at that time: an iteration takes 3.2 processor seconds where one without takes 2.2."""

PASSES = ("--teacher.iterations", "393")
"""Options of four supervised passes at that time: each takes 0.087 of the 2.20 seconds of an iteration."""

PHASES = ("--teacher.latent", "alternate", "--teacher.iterations", "360", "--student.iterations", "80")
"""Options of teacher and student in the budget of one phase."""

WIDE = ("--task.friction.range", "0", "1.2")
"""Options that give a method the friction of `deception`."""

LITERAL = (
    *("--method", "deception", "--friction-level", "0.01", "--task.friction.per", "joint", "--teacher.both-ways"),
    *("--set", "task.randomization.action_delay=[0, 0]", "--set", "task.randomization.encoder_offset=[0, 0]"),
    *("--set", "task.noise.angular_velocity=0", "--set", "task.noise.roll_pitch=0"),
    *("--set", "task.noise.joint_position=0", "--set", "task.noise.joint_velocity=0"),
    *("--physics", "rows"),
)
"""Options by which the preset `two-phase`, with the budget of all conditions, takes the paper at its word where the
preset `paper` does what works better: L_ada trains both encoders, the table has no noise, every joint has friction of
its own, and there is as much of it as was measured, 1 % of the torque limit."""

NO_TROT, NO_UNSYNC = ("--set", "task.rewards.trot=0"), ("--set", "task.rewards.unsync=0")

MANIFEST: tuple[Condition, ...] = (
    _coulomb("none", "1", "conventional randomisation", "none", seeds=5),
    _coulomb("direct", "1", "0.8 to 1.2 of the nominal friction", "direct", seeds=5),
    _coulomb("deception", "1", "0 to 1.2 of it", "deception", seeds=5),
    _coulomb("finetune", "2", "half the budget without friction, then all of it at once", "finetune"),
    _coulomb("iterative", "2", "half the budget without friction, then four steps", "iterative"),
    _coulomb("compensation", "2", f"{BY_SPEED.share:g} of the nominal friction added to the command", "compensation"),
    _coulomb("direct-long", "2", "three times the budget: slow, or stuck?", "direct", *LONG),
    _coulomb("deception-long", "2", "the same for the wide range", "deception", *LONG),
    _coulomb(
        *("deception-student240", "2", "three times the student's budget: does it overshoot less?", "deception"),
        *LONG_STUDENT,
    ),
    _coulomb("direct-strong", "2", "first actions of 40 N m (σ)", "direct", "--set", "network.initial_std=1.6"),
    _coulomb("direct-weak", "2", "first actions of 3.75 N m (σ)", "direct", "--set", "network.initial_std=0.15"),
    _coulomb("none-weak", "2", "the same, without friction", "none", "--set", "network.initial_std=0.15"),
    _coulomb("direct-mid", "2", "first actions of 7.5 N m (σ)", "direct", "--set", "network.initial_std=0.3"),
    _coulomb("none-mid", "2", "the same, without friction", "none", "--set", "network.initial_std=0.3"),
    _coulomb("narrow", "3", "the mean of deception, no easy robots", "direct", "--task.friction.range", "0.48", "0.72"),
    _coulomb("mean-kept", "3", "easy robots, mean kept: 0 to 2", "deception", "--task.friction.range", "0", "2"),
    _coulomb(
        *("mixture", "3", "one robot in five without friction, the rest with the nominal one", "deception"),
        *("--task.friction.mixture", "0.2", "0", "0", "0.8", "1", "1"),
    ),
    _coulomb("deception-joint", "3", "drawn for each joint", "deception", "--task.friction.per", "joint"),
    *(_load(coefficient, method) for coefficient in LOAD_COEFFICIENTS for method in ("direct", "deception")),
    *(
        Condition(
            f"literal01-{engine}", "literal", f"the paper to the letter, in {engine}", (*LITERAL, "--engine", engine)
        )
        for engine in ("mujoco", "physx")
    ),
    Condition(
        *("effort442-direct", "5", "the paper's number as a coefficient of the motor's torque"),
        ("--method", "direct", "--friction-law", "effort", "--friction-level", "0.442"),
    ),
    _coulomb(
        *("load-beside", "5", "friction up to 10 % of the limit, and up to 0.1 of the load beside it", "deception"),
        *("--task.friction.range", "0", "0.5", "--task.friction.load", "0", "0.1"),
    ),
    _coulomb(
        *("deception-spread", "3", "joints differ by half about their robot's mean", "deception"),
        *("--task.friction.spread", "0.5", "1.5"),
    ),
    *(
        replace(_coulomb(method, "6", "a quadruped", method, "--robot", "go1"), name=f"go1-coulomb20-{method}")
        for method in ("none", "direct", "deception")
    ),
    _coulomb("none-notrot", "gait", "without r_trot", "none", *NO_TROT),
    _coulomb("none-nounsync", "gait", "without r_unsync", "none", *NO_UNSYNC),
    _coulomb("none-nogait", "gait", "without both", "none", *NO_TROT, *NO_UNSYNC),
    _design("known", "one phase, told its joints' friction", "--task.known-friction"),
    _design("known-drawn", "the same, ground of drawn softness", "--task.known-friction", *DRAWN),
    _design("quiet", "ground of drawn softness, quiet iterations at the end", *DRAWN, *QUIET),
    _design("known-quiet", "the same, told its joints' friction", "--task.known-friction", *DRAWN, *QUIET),
    _design("rows", "quiet iterations, friction by the solver's rows", *DRAWN, *QUIET, "--physics", "rows"),
    _design("rows-loud", "the same, without quiet iterations", *DRAWN, "--physics", "rows"),
    _design("slow-means", "one phase, means over a second as inputs", "--task.slow-means", "1"),
    _design("drawn-contact", "one phase, ground of drawn softness", *DRAWN),
    _design(
        *("fine-contact", "the same, stiffer ground and half the physics step", "--set", "task.timestep=0.0025"),
        *("--set", "task.decimation=8", GROUND, "0.005", "0.02"),
    ),
    _design(
        *("recurrent", "one phase, a recurrent encoder", "--set", "network.recurrent=true", "--symmetry", "half"),
        *RECURRENT,
    ),
    _design("groups", "teacher and student side by side, one actor", "--teacher.latent", "groups"),
    _design("alternate", "the paper's two phases in the budget of one", *PHASES),
    _design("both-ways", "the same, L_ada through both encoders", *PHASES, "--teacher.both-ways"),
    _design(
        "half-noise", "the same, half of the student's robots walk without noise", *PHASES, "--student.noise", "half"
    ),
    _design("drawn-noise", "the same, each robot with noise of its own", *PHASES, "--student.noise", "drawn"),
    _design(
        *("ppo-student", "two phases, PPO in the second on the student's own z*", "--teacher.latent", "alternate"),
        *("--teacher.iterations", "300", "--student.algorithm", "ppo", "--student.iterations", "140"),
    ),
    _design(
        *("estimate-weight1", "one phase, velocity weighs as a contact does in L_est"),
        *("--set", "teacher.velocity_weight=1"),
    ),
    _design(
        *("estimate-narrow", "one phase, the estimator as wide as that of two phases"),
        *("--set", "network.estimator_frame=24", "--set", "network.estimator=[64]"),
    ),
    _design(
        *("estimate-passes4", "one phase, four supervised passes a rollout", "--set", "teacher.adaptation_passes=4"),
        *PASSES,
    ),
    _design("asymmetric", "one phase, nothing says left from right", "--symmetry", "none"),
    _design("mirrored-half", "the same, half of each mini-batch mirrored, at no cost", "--symmetry", "half"),
    _design("mirrored", "the same, every sample also mirrored, fewer iterations", "--symmetry", "batches", *DEARER),
    _method("dreamwaq", "DreamWaQ as in its paper, without dry friction", "dreamwaq"),
    _method("dreamwaq-friction", "DreamWaQ with the friction of deception", "dreamwaq", *WIDE),
    *(
        _method(f"dreamwaq-beta{beta}", f"the same, beta {beta}", "dreamwaq", *WIDE, "--set", f"dreamwaq.beta={beta}")
        for beta in ("0", "0.1", "1")
    ),
    *(
        _method(f"hinf-{name}", purpose, "hinf", *WIDE, *options)
        for name, purpose, *options in (
            ("force", "H∞ beside a disturber that pushes the base"),
            ("joints", "H∞ beside a disturber that adds to friction", "--set", "hinf.disturber=friction"),
            ("random", "PPO under random pushes", "--set", "hinf.disturber=random"),
            ("random-joints", "PPO under random torques of friction's size", "--set", "hinf.disturber=random-friction"),
            (
                *("random-curriculum", "PPO under random pushes that grow over half of the training"),
                *("--set", "hinf.disturber=random", "--set", "hinf.curriculum=0.5"),
            ),
            ("curriculum", "H∞, the push grows over half of the training", "--set", "hinf.curriculum=0.5"),
            (
                *("gentle", "the same, a fifth of the weight at most"),
                *("--set", "hinf.limit=0.2", "--set", "hinf.curriculum=0.5"),
            ),
            ("eta0", "H∞, every cost counts", "--set", "hinf.eta=0"),
            ("nobody", "PPO as H∞ has it, and nobody disturbs", "--set", "hinf.disturber=none"),
        )
    ),
    _method(
        *("compensated", f"{BY_SPEED.share:g} of the nominal friction fed forward by the measured speed"),
        "compensation",
    ),
    _method(
        "spread", "joints differ by half about their robot's mean", "deception", "--task.friction.spread", "0.5", "1.5"
    ),
    _method(
        *("with-load", "friction up to 10 % of the limit, and up to 0.1 of the load beside it", "deception"),
        *("--task.friction.range", "0", "0.5", "--task.friction.load", "0", "0.1"),
    ),
    _method(
        *("rows-load-spread", "as the presets: the same, and joints that differ by half", "deception"),
        *("--task.friction.range", "0", "0.5", "--task.friction.load", "0", "0.1"),
        *("--task.friction.spread", "0.5", "1.5", *DRAWN, *QUIET, "--physics", "rows"),
    ),
    # The set that runs from t - H to t has H + 1 frames.
    _coulomb("deception-history20", "history", "H = 20 in place of 10", "deception", "--set", "task.history=21"),
    _coulomb("deception-history50", "history", "H = 50", "deception", "--set", "task.history=51"),
    *(
        replace(_coulomb(f"cohort-{name}", "cohort", purpose, *words), seeds=COHORT_SEEDS)
        for name, purpose, *words in (
            ("none", "conventional randomisation", "none"),
            ("direct", "0.8 to 1.2 of the nominal friction", "direct"),
            ("deception", "0 to 1.2 of it", "deception"),
            ("told", "the same, told its joints' friction", "deception", "--task.known-friction"),
        )
    ),
)
"""The conditions in the order in which they are trained."""


def runs_of(parts: Collection[str], preset: str = TWO_PHASE) -> list[Run]:
    """Return the runs of some parts, of all that the preset has where none is named: part by part, in each part seed by
    seed. So an experiment that is cut short has the same seeds of every condition.

    Raises `StictionError` for a part that does not exist, or is not trained with this preset.
    """
    order = list(PARTS)
    if unknown := [part for part in parts if part not in order]:
        raise ConfigurationError(unknown_name("part", unknown[0], order))
    own = parts_of(preset)
    if others := [part for part in parts if part not in own]:
        raise ConfigurationError(
            f"part {others[0]} is not trained with the preset {preset!r}; expected parts of {', '.join(own)}, or "
            f"--preset {ONE_PHASE if preset == TWO_PHASE else TWO_PHASE}"
        )
    asked = parts or own
    chosen = [replace(run, preset=preset) for one in MANIFEST if one.part in asked for run in one.runs]
    return sorted(chosen, key=lambda run: (order.index(run.condition.part), run.seed))
