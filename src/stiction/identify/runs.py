"""One run of one joint, ready for the estimators: what drove it, in which unit, and the rows that count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stiction.core.errors import LogError
from stiction.formats.log import JointSignals, Log
from stiction.identify.checks import Uniform, check_excitation, check_log
from stiction.identify.model import Model
from stiction.identify.prepare import Prepared, Rows, make_rows, prepare
from stiction.identify.regression import check_rows
from stiction.identify.setup import IdentifySetup
from stiction.joints.pd import PDGains

SATURATED = 0.98
"""Share of the torque limit from which on a motor no longer follows its controller."""


@dataclass(frozen=True)
class Run:
    """A log of one joint, checked, filtered, and cut to the samples that count."""

    source: str
    """Name of the log."""
    joint: str
    """Name of the joint."""
    setup: IdentifySetup
    """How it was made; what the log's sidecar knew is in it."""
    signals: Uniform
    """On the even grid."""
    torque: np.ndarray
    """What drove the joint, as measured or from the PD law [N m, or the torque column's unit], (num_samples,)."""
    prepared: Prepared
    """Filtered."""
    rows: Rows
    """What counts."""
    notes: tuple[str, ...] = ()
    """What was said of the file when it was read."""

    @property
    def measured(self) -> bool:
        """Whether the log has torque; otherwise it comes from the PD law."""
        return self.signals.torque is not None

    @property
    def model(self) -> Model:
        """The torque equation with viscous and Coulomb friction, and with gravity where it is fitted."""
        return Model("coulomb", self.setup.fits_gravity)

    @property
    def gains(self) -> PDGains | None:
        """The controller, where kp and kd are known."""
        if self.setup.kp is None or self.setup.kd is None:
            return None
        return PDGains(self.setup.kp, self.setup.kd, self.setup.torque_limit or float("inf"))


def make_run(log: Log, joint: str | None, setup: IdentifySetup, alone: bool = True) -> Run:
    """Check and prepare one joint of a log. Raises `StictionError` with one line for whatever the log lacks.

    alone: whether it must tell friction by itself; of several runs in one fit none needs to.
    """
    name, raw = log.joint(joint)
    setup = setup.with_sidecar(log.setup_of(name))
    setup.check()
    signals = check_log(log, name, _in_si(raw, setup), 1.0 if setup.torque_scale is None else setup.torque_scale)
    if signals.disturbance is not None and setup.disturbance_scale is not None:
        signals = replace(signals, disturbance=setup.disturbance_scale * signals.disturbance)
    torque, unusable = _driving_torque(log.source, signals, setup)
    prepared = prepare(signals, torque, setup.cutoff, unusable)
    if alone:
        check_excitation(log.source, prepared.velocity, signals.step)
    rows = make_rows([prepared], [setup.payload], setup.motor_strength or 1.0)
    if alone:
        check_rows(log.source, rows)
    return Run(log.source, name, setup, signals, torque, prepared, rows, log.notes)


def _in_si(raw: JointSignals, setup: IdentifySetup) -> JointSignals:
    """Return signals whose angles, and their rates, are in rad (or m)."""
    scale = setup.position_scale
    if scale is None:
        return raw
    angles = {name: getattr(raw, name) for name in ("position", "velocity", "target")}
    return replace(raw, **{name: scale * values for name, values in angles.items() if values is not None})


def _driving_torque(source: str, signals: Uniform, setup: IdentifySetup) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque that drove the joint, and the samples at which it is not known.

    Without measured torque it is the PD law's, late by the delay; a motor at its limit does not follow that law.
    """
    if signals.torque is not None:
        return signals.torque, np.zeros(len(signals.time), bool)
    if signals.target is None or setup.kp is None or setup.kd is None:
        missing = "target" if signals.target is None else "kp" if setup.kp is None else "kd"
        raise LogError(
            f"{source}: no torque in the log, and without {missing} it cannot be reconstructed; log the motor's "
            "torque, or log the target and give --kp and --kd"
        )
    velocity = np.gradient(signals.position, signals.step)
    spring, damper = setup.kp * (signals.target - signals.position), setup.kd * velocity
    unusable = np.abs(spring - damper) > SATURATED * (setup.torque_limit or np.inf)
    delay = setup.delay or 0.0
    return np.interp(signals.time - delay, signals.time, spring - damper), unusable
