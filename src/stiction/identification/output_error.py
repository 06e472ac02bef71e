"""Closed-loop output error: simulate the joint under its controller and fit what it does to what was measured.

The residual is simulated − measured (the paper minimises reference − measurement, which measures the controller). With
known gains the torque is a function of target and position, so positions alone tell as much, and a torque that was
logged late or early cannot mislead them; where both are judged each is in units of its own residual's size. No
derivative of a noisy signal enters. The state at the first sample is fitted with the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from stiction.core.errors import ConfigurationError, StictionError
from stiction.core.linear import MIN_SHARE
from stiction.files.joints import Estimate
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import EXTRAS, SETTLED, START, ClosedLoop, LoopError, Response
from stiction.identification.intervals import (
    block_count,
    bootstrap_reach,
    correlation_time,
    make_blocks,
    robust_covariance,
    with_intervals,
)
from stiction.identification.model import NOT_NEGATIVE, Model, nearest_joint
from stiction.identification.reading import FINE_STEP
from stiction.identification.timing import settling
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Trajectory
from stiction.joints.variation import Segments

Signal = Literal["position", "torque"]
"""Signal of a log that a simulation is judged by."""

FEWEST_SAMPLES = 50
"""Fewest samples of a part of a log that is fitted alone."""

MAX_ITERATIONS = 40
"""Maximum number of trial points of a search."""

MAX_REJECTED_STEPS = 5
"""Rejected steps in a row, each shorter than the last, after which the search ends: it stands on a corner."""

RELATIVE_CURVATURE_FLOOR = 1e-12
"""Curvature, over the largest one with columns of unit length, below which a direction is left alone."""


# Not scipy.optimize.least_squares: stick and slip leave corners in the cost that no step size resolves, on which it
# spends most of its time. This one stops where its linear model predicts no further decrease that matters.
def levenberg_marquardt(
    residual: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    tolerance: Callable[[float], float],
    trials: int = MAX_ITERATIONS,
) -> np.ndarray:
    """Return the point, shape (num_parameters,), at which half the sum of squared residuals is least.

    residual: point -> shape (num_rows,); jacobian: point -> shape (num_rows, num_parameters); lower, upper: bounds,
    shape (num_parameters,) each; tolerance: cost -> predicted decrease of the cost that is not worth a step; trials:
    points tried.
    """
    point = np.clip(start, lower, upper)
    rows, slopes = residual(point), jacobian(point)
    cost, damping, growth, rejected = 0.5 * float(rows @ rows), 1e-4, 2.0, 0
    for _ in range(trials):
        step, predicted = _damped_step(slopes, rows, (point >= upper).astype(int) - (point <= lower), damping)
        if predicted <= tolerance(cost) or rejected > MAX_REJECTED_STEPS:
            break
        trial = np.clip(point + step, lower, upper)
        trial_rows = residual(trial)
        trial_cost = 0.5 * float(trial_rows @ trial_rows)
        if trial_cost < cost:
            # The better the model predicted the cost, the less the next step is damped (Nielsen's rule).
            damping *= max(0.1, 1.0 - (2.0 * (cost - trial_cost) / predicted - 1.0) ** 3)
            point, rows, cost, slopes = trial, trial_rows, trial_cost, jacobian(trial)
            growth, rejected = 2.0, 0
        else:
            damping, growth, rejected = max(growth * damping, 1e-4), 2.0 * growth, rejected + 1
    return point


def _damped_step(slopes: np.ndarray, rows: np.ndarray, bound: np.ndarray, damping: float) -> tuple[np.ndarray, float]:
    """Return the damped step from a point, and the decrease of the cost that the linear model predicts for it.

    bound: -1 for parameters at their lower bound and 1 for those at their upper one, else 0, shape (num_parameters,);
    from a bound they move away only.
    """
    gradient, curvature = slopes.T @ rows, slopes.T @ slopes
    scale = np.sqrt(np.diag(curvature))
    moving = (scale > 0) & (bound * gradient >= 0)
    step = np.zeros(len(gradient))
    if not moving.any():
        return step, 0.0
    units = scale[moving]
    values, directions = np.linalg.eigh(curvature[np.ix_(moving, moving)] / np.outer(units, units))
    # In a direction that the data do not tell the curvature is what rounding left, and a step would go anywhere.
    known = values > RELATIVE_CURVATURE_FLOOR * values[-1]
    gradient = np.where(known, directions.T @ (gradient[moving] / units), 0.0)
    moved = gradient / np.where(known, values + damping, 1.0)
    step[moving] = -(directions @ moved) / units
    return step, float(np.sum(moved * gradient - 0.5 * np.where(known, values, 0.0) * moved**2))


FEW_TRIALS, FEW_ROUNDS = 8, 1
"""Trial points of a round, and rounds, where fits are compared: the chosen one is then fitted to the end."""

ROUNDS, MOST_ROUNDS = 3, 8
"""Least and most rounds of the search, each with weights and exact delay from the round before."""

SETTLED_SHARE = 0.03
"""Change of the path between two passes, over the position's residual, below which a simulation is accepted."""

