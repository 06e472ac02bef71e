"""Assembly of the record of a joint in `joints.json` from its fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass, replace
from typing import Any

import numpy as np

from stiction.files.joints import LOAD_REGRESSORS, PARAMETERS, Estimate, JointRecord
from stiction.identification.choice import Choice, GravityChoice
from stiction.identification.combinations import (
    BackEmf,
    Braking,
    Strength,
    brake_summary,
    braking,
    combine,
    find_strength,
    missing_experiment,
    position_torque,
    product,
    shifted,
    split_viscous,
)
from stiction.identification.consistency import REPEAT, Comparison, Drift, find_drift, whiteness, widened
from stiction.identification.held_out import HeldOut
from stiction.identification.in_loop import InLoop, doubt
from stiction.identification.model import GRAVITY_TERMS
from stiction.identification.pooling import Pooling
from stiction.identification.prepare import Rows
from stiction.identification.regression import INVERSE_STRENGTH, MAX_INFLATION, Fit
from stiction.identification.runs import Run
from stiction.identification.verdict import torque_unit
from stiction.joints.friction import dead_band, friction_ratio

DELAY_ERROR = 0.1
"""Share of an estimated delay by which its interval is widened: the loop's model is of second order in it."""

CLEAR = 3.0
"""Standard deviations by which gravity must differ from zero for its phase to count."""

WIDEST_BIAS = 0.5
"""Half-width of the interval above which a bias is not known [rad]."""


def loop_unknowns(base: Fit, loop: InLoop, hanging: float | None) -> dict[str, Estimate | None]:
    """Return `delay` and `encoder_bias`, None where they were not requested or the log does not tell them.

    hanging: true angle at which the link hangs straight down [rad], if it is known: gravity then tells the bias.
    Otherwise the bias is that of the log's angle against the controller's.
    """
    estimates = {} if loop.best is None else loop.best.estimates
    bias = estimates.get("log_bias") if hanging is None else hanging_bias(base, hanging)
    delay = estimates.get("delay")
    if delay is not None:
        more = DELAY_ERROR * abs(delay.value)
        low, high = delay.interval95
        delay = Estimate(delay.value, float(np.hypot(delay.std, more / 2)), (low - more, high + more))
    return {"delay": delay, "encoder_bias": bias}


def hanging_bias(fit: Fit, hanging: float) -> Estimate | None:
    """Return the lead of the logged angle over the true one [rad], from the phase of gravity; None without it.

    G sin(θ − bias − hanging) is gravity_sin sin θ + gravity_cos cos θ. hanging: true angle at which the link hangs
    straight down [rad].
    """
    if "gravity_sin" not in fit.names or max(fit.inflation[name] for name in GRAVITY_TERMS) >= MAX_INFLATION:
        return None
    sine, cosine = (fit.names.index(name) for name in GRAVITY_TERMS)
    along, across = fit.values[sine], -fit.values[cosine]
    size = float(np.hypot(along, across))
    largest = float(np.linalg.eigvalsh(fit.covariance[np.ix_((sine, cosine), (sine, cosine))])[-1])
    # Not `<`, which is false where the phase is not told, and the variance no number.
    if not size**2 >= CLEAR**2 * largest:
        return None
    gradient = {"gravity_sin": -across / size**2, "gravity_cos": -along / size**2}
    # Into ±π, for an angle is only known up to a turn.
    phase = (np.arctan2(across, along) - hanging + np.pi) % (2 * np.pi) - np.pi
    estimate = fit.combination(gradient, "gravity_cos", phase)
    return estimate if estimate.interval95[1] - estimate.value < WIDEST_BIAS else None


REPEAT_FACTOR, REPEAT_ERROR = 2.0, 0.1
"""Error of a badly predicted repeat: this many times the fit's error, or this share of its torque, if that is less."""


def predicted_badly(tried: dict[str, Any], fit_error: float) -> bool:
    """Return True if a law misses a repeat that it was tried on.

    fit_error: its error on the log that it was fitted to [1].
    """
    return "refusal" in tried or tried["torque_error"] > min(REPEAT_FACTOR * fit_error, REPEAT_ERROR)


