"""Every run of the experiment, with the reason for it. Data; what is computed from it stands elsewhere.

All conditions have the preset `two-phase`, without its clips: the same budget, no early stop. Three ask what three
times as much would do. They differ from `stiction train --preset two-phase --video-every 0` in the options that stand
here and in nothing else.

The paper explains frozen training by friction that filters early actions. The first actions of saturn_lite ask for
kp · action scale · σ = 100 N m/rad · 0.25 rad · 0.8 = 20 N m, one standard deviation, against 5 N m (hip, thigh) and
9 N m (shank) of friction at level 0.2: by default they break away. So both sides of that are tried: `strong` with
σ = 1.6 (40 N m, four to eight times the friction; PPO, whose entropy bonus stays as it is, has 1.47 after 60
iterations), and `weak` with σ = 0.15 (3.75 N m, less than the friction of every joint), beside `weak` without friction,
to tell weak exploration itself from friction that filters it. Both `weak` stood still, so there is `mid`, σ = 0.3
(7.5 N m, between the friction of hip and shank), with and without friction.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from stiction.formats.errors import StictionError

LEVEL = 0.2
"""Nominal dry friction of the experiment, a fraction of each joint's torque limit [-]."""

LOAD_COEFFICIENTS = (0.05, 0.2, 0.442)
"""Coefficients of the law `load` [-]: where walking begins to suffer and where it ends, for policies that never met the
law (mean friction 3 and 12 N m a joint), and the number of the paper's Table III read as one."""

PARTS = {
    "1": "The ways to train with friction, five seeds",
    "2": "The paper's other ways, more budget, more and less exploration",
    "3": "What makes the wide range work",
    "4": "Which number predicts the onset",
    "5": "Friction that grows with load",
    "6": "A quadruped, which can fall",
    "gait": "The gait rewards, without friction",
    "history": "Longer histories for the student",
}
"""Part -> what it is about, in the order in which the parts are worth their time."""


@dataclass(frozen=True)
class Condition:
    """One way to train, and the seeds that it is trained with."""

    name: str
    """Name of its runs without `-s<seed>`."""
    part: str
    """Part of the experiment, see `PARTS`."""
    purpose: str
    """Why it is there."""
    options: tuple[str, ...]
    """Words for `stiction train`, without preset, seed and folder."""
    seeds: tuple[int, ...] = (0,)
    """Seeds of its runs."""

    @property
    def runs(self) -> tuple[Run, ...]:
        """One run a seed."""
        return tuple(Run(self, seed) for seed in self.seeds)


@dataclass(frozen=True)
class Run:
    """One training run."""

    condition: Condition
    """What it is a sample of."""
    seed: int
    """Seed of everything random in it."""

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.condition.name}-s{self.seed}"

    @property
    def arguments(self) -> tuple[str, ...]:
        """Words for `stiction train`, without the folder. Nobody looks at the clips of an experiment."""
        return "--preset", "two-phase", *self.condition.options, "--seed", str(self.seed), "--video-every", "0"


def condition_of(run: str) -> tuple[str, int]:
    """Return condition and seed of a run's name: `coulomb20-none-s3` -> (`coulomb20-none`, 3).

    Raises `StictionError` for a name without a seed.
    """
    name, mark, seed = run.rpartition("-s")
    if not mark or not seed.isdecimal():
        raise StictionError(f"{run!r} is no run of the experiment; expected CONDITION-s<SEED>")
    return name, int(seed)


def _coulomb(name: str, part: str, purpose: str, method: str, *options: str, seeds: int = 1) -> Condition:
    """Return a condition with Coulomb friction at the experiment's level."""
    words = ("--method", method, "--friction-level", f"{LEVEL:g}", *options)
    return Condition(f"coulomb20-{name}", part, purpose, words, tuple(range(seeds)))


def _load(coefficient: float, method: str) -> Condition:
    """Return a condition with friction c (|F| + |T|)."""
    options = ("--method", method, "--friction-law", "load", "--friction-level", f"{coefficient:g}")
    return Condition(f"load{round(1000 * coefficient)}-{method}", "5", "the number as a coefficient of load", options)


def _variant(short: str, robot: str, level: float, method: str) -> Condition:
    """Return a condition with another robot at the same friction in N m."""
    options = ("--method", method, "--friction-level", f"{level:g}", "--robot", robot)
    return Condition(f"coulomb20-{method}-{short}", "4", f"{robot}, the same friction in N m", options)


