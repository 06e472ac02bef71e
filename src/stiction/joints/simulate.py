"""One joint under its controller: I q'' + B q' = τ + f − offset, with stick and slip at exact instants.

Between two events the joint is a linear system whose target is a straight line from sample to sample, so its motion is
known in closed form: whole stretches are computed at once, and the instants of stopping and of breaking away are solved
for inside the sample. There is no sign(v) to chatter. Saturation of the motor begins and ends on samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.signal import lfilter

from stiction.formats.errors import StictionError
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains, pd_torque

FIRST_STRETCH = 64
"""Samples computed at once after an event; doubled while nothing happens."""

LONGEST_SERIES = 4.0
"""Time constants that one Taylor series spans; longer spans are cut, or large terms would cancel."""

SHORTEST = 1e-9
"""A slide shorter than this share of a sample is rest."""


@dataclass(frozen=True)
class Joint:
    """One joint without load. For a linear axis read kg, N s/m and N."""

    inertia: float
    """I, rotor included [kg m²]."""
    viscous: float
    """B [N m s/rad]."""
    friction: Coulomb
    """Dry friction."""
    offset: float = 0.0
    """Constant torque that the motor must supply: weight of a cable, bias of the current sensor [N m]."""

    def __post_init__(self) -> None:
        """Refuse a joint without inertia."""
        if not self.inertia > 0 or not np.isfinite([self.viscous, self.offset]).all():
            raise StictionError(
                f"joint with inertia {self.inertia}, viscous friction {self.viscous}, offset {self.offset}: "
                "expected a positive inertia and finite numbers"
            )


@dataclass(frozen=True)
class Trajectory:
    """What a simulated joint did, sample by sample; arrays of shape (num_samples,)."""

    position: np.ndarray
    """θ [rad]."""
    velocity: np.ndarray
    """θ' [rad/s], exactly zero while it sticks."""
    torque: np.ndarray
    """τ delivered by the motor [N m]."""


class _Regime:
    """The linear system of a sliding joint, q'' = u(t) − stiffness q − damping q', for one state of the motor."""

    def __init__(self, joint: Joint, gains: PDGains, saturated: int, step: float) -> None:
        """Discretise exactly for inputs that are straight lines between samples."""
        kp, kd = (0.0, 0.0) if saturated else (gains.strength * gains.kp, gains.strength * gains.kd)
        self.stiffness, self.damping = kp / joint.inertia, (joint.viscous + kd) / joint.inertia
        self.level = ((saturated * gains.torque_limit if saturated else 0.0) - joint.offset) / joint.inertia
        self.dry = joint.friction.level / joint.inertia
        # Columns of the transition, and the answers to a constant and to a ramp of input.
        first, second = self.inside((1.0, 0.0), 0.0, 0.0, step), self.inside((0.0, 1.0), 0.0, 0.0, step)
        self.transition = np.array([first, second]).T
        self.from_next = np.array(self.inside((0.0, 0.0), 0.0, 1.0, step)) / step
        self.from_this = np.array(self.inside((0.0, 0.0), 1.0, 0.0, step)) - self.from_next

    def drive(self, target: np.ndarray | float, sign: int) -> np.ndarray | float:
        """Return u [rad/s²] for targets [rad], sliding in direction `sign`."""
        return self.stiffness * target + (self.level - self.dry * sign)

    def stretch(self, state: tuple[float, float], target: np.ndarray, sign: int) -> np.ndarray:
        """Return q and q' at every sample of `target`, from `state` at the first; shape (2, num_samples).

        By Cayley and Hamilton each component of x' = Φ x + g obeys a second-order recursion, which `lfilter` runs.
        """
        drive = np.asarray(self.drive(target, sign))
        change = np.outer(self.from_this, drive[:-1]) + np.outer(self.from_next, drive[1:])
        trace, determinant = np.trace(self.transition), np.linalg.det(self.transition)
        excitation = np.empty((2, len(target)))
        excitation[:, 0] = state
        excitation[:, 1] = self.transition @ state + change[:, 0] - trace * excitation[:, 0]
        excitation[:, 2:] = change[:, 1:] + (self.transition - trace * np.eye(2)) @ change[:, :-1]
        return lfilter([1.0], [1.0, -trace, determinant], excitation, axis=1)

    def inside(
        self, state: tuple[float, float], drive: float, drive_slope: float, elapsed: float
    ) -> tuple[float, float]:
        """Return q and q' after `elapsed` seconds of the input u = drive + drive_slope t, by Taylor series."""
        pieces = 1 + int((self.damping + self.stiffness**0.5) * elapsed / LONGEST_SERIES)
        elapsed /= pieces
        for piece in range(pieces):
            state = self._series(state, drive + drive_slope * elapsed * piece, drive_slope, elapsed)
        return state

    def _series(self, state: tuple[float, float], drive: float, slope: float, elapsed: float) -> tuple[float, float]:
        """Sum the series; q⁽ⁿ⁺²⁾ = u⁽ⁿ⁾ − stiffness q⁽ⁿ⁾ − damping q⁽ⁿ⁺¹⁾ gives each derivative from the two before."""
        older, newer = state
        position, velocity = older + newer * elapsed, newer
        factor, forcing = elapsed, drive
        for order in range(2, 80):
            older, newer = newer, forcing - self.stiffness * older - self.damping * newer
            velocity += newer * factor
            factor *= elapsed / order
            position += newer * factor
            forcing = slope if order == 2 else 0.0
            if order > 3 and abs(newer * factor) <= 1e-17 * abs(position) and abs(older * factor) <= 1e-17:
                break
        return position, velocity


