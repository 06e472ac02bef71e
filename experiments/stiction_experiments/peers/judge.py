"""The one judge: a fitted joint follows the target of a record that its fit has not seen, in closed loop.

Toolboxes that know no late controller fit a joint whose inertia and viscous friction stand in for the lateness. In the
common simulation, which has a late controller, they are turned back into the joint that they mean: to second order in
its lateness d a loop is one without, whose target is late by d, on a joint of inertia I − kd d + kp d²/2 and viscous
friction B − kp d (`stiction.identification.closed_loop`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from stiction.core.errors import StictionError
from stiction.identification.in_loop import respond
from stiction.identification.model import Model
from stiction.identification.reading import Reading
from stiction_experiments.peers.records import Problem

Values = Mapping[str, float]
"""Parameters of a joint by the names of `Model`."""


@dataclass(frozen=True)
class Fitted:
    """Result of one estimator on the first part of a record."""

    law: str
    """Name of the friction law that was fitted."""
    values: Values | None = None
    """Parameters for the common simulation; None where it does not have the law."""
    model: Model = field(default_factory=Model)
    """Torque equation of the parameters."""
    reading: Reading = field(default_factory=Reading)
    """Lateness of the loop, as far as the estimator knows one."""
    own: Callable[[Problem], np.ndarray] | None = None
    """Prediction of the position by the estimator's own simulator [rad, or m], shape (T,); None without one."""
    note: str = ""
    """Remark for the reader of the table."""


def rms(problem: Problem, position: np.ndarray) -> float | None:
    """Return the error of a predicted position [rad, or m]; None where it is no number."""
    error = (position - problem.position)[problem.run.signals.valid]
    return float(np.sqrt(np.mean(error**2))) if np.abs(error).max() < 1e6 else None


def in_common(problem: Problem, fitted: Fitted) -> float | None:
    """Return the error in the common simulation [rad, or m]; None where it cannot be simulated."""
    if fitted.values is None:
        return None
    try:
        # Joints that run away are among the candidates.
        with np.errstate(all="ignore"):
            response = respond(problem.read(fitted.reading), fitted.model, dict(fitted.values))
    except StictionError:
        return None
    return rms(problem, response.position)


def in_own(problem: Problem, fitted: Fitted) -> float | None:
    """Return the error in the estimator's own simulation [rad, or m]; None without one."""
    return None if fitted.own is None else rms(problem, fitted.own(problem))


def meant_joint(values: Values, problem: Problem, delay: float) -> dict[str, float]:
    """Return the joint that a fit without a late controller means, where the target alone was late.

    values: of the fit; delay: lateness of the whole loop in the common simulation, without that of the velocity [s].
    """
    late = problem.kd * (delay + problem.velocity_delay) - 0.5 * problem.kp * delay**2
    inertia, viscous = values["inertia"] + late, values["viscous_friction"] + problem.kp * delay
    return dict(values) | {"inertia": inertia, "viscous_friction": viscous}


def best_start(problem: Problem, fits: Sequence[Fitted]) -> Fitted:
    """Return the fit that predicts the part that was fitted best, in the common simulation."""

    def error(fitted: Fitted) -> float:
        value = in_common(problem, fitted)
        return np.inf if value is None else value

    return min(fits, key=error)


def geometric_mean(errors: Sequence[float]) -> float:
    """Return the geometric mean of positive errors."""
    return float(np.exp(np.mean(np.log(errors))))