SETTLED_DELAY = 0.02
"""Change of the delay from round to round, in steps, below which it is settled."""

COST_TOLERANCE = 1e-3
"""Relative change of cost at which the first fit ends; its residuals weigh position against torque in the second."""

CHI2_TOLERANCE = 1e-2
"""Decrease of chi² below which later fits end: a tenth of a standard deviation."""

MAX_EXTRAPOLATION = 0.2
"""Largest change of the motion that its derivatives may predict, as the guess of a simulation [rad]."""

MAX_CONDITION = 1e6
"""Condition number of the Jacobian with unit columns beyond which parameters are not told apart."""

MAX_STD = {"delay": 0.02, "log_bias": 0.5, "motor_strength": 0.5}
"""Standard deviation above which an unknown of the loop is not identified: its prior knowledge is better."""

START_SAMPLES = 10
"""Samples that show the initial state; where none of them counts, the measured one is used."""

STILL = 0.02
"""Share of the top speed, its 99th percentile, below which the joint is taken to start from rest."""

SETTLING = 5.0
"""Time constants of the loop after which a simulation has forgotten a gap: less than a hundredth of it is left."""

MAX_PHASES = 300_000
"""Phases of stick and slip after which the search ends: half a minute. Ordinary logs need a tenth of it."""

FAILED_RESIDUAL = 1e3
"""Residual, in units of its size, of a joint that cannot be simulated."""

STRIBECK_SPEEDS = (0.005, 0.5)
"""Stribeck velocities that the search may try, over the top speed: below the first the fall of the friction does not
show, above the second it looks like less viscous friction."""

LOWER_BOUNDS = dict.fromkeys(NOT_NEGATIVE, 0.0)
"""Lower bounds. Inertia and motor strength stay above a hundredth of where they start, a delay above half a step of the
simulation before zero: a held target jumps within one."""