class _Simulator:
    """One run: the joint, its controller, the target, and the three regimes of the motor."""

    def __init__(self, joint: Joint, gains: PDGains, step: float, target: np.ndarray) -> None:
        self.joint, self.gains, self.step, self.target = joint, gains, step, target
        self.regimes = {0: _Regime(joint, gains, 0, step)}
        if np.isfinite(gains.torque_limit):
            self.regimes |= {side: _Regime(joint, gains, side, step) for side in (-1, 1)}

    def pull(self, target: np.ndarray, position: float) -> np.ndarray:
        """Return the torque on a joint at rest, friction apart [N m]."""
        return pd_torque(self.gains, target, np.asarray(position), np.zeros(())) - self.joint.offset

    def sides(self, target: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return -1 or +1 where the controller asks for more than the motor gives, else 0."""
        asked = self.gains.strength * (self.gains.kp * (target - position) - self.gains.kd * velocity)
        return np.where(np.abs(asked) <= self.gains.torque_limit, 0, np.sign(asked)).astype(int)

    def rest(self, index: int, position: float) -> int:
        """Return the first sample after `index` that friction no longer holds, or the number of samples."""
        free = np.abs(self.pull(self.target[index + 1 :], position)) > self.joint.friction.breakaway
        return index + 1 + (int(np.argmax(free)) if free.any() else len(free))

    def cross(self, index: int, state: tuple[float, float], sign: int, side: int) -> tuple[tuple[float, float], int]:
        """Return state and direction at sample `index + 1`, solving for stops and break-aways on the way.

        sign: -1, 0 (at rest) or 1; side: the motor's regime, kept over the sample.
        """
        end, regime, left = self.target[index + 1], self.regimes[side], self.step
        slope = (end - self.target[index]) / self.step
        while True:
            if sign == 0:
                left, sign = self.break_away(end, slope, left, state[0])
                if sign == 0:
                    return (state[0], 0.0), 0
            drive = float(regime.drive(end - slope * left, sign))
            final = regime.inside(state, drive, regime.stiffness * slope, left)
            if final[1] * sign >= 0:
                return final, sign if final[1] else 0

            def speed(elapsed: float, start=state, drive=drive) -> float:
                return regime.inside(start, drive, regime.stiffness * slope, elapsed)[1]

            moment = brentq(speed, 0.0, left, xtol=1e-12 * self.step)
            state, sign = (regime.inside(state, drive, regime.stiffness * slope, moment)[0], 0), 0
            left -= moment
            if moment < SHORTEST * self.step or left < SHORTEST * self.step:
                return state, 0

    def break_away(self, end: float, slope: float, left: float, position: float) -> tuple[float, int]:
        """Return the time left in the sample when a resting joint breaks away and which way, or (0, 0) if it holds."""
        hold = self.joint.friction.breakaway
        first, last = self.pull(np.array([end - slope * left, end]), position)
        if abs(first) > hold:
            return left, int(np.sign(first))
        if abs(last) <= hold:
            return 0.0, 0
        sign = int(np.sign(last))
        return left * (last - sign * hold) / (last - first), sign

    def run(self, position: float, velocity: float) -> np.ndarray:
        """Return q and q' at every sample; shape (2, num_samples)."""
        motion = np.empty((2, len(self.target)))
        index, state, length = 0, (position, velocity), FIRST_STRETCH
        sign = int(np.sign(velocity))
        motion[:, 0] = state
        while index < len(self.target) - 1:
            if sign == 0:
                free = self.rest(index, state[0])
                motion[:, index:free] = [[state[0]], [0.0]]
                if free == len(self.target):
                    break
                index = free - 1
                side = int(self.sides(self.target[free], np.asarray(state[0]), np.zeros(())))
                state, sign = self.cross(index, state, 0, side)
                index += 1
            else:
                side = int(self.sides(self.target[index], *map(np.asarray, state)))
                target = self.target[index : index + length + 1]
                ahead = self.regimes[side].stretch(state, target, sign)
                stopped = ahead[1] * sign <= 0
                stopped[0] = False
                changed = self.sides(target, ahead[0], ahead[1]) != side
                changed[0] = False
                events = np.flatnonzero(stopped | changed)
                last = int(events[0]) if len(events) else len(target) - 1
                length = 2 * length if not len(events) else max(FIRST_STRETCH, last)
                if stopped[last]:
                    last -= 1
                motion[:, index : index + last + 1] = ahead[:, : last + 1]
                index, state = index + last, (float(ahead[0, last]), float(ahead[1, last]))
                if len(events) and stopped[events[0]]:
                    state, sign = self.cross(index, state, sign, side)
                    index += 1
            motion[:, index] = state
        return motion


def simulate(
    joint: Joint, gains: PDGains, step: float, target: np.ndarray, position: float = 0.0, velocity: float = 0.0
) -> Trajectory:
    """Simulate a joint that follows `target`.

    step: time between samples [s]; target: a [rad], shape (num_samples,), a straight line from sample to sample;
    position, velocity: θ and θ' at the first sample. Raises `StictionError` if the target is not finite or too short.
    """
    target = np.asarray(target, float)
    if target.ndim != 1 or len(target) < 2 or not np.isfinite(target).all() or not step > 0:
        raise StictionError(
            f"target of shape {target.shape}, step {step} s: expected at least two finite samples and a positive step"
        )
    motion = _Simulator(joint, gains, step, target).run(position, velocity)
    return Trajectory(motion[0], motion[1], pd_torque(gains, target, motion[0], motion[1]))
