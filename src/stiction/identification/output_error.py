"""Closed-loop output error: simulate the joint under its controller and fit what it does to what was measured.

The residual is simulated − measured (the paper minimises reference − measurement, which measures the controller). In a
closed loop the position hardly depends on the parameters and the torque does, so both are fitted, each in units of its
own residual's size; without torque, the position alone. No derivative of a noisy signal enters. The state at the first
sample is fitted with the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stiction.core.errors import ConfigurationError, StictionError
from stiction.core.linear import MIN_SHARE
from stiction.files.joints import Estimate
from stiction.identification.checks import Uniform
from stiction.identification.closed_loop import EXTRAS, START, ClosedLoop, Response
from stiction.identification.intervals import (
    block_count,
    bootstrap_reach,
    make_blocks,
    robust_covariance,
    with_intervals,
)
from stiction.identification.model import NOT_NEGATIVE, Model, nearest_joint
from stiction.identification.timing import settling
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Trajectory

MAX_ITERATIONS = 40
"""Points tried before the search ends where it is."""

MAX_REJECTED_STEPS = 5
"""Steps in a row, each shorter than the last, that raise the cost: a corner, and the search ends on it."""

RELATIVE_CURVATURE_FLOOR = 1e-12
"""Curvature, over the largest one with columns of unit length, under which a direction is left alone."""


# Not scipy.optimize.least_squares: stick and slip leave corners in the cost that no step size resolves, and a search
# that asks the cost itself whether it still falls spends most of its time on them. This one stops where its linear
# model predicts no further decrease that matters.
def levenberg_marquardt(
    residual: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    tolerance: Callable[[float], float],
) -> np.ndarray:
    """Return the point, shape (num_parameters,), at which half the sum of squared residuals is least.

    residual: point -> shape (num_rows,); jacobian: point -> shape (num_rows, num_parameters); lower, upper: bounds,
    shape (num_parameters,) each; tolerance: cost -> predicted decrease of the cost that is not worth another step.
    """
    point = np.clip(start, lower, upper)
    rows, slopes = residual(point), jacobian(point)
    cost, damping, growth, rejected = 0.5 * float(rows @ rows), 1e-4, 2.0, 0
    for _ in range(MAX_ITERATIONS):
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


COST_TOLERANCE = 1e-3
"""The first fit, whose residuals weigh position against torque in the second, ends at this relative change of cost."""

CHI2_TOLERANCE = 1e-2
"""The second ends where chi² would fall by less than this: a tenth of a standard deviation."""

MAX_EXTRAPOLATION = 0.2
"""Change of the motion up to which its derivatives are trusted to predict it, as the guess of a simulation [rad]."""

MAX_CONDITION = 1e6
"""Condition number of the Jacobian with unit columns beyond which parameters are not told apart."""

MAX_STD = {"delay": 0.02, "log_bias": 0.5, "motor_strength": 0.5}
"""Standard deviation beyond which an unknown of the loop counts as not identified: its prior knowledge is better."""

START_SAMPLES = 10
"""Samples that show the start; where none of them counts the start is taken as it was measured."""

STILL = 0.02
"""Share of the top speed, its 99th percentile, under which the joint is taken to start from rest."""

SETTLING = 5.0
"""Time constants of the loop after which a simulation has forgotten a gap: less than a hundredth of it is left."""

MAX_PHASES = 300_000
"""Phases of stick and slip after which the search ends where it is: half a minute. Ordinary logs need a tenth of it."""

FAILED_RESIDUAL = 1e3
"""Residual, in units of its size, where there is no such joint."""

STRIBECK_SPEEDS = (0.005, 0.5)
"""Stribeck velocities that the search may try, over the top speed: under the first the fall of the friction does not
show, over the second it looks like less viscous friction."""

LOWER_BOUNDS = dict.fromkeys((*NOT_NEGATIVE, "delay"), 0.0)
"""Bounds; inertia and motor strength stay above a hundredth of where they start."""


@dataclass(frozen=True)
class OutputError:
    """A joint whose simulation follows the log."""

    estimates: dict[str, Estimate]
    """What was identified of the model's parameters and of the loop's unknowns; without torque, over the strength k."""
    unidentified: tuple[str, ...]
    """Names of what was to be fitted and does not show in this log, or not apart from the others."""
    simulated: Trajectory
    """The simulation with these values; position and torque as the log would have them."""
    relative_errors: dict[str, float]
    """|simulated − measured| / |measured| for position, velocity and, where there is, torque."""
    counted: np.ndarray
    """Samples that the simulation was judged in, bool, shape (num_samples,): neither in a gap nor soon after one."""
    residuals: dict[str, np.ndarray]
    """Simulated − measured for position and, where there is, torque; zero at samples that do not count. Shape
    (num_samples,) each."""

    @property
    def values(self) -> dict[str, float]:
        """The best estimates by name."""
        return {name: estimate.value for name, estimate in self.estimates.items()}


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
) -> OutputError:
    """Fit the model's parameters, and unknowns of the loop, to position and torque, or to position alone.

    signals: with a target; start: where the search begins, for each of `model.names`, at zero where friction is
    below it; velocity: filtered θ' [rad/s], shape (num_samples,); velocity_delay: how late the controller's velocity is
    beyond its loop [s]; delay: how late the loop is, known or, if unknown, where the search begins [s]; unknown: which
    of `EXTRAS` to fit; known: parameters of the model that are not to be fitted.

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
    search = _Search(loop, signals, valid, free, top)
    return _result(search, search.fit(), velocity)


