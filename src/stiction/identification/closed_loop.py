"""Closed loop as a function of its unknowns: the signals that the log would show, and their derivatives.

A loop that is late by d as a whole computes its torque from target, angle and speed of d ago. To second order in d
this is a loop without delay whose target is late by d, on a joint with inertia I − kd d + kp d²/2 and viscous friction
B − kp d (from θ(t − d) = θ − d θ' + d² θ''/2 in kp θ + kd θ', the term kd d² θ'''/2 left out). A velocity that is late
by a further δ (a difference over samples, a filter) takes δ kd more off the inertia that the position shows, and
nothing off the one that the torque shows. What this leaves out, at the torque limit too, is a torque along the path of
the simulation before (`ClosedLoop.correct`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import ConfigurationError, StictionError
from stiction.identification.checks import Uniform
from stiction.identification.filters import low_pass
from stiction.identification.model import Model, parameter_torques, strength_torque
from stiction.identification.timing import near
from stiction.joints.pd import PDGains, pd_torque
from stiction.joints.simulate import Joint, Trajectory, simulate
from stiction.joints.variation import Segments, segments, vary

EXTRAS = ("delay", "log_bias", "motor_strength")
"""Possible unknowns of the loop. `delay`: d [s]. `log_bias`: the log's angle minus the loop's [rad]; with
torque it is an offset that the torque lacks, without torque one with the joint's offset. `motor_strength`: torque
delivered over the torque asked for [1], which is the log's; only a known load shows it."""

START = ("start_position", "start_velocity")
"""Initial state: θ [rad] and θ' [rad/s] at the first sample, in the loop's frame; fitted, though of no interest."""


SETTLED = 1e-5
"""Change of the path between two passes of a simulation below which it is accepted [rad]: the next changes it by a
tenth of that or less, well below any encoder's step."""

FARTHEST = 1e3
"""Distance of a simulated joint from the measured one above which it has run away [rad]."""


class LoopError(StictionError):
    """The loop cannot be simulated, or what it does in simulation does not tell the joint's parameters."""


@dataclass(frozen=True)
class Response:
    """Signals that the log would show; arrays of shape (num_samples,)."""

    motion: Trajectory
    """Motion in the loop's frame."""
    position: np.ndarray
    """Position as the log has it [rad]."""
    torque: np.ndarray
    """Torque that the controller asks for, with its delay [N m]."""
    joint: Joint
    """Simulated joint, delays included."""
    gains: PDGains
    """Gains with the motor's strength."""

    def thinned(self, pieces: int) -> Response:
        """Return the same response on every so many-th sample."""
        motion = self.motion.thinned(pieces)
        return replace(self, motion=motion, position=self.position[::pieces], torque=self.torque[::pieces])


