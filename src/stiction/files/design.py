"""What `stiction excite` decided: `design.json`, and `design.npz` with the signals that its page draws."""

from __future__ import annotations

import shlex
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from stiction.core.decode import from_plain
from stiction.core.errors import FileError
from stiction.core.records import column
from stiction.files.log import TestCondition
from stiction.files.plain import read_object, take_version
from stiction.files.tables import read_arrays

SCHEMA_VERSION = 1


def percent(share: float) -> str:
    """Return a share in per cent with two digits."""
    return f"{two_digits(100 * share)} %"


def two_digits(value: float) -> str:
    """Return a number rounded to two digits, without an exponent where people would not write one: 120, not 1.2e+02."""
    return f"{float(f'{value:.2g}'):g}"


def _with_unit(name: str) -> str:
    """Return a parameter, or its combination with the motor strength, with its unit."""
    unit = "kg m²" if "inertia" in name else "N m s/rad" if "viscous_friction" in name else "N m"
    return f"{name} [{unit}]"


@dataclass(frozen=True)
class Predicted:
    """How well the log will show one parameter."""

    name: str = field(metadata=column("", form=_with_unit))
    """As in `joints.json`, or a combination with the motor strength k."""
    value: float = field(metadata=column("guess", form=".4g"))
    """The guess that the prediction rests on."""
    std: float = field(metadata=column("predicted std", form=".2g"))
    """Predicted standard deviation (Cramér–Rao) at the guess."""
    relative: float | None = field(metadata=column("of the guess", form=percent))
    """`std` over `value`; None where the guess is zero [1]."""
    worst_relative: float | None = field(metadata=column("at worst", form=percent))
    """The largest over the range of guesses [1]."""


@dataclass(frozen=True)
class OneSine:
    """How well A sin(ωt) shows them, of the same duration and within the same limits as the design."""

    frequency: float
    """[Hz]."""
    amplitude: float
    """Of the target: the design's own, or as much of it as the limits allow [rad]."""
    relative: tuple[float, float, float]
    """Relative standard deviations of inertia, viscous and Coulomb friction at the guess [1]."""
    worst: float
    """Largest of the three over the range of guesses [1]."""
    correlation: float
    """Of the estimates of viscous and Coulomb friction at the guess [1]."""


@dataclass(frozen=True)
class GainPoint:
    """How well the design's trajectory shows Coulomb friction at other gains."""

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
    """What gains promised before the search."""

    kp: float = field(metadata=column("kp", "N m/rad", "g"))
    """[N m/rad]."""
    kd: float = field(metadata=column("kd", "N m s/rad", "g"))
    """[N m s/rad]."""
    worst: float | None = field(metadata=column("worst deviation", form=percent))
    """Largest relative standard deviation over the range of guesses, best of a few motions; None: none fits the
    limits."""
    reach: float = field(metadata=column("reach", form=".0%"))
    """Range of that motion over that of its target, for the joint that follows worst [1]."""
    tracks: bool = field(metadata=column("tracks"))
    """Whether a log can be made at these gains."""


@dataclass(frozen=True)
class ExcitationDesign:
    """A designed log: how to run it, and how well it will show each parameter."""

    joint: str
    setup: dict[str, Any]
    """Everything that the design was asked for, defaults filled in."""
    gains: dict[str, float]
    """kp [N m/rad] and kd [N m s/rad] to run at."""
    advice: str
    pattern: dict[str, Any]
    pattern_duration: float
    """[s]."""
    repeats: int
    """Patterns in the log."""
    duration: float
    """Of the log [s]."""
    limits: dict[str, float]
    """`low`, `high` [rad], `speed` [rad/s], `torque` [N m]."""
    reached: dict[str, float]
    """The same quantities, the furthest that any joint in the range of guesses goes, target included."""
    predicted: tuple[Predicted, ...]
    correlation: float
    """Of the estimates of viscous and Coulomb friction at the guess [1]."""
    d_criterion: float
    """log det of the bound on the relative deviations of inertia, viscous and Coulomb friction, at the guess."""
    worst: float
    """Largest relative standard deviation among those three over the range of guesses, which the search minimised."""
    wanted: dict[str, float]
    """`relative`, the deviation of f asked for [1], and `duration`, the log that it takes in whole patterns [s]."""
    sines: tuple[OneSine, ...]
    trials: tuple[GainTrial, ...]
    """Gains that were compared, the given ones first."""
    sweep: tuple[GainPoint, ...]
    warnings: tuple[str, ...]
    command: str

    @property
    def torque_too(self) -> str:
        """What to log beside the angle, for sentences."""
        return "" if self.setup["position_only"] else " and motor torque"

    @property
    def test_condition(self) -> TestCondition:
        """What hangs on the motor: a link in the air if gravity was given, else nothing."""
        return "in_air" if self.setup["gravity_sin"] or self.setup["gravity_cos"] else "bare_motor"

    @property
    def next_command(self) -> str:
        """The command for the log that the robot brings back."""
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
    """Read `design.json`; raise `StictionError` for a file that is not one."""
    data = take_version(read_object(path, "a design of `stiction excite`"), SCHEMA_VERSION, path.name)
    return from_plain(ExcitationDesign, data, path.name)


@dataclass(frozen=True)
class DesignSignals:
    """The simulated log; arrays of shape (num_samples,)."""

    time: np.ndarray
    """[s]."""
    target: np.ndarray
    """[rad]."""
    position: np.ndarray
    """At the guess [rad]."""
    velocity: np.ndarray
    """At the guess [rad/s]."""
    torque: np.ndarray
    """At the guess [N m]."""
    position_low: np.ndarray
    position_high: np.ndarray
    """Lowest and highest over the range of guesses [rad]; so are the others."""
    velocity_low: np.ndarray
    velocity_high: np.ndarray
    torque_low: np.ndarray
    torque_high: np.ndarray


def read_signals(path: Path) -> DesignSignals:
    """Read `design.npz`; raise `StictionError` if a signal is missing or lengths differ."""
    signals = read_arrays(path, DesignSignals, "run `stiction excite` again")
    if len({values.shape for values in vars(signals).values()}) != 1:
        raise FileError(f"{path.name}: its signals differ in length; run `stiction excite` again")
    return signals