@dataclass(frozen=True)
class OutputError:
    """A joint whose simulation follows the log."""

    estimates: dict[str, Estimate]
    """Estimates of the model's parameters and of the loop's unknowns; without torque, over the strength k."""
    unidentified: tuple[str, ...]
    """Names of fitted parameters that this log does not show, or not separately."""
    simulated: Trajectory
    """The simulation with these values; position and torque as the log would have them."""
    relative_errors: dict[str, float]
    """Relative errors |simulated − measured| / |measured| of position, velocity and, where logged, torque."""
    counted: np.ndarray
    """Mask of the judged samples, bool, shape (num_samples,): neither in a gap nor soon after one."""
    residuals: dict[str, np.ndarray]
    """Residuals, simulated − measured, of judged signals; zero at uncounted samples. Shape (num_samples,) each."""
    names: tuple[str, ...]
    """Names of the columns of `slopes`, start included."""
    slopes: np.ndarray
    """Derivatives of `weighted` by `names`, shape (num_rows, num_names): the samples that count of each signal judged,
    one signal after the other."""
    weighted: np.ndarray
    """Residuals in units of their sizes, shape (num_rows,)."""
    covariance: np.ndarray
    """Covariance of `names`, shape (num_names, num_names)."""
    reach: np.ndarray
    """Half-width of each 95 % interval in standard deviations, shape (num_names,)."""
    loop: ClosedLoop
    """Simulated loop."""
    response: Response
    """Response of the loop, on the grid of the simulation."""
    pieces: int = 1
    """Number of simulation steps in each sample interval of the log."""

    @property
    def values(self) -> dict[str, float]:
        """Best estimates by name."""
        return {name: estimate.value for name, estimate in self.estimates.items()}

    def combination(self, weights: Mapping[str, float], like: str) -> Estimate:
        """Return a weighted sum of estimates, its interval as many deviations wide as that of `like`."""
        row = np.array([weights.get(name, 0.0) for name in self.names])
        value = sum(weight * self.values[name] for name, weight in weights.items())
        std = float(np.sqrt(max(row @ self.covariance @ row, 0.0)))
        reach = float(self.reach[self.names.index(like)]) * std
        return Estimate(value, std, (value - reach, value + reach))

    @property
    def rms(self) -> float:
        """Root mean square of the position's residual [rad]."""
        return float(np.std(self.residuals["position"][self.counted]))

    def position_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals and slopes of the position at the samples that count [rad], (num_rows,), (num_rows, P)."""
        rows = self.residuals["position"][self.counted]
        scale = float(np.linalg.norm(rows) / max(float(np.linalg.norm(self.weighted[: len(rows)])), 1e-300))
        return rows, scale * self.slopes[: len(rows)]

    def torque_columns(self, torques: Callable[[Segments, np.ndarray], list[np.ndarray]]) -> np.ndarray:
        """Return the change of the position at the samples that count per unit of further torques, (num_rows, n).

        torques: as of `ClosedLoop.torque_changes`; `LoopError` is raised as there.
        """
        return self.loop.torque_changes(self.response, self.values, torques)[:: self.pieces][self.counted]

    def part(self, chosen: np.ndarray, fixed: tuple[str, ...] = ()) -> dict[str, Estimate] | None:
        """Return the estimates of a part of the log, a Gauss-Newton step from the whole; None where it is too poor.

        chosen: samples of the part, bool, shape (num_samples,); fixed: parameters that stay as the whole log has them.
        """
        signals = len(self.residuals)
        rows = np.tile(chosen[self.counted], signals)
        columns = [place for place, name in enumerate(self.names) if name not in (*fixed, *START)]
        slopes, weighted = self.slopes[rows][:, columns], self.weighted[rows]
        samples = int(rows.sum()) // signals
        if samples < FEWEST_SAMPLES or len(unidentified(slopes, tuple(self.names[place] for place in columns))[1]) > 0:
            return None
        change = np.linalg.lstsq(slopes, -weighted, rcond=None)[0]
        left = weighted + slopes @ change
        count = min(block_count(row) for row in left.reshape(signals, -1))
        blocks = make_blocks(slopes, left, np.tile(np.arange(samples) * count // samples, signals))
        names = [self.names[place] for place in columns]
        values = np.array([self.estimates[name].value if name in self.estimates else 0.0 for name in names]) + change
        bounded = with_intervals(values, robust_covariance(blocks), bootstrap_reach(blocks))
        return {name: estimate for name, estimate in zip(names, bounded, strict=True) if name in self.estimates}

    def thinned(self, pieces: int) -> OutputError:
        """Return the same fit on every so many-th sample: the log's grid, where a finer one was simulated."""
        return replace(
            self,
            pieces=pieces,
            simulated=self.simulated.thinned(pieces),
            counted=self.counted[::pieces],
            residuals={name: row[::pieces] for name, row in self.residuals.items()},
        )