class ClosedLoop:
    """One joint under its controller, following the target of a log."""

    def __init__(
        self, signals: Uniform, gains: PDGains, model: Model, fixed: dict[str, float], velocity_delay: float = 0.0
    ) -> None:
        """Set up the loop. fixed: unknowns of known value; the others come with each call; velocity_delay: δ [s]."""
        self.signals, self.gains, self.model, self.velocity_delay = signals, gains, model, velocity_delay
        self.fixed = dict.fromkeys(EXTRAS, 0.0) | {"motor_strength": gains.strength} | fixed
        self.goal = np.asarray(signals.target, float)
        self.rate = np.gradient(self.goal, signals.step)
        self.outside = signals.disturbance
        """Torque that acts from outside, the correction of the late loop included [N m], shape (num_samples,)."""
        self.settled = SETTLED
        """Change of the path between two passes below which a simulation is accepted [rad]."""

    def delayed(self, values: np.ndarray, time: float) -> np.ndarray:
        """Return `values` of shape (num_samples,) or (num_samples, n) as they were `time` seconds before."""
        if time == 0.0:
            return values
        late = time / self.signals.step
        before, share = int(np.floor(late)), late - np.floor(late)
        index = np.arange(len(values)) - before
        last = len(values) - 1
        newer, older = values[np.clip(index, 0, last)], values[np.clip(index - 1, 0, last)]
        return newer + share * (older - newer)

    def run(self, free: dict[str, float], guess: np.ndarray | None = None) -> Response:
        """Simulate the joint under its controller.

        free: values of the unknowns that are not fixed; guess: approximate motion [rad], shape (num_samples,).

        Raises:
            LoopError: no joint has these values, or its motion does not settle, or runs away.
            StictionError: the delays would take half of the inertia.

        """
        values = self.fixed | free
        delay = values["delay"]
        try:
            joint = self.model.joint([values[name] for name in self.model.names])
        except StictionError as error:
            raise LoopError(f"output error is not done: {error}") from error
        gains = replace(self.gains, strength=values["motor_strength"])
        kp, kd = gains.strength * gains.kp, gains.strength * gains.kd
        late = kd * (delay + self.velocity_delay) - 0.5 * kp * delay**2
        if not late < 0.5 * joint.inertia:
            raise ConfigurationError(
                f"{'velocity delay' if delay == 0 else 'delays'} {self.velocity_delay + delay:.4g} s: with kd "
                f"{kd:.4g} and inertia {joint.inertia:.4g} expected 0 to {0.5 * joint.inertia / kd:.3g} s"
            )
        joint = replace(joint, inertia=joint.inertia - late, viscous=joint.viscous - kp * delay)
        signals, target = self.signals, self.delayed(self.goal, delay)
        start = values["start_position"], values["start_velocity"]
        try:
            # Without friction a late loop may run away, to numbers beyond all.
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                motion = simulate(joint, gains, signals.step, target, *start, self.outside, guess, self.settled)
        except StictionError as error:
            raise LoopError(f"output error is not done: {error}") from error
        if not np.abs(motion.position - signals.position).max() < FARTHEST:
            raise LoopError("output error is not done: the simulated joint runs away")
        commanded = self._commanded(gains, target, motion, delay)
        # The log has what was asked for: a motor of strength k is at its limit from limit/k on.
        limit = gains.torque_limit / gains.strength
        return Response(motion, motion.position + values["log_bias"], np.clip(commanded, -limit, limit), joint, gains)

    def correct(self, response: Response, free: dict[str, float]) -> None:
        """Add the torque of the late controller along a simulated path that the equivalent joint lacks.

        free: values that were simulated. The next simulation has that torque from outside.
        """
        values, motion, gains = self.fixed | free, response.motion, response.gains
        delay, kp, kd = values["delay"], gains.strength * gains.kp, gains.strength * gains.kd
        if delay + self.velocity_delay == 0.0:
            return
        target = self.delayed(self.goal, delay)
        late = kd * (delay + self.velocity_delay) - 0.5 * kp * delay**2
        exact = np.clip(
            gains.strength * self._commanded(gains, target, motion, delay), -gains.torque_limit, gains.torque_limit
        )
        acceleration = np.gradient(motion.velocity, self.signals.step)
        equivalent = pd_torque(gains, target, motion.position, motion.velocity)
        equivalent = equivalent + late * acceleration + kp * delay * motion.velocity
        disturbance = 0.0 if self.signals.disturbance is None else self.signals.disturbance
        self.outside = disturbance + exact - equivalent

    def _commanded(self, gains: PDGains, target: np.ndarray, motion: Trajectory, delay: float) -> np.ndarray:
        """Return the torque that the controller asks for, before any limit [N m], shape (num_samples,)."""
        velocity = self.delayed(motion.velocity, delay + self.velocity_delay)
        return gains.kp * (target - self.delayed(motion.position, delay)) - gains.kd * velocity

    def derivatives(self, response: Response, free: dict[str, float], names: tuple[str, ...]) -> np.ndarray:
        """Return the derivatives of position and torque by `names`, shape (2, num_samples, num_names).

        Raises:
            LoopError: the motion has no finite derivatives.

        """
        values, signals, motion = self.fixed | free, self.signals, response.motion
        delay, strength = values["delay"], values["motor_strength"]
        kp, kd, late = self.gains.kp, self.gains.kd, delay + self.velocity_delay
        target = self.delayed(self.goal, delay)
        pieces, effort = self._cut(response, values)
        zero, unsaturated = np.zeros_like(pieces.load), pieces.side == 0
        torques = parameter_torques(self.model, values, response.joint, pieces, effort)
        grid = np.arange(len(target))
        rate = np.interp(pieces.instant, grid, self.delayed(self.rate, delay))
        torques |= dict.fromkeys((*START, "log_bias"), zero)
        # Of the equivalent joint: per second of delay the inertia changes by kp d − kd, viscous friction by −kp, and
        # the target by −rate, which a motor at its limit does not follow.
        torques["delay"] = strength * (
            (kd - kp * delay) * pieces.acceleration + kp * pieces.velocity - kp * unsaturated * rate
        )
        torques["motor_strength"] = strength_torque(self.gains, pieces, response.joint.friction.effort_coefficient) + (
            (kd * late - 0.5 * kp * delay**2) * pieces.acceleration + kp * delay * pieces.velocity
        )
        start = np.array([[name == wanted for name in names] for wanted in START], float)
        changes = _vary(response, pieces, [torques[name] for name in names], start)
        commanded = -kp * self.delayed(changes[0], delay) - kd * self.delayed(changes[1], late)
        if "delay" in names:
            speed, growth = (
                self.delayed(motion.velocity, delay),
                self.delayed(np.gradient(motion.velocity, signals.step), late),
            )
            commanded[:, names.index("delay")] += kp * (speed - self.delayed(self.rate, delay)) + kd * growth
        # At the limit the torque depends on nothing.
        commanded[
            np.abs(self._commanded(response.gains, target, motion, delay)) * strength > self.gains.torque_limit
        ] = 0.0
        if "log_bias" in names:
            changes[0][:, names.index("log_bias")] += 1.0
        return np.stack([changes[0], commanded])

    def torque_changes(
        self,
        response: Response,
        free: dict[str, float],
        torques: Callable[[Segments, np.ndarray], list[np.ndarray]],
    ) -> np.ndarray:
        """Return the change of the position per unit of further torques, shape (num_samples, num_torques).

        torques: pieces of the motion and the motor's torque [N m] -> torque at both ends of each step, shape
        (2, num_steps) each. Raises `LoopError` as `derivatives`.
        """
        pieces, effort = self._cut(response, self.fixed | free)
        columns = torques(pieces, effort)
        return _vary(response, pieces, columns, np.zeros((2, len(columns))))[0]

    def _cut(self, response: Response, values: dict[str, float]) -> tuple[Segments, np.ndarray]:
        """Return a motion cut at its events, and the motor's torque at both ends of each step [N m]."""
        target = self.delayed(self.goal, values["delay"])
        pieces = segments(response.joint, response.gains, self.signals.step, target, response.motion, self.outside)
        asked = self.gains.kp * (pieces.target - pieces.position) - self.gains.kd * pieces.velocity
        limit = pieces.side * min(self.gains.torque_limit, 1e300)
        return pieces, np.where(pieces.side == 0, values["motor_strength"] * asked, limit)


