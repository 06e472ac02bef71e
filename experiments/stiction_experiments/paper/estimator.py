"""The printed estimator, min mean (θ* − θ)² over I, B and b, on simulated motors of known I, B and b.

θ* = A sin(ωt) is the target. Where θ is the sampled angle, I, B and b occur in neither. Where it is the angle of the
model, the log occurs in neither, and a joint follows the better the less inertia and friction it has: the infimum is at
I = B = b = 0, whatever the motor. Beside it the mended objective, simulated − measured, and `identify`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from stiction.files.log import Log
from stiction.identification.example import Excitation, Motor, example_log
from stiction.identification.pipeline import identify_joint
from stiction.joints.friction import Coulomb
from stiction.joints.pd import PDGains
from stiction.joints.simulate import Joint, simulate

PARAMETERS = ("I", "B", "b")
"""Inertia [kg m²], viscous friction [N m s/rad] and dry friction [N m]."""


class Column(NamedTuple):
    """One column of the table "shank motors": I, B, b."""

    means: tuple[float, float, float]
    stds: tuple[float, float, float]
    torque_limit: float
    """[N m]."""


TABLE = {
    "Saturn Lite": Column((0.0145, 0.0704, 0.442), (4.21e-4, 0.0272, 0.0661), 45.0),
    "Go1": Column((0.0121, 0.0342, 0.0481), (0.00223, 0.00229, 0.00299), 35.55),
}
"""Columns of the paper's table."""

DRAWS = 5
"""Motors that are drawn about each column."""

KP, KD = 20.0, 0.5
"""Gains of every motor [N m/rad, N m s/rad]: low ones, so that friction shows; the paper prints none."""

SECONDS, RATE = 10.0, 500.0
"""Length of a log [s], samples per second [Hz]."""

AMPLITUDES, FREQUENCIES = (0.3, 0.6), (0.5, 2.0)
"""Ranges of A [rad] and of ω/2π [Hz]."""

STARTS = (1.0, 1 / 3, 3.0)
"""Joints from which a search begins, over the true one [1]."""

LOWEST, HIGHEST = 1e-3, 1e3
"""Edges of a search, over the table's means [1]."""

CURVED = 0.1
"""Step of a second difference, over the true parameter [1]."""

FACTORS = (0.01, 0.1, 0.2, 0.5, 0.8, 1.0, 1.25, 2.0, 5.0, 10.0)
"""Points of a profile: one parameter over its true value, the others true [1]."""

SAMPLED, MODELLED, MENDED, OURS = "sampled angle", "angle of the model", "simulated − measured", "identify"
"""Estimators: the two readings of the printed one, the mended one, and the program's."""

Residual = Callable[[np.ndarray], np.ndarray]
"""I, B and b, shape (3,) -> the difference whose mean square is the objective [rad], shape (T,)."""


@dataclass(frozen=True)
class EstimateRow:
    """One parameter of one motor by one estimator; a row of estimator.csv."""

    draw: int
    motor: str
    estimator: str
    parameter: str
    """One of `PARAMETERS`."""
    truth: float
    estimate: float | None
    """None where the objective is the same everywhere."""
    at_edge: bool
    """True if the search ended at an edge: the objective has no minimum inside."""
    rms: float | None
    """Root of the objective at the estimate [rad]; None of `identify`."""
    curvature: float | None
    """Second difference of the objective over the relative change of the parameter [rad²]; None of `identify`."""

    @property
    def error(self) -> float:
        """Relative error [1]; infinite without an estimate."""
        return inf if self.estimate is None else abs(self.estimate / self.truth - 1.0)


@dataclass(frozen=True)
class ProfileRow:
    """Root of an objective along one parameter of the first motor; a row of profile.csv."""

    estimator: str
    parameter: str
    factor: float
    """Parameter over its true value, the others true [1]."""
    rms: float
    """Root of the objective [rad]."""


@dataclass(frozen=True)
class Drawn:
    """One motor and its log."""

    number: int
    name: str
    """Column of the table that it is drawn about."""
    truth: np.ndarray
    """I, B and b, shape (3,)."""
    log: Log

    @property
    def residuals(self) -> dict[str, Residual]:
        """Residuals of the three objectives by the names of their estimators."""
        signals = self.log.joints["shank"]
        target, measured = np.asarray(signals.target), np.asarray(signals.position)

        def simulated(joint: np.ndarray) -> np.ndarray:
            return simulate(_joint(joint), _gains(self.name), 1 / RATE, target).position

        return {
            SAMPLED: lambda joint: target - measured,
            MODELLED: lambda joint: target - simulated(joint),
            MENDED: lambda joint: simulated(joint) - measured,
        }