def fit_output_error(
    signals: Uniform,
    gains: PDGains,
    model: Model,
    start: Mapping[str, float],
    velocity: np.ndarray,
    *,
    velocity_delay: float = 0.0,
    delay: float = 0.0,
    unknown: tuple[str, ...] = (),
    known: Mapping[str, float] | None = None,
    judged: tuple[Signal, ...] = ("position", "torque"),
    trials: int = MAX_ITERATIONS,
) -> OutputError:
    """Fit the model's parameters, and unknowns of the loop, to position and torque, or to position alone.

    signals: with a target; start: where the search begins, for each of `model.names`, at zero where friction is
    below it; velocity: filtered θ' [rad/s], shape (num_samples,); velocity_delay: how late the controller's velocity is
    beyond its loop [s]; delay: how late the loop is, known or, if unknown, where the search begins [s]; unknown: which
    of `EXTRAS` to fit; known: parameters of the model that are not to be fitted; judged: signals that the simulation
    has to follow, where the log has them; trials: points tried in each of three rounds.

    Raises:
        StictionError: a name is none of these, or the delays would take away half of the inertia.
        LoopError: the joint of the start cannot be simulated.

    """
    fixed = dict(known or {})
    missing = set(model.names) - set(start) - set(fixed)
    wrong = (set(unknown) - set(EXTRAS)) | (set(fixed) - set(model.names)) | missing
    if wrong:
        raise ConfigurationError(
            f"output error: {', '.join(sorted(wrong))}: expected a start or a known value for each of "
            f"{', '.join(model.names)}, and unknowns among {', '.join(EXTRAS)}"
        )
    if not 0 <= delay < np.inf:
        raise ConfigurationError(f"delay {delay} s: expected a number that is not negative")
    fixed["delay"] = delay
    # Not the maximum, which a single outlier would set.
    top = float(np.quantile(np.abs(velocity[signals.valid]), 0.99))
    free = nearest_joint({name: float(start[name]) for name in model.names if name not in fixed})
    free |= {name: {"delay": delay, "motor_strength": gains.strength}.get(name, 0.0) for name in unknown}
    still = abs(velocity[0]) <= STILL * top
    begin = {"start_position": float(np.mean(signals.position[:3])), "start_velocity": float(velocity[0])}
    if still:
        begin["start_velocity"] = 0.0
    # The start is forgotten where its samples do not count, and a joint that starts from rest has no speed to fit.
    forgotten = set(START) if not signals.valid[:START_SAMPLES].any() else {"start_velocity"} if still else set()
    fixed |= {name: value for name, value in begin.items() if name in forgotten}
    free |= {name: value for name, value in begin.items() if name not in forgotten}
    # The delay has a value in any case, to start from if it is unknown.
    fixed = {name: value for name, value in fixed.items() if name not in free}
    loop = ClosedLoop(signals, gains, model, fixed, velocity_delay)
    wait = int(np.ceil(SETTLING * _slowest(gains, fixed | free) / signals.step))
    valid = signals.valid & ~settling(signals.bridged, np.abs(velocity) > STILL * top, wait)
    search = _Search(loop, signals, valid, free, top, judged)
    return _result(search, search.fit(trials), velocity)


def _slowest(gains: PDGains, values: Mapping[str, float]) -> float:
    """Return the slowest time constant of the loop where it slides [s]: of I s² + (B + k kd) s + k kp = 0."""
    inertia, strength = values["inertia"], values.get("motor_strength", gains.strength)
    viscous = min(values[name] for name in values if name.startswith("viscous_friction"))
    damping = max(viscous + strength * gains.kd, 1e-9)
    return float(-1 / np.roots([inertia, damping, strength * gains.kp]).real.max())