def _vary(response: Response, pieces: Segments, torques: list[np.ndarray], start: np.ndarray) -> np.ndarray:
    """Return the changes of angle and speed per unit of torques, (2, num_samples, num_torques); raises `LoopError`."""
    try:
        return vary(response.joint, response.gains, pieces, np.stack(torques, axis=2), start)
    except StictionError as error:
        raise LoopError(f"output error is not done: {error}") from error


TRUSTED = 0.1
"""Relative size of logged torque − PD torque, at the best lateness, up to which the declared controller is trusted
and simulated."""

LONGEST_LATENESS = 0.04
"""Longest lateness of a loop that is searched before its torque counts as another multiple [s]."""

LATENESS_STEPS = 20
"""Number of coarse steps of that search, before single samples about the best one."""


@dataclass(frozen=True)
class Mismatch:
    """Difference between the logged torque and the declared controller's."""

    size: float
    """Relative difference |τ_logged − PD(target, position, velocity)| / |τ_logged| [1]."""
    rest: float
    """Relative difference at the best lateness, a constant apart [1]."""
    scales: tuple[float, float]
    """Multiples of kp (target − position) and of −kd θ' that, with a constant and a lateness, come nearest to the
    logged torque [1]; 1 where a lateness alone leaves at most `EXPLAINED`."""

    @property
    def trusted(self) -> bool:
        """True if the declared controller is the one that made the log."""
        return self.rest <= TRUSTED


EXPLAINED = 0.03
"""Relative difference up to which lateness alone explains a torque, and no multiple is searched."""