@dataclass(frozen=True)
class JointFits:
    """All fits to the log of one joint, and their choice."""

    run: Run
    """Run of the log that is identified."""
    rows: Rows
    """Rows of all runs that were fitted together."""
    base: Fit
    """Fit of viscous and Coulomb friction."""
    chosen: Fit
    """Fit of the chosen law; `base` itself where that is it."""
    choice: Choice
    """Choice of the law."""
    loop: InLoop
    """Results of simulations."""
    comparisons: tuple[Comparison, ...]
    """Comparisons of parts and repeats."""
    gravity: GravityChoice | None = None
    """Choice of gravity; None where the user stated it."""
    predictions: tuple[dict[str, Any], ...] = ()
    """Predictions of the repeats, which the chosen law was not fitted to: `source`, the log's name,
    `torque_error` and `simulation_errors`, shares of what was measured [1]."""
    pooling: Pooling | None = None
    """Estimates of each of several runs that were fitted together."""
    back_emf: BackEmf | None = None
    """Back-EMF constant, where the data show it."""
    held_out: HeldOut | None = None
    """Predictions of a held-out record."""

    @property
    def braking(self) -> Braking | None:
        """Treatment of the brake of a motor that is driven by voltage."""
        return braking(self.run, self.back_emf)

    @property
    def admitted(self) -> tuple[Comparison, ...]:
        """Comparisons that stated intervals admit: all, but for those with repeats that the law does not predict."""
        fit_error = _relative_error(self.chosen, self.rows)
        poor = {tried["source"] for tried in self.predictions if predicted_badly(tried, fit_error)}
        return tuple(
            comparison
            for comparison in self.comparisons
            if not (comparison.label.startswith(REPEAT) and comparison.parts[1] in poor)
        )

    @property
    def by_simulation(self) -> bool:
        """True if the stated values are output error's: wherever the controller that made the log is known."""
        return self.loop.symmetric is not None

    @property
    def follows(self) -> bool:
        """True if the simulation follows the log's positions nearly to their noise: then nothing is missing in it."""
        best = self.loop.best
        return best is not None and best.rms <= NEAR_NOISE * self.run.prepared.noise

    @property
    def method(self) -> str:
        """Name of the estimator of the stated values."""
        if self.by_simulation:
            return "output_error"
        return "torque_regression" if self.run.measured else "position_regression"

    def symmetric(self) -> dict[str, Estimate]:
        """Return the estimates of viscous and Coulomb friction, in the unit of the torque."""
        return self.loop.symmetric.estimates if self.loop.symmetric is not None else self.base.estimates()

    def law(self) -> dict[str, Estimate]:
        """Return the estimates of the law that was chosen, in the unit of the torque."""
        if self.chosen is self.base:
            return self.symmetric()
        return self.loop.chosen.estimates if self.loop.chosen is not None else self.chosen.estimates()

    def standard(self) -> dict[str, Estimate]:
        """Return inertia, viscous and Coulomb friction, offset and gravity by the chosen law.

        Friction that depends on direction, load, torque or angle is the mean over the log's motion.
        """
        estimates = self.law()
        if self.chosen is self.base:
            return estimates
        fit = self.loop.chosen or self.chosen
        standard = {name: estimates[name] for name in SHARED if name in estimates}
        for name, (weights, like) in mean_friction(self.chosen).items():
            if set(weights) <= set(estimates):
                standard[name] = fit.combination(weights, like)
        return standard


NEAR_NOISE = 2.0
"""Residual of a simulation over the position's noise up to which the model lacks nothing."""

UNITLESS = ("stribeck_velocity", "load_coefficient", "effort_coefficient")
"""Parameters that do not grow with the motor strength."""

SHARED = ("inertia", "offset", *GRAVITY_TERMS)
"""Parameters that mean the same under every friction law."""

