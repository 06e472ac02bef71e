"""Stick and slip at exact instants: a joint on one straight piece of its friction after another.

A stop, a break-away or a new piece of the friction law inside a sample is solved for, so no sign(v) can chatter.
Saturation of the motor begins and ends on samples. The input is a straight line between samples, so the motion is known
in closed form: whole stretches are computed at once, and states between samples by a power series.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, exp, sin
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dtbtrs

from stiction.core.errors import ConfigurationError
from stiction.joints.friction import FrictionLaw, Piece
from stiction.joints.pd import PDGains

LONGEST_SERIES = 4.0
"""Maximum time constants in one Taylor series; longer spans are cut, or large terms would cancel."""

LEAST_STIFF, LEAST_APART = 1e-4, 1e-2
"""Stiffness, and distance of the two rates, times the step (squared): below either the closed form loses digits."""

LARGEST_GROWTH = 200.0
"""Maximum growth of an unstable motion in one stretch, as the logarithm: floating point ends at 700."""

MOST_SAMPLES = 1_000_000

State = tuple[float, float]
"""q [rad] and q' [rad/s]."""


class Regime:
    """Linear system of one stretch of motion."""

    def __init__(self, stiffness: float, damping: float, step: float) -> None:
        """Discretise exactly for inputs that are straight lines between samples.

        stiffness [1/s²]; damping [1/s]; step: time between samples [s].
        """
        self.stiffness, self.damping = stiffness, damping
        # No root of s² + damping s + stiffness has a larger real part.
        growth = (max(-damping, 0.0) + max(-stiffness, 0.0) ** 0.5) * step
        self.longest = int(LARGEST_GROWTH / growth) if growth * MOST_SAMPLES > LARGEST_GROWTH else MOST_SAMPLES
        # Columns of the transition, and the answers to a constant and to a ramp of input.
        first, second = self._expand((1.0, 0.0), 0.0, 0.0, step), self._expand((0.0, 1.0), 0.0, 0.0, step)
        self.transition = np.array([first, second]).T
        self.from_next = np.array(self._expand((0.0, 0.0), 0.0, 1.0, step)) / step
        self.from_this = np.array(self._expand((0.0, 0.0), 1.0, 0.0, step)) - self.from_next
        # Of s² + damping s + stiffness the roots are −damping/2 ± `_apart`, or that times i where it oscillates.
        square = damping**2 / 4 - stiffness
        self._oscillates, self._apart = square < 0, abs(square) ** 0.5
        self._closed = stiffness * step**2 > LEAST_STIFF and self._apart * step > LEAST_APART
        # By Cayley and Hamilton each component of x' = Φ x + g obeys a second-order recursion.
        trace, determinant = np.trace(self.transition), np.linalg.det(self.transition)
        self._recursion = np.array([1.0, -trace, determinant])
        self._crossed = self.transition - trace * np.eye(2)
        self.steady = stiffness > 0 and damping > 0

    def changes(self, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return g of each sample, and the excitation of the recursion, for `stretch`.

        That is g[n + 1] + (Φ − tr Φ) g[n], which needs no state, so that it is computed once for a whole run. drive: u
        at the samples [rad/s²], shape (num_samples,). Shapes (2, num_samples - 1) and (2, num_samples - 2).
        """
        change = self.from_this[:, None] * drive[:-1] + self.from_next[:, None] * drive[1:]
        return change, change[:, 1:] + self._crossed @ change[:, :-1]

    def stretch(self, state: State, change: np.ndarray, excited: np.ndarray) -> np.ndarray:
        """Return q and q' at several samples, from `state` at the first; shape (2, num_samples), at least two.

        change, excited: of `changes`, shapes (2, num_samples - 1) and (2, num_samples - 2).
        """
        excitation = np.empty((2, change.shape[1] + 1))
        excitation[:, 0] = state
        excitation[:, 1] = self._crossed @ state + change[:, 0]
        excitation[:, 2:] = excited
        # A triangle of two diagonals beside the main one: LAPACK runs the recursion over a whole stretch.
        bands = np.repeat(self._recursion[:, None], excitation.shape[1], axis=1)
        return dtbtrs(bands, excitation.T, uplo="L")[0].T

    def free(self, count: int) -> np.ndarray:
        """Return q and q' at `count` samples without input, from q = 1 and from q' = 1; shape (2, 2, count)."""
        none = np.zeros((2, count - 1))
        return np.stack([self.stretch(start, none, none[:, 1:]) for start in ((1.0, 0.0), (0.0, 1.0))])

    def acceleration(self, state: State, drive: float) -> float:
        """Return q'' [rad/s²] in `state` under the input `drive` [rad/s²]."""
        return drive - self.stiffness * state[0] - self.damping * state[1]

    def inside(self, state: State, drive: float, drive_slope: float, elapsed: float) -> State:
        """Return q and q' after `elapsed` seconds of the input u = drive + drive_slope t.

        With h the response to a unit of speed, q' is q'(0) (h' + damping h) + q''(0) h + drive_slope ∫h.
        """
        if not self._closed:
            return self._expand(state, drive, drive_slope, elapsed)
        stiffness, damping, apart = self.stiffness, self.damping, self._apart
        if self._oscillates:
            decay = exp(-0.5 * damping * elapsed)
            impulse = decay * sin(apart * elapsed) / apart
            rate = decay * cos(apart * elapsed) - 0.5 * damping * impulse
        else:
            slow, fast = apart - 0.5 * damping, -apart - 0.5 * damping
            slow_decay, fast_decay = exp(slow * elapsed), exp(fast * elapsed)
            impulse, rate = (
                0.5 * (slow_decay - fast_decay) / apart,
                0.5 * (slow * slow_decay - fast * fast_decay) / apart,
            )
        speed = rate + damping * impulse
        once = (1.0 - speed) / stiffness
        way = impulse + damping * once
        twice = (elapsed - way) / stiffness
        begin = drive - stiffness * state[0] - damping * state[1]
        return (
            state[0] + state[1] * way + begin * once + drive_slope * twice,
            state[1] * speed + begin * impulse + drive_slope * once,
        )

    def _expand(self, state: State, drive: float, drive_slope: float, elapsed: float) -> State:
        """Return the result of `inside` by Taylor series, for any stiffness and damping."""
        pieces = 1 + int((abs(self.damping) + abs(self.stiffness) ** 0.5) * elapsed / LONGEST_SERIES)
        elapsed /= pieces
        for piece in range(pieces):
            state = self._series(state, drive + drive_slope * elapsed * piece, drive_slope, elapsed)
        return state

    def _series(self, state: State, drive: float, slope: float, elapsed: float) -> State:
        """Sum the series; q⁽ⁿ⁺²⁾ = u⁽ⁿ⁾ − stiffness q⁽ⁿ⁾ − damping q⁽ⁿ⁺¹⁾ gives each derivative from the two before."""
        stiffness, damping = self.stiffness, self.damping
        # The first terms are written out, for the input and its slope are in these alone.
        first, second = state
        third = drive - stiffness * first - damping * second
        newer = slope - stiffness * second - damping * third
        factor = elapsed * (elapsed / 2)
        position = first + second * elapsed + third * factor
        velocity = second + third * elapsed + newer * factor
        factor *= elapsed / 3
        position += newer * factor
        older = third
        for order in range(4, 80):
            # The input is a straight line: its second derivative and all later ones are the 0.0.
            older, newer = newer, 0.0 - stiffness * older - damping * newer
            velocity += newer * factor
            factor *= elapsed / order
            term = newer * factor
            position += term
            # One term may be zero by itself: without damping every other one is, where the joint starts at rest.
            if abs(term) <= 1e-17 * abs(position) and abs(older * factor) <= 1e-17:
                break
        return position, velocity

    def reach(self, state: State, drive: float, drive_slope: float, span: float, speed: float, final: State) -> float:
        """Return the instant within `span` [s] at which q' passes `speed` for good, 0 if it starts beyond it.

        final: the state at the end of the span, where q' is beyond `speed`, relative to the start. Newton's method
        between two brackets, from where q' would pass if q'' were a straight line.
        """
        side = 1.0 if final[1] > speed else -1.0
        begin = side * self.acceleration(state, drive)
        growth = (side * self.acceleration(final, drive + drive_slope * span) - begin) / span
        low, high, gap = 0.0, span, side * (state[1] - speed)
        if gap >= 0:
            # It starts on the edge: it may turn inwards first, and leave later.
            if begin >= 0 or growth <= 0:
                return 0.0
            # It is furthest inside about where q'' is zero, and leaves for good after that.
            low, gap = -begin / growth, 0.0
            if low >= span or side * (self.inside(state, drive, drive_slope, low)[1] - speed) >= 0:
                return 0.0
        # The quadratic's root in the form that neither cancels nor divides by a growth of zero. From the edge itself,
        # where the gap is zero, q' is back at twice the time of its extremum.
        root = begin * begin - 2.0 * growth * gap
        instant = -2.0 * gap / (begin + root**0.5) if gap < 0 <= root and begin + root**0.5 > 0 else 2.0 * low
        if not low < instant < high:
            instant = 0.5 * (low + high)
        # Sixty halvings alone would reach the last bit, should Newton's method never help.
        for _ in range(60):
            now = self.inside(state, drive, drive_slope, instant)
            gap = side * (now[1] - speed)
            if gap >= 0:
                high = instant
            else:
                low = instant
            rate = side * self.acceleration(now, drive + drive_slope * instant)
            guess = instant - gap / rate if rate > 0 else 0.5 * (low + high)
            if not low <= guess <= high:
                guess = 0.5 * (low + high)
            # Newton's error is squared by the step that is taken here without looking again.
            if abs(guess - instant) <= 1e-7 * span:
                return guess
            instant = guess
        return instant


FIRST_STRETCH = 64
"""Samples computed at once after an event; doubled after every stretch without one."""

SHORTEST = 1e-9
"""Minimum length of a slide from rest, as a share of a sample."""

STEEPEST = 30.0
"""Maximum growth of an unstable joint within one sample, as the logarithm."""

STIFFEST = 1000.0
"""Maximum time constants in one sample; a joint beyond is too stiff to simulate."""

MOST_EVENTS = 100
"""Maximum events within one sample; a joint with more of them rests until the next sample."""


class Phase(NamedTuple):
    """Time without an event: whole samples from `first` to `last`, or part of one sample."""

    first: int
    """Sample at which the phase begins, or in which it lies."""
    last: int
    """Sample at which it ends; `first` if it is part of the sample interval after `first`."""
    begin: float
    end: float
    """Time from sample `first` to the end [s]."""
    sign: int
    """Direction: -1 or 1 while sliding, 0 at rest."""
    side: int
    """-1 or 1 while the motor is at that limit, else 0."""
    piece: int
    """Piece of the friction law, counted from rest."""
    start: State


@dataclass(frozen=True)
class Mechanism:
    """Moving part: I q'' + B q' + spring q + friction = motor + push."""

    inertia: float
    """I [kg m²]."""
    viscous: float
    """B [N m s/rad]."""
    friction: FrictionLaw
    """Dry friction; additional friction under load is in `load_friction`."""
    spring: float
    """Torque per angle of the link, the slope of gravity [N m/rad]."""
    push: np.ndarray
    """Known torque, straight between samples [N m], shape (num_samples,)."""
    load_friction: np.ndarray
    """Dry friction beyond the law's, straight between samples [N m], shape (num_samples,)."""


class _Sliding(NamedTuple):
    """Sliding in one direction on one piece of friction, under one state of the motor."""

    regime: Regime
    drive: np.ndarray
    """u at the samples [rad/s²], shape (num_samples,)."""
    change: np.ndarray
    excited: np.ndarray
    course: np.ndarray | None
    """q, q' and the requested torque [N m] from rest at zero, shape (3, num_samples); None for an unstable system."""
    free: np.ndarray | None
    """The same without input, from q = 1 and from q' = 1, shape (2, 3, num_samples); every motion is `course` and a
    share of these."""
    slow: float
    """Speed at which the piece begins [rad/s]."""
    fast: float
    """Speed at which it ends [rad/s]."""


Regimes = dict[tuple[float, float], tuple[Regime, np.ndarray | None]]
"""Stiffness and damping -> the linear system, and its motions without input."""


class StickSlip:
    """Run of a mechanism under its controller; `run` fills `phases`."""

    def __init__(
        self, mechanism: Mechanism, gains: PDGains, step: float, target: np.ndarray, regimes: Regimes | None = None
    ) -> None:
        """Prepare a run; step [s]; target: a [rad], shape (num_samples,); regimes: cache of earlier runs."""
        self.mechanism, self.gains, self.step, self.target = mechanism, gains, step, target
        self.phases: list[Phase] = []
        self.pieces: dict[int, tuple[Piece, ...]] = {sign: mechanism.friction.pieces(sign) for sign in (-1, 1)}
        self.holds = {sign: mechanism.friction.hold(sign) for sign in (-1, 1)}
        self.limited = bool(np.isfinite(gains.torque_limit))
        self.loaded = bool(mechanism.load_friction.any())
        self._regimes: Regimes = {} if regimes is None else regimes
        self._slidings: dict[tuple[int, int, int], _Sliding] = {}

    def sliding(self, sign: int, side: int, piece: int) -> _Sliding:
        """Return the linear system of sliding in direction `sign` on `piece`, the motor in state `side`."""
        key = (sign, side, piece)
        if key not in self._slidings:
            joint, gains, pieces = self.mechanism, self.gains, self.pieces[sign]
            kp, kd = (0.0, 0.0) if side else (gains.strength * gains.kp, gains.strength * gains.kd)
            law = pieces[piece]
            # On a straight piece friction is a damper and a constant torque; a motor at its limit has no gains.
            pair = (kp + joint.spring) / joint.inertia, (joint.viscous + law.slope + kd) / joint.inertia
            if -pair[1] * self.step > STEEPEST or -pair[0] * self.step**2 > STEEPEST**2:
                raise ConfigurationError(
                    f"a joint that runs away within a sample of {self.step:.3g} s: its friction falls by "
                    f"{-law.slope:.3g} per unit of speed, or its gravity is {-joint.spring:.3g} per unit of angle"
                )
            if pair[1] * self.step > STIFFEST or abs(pair[0]) ** 0.5 * self.step > STIFFEST:
                raise ConfigurationError(
                    f"inertia {joint.inertia:.3g} under kp {kp:.4g}, kd {kd:.4g} and friction: over {STIFFEST:.0f} "
                    f"time constants in a sample of {self.step:.3g} s; expected more inertia, or a finer step"
                )
            if pair not in self._regimes:
                regime = Regime(*pair, self.step)
                self._regimes[pair] = regime, self._requested(regime.free(len(self.target))) if regime.steady else None
            motor = side * gains.torque_limit if side else kp * self.target
            drive = (motor + joint.push - sign * (law.level + joint.load_friction)) / joint.inertia
            fast = pieces[piece + 1].start if piece + 1 < len(pieces) else np.inf
            regime, free = self._regimes[pair]
            changes = regime.changes(drive)
            course = None if free is None else self._requested(regime.stretch((0.0, 0.0), *changes), self.target)
            self._slidings[key] = _Sliding(regime, drive, *changes, course, free, law.start, fast)
        return self._slidings[key]

    def _requested(self, motion: np.ndarray, target: np.ndarray | float = 0.0) -> np.ndarray:
        """Return q, q' and the controller's torque [N m], (..., 3, num_samples), of q and q', (..., 2, num_samples)."""
        gains = self.gains
        requested = gains.strength * (gains.kp * (target - motion[..., 0, :]) - gains.kd * motion[..., 1, :])
        return np.concatenate([motion, requested[..., None, :]], axis=-2)

    def pull(self, samples: slice, position: float) -> np.ndarray:
        """Return the torque on a joint at rest at several samples, without friction [N m]."""
        joint, gains = self.mechanism, self.gains
        motor = (gains.strength * gains.kp) * (self.target[samples] - position)
        if self.limited:
            motor = np.clip(motor, -gains.torque_limit, gains.torque_limit)
        return motor + (joint.push[samples] - joint.spring * position)

    def pull_at(self, index: int, position: float) -> float:
        """Return the same at one sample, as Python numbers."""
        joint, gains = self.mechanism, self.gains
        motor = (gains.strength * gains.kp) * (float(self.target[index]) - position)
        if self.limited:
            motor = min(max(motor, -gains.torque_limit), gains.torque_limit)
        return motor + (float(joint.push[index]) - joint.spring * position)

    def side_at(self, index: int, position: float, velocity: float) -> int:
        """Return -1 or +1 where the requested torque exceeds the motor's limit at one sample, else 0."""
        gains = self.gains
        commanded = gains.strength * (gains.kp * (float(self.target[index]) - position) - gains.kd * velocity)
        return 0 if abs(commanded) <= gains.torque_limit else (1 if commanded > 0 else -1)

    def rest(self, index: int, position: float) -> int:
        """Return the first sample after `index` at which friction no longer holds, or the number of samples."""
        length = FIRST_STRETCH
        while index + 1 < len(self.target):
            ahead = slice(index + 1, index + 1 + length)
            pull = self.pull(ahead, position)
            more = self.mechanism.load_friction[ahead] if self.loaded else 0.0
            free = (pull > self.holds[1] + more) | (-pull > self.holds[-1] + more)
            first = int(free.argmax())
            if free[first]:
                return index + 1 + first
            index, length = index + len(free), 2 * length
        return len(self.target)

    def break_away(self, index: int, since: float, position: float) -> tuple[float, int]:
        """Return the time [s after sample `index`] and direction in which a joint at rest from `since` on breaks away.

        The direction is 0 if the joint rests until the next sample.
        """
        pull, pull_next = self.pull_at(index, position), self.pull_at(index + 1, position)
        load, load_next = self.mechanism.load_friction[index : index + 2].tolist()
        soonest, direction = self.step, 0
        for sign in (1, -1):
            hold = self.holds[sign]
            begin = sign * pull - hold - load
            end = sign * pull_next - hold - load_next
            if begin + (end - begin) * since / self.step > 0:
                return since, sign
            if end > 0:
                instant = max(since, self.step * begin / (begin - end))
                if instant < soonest:
                    soonest, direction = instant, sign
        return soonest, direction

    def cross(self, index: int, state: State, sign: int, side: int, piece: int) -> tuple[State, int, int]:
        """Return state, direction and piece at sample `index + 1`, solving for every event on the way.

        sign: -1, 0 (at rest) or 1; side: the motor's state, kept over the sample.
        """
        since, from_rest = 0.0, False
        for _ in range(MOST_EVENTS):
            if sign == 0:
                instant, sign = self.break_away(index, since, state[0])
                self._note(index, since, instant, 0, side, 0, state)
                if sign == 0:
                    return state, 0, 0
                since, piece, from_rest = instant, 0, True
            regime, drives, *_, slow, fast = self.sliding(sign, side, piece)
            slope = float(drives[index + 1] - drives[index]) / self.step
            drive, left = float(drives[index]) + slope * since, self.step - since
            final = regime.inside(state, drive, slope, left)
            speed = final[1] * sign
            if slow <= speed <= fast:
                self._note(index, since, self.step, sign, side, piece, state)
                return final, (sign if final[1] else 0), piece
            edge = slow if speed < slow else fast
            elapsed = regime.reach(state, drive, slope, left, sign * edge, final)
            # It broke away by rounding alone, and would do so again and again.
            if edge == 0 and from_rest and elapsed < SHORTEST * self.step:
                break
            self._note(index, since, since + elapsed, sign, side, piece, state)
            # The speed is set to the edge's own, which Newton's method only nearly hits: it decides what comes next.
            state, since = (regime.inside(state, drive, slope, elapsed)[0], sign * edge), since + elapsed
            if edge == 0:
                sign, from_rest = 0, False
            else:
                piece += 1 if speed > fast else -1
        state = (state[0], 0.0)
        self._note(index, since, self.step, 0, side, 0, state)
        return state, 0, 0

    def _note(self, index: int, begin: float, end: float, sign: int, side: int, piece: int, start: State) -> None:
        """Record a phase inside the sample interval after `index`."""
        if end > begin:
            self.phases.append(Phase(index, index, begin, end, sign, side, piece, start))

    def run(self, position: float, velocity: float) -> np.ndarray:
        """Return q and q' at every sample; shape (2, num_samples)."""
        motion = np.empty((2, len(self.target)))
        index, state, length, side = 0, (position, velocity), FIRST_STRETCH, 0
        sign = int(np.sign(velocity))
        piece = max(sum(part.start <= abs(velocity) for part in self.pieces[sign]) - 1, 0) if sign else 0
        motion[:, 0] = state
        while index < len(self.target) - 1:
            if sign == 0:
                free = self.rest(index, state[0])
                motion[:, index:free] = [[state[0]], [0.0]]
                held = free - 1 - index
                if held:
                    self.phases.append(Phase(index, free - 1, 0.0, held * self.step, 0, 0, 0, state))
                if free == len(self.target):
                    break
                index = free - 1
                side = self.side_at(free, state[0], 0.0) if self.limited else 0
                state, sign, piece = self.cross(index, state, 0, side, 0)
                index += 1
            else:
                side = self.side_at(index, *state) if self.limited else 0
                ahead, last, left_piece = self._slide(index, state, sign, side, piece, length)
                length = max(FIRST_STRETCH, last) if left_piece else 2 * length
                motion[:, index : index + last + 1] = ahead[:2, : last + 1]
                if last:
                    self.phases.append(Phase(index, index + last, 0.0, last * self.step, sign, side, piece, state))
                index, state = index + last, (float(ahead[0, last]), float(ahead[1, last]))
                if left_piece:
                    state, sign, piece = self.cross(index, state, sign, side, piece)
                    index += 1
            motion[:, index] = state
        return motion

    def _slide(
        self, index: int, state: State, sign: int, side: int, piece: int, length: int
    ) -> tuple[np.ndarray, int, bool]:
        """Return the motion ahead, the number of its valid samples, and whether the next one leaves the piece."""
        regime, _, change, excited, course, free, slow, fast = self.sliding(sign, side, piece)
        end = index + min(length, regime.longest)
        if course is None or free is None:
            ahead = regime.stretch(state, change[:, index:end], excited[:, index : end - 1])
            ahead = self._requested(ahead, self.target[index : end + 1])
        else:
            ahead = course[:, index : end + 1]
            apart, faster, free = state[0] - ahead[0, 0], state[1] - ahead[1, 0], free[:, :, : ahead.shape[1]]
            ahead = ahead + apart * free[0] + faster * free[1]
            ahead[:2, 0] = state
        speed = sign * ahead[1]
        # At zero speed the joint stops; on the edge of another piece a stretch may well begin.
        left = speed <= slow if slow == 0 else speed < slow
        if fast < np.inf:
            left |= speed > fast
        # Sample 0 is the state that the stretch starts from, whose event is over.
        left[0] = False
        events = left
        if self.limited:
            limit = self.gains.torque_limit
            changed = side * ahead[2] <= limit if side else np.abs(ahead[2]) > limit
            changed[0] = False
            events = left | changed
        first = int(events.argmax())
        if not events[first]:
            return ahead, ahead.shape[1] - 1, False
        # A piece ends between two samples, where `cross` finds it; saturation begins and ends on a sample.
        return (ahead, first - 1, True) if left[first] else (ahead, first, False)