def controller_mismatch(
    signals: Uniform, gains: PDGains, velocity: np.ndarray, cutoff: float, biased: bool = False
) -> Mismatch:
    """Compare the logged torque with the declared controller's, both below `cutoff` [Hz].

    signals: with target and torque; velocity: filtered θ' as the controller has it, late if it is [rad/s], shape
    (num_samples,); biased: the log's angle may be ahead of the controller's, so a constant difference is not held
    (num_samples,); biased: True if the log's angle may be ahead of the controller's: a constant difference is then not
    """
    target = low_pass(np.asarray(signals.target), cutoff, signals.step)
    position = low_pass(signals.position, cutoff, signals.step)
    measured = low_pass(np.asarray(signals.torque), cutoff, signals.step)
    expected = pd_torque(gains, target, position, velocity)
    clear = ~near(signals.bridged, round(1 / (cutoff * signals.step)))
    if not clear.any():
        clear = ~signals.bridged
    difference = (expected - measured)[clear]
    size = float(np.linalg.norm(difference - difference.mean() * biased) / np.linalg.norm(measured[clear]))
    if size <= EXPLAINED:
        return Mismatch(size, size, (1.0, 1.0))
    signals_below = np.stack([target, position, velocity, measured])
    rest, scales = _late_scales(signals_below, gains, clear, int(LONGEST_LATENESS / signals.step))
    return Mismatch(size, min(size, rest), (scales[0], scales[1] if gains.kd > 0 else 1.0))


def _late_scales(
    signals: np.ndarray, gains: PDGains, clear: np.ndarray, most: int
) -> tuple[float, tuple[float, float]]:
    """Return the remainder of a logged torque at the best lateness, and the nearest multiples of both terms.

    A command takes its time to the motor, and so does what the motor reports on its way back: torque of now came from
    an angle of so many samples ago, and from a target older still; it may be early too, where the angle is late. With
    the target taken to be as late as the angle, a joint that follows it freely seems to have other gains, for little
    more than that lateness is left of kp (a − θ).

    Both multiples are 1 where some lateness alone explains it: a motion of few frequencies does not tell lags from
    multiples.

    signals: target, position, velocity and torque, shape (4, num_samples); clear: samples that count, (num_samples,);
    most: samples that a loop may be late.
    """
    target, position, velocity, logged = signals
    spring, damper = gains.kp * (target - position), -gains.kd * velocity
    free = clear & (np.abs(spring + damper) < gains.torque_limit)
    if free.sum() < 0.5 * clear.sum():  # In another unit everything is beyond the limit.
        free = clear

    def fit(late: int, older: int) -> tuple[float, float, np.ndarray]:
        """Return the remainder at some lags by the declared gains, that by the nearest multiples, and these."""
        reach = max(late, 0) + older
        rows = np.flatnonzero(free[reach : len(free) + min(late, 0)]) + reach - late
        spring = gains.kp * (target[rows - older] - position[rows])
        columns = np.stack([spring, damper[rows], np.ones(len(rows))], axis=1)
        measured = logged[rows + late]
        multiples = np.linalg.lstsq(columns, measured, rcond=None)[0]
        declared = float(np.var(measured - spring - damper[rows]) / np.mean(measured**2))
        return declared, float(np.mean((measured - columns @ multiples) ** 2)), multiples

    # In wide steps over all lags, then sample by sample about the best pair.
    best, least, at, scales = np.inf, np.inf, (0, 0), np.ones(3)
    steps = {max(1, most // LATENESS_STEPS), 1}
    for step in sorted(steps, reverse=True):
        middle = at
        for late, older in _lags(most, step, None if step == max(steps) else middle, max(steps)):
            declared, rest, multiples = fit(late, older)
            least = min(least, declared)
            if declared <= EXPLAINED**2:
                return declared**0.5, (1.0, 1.0)
            if rest < best:
                best, at, scales = rest, (late, older), multiples
    return least**0.5, (float(scales[0]), float(scales[1]))


def _lags(most: int, step: int, about: tuple[int, int] | None, reach: int) -> list[tuple[int, int]]:
    """Return pairs of lags, together at most `most`, the first down to −`most`/2: all in steps, or near a pair."""
    places = range(0, most + 1, step)
    early = range(-step, -most // 2, -step)
    pairs = [(late, older) for late in (*places, *early) for older in places if late + older <= most]
    if about is None:
        return pairs
    return [pair for pair in pairs if max(abs(pair[0] - about[0]), abs(pair[1] - about[1])) < reach]