MODEL_ERROR, DAMPING_ERROR = 0.005, 0.001
"""Share of each value, and of kd in viscous friction, by which intervals are widened: gains, clocks and samples of a
loop are not known better, and a simulation of it is not more exact."""


def mean_friction(fit: Fit) -> dict[str, tuple[dict[str, float], str]]:
    """Return viscous and Coulomb friction as sums of a law's parameters, over the motion of the rows.

    Name -> weights by parameter, and the parameter whose interval it takes after.
    """
    rows, away = fit.rows, fit.rows.position - fit.model.middle
    if fit.model.law == "asymmetric":
        halves = {
            name: {f"{name}_forward": 0.5, f"{name}_backward": 0.5} for name in ("viscous_friction", "coulomb_friction")
        }
        halves["offset"] = {"coulomb_friction_forward": 0.5, "coulomb_friction_backward": -0.5}
        return {name: (weights, max(weights)) for name, weights in halves.items()}
    weights = {"coulomb_friction": 1.0}
    if fit.model.law == "load":
        column = fit.jacobian[:, fit.names.index("load_coefficient")]
        weights["load_coefficient"] = float(np.mean(np.abs(column)))
    elif fit.model.law == "effort":
        weights["effort_coefficient"] = float(np.mean(np.abs(rows.torque)))
    elif fit.model.law == "position":
        weights |= {"position_slope": float(np.mean(away)), "position_curvature": float(np.mean(away**2))}
    return {
        "viscous_friction": ({"viscous_friction": 1.0}, "viscous_friction"),
        "coulomb_friction": (weights, "coulomb_friction"),
    }


def modelled(estimates: Mapping[str, Estimate], kd: float) -> dict[str, Estimate]:
    """Return estimates whose intervals admit the error of any simulation of a loop; kd: derivative gain."""
    result = {}
    for name, old in estimates.items():
        floor = MODEL_ERROR * abs(old.value) + DAMPING_ERROR * kd * name.startswith("viscous")
        low, high = (float(np.hypot(end - old.value, floor)) for end in old.interval95)
        result[name] = Estimate(old.value, float(np.hypot(old.std, floor / 2)), (old.value - low, old.value + high))
    return result


def inertia_known(fit: Fit) -> bool:
    """Return True if the torque of the inertia exceeds the unexplained torque.

    What the model lacks can look like inertia, wholly so if it follows the acceleration, up to |residual| / |θ''|:
    where that is as much as the inertia itself, the fit does not tell it, whatever its scatter says.
    """
    inertial = fit.by_name["inertia"] * fit.rows.acceleration
    return bool(np.linalg.norm(inertial) > np.linalg.norm(fit.residual))


