"""Configuration of `--method hinf`: who disturbs, how strongly, and what the policy owes for it. No torch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Literal, get_args

from stiction.core.errors import ConfigurationError, unknown_name
from stiction.files.contract_rules import JOINT_DISTURBERS

DisturberName = Literal["none", "random", "random-friction", "force", "friction"]
"""Who disturbs, see `HinfCfg.disturber`."""

MOST_FORCE, MOST_FRICTION = 0.5, 1.0
"""Largest `HinfCfg.limit` of a force, as a share of the robot's weight, and of torques, of the joint's friction."""

LEARNT = ("eta", "tightening", "multiplier_rate", "actor", "critic", "learning_rate", "entropy", "initial_std")
"""Fields of `HinfCfg` that only a disturber which learns has a use for."""


@dataclass(frozen=True)
class HinfCfg:
    """The disturber of `--method hinf` and its constraint, see `stiction.learning.hinf`.

    The authors' code was never released. What is theirs: a disturber that learns beside the actor, the cost as the
    distance of the task's reward from the best one, the bound η on cost over disturbance, λ by dual ascent. All numbers
    here are choices of this project, and none has been tuned.
    """

    disturber: DisturberName = "force"
    """`force`: pushes the base, forward, sideways and up, and learns to. `friction`: a torque on each joint that its
    own Coulomb friction bounds, and learns it: ours. `random`, `random-friction`: the same, drawn, without a
    constraint. `none`: nobody disturbs, which is plain PPO bit for bit."""
    limit: float | None = None
    """Largest disturbance: of a force as a share of the robot's weight, of torques as a share of the friction that the
    joint has at that time, on top of which they come; by default half of the weight, all of the friction. 0: as
    `none`."""
    curriculum: float = 0.0
    """Share of the iterations over which the limit grows to its value on a straight line. 0: it is there at once."""
    hold: float = 0.5
    """Mean time for which `random` and `random-friction` keep what they have drawn [s]: a force that is drawn anew at
    every step cancels itself."""
    eta: float = 2.0
    """First η: the cost that a whole disturbance may cause, where a cost of 1 is all lost that the task pays. Two:
    nothing is asked of the policy at first, until η is tightened. 0: every cost counts, however large the disturbance.
    """
    tightening: float = 0.99
    """Factor on η after every iteration in which the constraint holds. 1: η stays."""
    multiplier_rate: float = 0.05
    """Step of λ by the constraint's mean, once an iteration. 0: λ stays 0, plain PPO against the disturber."""
    actor: tuple[int, ...] = (128, 64)
    """Hidden layers of the disturber."""
    critic: tuple[int, ...] = (128, 64)
    """Hidden layers of the critic of h."""
    learning_rate: float = 5e-4
    """Of disturber and critic of h, fixed."""
    entropy: float = 0.002
    """Weight of the disturber's entropy bonus."""
    initial_std: float = 0.5
    """Standard deviation of the first disturbances, in units of the limit."""

    def __post_init__(self) -> None:
        """Refuse unknown names and numbers out of range."""
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
        """Whether joints are disturbed, and not the base."""
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
        """Whether anybody disturbs."""
        return self.disturber != "none" and self.share > 0

    @property
    def learns(self) -> bool:
        """Whether the disturber learns, and the constraint with it."""
        return self.disturbs and self.disturber in ("force", "friction")

    def idle(self) -> Iterator[tuple[str, str]]:
        """Yield the fields that do nothing beside the others, each with why."""
        if not self.disturbs:
            why = f"with --set hinf.disturber={self.disturber} and --set hinf.limit={self.share:g} nobody disturbs"
            yield from ((field.name, why) for field in fields(self) if field.name not in ("disturber", "limit"))
            if self.disturber == "none":
                yield "limit", "with --set hinf.disturber=none nobody disturbs"
        elif self.learns:
            yield "hold", "a disturber that learns acts anew at every step"
            if self.eta == 0:
                yield "tightening", "with --set hinf.eta=0 there is nothing to tighten"
        else:
            yield from ((name, f"--set hinf.disturber={self.disturber} does not learn") for name in LEARNT)
