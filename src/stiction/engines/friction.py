"""Dry friction of one robot's joints in any engine: the bound of each joint, from its state before each step.

It is a sum of laws (`stiction.joints.friction.LAWS`), each with a level and numbers that may differ between joints:

    bound_j = wear_j f_j (1 + (r_j − 1) exp(−(q'/v_j)²)) + c_j (|F_j| + |T_j|)

for one with Stribeck friction and friction that grows with load. As in training, motor torque and transmitted force are
those of the step before, and the bound is low-pass filtered with the same time constant. Wear scales torques, as the
paper's seals do, and not coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from stiction.engines.engine import Motion
from stiction.joints.friction import LAWS, SMOOTHING_PERIOD, Law, Values, has_coefficient


@dataclass(frozen=True)
class Term:
    """One law at some level. Numbers are of the joints, shape (J,), or one for all."""

    law: str
    """One of `simulated_laws`."""
    level: Values
    """Torque [N m], or coefficient [-]."""
    numbers: Mapping[str, Values] = field(default_factory=dict)
    """What the law takes beside its level, by name; see `Law`."""

    def bound(self, signals: Mapping[str, Values]) -> Values:
        """Return its part of the bound [N m], unfiltered; `signals`: what laws may read, by name."""
        spec = LAWS[self.law]
        assert spec.factor is not None
        return self.level * spec.factor(**{name: signals[name] for name in spec.reads}, **self.numbers)


class JointFriction:
    """Dry friction of one robot."""

    def __init__(self, timestep: float, *terms: Term) -> None:
        """timestep: of the physics [s]; terms: laws whose bounds add up."""
        self._terms = [Term(term.law, np.array(term.level, float), term.numbers) for term in terms]
        self._decay = [LAWS[term.law].smoothing ** (timestep / SMOOTHING_PERIOD) for term in terms]
        self.reset()

    @classmethod
    def under(cls, law: Law, level: np.ndarray, timestep: float) -> JointFriction:
        """Return friction under one law of the training at some level: torque [N m] or coefficient [-], shape (J,)."""
        return cls(timestep, Term(law.name, level, law.numbers))

    @property
    def loaded(self) -> bool:
        """Whether the friction depends on what a joint transmits."""
        return any(LAWS[term.law].loaded and np.any(term.level) for term in self._terms)

    def reset(self) -> None:
        """Forget the bounds of the last step."""
        self._last: list[Values | None] = [None] * len(self._terms)

    def set_levels(self, *levels: Values) -> None:
        """Give each law another level from the next step on; the filters go on from the last bounds."""
        self._terms = [
            replace(term, level=np.array(level, float)) for term, level in zip(self._terms, levels, strict=True)
        ]

    def bound(self, motion: Motion, torque: np.ndarray, wear: Values = 1.0) -> np.ndarray:
        """Return the bounds of the coming step [N m], shape (J,).

        motion: of now; torque: of the motors in the last step [N m], shape (J,); wear: factor on torques [1].
        """
        load = motion.joint_force + motion.joint_torque
        signals = {"velocity": motion.joint_velocity, "load": load, "torque": torque}
        total = np.zeros_like(motion.joint_velocity)
        for index, (term, decay, last) in enumerate(zip(self._terms, self._decay, self._last, strict=True)):
            bound = term.bound(signals)
            if decay and last is not None:
                bound = decay * last + (1.0 - decay) * bound
            self._last[index] = bound
            total = total + (bound if has_coefficient(term.law) else wear * bound)
        return total
