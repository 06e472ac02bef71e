"""What a design is for: the candidate joints, their controller, their limits; and how a motion is tried.

Slow and fast in one log is what separates Coulomb from viscous friction: at one speed only their sum shows. The
triangle moves at an even speed; the sines bring speed and acceleration. The pattern is repeated, so that the halves of
the log can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stiction.identification.excite.fisher import Information, LogNoise, information, run
from stiction.identification.excite.setup import ExciteSetup
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Trajectory

ROUNDING = 0.97
"""How pointed the triangle is, asin(ROUNDING sin φ): at 1 its corners would ask for infinite acceleration."""

LONGEST_RAMP = 0.3
"""Time over which each part swells and fades [s]."""


@dataclass(frozen=True)
class Pattern:
    """A slow and a fast part, as offsets from the start pose."""

    share: float
    """Share of the time that the slow part takes, from 0 (no slow part) to 1 [1]."""
    slow_frequency: float
    """Roughly; the part holds whole periods, at least one [Hz]."""
    slow_amplitude: float
    """Peak of the slow part [rad]."""
    frequencies: tuple[float, ...]
    """Of the sines [Hz]."""
    amplitudes: tuple[float, ...]
    """Of the sines, before `fast_peak` scales them to their sum [1]."""
    phases: tuple[float, ...]
    """Of the sines [rad]."""
    fast_peak: float
    """Peak of the fast part [rad]."""

    def offsets(self, count: int, rate: float) -> np.ndarray:
        """Return the pattern [rad], shape (count,), at `rate` samples per second [Hz]."""
        slow_count = self.slow_count(count)
        return np.concatenate([self._slow(slow_count, rate), self._fast(count - slow_count, rate)])

    def slow_count(self, count: int) -> int:
        """Return how many samples of a pattern of `count` belong to the slow part."""
        return round(self.share * count)

    def _slow(self, count: int, rate: float) -> np.ndarray:
        """Return whole periods of the rounded triangle."""
        if count < 2:
            return np.zeros(count)
        periods = max(1, round(self.slow_frequency * count / rate))
        phase = 2 * np.pi * periods * np.arange(count) / count
        triangle = np.arcsin(ROUNDING * np.sin(phase)) / np.arcsin(ROUNDING)
        return self.slow_amplitude * triangle * window(count, rate)

    def _fast(self, count: int, rate: float) -> np.ndarray:
        """Return the sum of sines, its peak being `fast_peak`."""
        time = np.arange(count) / rate
        waves = zip(self.amplitudes, self.frequencies, self.phases, strict=True)
        total = sum((a * np.sin(2 * np.pi * f * time + p) for a, f, p in waves), np.zeros(count)) * window(count, rate)
        peak = float(np.abs(total).max(initial=0.0))
        return self.fast_peak * total / peak if peak > 0 else total


def sine(frequency: float, amplitude: float) -> Pattern:
    """Return A sin(ωt), the paper's excitation, as a pattern."""
    return Pattern(0.0, 1.0, 0.0, (frequency,), (1.0,), (0.0,), amplitude)


def window(count: int, rate: float) -> np.ndarray:
    """Return a window that swells from 0 to 1 and fades to 0, with slope zero at both ends, shape (count,)."""
    edge = min(int(LONGEST_RAMP * rate), count // 4)
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(edge) / max(edge, 1))
    return np.concatenate([ramp, np.ones(count - 2 * edge), ramp[::-1]])


SHARE = 0.9
"""Share of each limit that a design may use in simulation, over all candidates: a margin for what simulation lacks."""

LONGEST_PATTERN = 10.0
"""Rough length of one pattern [s]; longer logs repeat it."""

SCALINGS = 8
"""Times that a motion is scaled down until it is within its limits: friction is not proportional to the motion."""

BACKING_OFF = 0.98
"""Factor by which a motion is scaled further than proportion asks for, so that few scalings do."""


@dataclass(frozen=True)
class Limits:
    """What the joint must not exceed."""

    position: tuple[float, float]
    """Lowest and highest angle, of the target too [rad]."""
    speed: float
    """[rad/s]."""
    torque: float
    """[N m]."""