def _joint(values: np.ndarray) -> Joint:
    inertia, viscous, coulomb = values.tolist()
    return Joint(inertia, viscous, Coulomb(coulomb))


def _gains(name: str) -> PDGains:
    return PDGains(KP, KD, TABLE[name].torque_limit)


def draw_motor(number: int) -> Drawn:
    """Return the motor of a number, its joint and its sine drawn by it: the first `DRAWS` are Saturn Lite's."""
    name = [*TABLE][number // DRAWS]
    rng = np.random.default_rng(number)
    truth = np.zeros(3)
    while not (truth > 0).all():
        truth = rng.normal(TABLE[name].means, TABLE[name].stds)
    amplitude, frequency = rng.uniform(*np.transpose([AMPLITUDES, FREQUENCIES]))
    motor = Motor(name, _joint(truth), _gains(name))
    log = example_log(motor, Excitation((float(amplitude),), (float(frequency),), SECONDS, RATE), seed=number)
    return Drawn(number, name, truth, log)


def mean_square(residual: Residual, joint: np.ndarray) -> float:
    """Return the objective at a joint [rad²]."""
    return float(np.mean(residual(joint) ** 2))


def lowest(residual: Residual, starts: Sequence[np.ndarray], edges: tuple[np.ndarray, np.ndarray]) -> np.ndarray | None:
    """Return the joint at which the objective is least, shape (3,); None where it is the same at every start.

    edges: least and greatest joint of the search.
    """
    if len({mean_square(residual, start) for start in starts}) == 1:
        return None
    scale = starts[0]
    searches = [
        least_squares(
            lambda point: residual(point * scale),
            start / scale,
            bounds=(edges[0] / scale, edges[1] / scale),
            x_scale="jac",
            diff_step=1e-4,
            ftol=1e-10,
            xtol=1e-8,
            gtol=None,
        )
        for start in starts
    ]
    return min(searches, key=lambda search: search.cost).x * scale


def curvature(residual: Residual, joint: np.ndarray, truth: np.ndarray, index: int) -> float:
    """Return the second difference of the objective over the relative change of a parameter [rad²].

    joint: where it is taken, (3,); truth: unit of the change, (3,); index: of the parameter. One-sided where the step
    would leave positive values.
    """
    step = CURVED * truth[index] * np.eye(3)[index]
    middle = joint if joint[index] > step[index] else joint + step
    below, centre, above = (mean_square(residual, middle + side * step) for side in (-1, 0, 1))
    return (below - 2 * centre + above) / CURVED**2


def estimate_rows(drawn: Drawn) -> list[EstimateRow]:
    """Return what each estimator says of one motor."""
    means = np.array(TABLE[drawn.name].means)
    edges, starts = (LOWEST * means, HIGHEST * means), [share * drawn.truth for share in STARTS]
    rows = []
    for estimator, residual in drawn.residuals.items():
        joint = lowest(residual, starts, edges)
        place = drawn.truth if joint is None else joint
        rms = mean_square(residual, place) ** 0.5
        for index, parameter in enumerate(PARAMETERS):
            value = None if joint is None else float(joint[index])
            edge = value is not None and not 1.01 * edges[0][index] < value < 0.99 * edges[1][index]
            curved = curvature(residual, place, drawn.truth, index)
            truth = float(drawn.truth[index])
            rows.append(EstimateRow(drawn.number, drawn.name, estimator, parameter, truth, value, edge, rms, curved))
    record = identify_joint(drawn.log).record
    for parameter, truth, estimate in zip(
        PARAMETERS,
        drawn.truth.tolist(),
        (record.inertia, record.viscous_friction, record.coulomb_friction),
        strict=True,
    ):
        value = None if estimate is None else estimate.value
        rows.append(EstimateRow(drawn.number, drawn.name, OURS, parameter, truth, value, False, None, None))
    return rows


def profile_rows(drawn: Drawn) -> list[ProfileRow]:
    """Return the roots of the three objectives along each parameter of a motor."""
    rows = []
    for estimator, residual in drawn.residuals.items():
        for index, parameter in enumerate(PARAMETERS):
            for factor in FACTORS:
                joint = drawn.truth * np.where(np.arange(3) == index, factor, 1.0)
                rows.append(ProfileRow(estimator, parameter, factor, mean_square(residual, joint) ** 0.5))
    return rows