def make_record(fits: JointFits) -> JointRecord:
    """Assemble the record; objections, verdict and warnings come later."""
    run, base, setup = fits.run, fits.base, fits.run.setup
    # State the parameters where k is known, else the combinations that the log tells.
    strength = find_strength(base, run.measured, setup.calibrated, setup.motor_strength)
    estimates = all_admitting(fits, fits.standard())
    middle = float(run.signals.position.min() + run.signals.position.max()) / 2
    parameters, combinations = combine(base, estimates, strength, kd_assumed(run), middle)
    scaled = fits.loop.scaled
    if scaled is not None:
        strength = Strength(scaled.estimates["motor_strength"], "known_load")
        parameters |= {name: estimate for name, estimate in scaled.estimates.items() if name in base.model.names}
    # Take viscous friction apart from the motor's own brake.
    brakes = fits.braking
    if brakes is not None:
        viscous, together = split_viscous(brakes, estimates["viscous_friction"], strength)
        parameters["viscous_friction"] = viscous
        combinations = {name: estimate for name, estimate in combinations.items() if name != "B/k"} | together
    level = estimates["coulomb_friction"]
    # Put dry friction over the torque limit, and over the gain.
    in_si = run.measured and (setup.calibrated or setup.drive.column != "torque")
    # Where the torque is not known in N m the limit is in the unit of what the estimators saw, and k cancels.
    limited = parameters["coulomb_friction"] if in_si else level
    law = _law(fits, strength)
    # Fields that only a richer law fills.
    names = {"load_coefficient": law["parameters"].get("effort_coefficient")} | law["parameters"]
    law_fields = {
        name: None if (data := names.get(name)) is None else Estimate.from_dict(data, name)
        for name in ("static_friction", "stribeck_velocity", "load_coefficient")
    }
    if strength.value is None:
        law_fields["static_friction"] = None
    # Judge the joint by friction at rest where that is more: a torque and a position error must overcome it.
    static = fits.law().get("static_friction")
    held = law_fields["static_friction"] if in_si else static
    held = held if held and limited and held.value > limited.value else None
    ratio = dynamic_ratio = None
    if setup.torque_limit is not None and limited is not None:
        dynamic_ratio = limited.scaled(friction_ratio(1.0, setup.torque_limit))
        ratio = held.scaled(friction_ratio(1.0, setup.torque_limit)) if held else dynamic_ratio
    gain = setup.used_kp if setup.calibrated else None
    holding = static if static and static.value > level.value else level
    band = holding.scaled(dead_band(1.0, gain)) if gain else None
    if not fits.by_simulation and not inertia_known(base):
        parameters["inertia"] = None
    known: dict[str, Any] = parameters | law_fields | loop_unknowns(base, fits.loop, setup.hanging_angle)
    record = JointRecord(
        **known,
        motor_strength=strength.value if strength.source == "known_load" else None,
        friction_ratio=ratio,
        dynamic_ratio=dynamic_ratio if held else None,
        dead_band=band,
        combinations=combinations,
        friction_law=law,
        axis=setup.axis or "rotary",
        test_condition=setup.test_condition,
        torque_source=(setup.torque_source or "motor_side") if run.measured else None,
        kp=setup.kp,
        kd=setup.kd,
        torque_limit=setup.torque_limit,
        walking_kp=setup.walking_kp,
    )
    diagnostics = _diagnostics(fits, strength)
    if brakes is not None:
        diagnostics["drive"] = brake_summary(brakes, combinations, strength)
    return replace(record, diagnostics=plain(diagnostics))