class _Search:
    """The least-squares problem: residuals and derivatives of the samples that count, each signal in its own unit."""

    def __init__(
        self,
        loop: ClosedLoop,
        signals: Uniform,
        valid: np.ndarray,
        free: dict[str, float],
        top_speed: float,
        judged: tuple[Signal, ...],
    ) -> None:
        self.top_speed = top_speed
        self.loop, self.names, self.start = loop, tuple(free), np.array(list(free.values()))
        logged = {name: getattr(signals, name) for name in ("position", "torque")}
        self.logged = {name: values for name, values in logged.items() if values is not None}
        self.measured: dict[str, np.ndarray] = {name: values for name, values in self.logged.items() if name in judged}
        self.valid = valid
        self.weights: dict[str, float] = dict.fromkeys(self.measured, 1.0)
        self.phases = 0
        self._latest: tuple[bytes, Response] | None = None
        self._accepted: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def respond(self, values: np.ndarray) -> Response:
        """Simulate, unless it was done just before; the motion around the last derivatives is the guess."""
        # The search asks for residuals, and then for the derivatives at the same point.
        if self._latest is None or self._latest[0] != values.tobytes():
            guess = self.measured["position"]
            if self._accepted is not None:
                at, guess, both = self._accepted
                change = both[0] @ (values - at)
                if np.abs(change).max() < MAX_EXTRAPOLATION:
                    guess = guess + change
            self._latest = values.tobytes(), self.loop.run(dict(zip(self.names, values)), guess)
            self.phases += len(self._latest[1].motion.phases)
        return self._latest[1]

    def correct(self, values: np.ndarray) -> None:
        """Set the torque of the loop's exact delay along the motion of these values, where it can be simulated."""
        try:
            self.loop.correct(self.respond(values), dict(zip(self.names, values)))
        except StictionError:
            return
        self._latest = self._accepted = None

    def residuals(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Return simulated − measured of each signal, zero where a sample does not count."""
        response = self.respond(values)
        return {
            name: np.where(self.valid, getattr(response, name) - measured, 0.0)
            for name, measured in self.measured.items()
        }

    def weighted(self, values: np.ndarray) -> np.ndarray:
        """Return all residuals in units of their sizes; a joint that cannot be simulated gives `FAILED_RESIDUAL`."""
        try:
            rows = self.residuals(values)
        except StictionError:
            return np.full(len(self.measured) * len(self.valid), FAILED_RESIDUAL)
        return np.concatenate([self.weights[name] * row for name, row in rows.items()])

    def slopes(self, values: np.ndarray) -> np.ndarray:
        """Return the derivatives of `weighted`, shape (num_rows, num_names)."""
        response = self.respond(values)
        if self._accepted is None or not np.array_equal(self._accepted[0], values):
            both = self.loop.derivatives(response, dict(zip(self.names, values)), self.names)
            self._accepted = np.array(values), response.motion.position, both
        both = np.where(self.valid[:, None], self._accepted[2], 0.0)
        return np.concatenate([self.weights[name] * rows for name, rows in zip(self.measured, both)])

    def fit(self, trials: int) -> np.ndarray:
        """Return the values whose simulation follows the log best; trials: points tried in each round."""
        values = np.array(self.start)
        lower = np.array([LOWER_BOUNDS.get(name, -np.inf) for name in self.names])
        upper = np.full(len(self.names), np.inf)
        for place, name in enumerate(self.names):
            if name in ("inertia", "motor_strength"):
                lower[place] = 1e-2 * self.start[place]
            elif name == "delay":
                lower[place] = -0.5 * min(self.loop.signals.step, FINE_STEP)
            elif name == "stribeck_velocity":
                lower[place], upper[place] = (share * self.top_speed for share in STRIBECK_SPEEDS)
        # Residuals that remember each other tell less than their number: a decrease within their noise is no step.
        least = 0.5 * CHI2_TOLERANCE
        late = self.names.index("delay") if "delay" in self.names else None
        before = np.inf
        for rounds in range(MOST_ROUNDS if trials > FEW_TRIALS else FEW_ROUNDS):
            # The delay's exact torque is of the path before, so rounds go on until both agree.
            settled = late is None or abs(values[late] - before) < SETTLED_DELAY * self.loop.signals.step
            if rounds >= ROUNDS and settled:
                break
            before = np.inf if late is None else values[late]
            if rounds:
                memory = max(correlation_time(row[self.valid]) for row in self.residuals(values).values())
                least = 0.5 * CHI2_TOLERANCE * memory

            def tolerance(cost: float, least: float = least, first: bool = not rounds) -> float:
                if self.phases >= MAX_PHASES:
                    return np.inf
                return COST_TOLERANCE * cost if first or trials <= FEW_TRIALS else least

            self.correct(values)
            for name, row in self.residuals(values).items():
                size = float(np.std(row[self.valid]))
                # A simulated log without noise leaves nothing, and its weight must be finite all the same.
                self.weights[name] = 1.0 / max(size, 1e-9 * float(np.std(self.measured[name])))
            self.loop.settled = max(SETTLED, SETTLED_SHARE / self.weights["position"])
            values = levenberg_marquardt(self.weighted, self.slopes, values, lower, upper, tolerance, trials)
        self.loop.settled, self._latest = SETTLED, None
        return values


def unidentified(jacobian: np.ndarray, names: tuple[str, ...]) -> tuple[list[int], set[str]]:
    """Return the columns that are identified together, and the names that are not identified separately.

    jacobian: shape (num_rows, num_names), in units of the residual's size. A direction without effect removes all
    names with a share in it: of inertia over strength the ratio is known, and neither alone.
    """
    length = np.linalg.norm(jacobian, axis=0)
    identified = [place for place in range(len(names)) if length[place] > 0]
    lost = {name for place, name in enumerate(names) if length[place] == 0}
    while identified:
        _, sizes, directions = np.linalg.svd(np.linalg.qr(jacobian[:, identified] / length[identified], mode="r"))
        if sizes[-1] * MAX_CONDITION > sizes[0]:
            break
        # Of the names in that direction the one with the largest part goes, and the rest is examined again.
        parts = np.abs(directions[-1])
        lost |= {names[identified[place]] for place in np.flatnonzero(parts > MIN_SHARE)}
        del identified[int(np.argmax(parts))]
    return identified, lost


def _result(search: _Search, values: np.ndarray, velocity: np.ndarray) -> OutputError:
    """Compute the intervals of the values, and measure how well the simulation follows."""
    response, rows = search.respond(values), search.residuals(values)
    weighted, slopes = search.weighted(values), search.slopes(values)
    identified, lost = unidentified(slopes, search.names)
    if not identified:
        raise LoopError("output error is not done: the simulation does not depend on any parameter")
    count = min(block_count(row[search.valid]) for row in rows.values())
    samples, counted = int(search.valid.sum()), np.tile(search.valid, len(rows))
    slopes, weighted = slopes[counted][:, identified], weighted[counted]
    # Position and torque of one time are of one block, for their residuals depend on each other.
    block = np.tile(np.arange(samples) * count // samples, len(rows))
    blocks = make_blocks(slopes, weighted, block)
    covariance, reach = robust_covariance(blocks), bootstrap_reach(blocks)
    bounded = with_intervals(values[identified], covariance, reach)
    estimates = {search.names[place]: estimate for place, estimate in zip(identified, bounded, strict=True)}
    lost |= {name for name, estimate in estimates.items() if not estimate.std < MAX_STD.get(name, np.inf)}
    motion = response.motion
    simulated = Trajectory(response.position, motion.velocity, response.torque, motion.phases)
    compared = {
        name: (np.where(search.valid, getattr(response, name) - values, 0.0), values)
        for name, values in search.logged.items()
    }
    compared["velocity"] = (np.where(search.valid, simulated.velocity - velocity, 0.0), velocity)
    return OutputError(
        estimates={name: value for name, value in estimates.items() if name not in lost and name not in START},
        unidentified=tuple(name for name in search.names if name in lost and name not in START),
        simulated=simulated,
        relative_errors={
            name: float(np.linalg.norm(row) / np.linalg.norm(measured[search.valid]))
            for name, (row, measured) in compared.items()
        },
        counted=search.valid,
        residuals=rows,
        names=tuple(search.names[place] for place in identified),
        slopes=slopes,
        weighted=weighted,
        covariance=covariance,
        reach=reach,
        loop=search.loop,
        response=response,
    )