MANIFEST: tuple[Condition, ...] = (
    _coulomb("none", "1", "conventional randomisation", "none", seeds=5),
    _coulomb("direct", "1", "0.8 to 1.2 of the nominal friction", "direct", seeds=5),
    _coulomb("deception", "1", "0 to 1.2 of it", "deception", seeds=5),
    _coulomb("finetune", "2", "half the budget without friction, then all of it at once", "finetune"),
    _coulomb("iterative", "2", "half the budget without friction, then four steps", "iterative"),
    _coulomb("compensation", "2", "the nominal friction added to the command", "compensation"),
    _coulomb(
        *("direct-long", "2", "three times the budget: slow, or stuck?", "direct"),
        *("--teacher.iterations", "1050", "--student.iterations", "240"),
    ),
    _coulomb(
        *("deception-long", "2", "the same for the wide range", "deception"),
        *("--teacher.iterations", "1050", "--student.iterations", "240"),
    ),
    _coulomb(
        *("deception-student240", "2", "three times the student's budget: does it overshoot less?", "deception"),
        *("--student.iterations", "240"),
    ),
    _coulomb("direct-strong", "2", "first actions of 40 N m (σ)", "direct", "--network.initial-std", "1.6"),
    _coulomb("direct-weak", "2", "first actions of 3.75 N m (σ)", "direct", "--network.initial-std", "0.15"),
    _coulomb("none-weak", "2", "the same, without friction", "none", "--network.initial-std", "0.15"),
    _coulomb("direct-mid", "2", "first actions of 7.5 N m (σ)", "direct", "--network.initial-std", "0.3"),
    _coulomb("none-mid", "2", "the same, without friction", "none", "--network.initial-std", "0.3"),
    _coulomb("narrow", "3", "the mean of deception, no easy robots", "direct", "--task.friction.range", "0.48", "0.72"),
    _coulomb("mean-kept", "3", "easy robots, mean kept: 0 to 2", "deception", "--task.friction.range", "0", "2"),
    _coulomb(
        *("mixture", "3", "one robot in five without friction, the rest with the nominal one", "deception"),
        *("--task.friction.mixture", "0.2", "0", "0", "0.8", "1", "1"),
    ),
    _coulomb("deception-joint", "3", "drawn for each joint", "deception", "--task.friction.per", "joint"),
    *(_variant("kp05", "saturn_lite@kp=0.5", LEVEL, method) for method in ("direct", "deception")),
    *(_variant("kp2", "saturn_lite@kp=2", LEVEL, method) for method in ("direct", "deception")),
    *(_variant("torque2", "saturn_lite@torque=2", LEVEL / 2, method) for method in ("direct", "deception")),
    *(_load(coefficient, method) for coefficient in LOAD_COEFFICIENTS for method in ("direct", "deception")),
    *(
        Condition(
            *(f"go1-coulomb20-{method}", "6", "a quadruped"),
            ("--method", method, "--friction-level", f"{LEVEL:g}", "--robot", "go1"),
        )
        for method in ("none", "direct", "deception")
    ),
    _coulomb("none-notrot", "gait", "without r_trot", "none", "--task.rewards.trot", "0"),
    _coulomb("none-nounsync", "gait", "without r_unsync", "none", "--task.rewards.unsync", "0"),
    _coulomb(
        *("none-nogait", "gait", "without both", "none"),
        *("--task.rewards.trot", "0", "--task.rewards.unsync", "0"),
    ),
    # The set that runs from t - H to t has H + 1 frames.
    _coulomb("deception-history20", "history", "H = 20 in place of 10", "deception", "--task.history", "21"),
    _coulomb("deception-history50", "history", "H = 50", "deception", "--task.history", "51"),
)
"""The conditions in the order in which they are trained."""


def runs_of(parts: Collection[str]) -> list[Run]:
    """Return the runs of some parts, of all where none is named: part by part, and in each part seed by seed.

    So an experiment that is cut short has the same seeds of every condition.

    Raises `StictionError` for a part that does not exist.
    """
    unknown = [part for part in parts if part not in PARTS]
    if unknown:
        raise StictionError(f"part {unknown[0]!r} is none of the experiment's; expected one of {', '.join(PARTS)}")
    chosen = [run for condition in MANIFEST if not parts or condition.part in parts for run in condition.runs]
    order = list(PARTS)
    return sorted(chosen, key=lambda run: (order.index(run.condition.part), run.seed))