def all_admitting(fits: JointFits, estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    """Return estimates whose intervals admit those of parts of the log, and of runs that were fitted together."""
    wide = widened(estimates, fits.admitted)
    if fits.by_simulation:
        wide = modelled(wide, fits.run.setup.kd or 0.0)
    for name, change in doubt(fits.run, fits.loop).items():
        old = wide[name]
        ends = [end + change for end in old.interval95]
        wide[name] = Estimate(
            old.value,
            float(np.hypot(old.std, change / 2)),
            (min(*old.interval95, *ends), max(*old.interval95, *ends)),
        )
    return fits.pooling.admitted(wide) if fits.pooling else wide


def plain(value: Any) -> Any:
    """Return nested dataclasses, dictionaries and sequences as dictionaries and lists, as JSON would read them."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, list | tuple) else value


def kd_assumed(run: Run) -> float:
    """Return the kd that was subtracted from viscous friction: the controller's, where torque is not measured."""
    return 0.0 if run.measured else float(run.setup.kd or 0.0)


def _law(fits: JointFits, strength: Strength) -> dict[str, Any]:
    """Return the chosen law, its parameters, and the results of the other candidates."""
    fit = fits.chosen
    damping, brakes = kd_assumed(fits.run) if strength.value is None else 0.0, fits.braking
    parameters = {}
    stated = fits.law()
    if fit is fits.base:
        stated = all_admitting(fits, stated)
    elif fits.by_simulation:
        stated = modelled(stated, fits.run.setup.kd or 0.0)
    for name, estimate in stated.items():
        identified = fits.loop.chosen is not None or fit.inflation.get(name, np.inf) < MAX_INFLATION
        if name not in fit.names or name == INVERSE_STRENGTH or not identified:
            continue
        corrected = shifted(estimate, damping) if name.startswith("viscous_friction") else estimate
        if brakes is not None:
            corrected = brakes.widened(name, corrected)
            if name.startswith("viscous_friction") and (brakes.unseen or corrected.interval95[0] <= 0):
                continue
        unitless = name in UNITLESS
        parameters[name] = (
            corrected if strength.value is None or unitless else product(corrected, strength.value)
        ).to_dict()
    regressor = {"load": "gravity", "effort": "motor_torque"}.get(fit.model.law)
    named: dict[str, Any] = {"regressor": regressor, "load": LOAD_REGRESSORS[regressor]} if regressor else {}
    if fit is not fits.base:
        named["symmetric"] = {
            name: (estimate if strength.value is None else product(estimate, strength.value)).to_dict()
            for name, estimate in fits.symmetric().items()
            if name in PARAMETERS
        }
    return named | {
        "law": fit.model.law,
        "parameters": parameters,
        "over_strength": strength.value is None,
        "drawn": {
            "viscous_friction": fit.by_name.get("viscous_friction", 0.0),
            "symmetric": fits.base.by_name["coulomb_friction"],
        },
        "middle": fit.model.middle,
        "text": fits.choice.text,
        "candidates": [asdict(candidate) for candidate in fits.choice.candidates],
        "method": "output_error" if fits.loop.chosen is not None else fits.method,
        "relative_torque_error": _relative_error(fit, fits.rows),
    }


def _relative_error(fit: Fit, rows: Rows) -> float:
    """Return |residual| / |torque| over the rows."""
    return float(np.linalg.norm(fit.residual) / np.linalg.norm(rows.torque))


def sampling(run: Run) -> dict[str, Any]:
    """Return sampling and filtering of a run, for the diagnostics."""
    return {
        "duration": float(run.signals.time[-1]),
        "sampling_rate": 1 / run.signals.step,
        "timing": run.signals.timing,
        "cutoff": run.prepared.cutoff,
        "speed_threshold": run.prepared.threshold,
    }


def _diagnostics(fits: JointFits, strength: Strength) -> dict[str, Any]:
    """Return the diagnostics of a joint's record."""
    run, base, rows, loop = fits.run, fits.base, fits.rows, fits.loop
    alone = rows is run.rows
    # Where gravity is in the model, or nothing is missing in it, the position takes no torque.
    asks_position = not (run.setup.fits_gravity or run.setup.payload or fits.follows)
    # Results of output error, in units of k.
    simulated, law = (
        None if simulation is None else {**simulation.estimates, "relative_errors": simulation.relative_errors}
        for simulation in (loop.symmetric, loop.chosen)
    )
    return {
        "method": fits.method,
        "seen": base.estimates(),
        "strength": {
            "source": strength.source,
            "missing": missing_experiment(strength, run.measured, run.setup.drive.lacking),
        },
        "samples": len(run.signals.time),
        "samples_used": len(rows),
        **sampling(run),
        "condition_number": base.condition,
        "scaled_condition_number": base.scaled_condition,
        "inflation": base.inflation,
        "relative_torque_error": _relative_error(base, rows),
        "whiteness": whiteness(base.residual),
        "blocks": base.blocks.count,
        "position_torque": position_torque(rows, base) if asks_position else None,
        "comparisons": [comparison.to_dict() for comparison in fits.comparisons],
        "predictions": fits.predictions,
        "inertia_known": fits.by_simulation or inertia_known(base),
        "gravity": fits.gravity and fits.gravity.text,
        "drift": find_drift(rows, base) if alone else Drift(None, "several logs were fitted together"),
        "controller_mismatch": loop.mismatch and loop.mismatch.size,
        "torque_unit": torque_unit(run),
        "closed_loop": loop.reason,
        "output_error": simulated,
        "output_error_law": law,
        "reading": run.reading,
        "held_out": fits.held_out and fits.held_out.to_dict(),
        **({"runs": fits.pooling.to_dict()} if fits.pooling else {}),
    }
