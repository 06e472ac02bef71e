"""`--method hinf`, its settings (who disturbs, how strongly, what the policy owes for it) and its record. No torch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from stiction.core.effects import all_of, needs
from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.provenance import stream_seed
from stiction.files.contract import Contract
from stiction.files.method import Method
from stiction.learning.config import TrainCfg, check_counts

JOINT_DISTURBERS = ("friction", "random-friction")
"""Disturbers of joints, which need friction to be bounded by, and not of the base."""

DisturberName = Literal["none", "random", "random-friction", "force", "friction"]
"""Kind of disturber, see `HinfCfg.disturber`."""

MOST_FORCE, MOST_FRICTION = 0.5, 1.0
"""Largest `HinfCfg.limit` of a force, as a share of the robot's weight, and of torques, of the joint's friction."""

DISTURBED = needs("a --set hinf.disturber with a limit above 0", lambda cfg: cfg.disturbs)
LEARNT = all_of(DISTURBED, needs("--set hinf.disturber=force or friction", lambda cfg: cfg.learns))
DRAWN = all_of(DISTURBED, needs("--set hinf.disturber=random or random-friction", lambda cfg: not cfg.learns))
"""Requirements of fields of `HinfCfg` that act with a disturber, one that learns, one that draws."""


@dataclass(frozen=True)
class HinfCfg:
    """The disturber of `--method hinf` and its constraint, see `stiction_experiments.methods.hinf_ppo`.

    The authors' code was never released. What is theirs: a disturber that learns beside the actor, the cost as the
    distance of the task's reward from the best one, the bound η on cost over disturbance, λ by dual ascent. All numbers
    here are choices of this project, and none has been tuned.
    """

    disturber: DisturberName = "force"
    """`force`: pushes the base, forward, sideways and up, and learns to. `friction`: a torque on each joint that its
    own Coulomb friction bounds, and learns it: ours. `random`, `random-friction`: the same, drawn, without a
    constraint. `none`: nobody disturbs, which is plain PPO bit for bit."""
    limit: float | None = field(
        default=None, metadata=needs("a --set hinf.disturber", lambda cfg: cfg.disturber != "none")
    )
    """Largest disturbance: of a force as a share of the robot's weight, of torques as a share of the friction that the
    joint has at that time, on top of which they come; by default half of the weight, all of the friction. 0: as
    `none`."""
    curriculum: float = field(default=0.0, metadata=DISTURBED)
    """Share of the iterations over which the limit grows to its value on a straight line. 0: it is there at once."""
    hold: float = field(default=0.5, metadata=DRAWN)
    """Mean time for which `random` and `random-friction` keep what they have drawn [s]: a force that is drawn anew at
    every step cancels itself."""
    eta: float = field(default=2.0, metadata=LEARNT)
    """First η: the cost that a whole disturbance may cause, where a cost of 1 is all lost that the task pays. Two:
    nothing is asked of the policy at first, until η is tightened. 0: every cost counts, however large the disturbance.
    """
    tightening: float = field(
        default=0.99, metadata=all_of(LEARNT, needs("--set hinf.eta above 0", lambda cfg: cfg.eta > 0))
    )
    """Factor on η after every iteration in which the constraint holds. 1: η stays."""
    multiplier_rate: float = field(default=0.05, metadata=LEARNT)
    """Step of λ by the constraint's mean, once an iteration. 0: λ stays 0, plain PPO against the disturber."""
    actor: tuple[int, ...] = field(default=(128, 64), metadata=LEARNT)
    """Hidden layers of the disturber."""
    critic: tuple[int, ...] = field(default=(128, 64), metadata=LEARNT)
    """Hidden layers of the critic of h."""
    learning_rate: float = field(default=5e-4, metadata=LEARNT)
    """Learning rate of the disturber and the critic of h, fixed."""
    entropy: float = field(default=0.002, metadata=LEARNT)
    """Weight of the disturber's entropy bonus."""
    initial_std: float = field(default=0.5, metadata=LEARNT)
    """Standard deviation of the first disturbances, in units of the limit."""

    def __post_init__(self) -> None:
        """Refuse unknown names and numbers out of range."""
        check_counts({}, {f"hinf.{name}": getattr(self, name) for name in ("actor", "critic")})
        if self.disturber not in get_args(DisturberName):
            raise ConfigurationError(unknown_name("disturber", self.disturber, get_args(DisturberName)))
        most = self.most
        if self.limit is not None and not 0 <= self.limit <= most:
            unit = "the joint's friction" if self.by_torque else "the robot's weight"
            raise ConfigurationError(f"disturber of up to {self.limit}: expected a share of {unit} from 0 to {most:g}")
        for name, low, high in (
            ("curriculum", 0.0, 1.0),
            ("hold", 1e-3, 100.0),
            ("eta", 0.0, 1e3),
            ("multiplier_rate", 0.0, 1e3),
            ("entropy", 0.0, 10.0),
            ("initial_std", 0.1, 1.0),
        ):
            if not low <= getattr(self, name) <= high:
                raise ConfigurationError(f"hinf.{name} is {getattr(self, name)}; expected {low:g} to {high:g}")
        for name in ("tightening", "learning_rate"):
            if not 0 < getattr(self, name) <= 1:
                raise ConfigurationError(f"hinf.{name} is {getattr(self, name)}; expected more than 0 and at most 1")

    @property
    def by_torque(self) -> bool:
        """Return whether joints are disturbed, and not the base."""
        return self.disturber in JOINT_DISTURBERS

    @property
    def most(self) -> float:
        """Largest limit."""
        return MOST_FRICTION if self.by_torque else MOST_FORCE

    @property
    def share(self) -> float:
        """The limit as a number."""
        return self.most if self.limit is None else self.limit

    @property
    def disturbs(self) -> bool:
        """Return whether a disturber acts."""
        return self.disturber != "none" and self.share > 0

    @property
    def learns(self) -> bool:
        """Return whether the disturber learns, and the constraint with it."""
        return self.disturbs and self.disturber in ("force", "friction")