def _slowest(gains: PDGains, values: Mapping[str, float]) -> float:
    """Return the slowest time constant of the loop where it slides [s]: of I s² + (B + k kd) s + k kp = 0."""
    inertia, strength = values["inertia"], values.get("motor_strength", gains.strength)
    viscous = min(values[name] for name in values if name.startswith("viscous_friction"))
    damping = max(viscous + strength * gains.kd, 1e-9)
    return float(-1 / np.roots([inertia, damping, strength * gains.kp]).real.max())


class _Search:
    """The least-squares problem: residuals and derivatives of the samples that count, each signal in its own unit."""

    def __init__(
        self, loop: ClosedLoop, signals: Uniform, valid: np.ndarray, free: dict[str, float], top_speed: float
    ) -> None:
        self.top_speed = top_speed
        self.loop, self.names, self.start = loop, tuple(free), np.array(list(free.values()))
        self.measured = {"position": signals.position}
        if signals.torque is not None:
            self.measured["torque"] = signals.torque
        self.valid = valid
        self.weights = dict.fromkeys(self.measured, 1.0)
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

    def fit(self) -> np.ndarray:
        """Return the values with which the simulation follows the log best."""
        values = np.array(self.start)
        lower = np.array([LOWER_BOUNDS.get(name, -np.inf) for name in self.names])
        upper = np.full(len(self.names), np.inf)
        for place, name in enumerate(self.names):
            if name in ("inertia", "motor_strength"):
                lower[place] = 1e-2 * self.start[place]
            elif name == "stribeck_velocity":
                lower[place], upper[place] = (share * self.top_speed for share in STRIBECK_SPEEDS)
        tolerances: tuple[Callable[[float], float], ...] = (
            lambda cost: COST_TOLERANCE * cost if self.phases < MAX_PHASES else np.inf,
            lambda cost: 0.5 * CHI2_TOLERANCE if self.phases < MAX_PHASES else np.inf,
        )
        for tolerance in tolerances:
            for name, row in self.residuals(values).items():
                size = float(np.std(row[self.valid]))
                # A simulated log without noise leaves nothing, and its weight must be finite all the same.
                self.weights[name] = 1.0 / max(size, 1e-9 * float(np.std(self.measured[name])))
            values = levenberg_marquardt(self.weighted, self.slopes, values, lower, upper, tolerance)
        return values


def unidentified(jacobian: np.ndarray, names: tuple[str, ...]) -> tuple[list[int], set[str]]:
    """Return the columns that together hold all that is known, and the names of which nothing is known apart.

    jacobian: shape (num_rows, num_names), in units of the residual's size. A direction in which nothing changes takes
    every name that has a share in it along: of inertia over strength one knows the ratio and neither.
    """
    length = np.linalg.norm(jacobian, axis=0)
    identified = [place for place in range(len(names)) if length[place] > 0]
    lost = {name for place, name in enumerate(names) if length[place] == 0}
    while identified:
        _, sizes, directions = np.linalg.svd(np.linalg.qr(jacobian[:, identified] / length[identified], mode="r"))
        if sizes[-1] * MAX_CONDITION > sizes[0]:
            break
        # Of the names in that direction the one with the largest part goes, and the others are looked at again.
        parts = np.abs(directions[-1])
        lost |= {names[identified[place]] for place in np.flatnonzero(parts > MIN_SHARE)}
        del identified[int(np.argmax(parts))]
    return identified, lost


def _result(search: _Search, values: np.ndarray, velocity: np.ndarray) -> OutputError:
    """Put intervals to the values, and measure how well the simulation follows."""
    response, rows = search.respond(values), search.residuals(values)
    weighted, slopes = search.weighted(values), search.slopes(values)
    identified, lost = unidentified(slopes, search.names)
    count = min(block_count(row[search.valid]) for row in rows.values())
    samples, counted = int(search.valid.sum()), np.tile(search.valid, len(rows))
    # Position and torque of one time are of one block, for their residuals depend on each other.
    block = np.tile(np.arange(samples) * count // samples, len(rows))
    blocks = make_blocks(slopes[counted][:, identified], weighted[counted], block)
    bounded = with_intervals(values[identified], robust_covariance(blocks), bootstrap_reach(blocks))
    found = {search.names[place]: estimate for place, estimate in zip(identified, bounded, strict=True)}
    lost |= {name for name, estimate in found.items() if not estimate.std < MAX_STD.get(name, np.inf)}
    motion = response.motion
    simulated = Trajectory(response.position, motion.velocity, response.torque, motion.phases)
    compared = {name: (rows[name], measured) for name, measured in search.measured.items()}
    compared["velocity"] = (np.where(search.valid, simulated.velocity - velocity, 0.0), velocity)
    return OutputError(
        estimates={name: value for name, value in found.items() if name not in lost and name not in START},
        unidentified=tuple(name for name in search.names if name in lost and name not in START),
        simulated=simulated,
        relative_errors={
            name: float(np.linalg.norm(row) / np.linalg.norm(measured[search.valid]))
            for name, (row, measured) in compared.items()
        },
        counted=search.valid,
        residuals=rows,
    )
