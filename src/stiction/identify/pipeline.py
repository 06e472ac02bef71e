"""Identification of one joint, start to end: check, filter, regress, simulate, compare, judge."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from stiction.formats.errors import StictionError
from stiction.formats.fit import FitSignals
from stiction.formats.joints import PARAMETERS, JointRecord
from stiction.formats.log import UNNAMED, Log
from stiction.identify.checks import Uniform, check_excitation, check_log
from stiction.identify.controller import LARGEST_MISMATCH, controller_mismatch
from stiction.identify.model import Model
from stiction.identify.output_error import OutputError, fit_output_error
from stiction.identify.position import position_torque
from stiction.identify.prepare import Prepared, prepare
from stiction.identify.regression import Regression, regress
from stiction.identify.setup import IdentifySetup
from stiction.identify.verdict import verdict
from stiction.identify.warn import find_warnings
from stiction.joints.friction import dead_band, friction_ratio
from stiction.joints.pd import PDGains


@dataclass(frozen=True)
class Identification:
    """What came out for one joint."""

    name: str
    """The joint."""
    record: JointRecord
    """For `joints.json`."""
    fit: FitSignals
    """For `fit.npz`."""


def identify_joint(log: Log, joint: str | None = None, setup: IdentifySetup | None = None) -> Identification:
    """Identify one joint of a log with measured torque.

    joint: its name, or None for the only one. Raises `StictionError` with one line for whatever the log lacks.
    """
    setup = (setup or IdentifySetup()).with_sidecar(log.setup)
    setup.check()
    name, raw = log.joint(joint)
    signals = check_log(log, name, raw, setup.torque_scale)
    prepared = prepare(signals, setup.cutoff)
    check_excitation(log.source, prepared.velocity, signals.step)
    regression = regress(log.source, prepared)
    if regression.estimates[0].value <= 0:
        raise StictionError(
            f"{log.source}: the fitted inertia is {regression.estimates[0].value:.3g}; it must be positive: is the "
            "torque's sign that of the position (--torque-scale -1 turns it round), and its column the right one?"
        )
    if all(estimate.interval95[0] <= 0 for estimate in regression.estimates[:3]):
        raise StictionError(
            f"{log.source}: excitation too poor: the intervals of inertia, viscous and dry friction all reach zero; "
            "move further and faster, or check that the torque belongs to this joint"
        )
    _check_limit(log.source, regression, setup.torque_limit)
    simulated, mismatch = _simulate(signals, prepared, regression, setup)
    record = _record(signals, prepared, regression, simulated, mismatch, setup)
    warnings = find_warnings(record, signals, prepared.velocity, has_target=raw.target is not None)
    if name == UNNAMED and joint is None and record.axis == "rotary":
        warnings += (NAMELESS,)
    return Identification(
        name, replace(record, warnings=warnings), _fit_signals(signals, prepared, regression, simulated)
    )


def _check_limit(source: str, regression: Regression, torque_limit: float | None) -> None:
    """Refuse friction that the motor could not overcome: the joint did move."""
    coulomb = regression.estimates[2].value
    if torque_limit is not None and coulomb >= torque_limit:
        raise StictionError(
            f"{source}: dry friction of {coulomb:.4g} would be beyond the torque limit {torque_limit:.4g}, and yet the "
            "joint moved: check the torque's unit (--torque-scale) and --torque-limit"
        )


def _simulate(
    signals: Uniform, prepared: Prepared, regression: Regression, setup: IdentifySetup
) -> tuple[OutputError | None, float | None]:
    """Fit by output error where gains and target are known and agree with the logged torque.

    Returns the fit, or None, and the relative mismatch of gains and torque, or None.
    """
    if setup.kp is None or setup.kd is None or signals.target is None:
        return None, None
    gains = PDGains(setup.kp, setup.kd, setup.torque_limit or float("inf"))
    late = np.interp(signals.time - setup.velocity_delay, signals.time, prepared.velocity)
    mismatch = controller_mismatch(signals, gains, late, prepared.cutoff)
    if mismatch > LARGEST_MISMATCH:
        return None, mismatch
    start = {name: estimate.value for name, estimate in zip(PARAMETERS, regression.estimates)}
    fit = fit_output_error(signals, gains, Model(), start, prepared.velocity, velocity_delay=setup.velocity_delay)
    return (None if fit.unidentified else fit), mismatch


def _record(
    signals: Uniform,
    prepared: Prepared,
    regression: Regression,
    simulated: OutputError | None,
    mismatch: float | None,
    setup: IdentifySetup,
) -> JointRecord:
    """Put everything into the record, warnings apart."""
    inertia, viscous, coulomb, offset = regression.estimates
    ratio = None if setup.torque_limit is None else coulomb.scaled(friction_ratio(1.0, setup.torque_limit))
    band = None if setup.kp is None else coulomb.scaled(dead_band(1.0, setup.kp))
    judged = verdict(coulomb, ratio, band, setup.test_condition, setup.axis or "rotary")
    diagnostics: dict[str, Any] = {
        "method": "torque_regression",
        "samples": len(signals.time),
        "samples_used": len(prepared.used),
        "duration": float(signals.time[-1]),
        "sampling_rate": 1 / signals.step,
        "cutoff": prepared.cutoff,
        "speed_threshold": prepared.threshold,
        "condition_number": regression.condition,
        "scaled_condition_number": regression.scaled_condition,
        "relative_torque_error": regression.relative_error,
        "blocks": regression.blocks,
        "position_torque": asdict(position_torque(prepared, signals.position, signals.step, regression)),
        "controller_mismatch": mismatch,
        "output_error": None,
        "disagreement": None,
        "verdict": judged.to_dict(),
    }
    if simulated is not None:
        diagnostics["output_error"] = {name: found.to_dict() for name, found in simulated.estimates.items()}
        diagnostics["output_error"]["relative_errors"] = simulated.relative_errors
        diagnostics["disagreement"] = disagreement(regression, simulated)
    return JointRecord(
        inertia=inertia,
        viscous_friction=viscous,
        coulomb_friction=coulomb,
        offset=offset,
        friction_ratio=ratio,
        dead_band=band,
        axis=setup.axis or "rotary",
        test_condition=setup.test_condition,
        torque_source=setup.torque_source or "motor_side",
        kp=setup.kp,
        kd=setup.kd,
        torque_limit=setup.torque_limit,
        diagnostics=diagnostics,
        warnings=() if setup.torque_source else (UNDECLARED,),
    )


UNDECLARED = (
    "where torque was measured was not declared: taken as the motor's side (current or command, joint friction not in "
    "it); declare it with --torque-source"
)


NAMELESS = (
    f"nobody named the joint, so it is called {UNNAMED!r}: `stiction train --joints` finds a robot's joints by name or "
    "kind; give --joint FL_shank, or --joint shank for all of its kind"
)


def disagreement(regression: Regression, simulated: OutputError) -> dict[str, dict[str, float]]:
    """Return per parameter |a − b| in combined standard deviations (`sigmas`) and over |a| (`relative`).

    a is the regression's value, b that of output error. Both come from one log, so their errors are not independent,
    and the combined deviation is a rough yardstick.
    """
    result = {}
    for name, a in zip(PARAMETERS, regression.estimates, strict=True):
        b = simulated.estimates[name]
        gap = abs(a.value - b.value)
        result[name] = {
            "sigmas": gap / max(float(np.hypot(a.std, b.std)), 1e-300),
            "relative": gap / max(abs(a.value), 1e-300),
        }
    return result


def _fit_signals(
    signals: Uniform, prepared: Prepared, regression: Regression, simulated: OutputError | None
) -> FitSignals:
    """Collect what the page draws."""
    used = np.zeros(len(signals.time))
    used[prepared.used] = 1.0
    return FitSignals(
        time=signals.time,
        position=signals.position,
        velocity=prepared.velocity,
        acceleration=prepared.acceleration,
        torque=prepared.torque,
        fitted_torque=regression.fitted,
        used=used,
        target=signals.target,
        simulated_position=simulated.simulated.position if simulated else None,
        simulated_torque=simulated.simulated.torque if simulated else None,
    )
