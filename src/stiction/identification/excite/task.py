"""Task of a design: candidate joints, their controller and limits, and the trial of a motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stiction.identification.excite.fisher import Information, information, run
from stiction.identification.excite.pattern import Pattern
from stiction.identification.excite.setup import ExciteSetup
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Trajectory

SHARE = 0.9
"""Share of each limit that a design may use in simulation, over all candidates: a margin for what simulation lacks."""

LONGEST_PATTERN = 10.0
"""Rough length of one pattern [s]; longer logs repeat it."""

SCALINGS = 8
"""Most times that a motion is scaled down until it is within its limits: friction is not proportional to the motion."""

BACKING_OFF = 0.98
"""Factor by which a motion is scaled further than proportion asks for, so that few scalings do."""


@dataclass(frozen=True)
class Task:
    """Joint, controller and limits by which a motion is judged."""

    setup: ExciteSetup
    """Joint, its controller, limits and sensors, filled: nothing is None."""
    weighs: bool = True
    """True if gravity counts. It takes ten times longer to simulate and changes little for a search."""

    @property
    def values(self) -> np.ndarray:
        """Nominal parameters: inertia, viscous, Coulomb, offset and, where gravity pulls, its sine and cosine."""
        setup = self.setup
        gravity = (setup.gravity_sin, setup.gravity_cos) if self.weighs else ()
        return np.array([setup.inertia, setup.viscous, setup.coulomb, 0.0, *(gravity if any(gravity) else ())], float)

    @property
    def gains(self) -> PDGains:
        """Controller without torque limit: the torque of a motion is judged, and a design takes less."""
        assert self.setup.kp is not None and self.setup.kd is not None
        return PDGains(self.setup.kp, self.setup.kd)

    @property
    def limits(self) -> dict[str, float]:
        """Limits of the joint: angles `low` and `high` [rad], `speed` [rad/s], `torque` [N m]."""
        assert self.setup.position_limits is not None and self.setup.torque_limit is not None
        low, high = self.setup.position_limits
        return {"low": low, "high": high, "speed": self.setup.speed_limit, "torque": self.setup.torque_limit}

    @property
    def noise(self) -> tuple[float, float | None]:
        """Standard deviations of the logged angle [rad] and torque [N m]; None where no torque is logged."""
        return self.setup.position_std, None if self.setup.position_only else self.setup.noise_torque

    @property
    def start(self) -> float:
        """Start pose [rad]."""
        return float(self.setup.start or 0.0)

    @property
    def total(self) -> int:
        """Number of samples in the log."""
        return round(self.setup.duration * self.setup.rate)

    @property
    def repeats(self) -> int:
        """Number of patterns in the log."""
        return max(1, round(self.setup.duration / LONGEST_PATTERN))

    @property
    def count(self) -> int:
        """Number of samples in one pattern."""
        return self.total // self.repeats

    @property
    def room(self) -> float:
        """Largest swing to either side of the start pose that `SHARE` of the limits allows [rad]."""
        return SHARE * min(self.limits["high"] - self.start, self.start - self.limits["low"])

    @property
    def sag(self) -> float:
        """Largest sag of the heaviest link in the range below its target [rad]."""
        return float(np.hypot(*self.values[4:])) * self.setup.spread / self.gains.kp if len(self.values) > 4 else 0.0

    def candidates(self) -> list[np.ndarray]:
        """Return the nominal parameters and the eight corners of their range; gravity goes with the inertia."""
        spread, corners = self.setup.spread, [self.values]
        for factors in product((1 / spread, spread), repeat=3) if spread > 1 else ():
            values = self.values
            values[:3] *= factors
            values[4:] *= factors[0]
            corners.append(values)
        return corners

    def extremes(self) -> list[np.ndarray]:
        """Return the corners in which inertia, viscous or Coulomb friction is hardest to see.

        Each is small there, and what hides it large. Whether Coulomb friction hides the viscous one more in a light or
        in a heavy joint depends on the motion: both are there.
        """
        corners = self.candidates()
        # Of I, B and f, behind the nominal joint: (−, −, +), (−, +, −), (−, +, +) and (+, −, +).
        return corners if len(corners) == 1 else [corners[index] for index in (2, 3, 4, 6)]

    def least_damped(self) -> np.ndarray:
        """Return the corner with the least damping for its inertia: it overshoots most."""
        corners = self.candidates()
        # Heavy, and little friction of either kind: (+, −, −).
        return corners[5] if len(corners) > 1 else corners[0]

    def without_gravity(self) -> Task:
        """Return the task without gravity."""
        return replace(self, weighs=False)

    def with_gains(self, gains: PDGains) -> Task:
        """Return the task under other gains."""
        return replace(self, setup=replace(self.setup, kp=gains.kp, kd=gains.kd))

    def target(self, pattern: Pattern) -> np.ndarray:
        """Return one pattern as a target [rad], shape (count,)."""
        return self.start + pattern.offsets(self.count, self.setup.rate)

    def full_target(self, pattern: Pattern) -> np.ndarray:
        """Return the whole log's target [rad], shape (total + 1,): the patterns, and the start pose at the end."""
        patterns = np.tile(self.target(pattern), self.repeats)
        return np.concatenate([patterns, np.full(self.total + 1 - len(patterns), self.start)])

    def run(self, values: np.ndarray, target: np.ndarray) -> Trajectory:
        """Simulate one joint that follows a target."""
        return run(values, self.gains, 1 / self.setup.rate, target)

    def limit_use(self, target: np.ndarray, motion: Trajectory, part: slice = slice(None)) -> dict[str, float]:
        """Return the share of each limit that a part of a motion uses; position counts from the start pose."""
        limits = self.limits
        reach = np.stack([target[part], motion.position[part]]) - self.start
        position = np.maximum(reach / (limits["high"] - self.start), reach / (limits["low"] - self.start))
        return {
            # Limits are scaled by what a part uses, and an empty part uses nothing: hence the 1e-9.
            "position": float(position.max(initial=1e-9)),
            "speed": float(np.abs(motion.velocity[part]).max(initial=1e-9)) / limits["speed"],
            "torque": float(np.abs(motion.torque[part]).max(initial=1e-9)) / limits["torque"],
        }

    def within_limits(self, pattern: Pattern, joints: list[np.ndarray]) -> Pattern | None:
        """Return the pattern, each part made small enough for the limits, or None if that cannot be done."""
        split = pattern.slow_count(self.count)
        for _ in range(SCALINGS):
            target = self.target(pattern)
            runs = [self.run(values, target) for values in joints]
            slow, fast = (
                max((max(self.limit_use(target, motion, part).values()) for motion in runs), default=0.0)
                for part in (slice(0, split), slice(split, None))
            )
            if max(slow, fast) <= SHARE * (1 + 1e-9):
                return pattern
            pattern = replace(
                pattern,
                slow_amplitude=pattern.slow_amplitude * min(1.0, BACKING_OFF * SHARE / slow),
                fast_peak=pattern.fast_peak * min(1.0, BACKING_OFF * SHARE / fast),
            )
        return None

    def reach(self, target: np.ndarray, joints: list[np.ndarray]) -> float:
        """Return the range of the joint's motion over that of the target, the smallest of any of the joints [1]."""
        return min(float(np.ptp(self.run(values, target).position)) for values in joints) / float(np.ptp(target))

    def information(self, values: np.ndarray, pattern: Pattern, fast: bool = False) -> Information:
        """Return the information of the log of all patterns about one joint: that of one pattern, times their number.

        fast: one-sided differences, for comparing motions.
        """
        single = information(values, self.gains, 1 / self.setup.rate, self.target(pattern), self.noise, fast)
        return replace(single, covariance=single.covariance / self.repeats)

    def worst(self, pattern: Pattern, fast: bool = False) -> float:
        """Return the largest relative standard deviation over the extreme joints, infinite where one shows nothing."""
        return max(self.information(values, pattern, fast).worst for values in self.extremes())