def _algorithm(cfg: TrainCfg) -> dict[str, Any]:
    algorithm = {"class_name": "stiction_experiments.methods.hinf_ppo:HinfPPO", "hinf": cfg.method_settings}
    return algorithm | {"iterations": cfg.teacher.iterations, "seed": stream_seed(cfg.seed, "disturber")}


def _check(cfg: TrainCfg) -> None:
    """Reject terrain, and a disturber of joints without friction."""
    if cfg.task.terrain.kind != "flat":
        raise ConfigurationError(
            f"the method 'hinf' learns in one phase, on flat ground alone, not on {cfg.task.terrain.kind!r}; "
            "leave --terrain out"
        )
    settings = cfg.method_settings
    if settings.by_torque and settings.disturbs and not cfg.task.friction.has_friction:
        raise ConfigurationError(
            f"--set hinf.disturber={settings.disturber} is bounded by the joints' friction, and there is none; say "
            "--task.friction.range 0 1.2"
        )


def _preset(cfg: TrainCfg) -> TrainCfg:
    """Return a preset without quiet iterations: more than an estimator learns beside the policy."""
    return replace(cfg, teacher=replace(cfg.teacher, quiet=0))


def _notes(cfg: TrainCfg) -> Iterator[str]:
    settings = cfg.method_settings
    if not cfg.task.friction.has_friction:
        yield "hinf trains without dry friction; with: --task.friction.range 0 1.2"
    if 0 < settings.curriculum * cfg.teacher.iterations <= 1:
        yield f"--set hinf.curriculum={settings.curriculum:g} is one iteration at most: the limit is there at once"
    half = not settings.by_torque and settings.share == settings.most
    if settings.disturbs and half and not settings.curriculum:
        # Two trainings each, results/methods at revision 8d1420b5.
        measured = "none of two walked both ways so, and two of two with --set hinf.curriculum=0.5"
        yield f"hinf pushes with half of the weight from the first iteration on: {measured}"


def _contract(cfg: TrainCfg) -> dict[str, Any]:
    """Return who disturbed, a field of the contract."""
    return {"disturber": cfg.method_settings.disturber if cfg.method_settings.disturbs else None}


NAMES = {
    "force": ("hinf", "H∞: beside a disturber that learns to push the base"),
    "friction": ("hinf-joints", "H∞: beside a disturber that learns torques within each joint's friction"),
    "random": ("hinf-random", "PPO under random pushes of the base, to compare H∞ with"),
    "random-friction": ("hinf-random-joints", "PPO under random torques within each joint's friction, to compare"),
    None: ("hinf-nobody", "PPO as H∞ has it, and nobody disturbs"),
}
"""Disturber -> name in results, and what it is."""

WITH_FRICTION = "-friction"
"""Suffix of those of `NAMES` that need no friction in training and had some."""

_PUSHED = [names for kind, names in NAMES.items() if kind not in JOINT_DISTURBERS]


def _called(contract: Contract) -> str:
    """Return the name in results, by who disturbed, and whether there was friction."""
    name = NAMES[contract.disturber][0] if contract.disturber in NAMES else METHOD.name
    return f"{name}{WITH_FRICTION}" if contract.met_friction and contract.disturber not in JOINT_DISTURBERS else name


METHOD = Method(
    "hinf",
    "H∞: disturbed while it learned, by pushes or by torques in its joints; without dry friction in the joints unless "
    "a range is named",
    settings=HinfCfg,
    one_phase=True,
    algorithm=_algorithm,
    acts_on_fleet=True,
    check=_check,
    preset=_preset,
    notes=_notes,
    contract=_contract,
    called=_called,
    names={
        **{name: f"{text}; without friction" for name, text in _PUSHED},
        **{f"{name}{WITH_FRICTION}": f"{text}; with friction" for name, text in _PUSHED},
        **{NAMES[kind][0]: f"{NAMES[kind][1]}, with friction" for kind in JOINT_DISTURBERS},
    },
)