@dataclass(frozen=True)
class Task:
    """Everything that a motion is judged by."""

    values: np.ndarray
    """Nominal parameters: inertia, viscous, Coulomb, offset and, where gravity pulls, its sine and cosine."""
    spread: float
    """Factor by which inertia, viscous and Coulomb friction may be off, either way [1]."""
    gains: PDGains
    """The controller, without torque limit: what a motion asks for is judged, and a design asks for less."""
    limits: Limits
    """What must hold."""
    noise: LogNoise
    """What the log will have."""
    start: float
    """Start pose [rad]."""
    rate: float
    """[Hz]."""
    count: int
    """Samples in one pattern."""
    repeats: int
    """Patterns in the log."""
    total: int
    """Samples in the log."""

    @property
    def room(self) -> float:
        """Largest swing to either side of the start pose that `SHARE` of the limits allows [rad]."""
        low, high = self.limits.position
        return SHARE * min(high - self.start, self.start - low)

    def candidates(self) -> list[np.ndarray]:
        """Return the nominal parameters and the eight corners of their range; gravity goes with the inertia."""
        corners = []
        for factors in product((1 / self.spread, self.spread), repeat=3):
            values = self.values.copy()
            values[:3] *= factors
            values[4:] *= factors[0]
            corners.append(values)
        return [self.values, *corners] if self.spread > 1 else [self.values]

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
        """Return the task without gravity, which takes ten times longer to simulate and changes little for a search."""
        return replace(self, values=self.values[:4])

    @property
    def sag(self) -> float:
        """How far the heaviest link in the range may hang below its target [rad]."""
        return float(np.hypot(*self.values[4:])) * self.spread / self.gains.kp if len(self.values) > 4 else 0.0

    def with_gains(self, gains: PDGains) -> Task:
        """Return the task under other gains."""
        return replace(self, gains=gains)

    def target(self, pattern: Pattern) -> np.ndarray:
        """Return one pattern as a target [rad], shape (count,)."""
        return self.start + pattern.offsets(self.count, self.rate)

    def full_target(self, pattern: Pattern) -> np.ndarray:
        """Return the whole log's target [rad], shape (total + 1,): the patterns, and the start pose at the end."""
        offsets = np.tile(pattern.offsets(self.count, self.rate), self.repeats)
        return self.start + np.concatenate([offsets, np.zeros(self.total + 1 - len(offsets))])

    def run(self, values: np.ndarray, target: np.ndarray) -> Trajectory:
        """Simulate one joint that follows a target."""
        return run(values, self.gains, 1 / self.rate, target)

    def limit_use(self, target: np.ndarray, motion: Trajectory, part: slice = slice(None)) -> dict[str, float]:
        """Return the share of each limit that a part of a motion uses; position counts from the start pose."""
        low, high = self.limits.position
        reach = np.stack([target[part], motion.position[part]]) - self.start
        return {
            # Limits are scaled by what a part uses, and an empty part uses nothing: hence the 1e-9.
            "position": float(np.maximum(reach / (high - self.start), reach / (low - self.start)).max(initial=1e-9)),
            "speed": float(np.abs(motion.velocity[part]).max(initial=1e-9)) / self.limits.speed,
            "torque": float(np.abs(motion.torque[part]).max(initial=1e-9)) / self.limits.torque,
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
        """Return what the log of all patterns tells about one joint: that of one pattern, times their number.

        fast: one-sided differences, for comparing motions.
        """
        target = self.target(pattern)
        one = information(values, self.gains, 1 / self.rate, target, self.noise, fast)
        return replace(one, covariance=one.covariance / self.repeats)


def make_task(setup: ExciteSetup) -> Task:
    """Return the task of a setup that is filled."""
    if setup.kp is None or setup.kd is None or setup.torque_limit is None or setup.position_limits is None:
        raise ValueError("the setup must be filled first")
    gravity = (setup.gravity_sin, setup.gravity_cos)
    values = [setup.inertia, setup.viscous, setup.coulomb, 0.0, *(gravity if any(gravity) else ())]
    total = round(setup.duration * setup.rate)
    repeats = max(1, round(setup.duration / LONGEST_PATTERN))
    return Task(
        values=np.array(values, float),
        spread=setup.spread,
        gains=PDGains(setup.kp, setup.kd),
        limits=Limits(setup.position_limits, setup.speed_limit, setup.torque_limit),
        noise=LogNoise(setup.noise_position, None if setup.position_only else setup.noise_torque, setup.resolution),
        start=float(setup.start or 0.0),
        rate=setup.rate,
        count=total // repeats,
        repeats=repeats,
        total=total,
    )
