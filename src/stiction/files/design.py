"""Results of `stiction excite`: `design.json`, and `design.npz` with the signals that its page draws."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import FileError
from stiction.core.records import column, two_digits
from stiction.files.log import TestCondition
from stiction.files.plain import read_object, take_version
from stiction.files.tables import read_arrays

SCHEMA_VERSION = 1


def percent(share: float) -> str:
    """Return a share in per cent with two digits."""
    return f"{two_digits(100 * share)} %"


def _with_unit(name: str) -> str:
    """Return a parameter, or its combination with the motor strength, with its unit."""
    unit = "kg m²" if "inertia" in name else "N m s/rad" if "viscous_friction" in name else "N m"
    return f"{name} [{unit}]"


@dataclass(frozen=True)
class Predicted:
    """Predicted precision of one parameter."""

    name: str = field(metadata=column("", form=_with_unit))
    """Name as in `joints.json`, or a combination with the motor strength k."""
    value: float = field(metadata=column("guess", form=".4g"))
    """Guess that the prediction is based on."""
    std: float = field(metadata=column("predicted std", form=".2g"))
    """Predicted standard deviation (Cramér–Rao) at the guess."""
    relative: float | None = field(metadata=column("of the guess", form=percent))
    """`std` over `value`; None where the guess is zero [1]."""
    worst_relative: float | None = field(metadata=column("at worst", form=percent))
    """Maximum over the range of guesses [1]."""


@dataclass(frozen=True)
class OneSine:
    """Precision with A sin(ωt), of the same duration and within the same limits as the design."""

    frequency: float
    """[Hz]."""
    amplitude: float
    """Amplitude of the target: the design's, or as much of it as the limits allow [rad]."""
    relative: tuple[float, float, float]
    """Relative standard deviations of inertia, viscous and Coulomb friction at the guess [1]."""
    worst: float
    """Maximum of the three over the range of guesses [1]."""
    correlation: float
    """Correlation of the estimates of viscous and Coulomb friction at the guess [1]."""


@dataclass(frozen=True)
class GainPoint:
    """Precision of Coulomb friction with the design's trajectory at other gains."""

    kp: float
    """[N m/rad]."""
    kd: float
    """[N m s/rad]."""
    position_only: float | None
    """Relative standard deviation of f, positions alone; None where friction holds the joint [1]."""
    with_torque: float | None
    """Relative standard deviation of f with torque in the log [1]."""
    reach: float
    """Range of the motion over that of the target [1]."""


@dataclass(frozen=True)
class GainTrial:
    """Result of one pair of gains before the search."""

    kp: float = field(metadata=column("kp", "N m/rad", "g"))
    """[N m/rad]."""
    kd: float = field(metadata=column("kd", "N m s/rad", "g"))
    """[N m s/rad]."""
    worst: float | None = field(metadata=column("worst deviation", form=percent))
    """Maximum relative standard deviation over the range of guesses, best of a few motions; None: none is within the
    limits."""
    reach: float = field(metadata=column("reach", form=".0%"))
    """Range of that motion over that of its target, for the joint that follows worst [1]."""
    tracks: bool = field(metadata=column("tracks"))
    """True if a log can be made at these gains."""


@dataclass(frozen=True)
class ExcitationDesign:
    """Designed log: its command, and the predicted precision of each parameter."""

    joint: str
    setup: dict[str, Any]
    """Requested settings, with the defaults."""
    gains: dict[str, float]
    """kp [N m/rad] and kd [N m s/rad] of the run."""
    advice: str
    pattern: dict[str, Any]
    pattern_duration: float
    """[s]."""
    repeats: int
    """Number of patterns in the log."""
    duration: float
    """Duration of the log [s]."""
    limits: dict[str, float]
    """`low`, `high` [rad], `speed` [rad/s], `torque` [N m]."""
    reached: dict[str, float]
    """Extremes of the same quantities over all joints in the range of guesses, target included."""
    predicted: tuple[Predicted, ...]
    correlation: float
    """Correlation of the estimates of viscous and Coulomb friction at the guess [1]."""
    d_criterion: float
    """log det of the bound on the relative deviations of inertia, viscous and Coulomb friction, at the guess."""
    worst: float
    """Maximum relative standard deviation among those three over the range of guesses, which the search minimised."""
    wanted: dict[str, float]
    """`relative`, the requested deviation of f, and `duration`, the log that it takes in whole patterns [s]."""
    sines: tuple[OneSine, ...]
    trials: tuple[GainTrial, ...]
    """Compared gains, the requested ones first."""
    sweep: tuple[GainPoint, ...]
    warnings: tuple[str, ...]
    command: str

    @property
    def torque_too(self) -> str:
        """Signals to log in addition to the angle, for sentences."""
        return "" if self.setup["position_only"] else " and motor torque"

    @property
    def test_condition(self) -> TestCondition:
        """Test condition: `in_air`, a link, if gravity was given, else `bare_motor`."""
        return "in_air" if self.setup["gravity_sin"] or self.setup["gravity_cos"] else "bare_motor"

    @property
    def next_command(self) -> str:
        """Command for the resulting log."""
        name = shlex.quote(self.joint)
        source = "" if self.setup["position_only"] else " --torque-source motor_side"
        return (
            f"stiction identify LOG.csv --joint {name} --kp {self.gains['kp']:g} --kd {self.gains['kd']:g} "
            f"--torque-limit {self.limits['torque']:g}{source} --test-condition {self.test_condition} "
            f"--out {name}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {"schema_version": SCHEMA_VERSION, **asdict(self)}


def load_design(path: Path) -> ExcitationDesign:
    """Read `design.json`; raise `StictionError` for another file."""
    data = take_version(read_object(path, "a design of `stiction excite`"), SCHEMA_VERSION, path.name)
    return from_plain(ExcitationDesign, data, path.name)


@dataclass(frozen=True)
class DesignSignals:
    """Simulated log; arrays of shape (num_samples,)."""

    time: np.ndarray
    """[s]."""
    target: np.ndarray
    """[rad]."""
    position: np.ndarray
    """Position at the guess [rad]."""
    velocity: np.ndarray
    """Velocity at the guess [rad/s]."""
    torque: np.ndarray
    """Torque at the guess [N m]."""
    position_low: np.ndarray
    position_high: np.ndarray
    """Lowest and highest position over the range of guesses [rad]; likewise the other signals."""
    velocity_low: np.ndarray
    velocity_high: np.ndarray
    torque_low: np.ndarray
    torque_high: np.ndarray


def read_signals(path: Path) -> DesignSignals:
    """Read `design.npz`; raise `StictionError` for missing signals or different lengths."""
    signals = read_arrays(path, DesignSignals, "run `stiction excite` again")
    if len({values.shape for values in vars(signals).values()}) != 1:
        raise FileError(f"{path.name}: its signals differ in length; run `stiction excite` again")
    return signals
