"""Dry friction during training: its size, law and schedule. No torch, no mujoco.

A method is a schedule: stages, each with a distribution of the multiplier of nominal friction. Students have the last.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from stiction.core.effects import all_of, needs
from stiction.core.errors import ConfigurationError, if_per_cent, unknown_name
from stiction.core.flags import FLAG, Form, flag
from stiction.files.method import Mixture, Stage, find_method, method_names, stages_of
from stiction.joints.friction import LAWS, Law, has_coefficient, simulated_laws
from stiction.robots.model import Robot

NUMBERS = ("static_ratio", "stribeck_velocity")
"""Numbers of a friction law that may differ by robot."""


def law_flag(text: str, name: str = "") -> Form:
    """Return the form of an option for a law: `text`, then every law of the table; name: its flag."""
    meanings = "; ".join(f"{law}: {LAWS[law].meaning}" for law in simulated_laws())
    return flag(name, f"{text} {meanings}.", simulated_laws)


SCALED = needs("--friction-level above 0", lambda cfg: cfg.level != 0.0 or not cfg.draws_load)
"""Requirement of a distribution: at level 0 friction is that of the load, and all multiples of the level are 0."""

DRAWN = all_of(
    SCALED, needs("friction in training, such as --task.friction.range 0 1.2", lambda cfg: cfg.last.range[1] > 0)
)
"""Requirement of options for the draw of multipliers. A level or a law has none, since it is used in evaluation."""


STRIBECK = needs("--friction-law stribeck")


@dataclass(frozen=True)
class FrictionCfg:
    """Dry friction in the joints during training: b_c = multiplier x nominal, at rest any value up to the bound."""

    method: Annotated[str, flag("--method", choices=method_names)] = "deception"
    """Method of training with friction. deception: drawn from zero to 1.2 times the level; direct: 0.8 to 1.2 times it;
    none: without friction. All others are methods of installed distributions (stiction-experiments)."""
    level: Annotated[float | None, flag("--friction-level")] = None
    """Nominal friction, as a share of each joint's torque limit [1], by default the robot's; for the laws load and
    effort, their coefficient. The robot's default is in N m, as measured; for load and effort it is from the
    load_coefficient of --joints, converted by the robot's model where its regressor differs."""
    law: Annotated[str, law_flag("Law of the dry friction.", "--friction-law")] = "coulomb"
    """Law of the friction, one of `simulated_laws`."""
    per: Annotated[Literal["robot", "joint"], FLAG] = field(
        default="robot", metadata=all_of(DRAWN, needs("multipliers that differ", lambda cfg: cfg.varies))
    )
    """Multipliers per robot, one for all its joints, or per joint. Per robot, some robots have nearly no friction
    anywhere, on which the paper's explanation of its wide range relies."""
    spread: Annotated[tuple[float, float] | None, FLAG] = field(
        default=None, metadata=all_of(DRAWN, needs("factors other than 1", lambda cfg: cfg.spread != (1.0, 1.0)))
    )
    """Factor of each joint on its robot's multiplier, drawn uniformly: `0.5 1.5`. Joints then differ, and some robots
    still have nearly no friction anywhere."""
    load: Annotated[tuple[float, float] | None, FLAG] = field(
        default=None, metadata=needs("a coefficient above 0", lambda cfg: cfg.load is None or cfg.draws_load)
    )
    """Coefficient of friction that grows with the load that the joint transmits (the law `load`), drawn for each robot
    in every stage, in addition to the law: `0 0.1`."""
    range: Annotated[tuple[float, float] | None, FLAG] = field(default=None, metadata=SCALED)
    """Multiplier in the last stage, replacing the method's."""
    mixture: Annotated[Mixture, FLAG] = field(default=(), metadata=SCALED)
    """Mixture of uniform distributions of the multiplier in the last stage: weight, lower, upper end of each. `0.2 0 0
    0.8 1 1`: one robot in five without friction, the rest with the nominal one."""
    begin: float | None = field(default=None, metadata=DRAWN)
    """Share of the teacher's iterations before there is friction, replacing the method's: 0.4 for a robot that does
    not learn to walk with it, as a biped. It counts towards the budget."""
    stages: int | None = field(default=None, metadata=DRAWN)
    """Number of equal stages in which friction grows from then on, replacing the method's."""
    static_ratio: float | tuple[float, float] = field(default=1.5, metadata=STRIBECK)
    """Static over Coulomb friction, for the law `stribeck`; or lowest and highest, `[1.2,1.8]`, of one drawn for each
    robot, or each joint where multipliers are (`per`)."""
    stribeck_velocity: float | tuple[float, float] = field(
        default=0.1,
        metadata=all_of(STRIBECK, needs("a static_ratio other than 1", lambda cfg: cfg.ends("static_ratio") != (1, 1))),
    )
    """Speed at which 63 % of the excess at rest is gone [rad/s], for the law `stribeck`; or lowest and highest, as
    above."""
    privileged_unit: float = field(default=0.1, metadata=needs("friction in training", lambda cfg: cfg.has_friction))
    """Friction over the torque limit [1] that is 1 in o_priv. At a level of 0.01 it is at most 0.12 there."""

    def __post_init__(self) -> None:
        """Validate names and numbers."""
        find_method(self.method)
        if self.per not in ("robot", "joint"):
            raise ConfigurationError(unknown_name("friction per", self.per, ("robot", "joint")))
        self._check_law()
        self._check_level()
        self._check_more()
        self._check_distribution()
        begin, count = self._begin_and_stages
        if not 0 <= begin < 1 or not 1 <= count <= 100:
            raise ConfigurationError(
                f"friction begin {begin}, {count} stages: expected a share in [0, 1) and 1 to 100 stages"
            )
        if not 1e-3 <= self.privileged_unit <= 1.0:
            raise ConfigurationError(
                f"friction privileged_unit: got {self.privileged_unit:g}, expected 0.001 to 1 of the torque limit"
            )

    def _check_law(self) -> None:
        """Validate numbers of the law and their ranges."""
        for name in NUMBERS:
            value = getattr(self, name)
            if isinstance(value, tuple) and not (len(value) == 2 and value[0] <= value[1]):
                raise ConfigurationError(
                    f"friction {name}: got {value}, expected a number, or a lower and an upper end"
                )
            for end in self.ends(name):
                Law(self.law, **{name: end})

    def _check_level(self) -> None:
        """Validate the level: below the motor's torque, and the coefficient of its law."""
        number = isinstance(self.level, int | float) and not isinstance(self.level, bool)
        if self.level is not None and not (number and 0.0 <= self.level < 0.8):
            unit = "a coefficient" if has_coefficient(self.law) else "a fraction of the torque limit"
            meant = if_per_cent(float(self.level)) if number and not has_coefficient(self.law) else ""
            raise ConfigurationError(f"friction level {self.level!r}: expected {unit} in [0, 0.8){meant}")
        if has_coefficient(self.law) and self.compensation is not None:
            raise ConfigurationError(
                f"the friction law {self.law!r} has no nominal torque that {self.method} could add; use another "
                "method, or the law 'coulomb'"
            )

    def _check_more(self) -> None:
        """Reject a spread in addition to per-joint draws, load friction under a load law, and invalid ranges of
        them.
        """
        if self.spread is not None and self.per == "joint":
            raise ConfigurationError("friction spread and per-joint friction both let joints differ; leave one out")
        if (self.spread is not None or self.load is not None) and self.method == "none":
            raise ConfigurationError(
                "the method 'none' has no friction to draw; choose another, or leave out its spread and load"
            )
        if self.load is not None and LAWS[self.law].unit != "share":
            raise ConfigurationError(
                f"friction load {self.load} beside the law {self.law!r}, which is a coefficient itself; use the law "
                "'coulomb' or 'stribeck'"
            )
        for name, most in {"spread": 10.0, "load": 0.8}.items():
            span = getattr(self, name)
            if span is not None and not (len(span) == 2 and 0 <= span[0] <= span[1] < most):
                raise ConfigurationError(f"friction {name} {span}: expected a lower and an upper end in [0, {most:g})")

    def _check_distribution(self) -> None:
        """Validate ranges and mixtures."""
        if self.range is not None and self.mixture:
            raise ConfigurationError("friction range and mixture are both given; leave one of them out")
        if self.method == "none" and (self.range is not None or self.mixture):
            raise ConfigurationError(
                "the method 'none' has no friction to draw; choose another, or leave out the range"
            )
        for part in self._final:
            if len(part) != 3 or not (0 < part[0] < float("inf") and 0 <= part[1] <= part[2] <= 10):
                raise ConfigurationError(
                    f"friction multipliers {part}: expected a finite weight above 0, and a lower and an upper end in "
                    "[0, 10]"
                )

    @property
    def requests_friction(self) -> bool:
        """True if method, range or mixture request friction by the law; it may still be zero, see `draws_law`."""
        return find_method(self.method).friction_range != (0.0, 0.0) or self.range is not None or bool(self.mixture)

    @property
    def draws_law(self) -> bool:
        """True if training draws friction by the law: a multiplier above 0, of a level that is not 0."""
        most = 1.0 if self.spread is None else self.spread[1]
        return self.level != 0.0 and self.last.range[1] * most > 0.0

    @property
    def draws_load(self) -> bool:
        """True if training draws a coefficient of load above 0, in addition to the law."""
        return self.load is not None and self.load[1] > 0.0

    @property
    def varies(self) -> bool:
        """True if multipliers differ."""
        return len({end for _, low, high in self.last.mixture for end in (low, high)}) > 1

    @property
    def compensation(self) -> str | None:
        """Compensation added to the command, as `parse_compensation` reads it; or None."""
        return find_method(self.method).compensation

    @property
    def has_friction(self) -> bool:
        """True if training draws any friction, by the law or by load."""
        return self.draws_law or self.draws_load

    def ends(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest `static_ratio` or `stribeck_velocity`, by its name."""
        value = getattr(self, name)
        low, high = value if isinstance(value, tuple) else (value, value)
        return low, high

    @property
    def drawn_numbers(self) -> dict[str, tuple[float, float]]:
        """Numbers of the law that differ by robot, by name: the lowest and the highest."""
        spans = {name: self.ends(name) for name in LAWS[self.law].numbers}
        return {name: (low, high) for name, (low, high) in spans.items() if low < high}

    @property
    def joint_law(self) -> Law:
        """Law with its numbers, the middle of drawn ones."""
        return Law(self.law, sum(self.ends("static_ratio")) / 2, sum(self.ends("stribeck_velocity")) / 2)

    @property
    def laws(self) -> tuple[Law, ...]:
        """Names of the law, and of `load` if drawn in addition."""
        return (self.joint_law,) if self.load is None else (self.joint_law, Law("load"))

    @property
    def loaded(self) -> bool:
        """True if friction depends on the load that a joint transmits."""
        return any(law.spec.loaded for law in self.laws)

    @property
    def _final(self) -> Mixture:
        """Distribution of the last stage."""
        return self.mixture or ((1.0, *(self.range or find_method(self.method).friction_range)),)

    @property
    def last(self) -> Stage:
        """Last stage of the training."""
        return self.schedule[-1]

    @property
    def schedule(self) -> tuple[Stage, ...]:
        """Stages, from the first iteration on."""
        return stages_of(self._final, *self._begin_and_stages)

    @property
    def _begin_and_stages(self) -> tuple[float, int]:
        """Share of the iterations before friction, and the number of stages in which it grows."""
        method = find_method(self.method)
        begin = method.begin if self.begin is None else self.begin
        return begin, method.stages if self.stages is None else self.stages

    def stage(self, iteration: int, iterations: int) -> int:
        """Return the number of the stage of iteration `iteration` of `iterations` of the teacher."""
        return max(k for k, stage in enumerate(self.schedule) if iteration >= round(stage.begin * iterations))


def friction_share(law: str, friction: np.ndarray, spec: Robot) -> np.ndarray:
    """Return friction, [N m] or coefficients, over each joint's torque limit, shape (..., joints).

    A coefficient counts at the motor's full torque and an equal share of the robot's weight.
    """
    limit = spec.joint_values("torque_limit")
    if not has_coefficient(law):
        return friction / limit
    return friction / limit * Law(law).factor(velocity=0.0, load=spec.weight / len(spec.feet), torque=limit)
