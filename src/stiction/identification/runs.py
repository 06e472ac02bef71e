"""One run of one joint, ready for the estimators: its driving torque and unit, and the rows that count."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from stiction.core.errors import LogError
from stiction.files.joints import FitSignals
from stiction.files.log import JointSignals, Log
from stiction.identification.checks import FEWEST_POOLED, FEWEST_SAMPLES, Uniform, check_excitation, check_log
from stiction.identification.filters import slope
from stiction.identification.logs.naming import LEROBOT
from stiction.identification.model import GRAVITY_TERMS, Model
from stiction.identification.prepare import Prepared, Rows, make_rows, prepare
from stiction.identification.reading import Reading, controller_torque, cut
from stiction.identification.regression import MAX_INFLATION, check_rows, fit_rows
from stiction.identification.setup import IdentifySetup
from stiction.joints.pd import PDGains

MOST_SATURATED = 0.5
"""Share of samples beyond the torque limit above which gains, limit or angles cannot be as declared."""

SATURATED = 0.98
"""Share of the torque limit above which a motor no longer follows its controller."""


@dataclass(frozen=True)
class Run:
    """A log of one joint, checked, filtered, and cut to the samples that count."""

    source: str
    """Name of the log."""
    joint: str
    """Name of the joint."""
    setup: IdentifySetup
    """Set-up of the log, completed from its sidecar."""
    signals: Uniform
    """Signals on the even grid."""
    torque: np.ndarray
    """Torque that drove the joint, measured or from the PD law [N m, or the torque column's unit], (num_samples,)."""
    prepared: Prepared
    """Filtered signals."""
    rows: Rows
    """Rows that count."""
    notes: tuple[str, ...] = ()
    """Notes from reading the file."""
    reading: Reading = field(default_factory=Reading)
    """Reading of the log between its samples."""
    driven: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Torque that drove the joint, at the time at which it acted by the reading [N m], shape (num_samples,)."""

    @property
    def where(self) -> str:
        """Log and joint, for messages."""
        return f"{self.source}: joint {self.joint!r}"

    @property
    def logged_target(self) -> np.ndarray | None:
        """Target as it was logged, without the feedforward that `signals.target` carries [rad], (num_samples,)."""
        signals, kp = self.signals, self.setup.kp
        if signals.target is None or signals.feedforward is None or kp is None:
            return signals.target
        return signals.target - signals.feedforward / kp

    @property
    def measured(self) -> bool:
        """True if the log has torque; otherwise it comes from the PD law."""
        return self.signals.torque is not None

    @property
    def model(self) -> Model:
        """Torque equation with viscous and Coulomb friction, and with gravity where it is fitted."""
        return Model("coulomb", self.setup.fits_gravity)

    @property
    def gains(self) -> PDGains | None:
        """Gains of the controller; None where kp or kd is not known."""
        if self.setup.kp is None or self.setup.kd is None:
            return None
        return PDGains(self.setup.kp, self.setup.kd, self.setup.torque_limit or float("inf"))


def make_run(log: Log, joint: str | None, setup: IdentifySetup, alone: bool = True) -> Run:
    """Check and prepare one joint of a log. Raise `StictionError` with one line for whatever the log lacks.

    alone: True if it must tell friction by itself; of several runs in one fit none needs to.
    """
    name, _ = log.joint(joint)
    setup, signals, torque, unusable = driven_signals(log, name, setup, FEWEST_SAMPLES if alone else FEWEST_POOLED)
    prepared = prepare(signals, torque, setup.cutoff, unusable)
    where = f"{log.source}: joint {name!r}"
    if alone:
        check_excitation(where, prepared.velocity, signals.step)
    if setup.pendulum and setup.pendulum_angle is None:
        setup = replace(setup, pendulum_angle=hanging(where, prepared))
    rows = make_rows([prepared], [setup.payload], setup.motor_strength or 1.0)
    if alone:
        check_rows(where, rows, prepared)
    return Run(log.source, name, setup, signals, torque, prepared, rows, notes_of(log, setup), driven=torque)


def reread(run: Run, reading: Reading) -> Run:
    """Return the run with its torque at the time at which it acted by `reading`; the signals stay as logged."""
    signals, setup, unusable = run.signals, run.setup, None
    if signals.torque is not None and not reading.held:
        torque = np.interp(signals.time + reading.torque_lag, signals.time, signals.torque)
    else:
        torque, unusable = _controller_torque(run.where, signals, setup, reading)
    prepared = prepare(signals, torque, run.prepared.cutoff, unusable)
    rows = make_rows([prepared], [setup.payload], setup.motor_strength or 1.0)
    return replace(run, reading=reading, prepared=prepared, rows=rows, driven=torque)


def part_of(run: Run, part: slice) -> Run:
    """Return a part of a run for simulation, its time from zero; filtered rows stay those of the whole."""
    filtered = {name: getattr(run.prepared, name)[part] for name in ("position", "velocity")}
    signals, prepared = cut(run.signals, part), replace(run.prepared, **filtered)
    return replace(run, signals=signals, prepared=prepared, driven=run.driven[part])


def fit_signals(
    run: Run,
    fitted: np.ndarray,
    law: np.ndarray,
    rigid: np.ndarray,
    simulated_position: np.ndarray | None = None,
    simulated_torque: np.ndarray | None = None,
) -> FitSignals:
    """Return the signals of a run that the page draws, and torques as of `FitSignals`, shape (num_samples,) each."""
    prepared = run.prepared
    return FitSignals(
        time=run.signals.time,
        position=run.signals.position,
        velocity=prepared.velocity,
        acceleration=prepared.acceleration,
        torque=prepared.torque - prepared.outside,
        fitted_torque=fitted,
        law_torque=law,
        rigid_torque=rigid,
        used=prepared.mask,
        target=run.logged_target,
        simulated_position=simulated_position,
        simulated_torque=simulated_torque,
    )


def hanging(where: str, prepared: Prepared) -> float:
    """Return the angle at which a pendulum hangs straight down, from the phase of its weight [rad].

    Raises `LogError` where the log does not show it.
    """
    rows = make_rows([prepared], [None])
    check_rows(where, rows, prepared)
    fit = fit_rows(rows, Model("coulomb", True))
    along, across = (fit.names.index(name) for name in GRAVITY_TERMS)
    # The variance in the worst direction, for the phase need not lie along either term.
    largest = float(np.linalg.eigvalsh(fit.covariance[np.ix_((along, across), (along, across))])[-1])
    size = float(np.hypot(fit.values[along], fit.values[across]))
    # Not `>`, which is false where the phase is not told, and the variance no number.
    if fit.inflation["inertia"] >= MAX_INFLATION or not np.sqrt(largest) <= LARGEST_PHASE * size:
        raise LogError(
            f"{where}: over this range of angles the log does not show where the pendulum hangs straight down; give "
            "--set pendulum_angle, or swing it further"
        )
    return float(np.arctan2(-fit.values[across], fit.values[along]))


LARGEST_PHASE = 0.02
"""Deviation of a pendulum's angle from the log above which it is not known [rad]: it turns so much of the weight into
an offset."""


def driven_signals(
    log: Log, name: str, setup: IdentifySetup, fewest: int = FEWEST_SAMPLES
) -> tuple[IdentifySetup, Uniform, np.ndarray, np.ndarray]:
    """Return a joint's set-up with its sidecar, its checked signals, its torque, and the samples without known torque.

    Torque in N m, or the torque column's unit, and a mask, shape (num_samples,) each. Raises `StictionError`.
    """
    setup = setup.with_sidecar(log.setup_of(name))
    setup.check()
    raw = in_si(log.joints[name], setup)
    signals = check_log(log, name, raw, 1.0 if setup.torque_scale is None else setup.torque_scale, fewest)
    if signals.disturbance is not None and setup.disturbance_scale is not None:
        signals = replace(signals, disturbance=setup.disturbance_scale * signals.disturbance)
    if signals.feedforward is not None:
        signals = _with_feedforward(signals, setup)
    signals = _driven(f"{log.source}: joint {name!r}", signals, setup)
    torque, unusable = _driving_torque(f"{log.source}: joint {name!r}", signals, setup)
    return setup, signals, torque, unusable


def _driven(where: str, signals: Uniform, setup: IdentifySetup) -> Uniform:
    """Return signals whose torque column is converted from a current, a voltage or a duty."""
    drive = setup.drive
    if drive.column == "torque":
        return signals
    if signals.torque is None:
        raise LogError(
            f"{where}: a torque column that holds {drive.column} was declared, and the log has none; map it: --columns "
            "torque=NAME, with position=NAME and so on"
        )
    velocity = slope(signals.position, signals.step)
    scale = 1.0 if setup.torque_scale is None else setup.torque_scale
    return replace(signals, torque=drive.torque(where, signals.torque, scale, velocity))


def _with_feedforward(signals: Uniform, setup: IdentifySetup) -> Uniform:
    """Return signals whose target includes the torque that the controller adds to its own.

    kp (a + u/kp − θ) − kd θ' is kp (a − θ) − kd θ' + u: to whatever simulates or reconstructs the controller, limit
    included, feedforward is a target that is u/kp ahead. Logged torque has it already. Without kp or a target nothing
    is simulated, and it has no effect.
    """
    scales = (setup.feedforward_scale, setup.torque_scale, 1.0)
    scale = next(value for value in scales if value is not None)
    added = scale * np.asarray(signals.feedforward)
    if signals.target is None or setup.kp is None:
        return replace(signals, feedforward=added)
    return replace(signals, feedforward=added, target=signals.target + added / setup.kp)


def in_si(raw: JointSignals, setup: IdentifySetup) -> JointSignals:
    """Return signals whose angles, and their rates, are in rad (or m)."""
    scale = setup.position_scale
    if scale is None:
        return raw
    angles = {name: getattr(raw, name) for name in ("position", "velocity", "target")}
    return replace(raw, **{name: scale * values for name, values in angles.items() if values is not None})


def notes_of(log: Log, setup: IdentifySetup) -> tuple[str, ...]:
    """Return the notes of a log, without the question for a scale of the position where `setup` has one."""
    return tuple(note for note in log.notes if setup.position_scale is None or note != LEROBOT)


def _driving_torque(source: str, signals: Uniform, setup: IdentifySetup) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque that drove the joint, from the PD law where it was not measured, and the unusable samples."""
    if signals.torque is not None:
        return signals.torque, np.zeros(len(signals.time), bool)
    return _controller_torque(source, signals, setup, Reading(delay=setup.delay or 0.0))


def _controller_torque(
    source: str, signals: Uniform, setup: IdentifySetup, reading: Reading
) -> tuple[np.ndarray, np.ndarray]:
    """Return the torque of the PD law, and the samples at which its motor is at the limit and does not follow it."""
    if signals.target is None or setup.kp is None or setup.kd is None:
        missing = "target" if signals.target is None else "kp" if setup.kp is None else "kd"
        raise LogError(
            f"{source}: no torque in the log, and without {missing} it cannot be reconstructed; log the motor's "
            "torque, or log the target and give --kp and --kd"
        )
    # Not filtered here: this torque passes through the same filter as everything else later.
    torque = controller_torque(signals, setup.kp, setup.kd, reading)
    unusable = np.abs(torque) > SATURATED * (setup.torque_limit or np.inf)
    if unusable.mean() > MOST_SATURATED:
        raise LogError(
            f"{source}: kp (target − position) − kd velocity is beyond the torque limit in {unusable.mean():.0%} of "
            "the "
            "samples; expected a controller that its motor can follow: are the angles in degrees, is the target this "
            "joint's and of its sign, and are --kp, --kd and --torque-limit right?"
        )
    return torque, unusable
