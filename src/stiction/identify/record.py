"""From everything that was found about a joint to the record that `joints.json` holds."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from stiction.formats.joints import Estimate, JointRecord
from stiction.identify.choice import Choice
from stiction.identify.combinations import Strength, combine, find_strength, missing_experiment, shifted, times
from stiction.identify.consistency import COMPARED, Comparison, find_drift, whiteness, widened
from stiction.identify.in_loop import InLoop, seen_in_loop
from stiction.identify.intervals import bootstrap_reach, with_intervals
from stiction.identify.model import GRAVITY
from stiction.identify.output_error import OutputError
from stiction.identify.position import position_torque
from stiction.identify.regression import INVERSE_STRENGTH, LARGEST_INFLATION, Fit
from stiction.identify.rows import Rows
from stiction.identify.runs import Run
from stiction.identify.verdict import verdict
from stiction.joints.friction import dead_band, friction_ratio


@dataclass(frozen=True)
class Prediction:
    """How well the chosen law does on a log that it has not seen."""

    source: str
    """Name of the log."""
    torque_error: float
    """|measured − predicted| over |measured| torque, at the samples that count."""
    simulation_errors: dict[str, float] | None
    """The same for position, velocity and torque of a simulation of the whole log; None where it could not be done."""


@dataclass(frozen=True)
class Evidence:
    """What the estimators left behind."""

    run: Run
    """The log that was asked about."""
    rows: Rows
    """Rows of all runs that were fitted together."""
    base: Fit
    """Viscous and Coulomb friction."""
    chosen: Fit
    """The law that was chosen; `base` itself where that is it."""
    choice: Choice
    """How it was chosen."""
    loop: InLoop
    """What simulations gave."""
    comparisons: tuple[Comparison, ...]
    """Parts and repeats."""
    predictions: tuple[Prediction, ...] = ()
    """The chosen law on the repeats."""

    @property
    def by_simulation(self) -> bool:
        """Whether the stated values are output error's: where torque was not measured it is the better estimator.

        The torque of the PD law is made from the same noisy position as the regressors, and least squares suffers.
        """
        return not self.run.measured and self.loop.symmetric is not None

    @property
    def method(self) -> str:
        """Name of the estimator that the stated values come from."""
        if self.by_simulation:
            return "output_error"
        return "torque_regression" if self.run.measured else "position_regression"

    def symmetric(self) -> dict[str, Estimate]:
        """Return the stated estimates of viscous and Coulomb friction, kd in the viscous one without torque."""
        if self.by_simulation and self.loop.symmetric is not None:
            return seen_in_loop(self.loop.symmetric, damping_seen(self.run))
        return self.base.estimates()

    def law(self) -> dict[str, Estimate]:
        """Return the stated estimates of the law that was chosen, in the same form, by output error where it was done.

        It uses the samples around reversals too, and no derivative of a noisy signal.
        """
        if self.chosen is self.base:
            return self.symmetric()
        if self.loop.chosen is not None:
            return seen_in_loop(self.loop.chosen, damping_seen(self.run))
        return self.chosen.estimates()


def make_record(evidence: Evidence) -> JointRecord:
    """Put everything into the record; the warnings that it calls for come later."""
    run, base, setup = evidence.run, evidence.base, evidence.run.setup
    strength = find_strength(base, run.measured, setup.torque_calibrated is not False, setup.motor_strength)
    seen = widened(evidence.symmetric(), evidence.comparisons)
    found = combine(base, seen, strength, damping_seen(run), _middle(run))
    level = seen["coulomb_friction"]
    ratio = None if setup.torque_limit is None else level.scaled(friction_ratio(1.0, setup.torque_limit))
    gains_fit = setup.kp is not None and setup.torque_calibrated is not False
    band = level.scaled(dead_band(1.0, setup.kp)) if gains_fit and setup.kp else None
    axis = setup.axis or "rotary"
    judged = verdict(found.parameters["coulomb_friction"], ratio, band, setup.test_condition, axis)
    law = _law(evidence, strength)
    known = found.parameters | _of_law(law, strength) | _of_loop(evidence)
    return JointRecord(
        inertia=known["inertia"],
        viscous_friction=known["viscous_friction"],
        coulomb_friction=known["coulomb_friction"],
        offset=known["offset"],
        gravity_sin=known.get("gravity_sin"),
        gravity_cos=known.get("gravity_cos"),
        static_friction=known["static_friction"],
        stribeck_velocity=known["stribeck_velocity"],
        load_coefficient=known["load_coefficient"],
        encoder_bias=known["encoder_bias"],
        delay=known["delay"],
        motor_strength=strength.value if strength.source == "known_load" else None,
        friction_ratio=ratio,
        dead_band=band,
        combinations=found.combinations,
        friction_law=law,
        axis=axis,
        test_condition=setup.test_condition,
        torque_source=(setup.torque_source or "motor_side") if run.measured else None,
        kp=setup.kp,
        kd=setup.kd,
        torque_limit=setup.torque_limit,
        diagnostics=_diagnostics(evidence, strength) | {"verdict": judged.to_dict()},
    )


def damping_seen(run: Run) -> float:
    """Return the kd that the regression's viscous friction contains: the controller's, where torque is not measured."""
    return 0.0 if run.measured else float(run.setup.kd or 0.0)


def _middle(run: Run) -> float:
    """Return θ in the middle of the range [rad]."""
    return float(run.signals.position.min() + run.signals.position.max()) / 2


def _law(evidence: Evidence, strength: Strength) -> dict[str, Any]:
    """Return the law that was chosen, its parameters, and how the others fared."""
    fit = evidence.chosen
    damping = damping_seen(evidence.run)
    parameters = {}
    for name, estimate in evidence.law().items():
        if name not in fit.names or name == INVERSE_STRENGTH or fit.inflation[name] >= LARGEST_INFLATION:
            continue
        own = shifted(estimate, -damping) if name.startswith("viscous_friction") and strength.value else estimate
        unitless = name in UNITLESS
        parameters[name] = (own if strength.value is None or unitless else times(own, strength.value)).to_dict()
    return {
        "law": fit.model.law,
        "parameters": parameters,
        "over_strength": strength.value is None,
        "drawn": {
            "viscous_friction": dict(zip(fit.names, fit.values.tolist())).get("viscous_friction", 0.0),
            "symmetric": float(evidence.base.values[evidence.base.names.index("coulomb_friction")]),
        },
        "middle": fit.model.middle,
        "text": evidence.choice.text,
        "candidates": [asdict(candidate) for candidate in evidence.choice.candidates],
        "method": "output_error" if evidence.loop.chosen is not None else evidence.method,
        "relative_torque_error": _relative_error(fit, evidence.rows),
    }


UNITLESS = ("stribeck_velocity", "load_coefficient")
"""Parameters that do not grow with the motor strength."""


def _of_law(law: dict[str, Any], strength: Strength) -> dict[str, Estimate | None]:
    """Return the fields of the record that only a richer law fills."""
    names = ("static_friction", "stribeck_velocity", "load_coefficient")
    known = {name: law["parameters"].get(name) for name in names}
    if strength.value is None:
        known["static_friction"] = None
    return {name: None if data is None else Estimate.from_dict(data, name) for name, data in known.items()}


def _of_loop(evidence: Evidence) -> dict[str, Estimate | None]:
    """Return delay and encoder bias, where they were asked for and the log tells them.

    Gravity tells the bias where the angle is known at which the link hangs straight down: G sin(θ − bias − hanging) is
    gravity_sin sin θ + gravity_cos cos θ. Otherwise the bias is that of the log's angle against the controller's.
    """
    found = {} if evidence.loop.symmetric is None else evidence.loop.symmetric.estimates
    hanging = evidence.run.setup.hanging_angle
    bias = found.get("log_bias") if hanging is None else hanging_bias(evidence.base, hanging)
    return {"delay": found.get("delay"), "encoder_bias": bias}


def hanging_bias(fit: Fit, hanging: float) -> Estimate | None:
    """Return by how much the logged angle is ahead of the true one [rad], from the phase of gravity; None without it.

    hanging: true angle at which the link hangs straight down [rad].
    """
    if "gravity_sin" not in fit.names or fit.inflation["gravity_cos"] >= LARGEST_INFLATION:
        return None
    sine, cosine = (fit.names.index(name) for name in GRAVITY)
    along, across = fit.values[sine], -fit.values[cosine]
    gradient = np.zeros(len(fit.names))
    gradient[sine], gradient[cosine] = -across, -along
    gradient /= along**2 + across**2
    phase = (np.arctan2(across, along) - hanging + np.pi) % (2 * np.pi) - np.pi
    reach = bootstrap_reach(fit.blocks)[cosine]
    variance = gradient @ fit.covariance @ gradient
    return with_intervals(np.array([phase]), np.array([[variance]]), reach)[0]


def _relative_error(fit: Fit, rows: Rows) -> float:
    """Return |residual| / |torque| over the rows."""
    return float(np.linalg.norm(fit.residual) / np.linalg.norm(rows.torque))


def _simulated(result: OutputError | None) -> dict[str, Any] | None:
    """Return what output error found, as plain data, in units of k."""
    if result is None:
        return None
    data: dict[str, Any] = {name: estimate.to_dict() for name, estimate in result.estimates.items()}
    return data | {"relative_errors": result.relative_errors}


def disagreement(fit: Fit, other: dict[str, Estimate], damping: float) -> dict[str, dict[str, float]]:
    """Return per parameter |a − b| in combined standard deviations (`sigmas`) and over |a| (`relative`).

    a is the regression's value, b the other estimator's. Both come from one log, so their errors are not independent,
    and the combined deviation is a rough yardstick. damping: kd that the regression's viscous friction contains.
    """
    result = {}
    for name, a in fit.estimates().items():
        if name in other and name in COMPARED:
            b = shifted(other[name], damping) if name == "viscous_friction" else other[name]
            gap = abs(a.value - b.value)
            result[name] = {
                "sigmas": gap / max(float(np.hypot(a.std, b.std)), 1e-300),
                "relative": gap / max(abs(a.value), 1e-300),
            }
    return result


def _diagnostics(evidence: Evidence, strength: Strength) -> dict[str, Any]:
    """Return the numbers behind the fit."""
    run, base, rows, loop = evidence.run, evidence.base, evidence.rows, evidence.loop
    simulated = _simulated(loop.symmetric)
    damping = damping_seen(run)
    instrumental = None if loop.instrumental is None else loop.instrumental.estimates()
    follows = None if run.setup.fits_gravity or run.setup.payload else position_torque(rows, base)
    return {
        "method": evidence.method,
        "seen": {name: estimate.to_dict() for name, estimate in base.estimates().items()},
        "strength": {"source": strength.source, "missing": missing_experiment(strength, run.measured)},
        "samples": len(run.signals.time),
        "samples_used": len(rows),
        "duration": float(run.signals.time[-1]),
        "sampling_rate": 1 / run.signals.step,
        "timing": None if run.signals.timing is None else asdict(run.signals.timing),
        "cutoff": run.prepared.cutoff,
        "speed_threshold": run.prepared.threshold,
        "condition_number": base.condition,
        "scaled_condition_number": base.scaled_condition,
        "inflation": base.inflation,
        "relative_torque_error": _relative_error(base, rows),
        "whiteness": asdict(whiteness(base.residual)),
        "blocks": base.blocks.count,
        "position_torque": None if follows is None else asdict(follows),
        "comparisons": [comparison.to_dict() for comparison in evidence.comparisons],
        "predictions": [asdict(prediction) for prediction in evidence.predictions],
        "drift": find_drift(rows, base, damping).to_dict(),
        "controller_mismatch": loop.mismatch,
        "closed_loop": loop.reason,
        "output_error": simulated,
        "output_error_law": _simulated(loop.chosen),
        "disagreement": None if loop.symmetric is None else disagreement(base, loop.symmetric.estimates, damping),
        "instrumental_variable": None
        if instrumental is None
        else {name: estimate.to_dict() for name, estimate in instrumental.items()},
    }
